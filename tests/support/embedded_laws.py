"""Laws on emulated microcontrollers: what they give for some cases, in how many instructions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from support.tools import run, tool

Array = NDArray[np.floating]
EMBEDDED = Path(__file__).parents[1] / "embedded"
CROSS = "arm-none-eabi-"
_ARM = ("-std=c99", "-O2", "-mthumb", "-mfloat-abi=hard", "-ffunction-sections")
_WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Wdouble-promotion")
# A call of SysTick's processor clock, Hz, and how long an instruction takes, ns: as QEMU has them.
_CLOCK, _SHIFT, _CALLS = 25e6, 6, 100


@dataclass(frozen=True)
class Processor:
    """A processor, its numbers, and the board of QEMU that has it."""

    name: str
    flags: tuple[str, ...]
    real: type[np.floating]
    board: str


M4F = Processor("M4F", ("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"), np.float32, "mps2-an386")
M7 = Processor("M7", ("-mcpu=cortex-m7", "-mfpu=fpv5-d16"), np.float64, "mps2-an500")


@dataclass(frozen=True)
class Calls:
    """Inputs (k, nu) of a law in some cases, and instructions (k) of a call of each."""

    u: Array
    instructions: Array


def objects(name: str, folder: Path, processor: Processor) -> list[Path]:
    """The object of a module's functions and that of its laws, for a processor."""
    single = [f"-D{name.upper()}_FLOAT"] if processor.real is np.float32 else []
    found = []
    for stem in (name, f"{name}_laws"):
        output = folder / f"{stem}.{processor.name}.o"
        warnings = [*_WARNINGS, "-Werror"]
        command = [tool(f"{CROSS}gcc"), *_ARM, *warnings, *processor.flags, *single]
        run([*command, "-fstack-usage", "-c", folder / f"{stem}.c", "-o", output])
        found.append(output)
    return found


def called(
    name: str, law: str, folder: Path, processor: Processor, cases: Sequence[Sequence[Array]]
) -> Calls:
    """What a law gives for cases of gains, state and reference, each all entries of a structure."""
    suffix = "f" if processor.real is np.float32 else ""
    made = objects(name, folder, processor)
    lines = [
        f'#include "{name}_laws.h"',
        f"typedef {name}_real real;",
        f"typedef {name}_constants Constants;",
        f"typedef {name}_rotors Rotors;",
        f"#define MODEL(function) {name}_##function",
        f"#define LAW {name}_{law}",
        f"enum {{ INPUTS = {name.upper()}_INPUTS, CASES = {len(cases)} }};",
    ]
    for place, (structure, plural) in enumerate(
        (("gains", "gains"), ("state", "states"), ("reference", "references"))
    ):
        lines.append(f"static const {name}_{structure} all_{plural}[] = {{")
        for case in cases:
            members = (
                "{" + ", ".join(_literal(x, suffix) for x in np.ravel(part)) + "}"
                for part in case[place]
            )
            lines.append(f"    {{{', '.join(members)}}},")
        lines.append("};")
    (folder / "cases.h").write_text("\n".join([*lines, ""]), encoding="utf-8")
    program = folder / f"{processor.name}.elf"
    single = [f"-D{name.upper()}_FLOAT"] if suffix else []
    flags = [*_ARM, *processor.flags, *single, f"-I{folder}"]
    flags += ["--specs=rdimon.specs", "-nostartfiles", "-T", str(EMBEDDED / "link.ld")]
    sources = [EMBEDDED / "laws.c", EMBEDDED / "startup.c"]
    run([tool(f"{CROSS}gcc"), *flags, *made, *sources, "-o", program, "-lm"])
    said = run(
        [
            *(tool("qemu-system-arm"), "-M", processor.board, "-nographic", "-monitor", "none"),
            *("-semihosting-config", "enable=on,target=native", "-icount", f"shift={_SHIFT}"),
            *("-kernel", program),
        ],
        120.0,
    )
    rows = [line.split() for line in said.splitlines()]
    real = np.dtype(processor.real).newbyteorder("<")
    u = np.array([np.frombuffer(bytes.fromhex(digits), real) for _, digits, _ in rows])
    ticks = np.array([float(count) for *_, count in rows])
    return Calls(u, ticks / _CLOCK * 1e9 / 2**_SHIFT / _CALLS)


def _literal(value: float, suffix: str) -> str:
    if np.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return f"{float(value).hex()}{suffix}"
