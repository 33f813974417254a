"""The C module on microcontrollers: it builds for them unchanged, keeps to what it states of its
stack, and computes the desktop's numbers on emulated processors.

Where the tools are missing the tests are skipped, unless GIBBS_CODEGEN_REQUIRE_TOOLS=1.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from numpy.typing import NDArray
from support.tools import missing, run, tool

from gibbs_codegen.interface import module_signatures

EMBEDDED = ROOT / "tests" / "embedded"
STRICT = (
    *("-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow"),
    *("-Wdouble-promotion", "-Wstrict-prototypes", "-Wmissing-prototypes", "-Werror"),
)
# What the emitted code may call.
LIBRARY = {"sinf", "cosf"}
MEMORY = {"memcpy", "memset", "memmove"}
RUN_SECONDS = 60.0
# Rounding errors of a result, in units of its last place; seven times the most that was seen.
FEW = 64

Shipped = Callable[[str], ModuleType]
Results = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Target:
    """A processor: its compiler with flags, its numbers, and QEMU's board that has it."""

    name: str
    compiler: str
    flags: tuple[str, ...]
    real: type[np.floating[Any]]
    board: str | None = None


CROSS = "arm-none-eabi-"
ARM = ("-mthumb", "-mfloat-abi=hard")
M4F = Target(
    "M4F", f"{CROSS}gcc", (*ARM, "-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"), np.float32, "mps2-an386"
)
DESKTOP_FLOAT = Target("desktop_float", "gcc", (), np.float32)


def compiler(target: Target) -> str:
    """Path of a target's compiler, with a C library for it."""
    path = tool(target.compiler)
    if target.board and not Path(run([path, "-print-file-name=rdimon.specs"]).strip()).is_file():
        missing(f"{target.compiler} has no newlib")
    return path


def precision(module: ModuleType, target: Target) -> list[str]:
    """Flags that choose a target's numbers."""
    return [f"-D{module.NAME.upper()}_FLOAT"] if target.real is np.float32 else []


@dataclass(frozen=True)
class Build:
    """A module whose C sources were compiled for a target, for one state and for batches."""

    module: ModuleType
    target: Target
    object: Path
    batches: Path

    @property
    def emitted(self) -> Path:
        """Folder of the emitted files."""
        return Path(self.module.__file__ or "").parent

    def stack(self) -> dict[str, int]:
        """Bytes of stack of each function of the object, as the compiler says."""
        lines = self.object.with_suffix(".su").read_text(encoding="utf-8").splitlines()
        rows = [line.split("\t") for line in lines]
        return {place.rsplit(":", 1)[-1]: int(size) for place, size, _ in rows}


def compiled(module: ModuleType, target: Target, folder: Path) -> Build:
    """Compile a module's C sources into objects in `folder`."""
    build = Build(module, target, *(folder / f"{module.NAME}{part}.o" for part in ("", "_batch")))
    flags = [*STRICT, *target.flags, *precision(module, target), "-fstack-usage"]
    for output in (build.object, build.batches):
        source = (build.emitted / output.name).with_suffix(".c")
        run([compiler(target), *flags, "-c", source, "-o", output])
    return build


@pytest.fixture(scope="module")
def build(shipped: Shipped, tmp_path_factory: pytest.TempPathFactory) -> Build:
    """A small robot's module for a microcontroller."""
    return compiled(shipped("quadrotor_2link"), M4F, tmp_path_factory.mktemp("embedded"))


@pytest.mark.slow
def test_an_object_has_no_variables_calls_nothing_foreign_and_keeps_to_its_stack(build: Build):
    undefined = run([tool(f"{CROSS}nm"), "--undefined-only", build.object]).splitlines()
    called = {line.split()[-1] for line in undefined}
    assert LIBRARY <= called <= LIBRARY | MEMORY
    header, line = run([tool(f"{CROSS}size"), build.object]).splitlines()
    sizes = dict(zip(header.split()[:3], map(int, line.split()[:3]), strict=True))
    assert sizes.pop("text") > 1000
    assert sizes == {"data": 0, "bss": 0}
    assert_stack_as_stated(build)


