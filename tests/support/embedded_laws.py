"""Laws on emulated microcontrollers: what they give for some cases, in how many instructions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gibbs_codegen.arrays.c_file import CFunction
from gibbs_codegen.arrays.contents import owners_of
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


@cache
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
    lines = [f"enum {{ INPUTS = {name.upper()}_INPUTS, CASES = {len(cases)} }};"]
    lines.append(f"typedef {name}_rotors Rotors;")
    if law == "adaptive":  # It learns nothing in no time.
        lines += [f"static {name}_estimates learnt;", "#undef LAW"]
        known = "constants, rotors, gains, state, reference"
        lines.append(f"#define LAW({known}, u) {name}_{law}({known}, &learnt, 0, u)")
    for place, (structure, plural) in enumerate(
        (("gains", "gains"), ("state", "states"), ("reference", "references"))
    ):
        lines.append(f"static const {name}_{structure} all_{plural}[] = {{")
        lines += [f"    {_members(case[place], processor)}," for case in cases]
        lines.append("};")
    rows = [line.split() for line in _said(name, law, folder, processor, "laws.c", lines)]
    real = np.dtype(processor.real).newbyteorder("<")
    u = np.array([np.frombuffer(bytes.fromhex(digits), real) for _, digits, _ in rows])
    ticks = np.array([float(count) for *_, count in rows])
    return Calls(u, ticks / _CLOCK * 1e9 / 2**_SHIFT / _CALLS)


def flown(
    name: str,
    law: str,
    folder: Path,
    processor: Processor,
    numbers: Mapping[str, int | float],
    structures: Mapping[str, Sequence[Array]],
    arrays: Mapping[str, Array],
) -> Array:
    """States (samples, size) that a law flies a robot with actuators to, by `flight.c`.

    `numbers`, `structures` and `arrays` are what it is given, by name.
    """
    lines = [f"typedef {name}_state State;", f"typedef {name}_rotors Rotors;"]
    lines += [f"#define {key} {_number(value, processor)}" for key, value in numbers.items()]
    for key, members in structures.items():
        lines.append(f"static const {name}_{key} {key} = {_members(members, processor)};")
    for key, values in arrays.items():
        lines.append(f"static const real {key}[] = {_members([values], processor)[1:-1]};")
    said = _said(name, law, folder, processor, "flight.c", lines)
    real = np.dtype(processor.real).newbyteorder("<")
    return np.array([np.frombuffer(bytes.fromhex(digits), real) for digits in said])


def observed(
    name: str, folder: Path, processor: Processor, frames: int, arrays: Mapping[str, Array]
) -> tuple[list[Array], list[float]]:
    """Residual and wrench on the last frame after a hundred steps, by `observer.c`.

    And instructions of a step, and of a Jacobian with the wrench. `arrays` are what it is given.
    """
    lines = [f"enum {{ VELOCITIES = {name.upper()}_VELOCITIES, FRAMES = {frames} }};"]
    lines += [f"typedef {name}_observer Observer;"]
    lines += [f"typedef {name}_frame_observer FrameObserver;"]
    for key, values in arrays.items():
        lines.append(f"static const real {key}[] = {_members([values], processor)[1:-1]};")
    lines.append(f"static const real time_step = {_number(1e-3, processor)};")
    rows = [x.split() for x in _said(name, "", folder, processor, "observer.c", lines)]
    real = np.dtype(processor.real).newbyteorder("<")
    found = [np.frombuffer(bytes.fromhex(digits), real) for digits, _ in rows]
    return found, [float(ticks) / _CLOCK * 1e9 / 2**_SHIFT / _CALLS for _, ticks in rows]


def filtered(
    name: str, function: CFunction, folder: Path, processor: Processor, arrays: Mapping[str, Array]
) -> tuple[Array, float]:
    """Coordinates and velocities after ten calls of a function of a filter, by `filter.c`.

    And instructions of a call. `arrays` are what it is given, and members of its structure.
    """
    (structure,), program = function.structures, function.program
    members = [member.name for member in structure.members]
    whole = _members([arrays[member] for member in members], processor)
    lines = [f"typedef {name}_{structure.name} Filter;", f"static const Filter begin = {whole};"]
    passed = ["constants"] * bool(owners_of(program)) + ["&filter"]
    for key, x in zip(program.names, program.inputs, strict=True):
        if key not in members:
            lines.append(f"static const real {key}[] = {_members([arrays[key]], processor)[1:-1]};")
            passed.append(key if x.shape else f"*{key}")
    passed += ["&nis"] * ("nis" in program.outputs)
    lines.append(f"#define CALL {name}_{program.name}({', '.join(passed)})")
    ((digits, ticks),) = (x.split() for x in _said(name, "", folder, processor, "filter.c", lines))
    told = np.frombuffer(bytes.fromhex(digits), np.dtype(processor.real).newbyteorder("<"))
    return told, float(ticks) / _CLOCK * 1e9 / 2**_SHIFT / 10


def _said(
    name: str, law: str, folder: Path, processor: Processor, source: str, lines: Sequence[str]
) -> list[str]:
    """Lines that a program prints that is compiled with a module, its laws and lines of its own."""
    made = objects(name, folder, processor)
    first = [
        f'#include "{name}_laws.h"',
        f"typedef {name}_real real;",
        f"typedef {name}_constants Constants;",
        f"#define MODEL(function) {name}_##function",
        f"#define LAW {name}_{law}",
    ]
    (folder / "cases.h").write_text("\n".join([*first, *lines, ""]), encoding="utf-8")
    program = folder / f"{processor.name}.elf"
    single = [f"-D{name.upper()}_FLOAT"] if processor.real is np.float32 else []
    flags = [*_ARM, *processor.flags, *single, f"-I{folder}"]
    flags += ["--specs=rdimon.specs", "-nostartfiles", "-T", str(EMBEDDED / "link.ld")]
    sources = [EMBEDDED / source, EMBEDDED / "startup.c"]
    run([tool(f"{CROSS}gcc"), *flags, *made, *sources, "-o", program, "-lm"])
    said = run(
        [
            *(tool("qemu-system-arm"), "-M", processor.board, "-nographic", "-monitor", "none"),
            *("-semihosting-config", "enable=on,target=native", "-icount", f"shift={_SHIFT}"),
            *("-kernel", program),
        ],
        120.0,
    )
    return said.splitlines()


def _members(arrays: Sequence[Array], processor: Processor) -> str:
    """The initialiser of a structure of arrays."""
    each = ("{" + ", ".join(_number(x, processor) for x in np.ravel(part)) + "}" for part in arrays)
    return "{" + ", ".join(each) + "}"


def _number(value: float, processor: Processor) -> str:
    """A number in C, of the processor's precision."""
    if isinstance(value, int):
        return str(value)
    if np.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return f"{float(value).hex()}{'f' if processor.real is np.float32 else ''}"