def assert_stack_as_stated(build: Build) -> None:
    """No function for one state takes more than its comment states, and floats half of it."""
    taken = build.stack()
    helper = max(size for name, size in taken.items() if name.startswith("library_sine_cosine"))
    share = np.dtype(build.target.real).itemsize / 8
    stated = stated_stack((build.emitted / f"{build.module.NAME}.h").read_text(encoding="utf-8"))
    assert len(stated) == len(module_signatures(build.module))
    rows = {name: (taken[name] + helper, share * size) for name, size in stated.items()}
    assert not {name: row for name, row in rows.items() if row[0] > row[1]}


def stated_stack(header: str) -> dict[str, int]:
    """Bytes of stack for one state of doubles that a header states, by function."""
    comments = re.findall(r"/\*\*(.*?)\*/\s*void\s+(\w+)\(", header, flags=re.DOTALL)
    plain = {name: " ".join(re.sub(r"\n \*", " ", text).split()) for text, name in comments}
    found = {name: re.search(r"(\d+) bytes of stack", text) for name, text in plain.items()}
    return {name: int(match[1]) for name, match in found.items() if match}


# ---- Numbers ----

LANES = {np.float32: 16, np.float64: 8}
# Whole blocks of ordinary states, and some beside them, the last with angles left to the library.
WHOLE = 16
STATES = WHOLE + 3


def states(module: ModuleType, real: type[np.floating[Any]]) -> dict[str, NDArray[Any]]:
    """Fixed states with numbers that the target has, by argument."""
    rng = np.random.default_rng(6)
    q, v, a = rng.uniform(-2.5, 2.5, (3, STATES, len(module.COORDINATES)))
    u = rng.uniform(-20.0, 20.0, (STATES, len(module.INPUTS)))
    q[0] = v[0] = a[0] = 0.0
    # Away from where the attitude's angles are singular.
    q[:, 1] = rng.uniform(-1.0, 1.0, STATES)
    # Many turns, in steps whose sums floats hold exactly: an arm's angles are added up.
    q[-1, :-3] = np.round((q[-1, :-3] + np.round(2e5 / math.tau) * math.tau) * 32) / 32
    wrenches = rng.uniform(-20.0, 20.0, (STATES, len(module.FRAMES), 6))
    named = {"q": q, "v": v, "a": a, "u": u, "W": wrenches, "q0": q, "q1": q[::-1]}
    named |= {"v_r": v[::-1], "a_r": a[::-1]}
    return {name: values.astype(real) for name, values in named.items()}


def chosen_parameters(module: ModuleType) -> dict[str, float]:
    """Parameters other than the robot file's."""
    factors = np.random.default_rng(7).uniform(0.7, 1.3, len(module.PARAMETERS))
    return {k: float(f) * x for (k, x), f in zip(module.PARAMETERS.items(), factors, strict=True)}


def cases_header(module: ModuleType, real: type[np.floating[Any]]) -> str:
    """The cases.h that main.c asks for."""
    functions = module_signatures(module)
    given = states(module, real)
    arrays = {f"all_{name}": values for name, values in given.items()}
    widths = [f"ARGUMENT({name}, {values[0].size})" for name, values in given.items()]
    arrays["parameters"] = np.array([*chosen_parameters(module).values()], dtype=real)
    lengths = {
        "LANES": LANES[real],
        "PARAMETERS": len(module.PARAMETERS),
        "WIDEST": max(math.prod(shape) for s in functions for shape in s.shapes),
        "STATES": STATES,
        "BLOCKS": math.ceil(STATES / LANES[real]),
    }
    name, suffix = module.NAME, "f" if real is np.float32 else ""
    lines = [
        f'#include "{name}.h"',
        f"typedef {name}_real real;",
        f"typedef {name}_constants Constants;",
        f"#define MODEL(function) {name}_##function",
        *(f"#define {key} {value}" for key, value in lengths.items()),
    ]
    for key, values in arrays.items():
        numbers = [f"{float(number).hex()}{suffix}" for number in values.ravel()]
        lines.append(f"static const real {key}[{len(numbers)}] = {{")
        lines += [f"    {number}," for number in numbers]
        lines.append("};")
    calls = [
        f"{('ONE', 'TWO')[len(s.shapes) - 1]}"
        f"({', '.join([s.name, *(str(math.prod(shape)) for shape in s.shapes), *s.arguments])})"
        for s in functions
    ]
    lines.append(f"#define ARGUMENTS {' '.join(widths)}")
    return "\n".join([*lines, f"#define FUNCTIONS {' '.join(calls)}", ""])


def evaluated(build: Build) -> Results:
    """Results of every function as the target of a build computes them, by label."""
    module, target, folder = build.module, build.target, build.object.parent
    (folder / "cases.h").write_text(cases_header(module, target.real), encoding="utf-8")
    program = folder / "program.elf"
    inputs = [build.object, build.batches, EMBEDDED / "main.c"]
    flags = [*target.flags, *precision(module, target), f"-I{folder}", f"-I{build.emitted}"]
    command: list[str | Path] = [program]
    if target.board:
        inputs.append(EMBEDDED / "startup.c")
        flags += ["--specs=rdimon.specs", "-nostartfiles", "-T", str(EMBEDDED / "link.ld")]
        command = [
            *(tool("qemu-system-arm"), "-M", target.board, "-nographic", "-monitor", "none"),
            *("-semihosting-config", "enable=on,target=native", "-kernel", program),
        ]
    run([compiler(target), *STRICT, *flags, *inputs, "-o", program, "-lm"])
    found: dict[str, bytes] = {}
    for line in run(command, RUN_SECONDS).splitlines():
        label, digits = line.split(" ")
        found[label] = found.get(label, b"") + bytes.fromhex(digits)
    real = np.dtype(target.real).newbyteorder("<" if target.board else "=")
    return {label: np.frombuffer(data, real) for label, data in found.items()}


def by_state(results: Results) -> Results:
    """Results of the functions, one row a state."""
    return {k: x.reshape(STATES, -1) for k, x in results.items() if not k.startswith("constants")}


def numpy_results(module: ModuleType, real: type[np.floating[Any]]) -> Results:
    """The same results from NumPy's doubles, one row a state."""
    constants = module.prepare(chosen_parameters(module))
    arguments = {name: values.astype(float) for name, values in states(module, real).items()}
    results = {}
    for s in module_signatures(module):
        function = getattr(module, s.name)
        outputs = function(*(arguments[name] for name in s.arguments), constants=constants)
        for i, output in enumerate(outputs if len(s.shapes) > 1 else [outputs], start=1):
            results[f"{s.name}:{i}"] = results[f"{s.name}_batch:{i}"] = output.reshape(STATES, -1)
    return results


@pytest.mark.slow
def test_an_emulated_processor_computes_the_desktops_bits_and_numpys_numbers(
    build: Build, tmp_path: Path
):
    module, target = build.module, build.target
    found = evaluated(build)
    desktop = compiled(module, DESKTOP_FLOAT, tmp_path)
    assert_stack_as_stated(desktop)
    wanted = evaluated(desktop)
    assert found.keys() == wanted.keys()
    assert found["constants"].tobytes() == wanted["constants"].tobytes()
    found, wanted = by_state(found), by_state(wanted)
    # The block with the last state has its sines and cosines from the library, which is another.
    differing = [k for k in found if found[k][:WHOLE].tobytes() != wanted[k][:WHOLE].tobytes()]
    assert not differing
    assert_near_numpy(module, target, found)


def assert_near_numpy(module: ModuleType, target: Target, results: Results) -> None:
    """Each state's results of each function are NumPy's, but for rounding errors."""
    found = {label: values.astype(float) for label, values in results.items()}
    wanted = numpy_results(module, target.real)
    assert found.keys() == wanted.keys()
    scale = {label: np.linalg.norm(values, axis=1) for label, values in wanted.items()}
    # Accelerations are as uncertain as M is ill-conditioned, but M times them is not.
    size = len(module.COORDINATES)
    matrices = wanted["mass_matrix:1"].reshape(STATES, size, size)
    for label in (label for label in wanted if label.startswith("forward_dynamics")):
        scale[label] *= np.linalg.norm(matrices, axis=(1, 2))
        for values in (found, wanted):
            values[label] = np.einsum("sij,sj->si", matrices, values[label])
    errors = {label: np.linalg.norm(found[label] - wanted[label], axis=1) for label in wanted}
    allowed = FEW * np.finfo(target.real).eps
    assert not {k: errors[k] for k in wanted if not np.all(errors[k] <= allowed * scale[k])}
