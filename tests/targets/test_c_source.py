"""The emitted C under instruments: compilers, sanitizers, symbol tables, and NumPy's numbers."""

from __future__ import annotations

import hashlib
import itertools
import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from conftest import ROOT
from numpy.typing import NDArray
from support.c_programs import random_calls
from support.compiled import (
    LANES,
    RANDOM,
    SANITIZERS,
    SMALL,
    Array,
    Emitted,
    Library,
    build,
    compile_only,
    finds_leaks,
)
from support.derived import derived
from support.random_robots import random_robot
from support.tools import compiled, run, tool

from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.program.nodes import Function, count_operations
from gibbs_codegen.program.scratch import stack_bytes
from gibbs_codegen.program.trigonometry import gather_angles
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import name_fault
from gibbs_codegen.robot.parts.body import RigidBody
from gibbs_codegen.robot.parts.link import JOINT_KINDS
from gibbs_codegen.runtime.c_library import RUNTIME
from gibbs_codegen.targets.registry import find_targets, render_module

# What distributions add to every program is no part of the emitted code; and addresses in constant
# tables would be written by the loader if the code might lie anywhere.
PLAIN = ["-fno-stack-protector", "-U_FORTIFY_SOURCE", "-fno-pic"]
STATES = 21  # Two whole blocks and a part of one.

Arrays = dict[str, NDArray[np.float64]]


def signalling_nan(real: type[np.floating]) -> Array:
    """A signalling NaN, which no arithmetic makes."""
    if real is np.float32:
        return np.array(0x7F800001, np.uint32).view(np.float32)
    return np.array(0x7FF0000000000001, np.uint64).view(np.float64)


def states(module: ModuleType, real: type[np.floating] = np.float64) -> Arrays:
    """Random arguments that `real` can represent, away from the singularity of the attitude."""
    rng = np.random.default_rng(5)
    n = len(module.COORDINATES)
    q = rng.uniform(-7.0, 7.0, (STATES, n))
    q[:, 1] = rng.uniform(-1.0, 1.0, STATES)
    v, a = rng.normal(size=(2, STATES, n))
    u = rng.normal(size=(STATES, len(module.INPUTS)))
    wrenches = rng.normal(size=(STATES, len(module.FRAMES), 6))
    named = {"q": q, "v": v, "a": a, "u": u, "W": wrenches, "q0": q, "q1": q[::-1]}
    named |= {"v_r": a, "a_r": v}
    return {name: values.astype(real).astype(np.float64) for name, values in named.items()}


def numpy_outputs(module: ModuleType, name: str, arguments: Sequence[Array]) -> tuple[Array, ...]:
    values = getattr(module, name)(*arguments)
    return values if isinstance(values, tuple) else (values,)


def deviation(ours: Array, theirs: Array) -> float:
    """Distance relative to the norm; what is zero throughout must be so in both.

    NaN, which no maximum and no comparison would show, is infinitely far off.
    """
    size, error = float(np.linalg.norm(theirs)), float(np.linalg.norm(ours - theirs))
    if error == 0.0:
        return 0.0
    return error / size if size > 0 and math.isfinite(error) else math.inf


def worst_deviation(
    emitted: Emitted, library: Library, at: Arrays, scale: Callable[[Array], Array]
) -> dict[str, float]:
    """The largest deviation from NumPy of each function, for one state and in blocks.

    It is relative to the norm over all states, since a single energy may be zero by cancellation.
    Accelerations are taken state by state, divided by what `scale` makes of the mass matrices'
    condition numbers.
    """
    worst = {}
    divisors = scale(np.linalg.cond(emitted.module.mass_matrix(at["q"])))
    for signature in emitted.signatures():
        arguments = [at[name] for name in signature.arguments]
        theirs = numpy_outputs(emitted.module, signature.name, arguments)
        unused = signalling_nan(library.real)
        found = []
        for outputs in (
            library.one(signature, arguments),
            library.batch(signature, arguments, unused),
        ):
            for ours, expected in zip(outputs, theirs, strict=True):
                if signature.name.startswith("forward_dynamics"):
                    each = map(deviation, ours, expected)
                    found += [e / d for e, d in zip(each, divisors, strict=True)]
                else:
                    found.append(deviation(ours, expected))
        worst[signature.name] = max(found)
    return worst


@pytest.fixture(scope="module")
def strict(
    emitted: Callable[[str], Emitted], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Emitted, Library]:
    """The small robot, compiled to keep to the arithmetic as it is written."""
    small = emitted(SMALL)
    path = tmp_path_factory.mktemp("strict") / "small.so"
    return small, Library(small, path, "gcc", ["-O0"], each=True)


def test_the_random_robots_are_of_every_kind() -> None:
    robots = [random_robot(*numbers) for numbers in RANDOM.values()]
    links = [link for robot in robots for link in robot.links]
    assert [len(robot.links) for robot in robots] == [0, 1, 2, 3, 4, 5]
    assert {link.joint for link in links} == set(JOINT_KINDS)
    assert any(isinstance(link.body, RigidBody) for link in links)
    assert any(isinstance(arm, RigidBody) for robot in robots for arm in robot.base.arms)
    assert any(robot.base.rotors == 2 for robot in robots)
    assert any(any(robot.base.drag) for robot in robots)
    assert {robot.base.origin for robot in robots} == {"motor1", "centre"}


def test_what_is_kept_hides_no_warning(tmp_path: Path) -> None:
    source, header, output = (tmp_path / name for name in ("a.c", "a.h", "a.o"))
    source.write_text('#include "a.h"\nint one = 1;\n')
    header.write_text("")
    command = [tool("gcc"), "-Wundef", "-Wunused-macros", "-Werror", "-c", source]
    for _ in range(2):
        compiled(command, output)
    header.write_text("#if NOT_THERE\n#endif\n")
    with pytest.raises(pytest.fail.Exception, match="NOT_THERE"):
        compiled(command, output)
    header.write_text("")
    source.write_text("#define UNUSED 1\nint one = 1;\n")
    with pytest.raises(pytest.fail.Exception, match="UNUSED"):
        compiled(command, output)


def test_a_missing_tool_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a skip, or where the environment requires tools by a failure."""
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("GIBBS_CODEGEN_REQUIRE_TOOLS", raising=False)
    with pytest.raises(pytest.skip.Exception, match="gcc is not installed"):
        tool("gcc")
    monkeypatch.setenv("GIBBS_CODEGEN_REQUIRE_TOOLS", "1")
    with pytest.raises(pytest.fail.Exception, match="gcc is not installed"):
        tool("gcc")


# Warnings


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_functions_without_sines_compile_silently(compiler: str, tmp_path: Path) -> None:
    robot, text = read_robot(SMALL)
    model = derived(robot, functions=("coordinate_rates",))
    for name, content in render_module(model, text, find_targets(["c"])).items():
        (tmp_path / name).write_text(content, encoding="utf-8")
    sources = [str(tmp_path / f"{SMALL}{ending}.c") for ending in ("", "_batch", "_each")]
    compile_only(compiler, ["-O0"], sources, tmp_path)


@pytest.mark.slow
def test_random_robots_compile_silently(emitted: Callable[[str], Emitted], tmp_path: Path) -> None:
    """As C++ in single precision; below, the small robot as C in double precision."""
    robot = emitted("random_3_1")
    compile_only("clang++", ["-O0", robot.single], robot.functions, tmp_path)


# Numbers


@pytest.mark.slow
def test_functions_equal_numpy(emitted: Callable[[str], Emitted], tmp_path: Path) -> None:
    """Every function for one state and in blocks, to 1e-14 of the norm.

    Accelerations solve M a = R + B u, which magnifies rounding of M by its condition number.
    """
    robot = emitted(SMALL)
    library = Library(robot, tmp_path / "robot.so", "gcc", ["-O3", "-march=native"])
    worst = worst_deviation(robot, library, states(robot.module), lambda condition: condition)
    assert max(worst.values()) <= 1e-14, worst


@pytest.mark.parametrize(
    "count",
    [pytest.param(1, marks=pytest.mark.slow), pytest.param(7, marks=pytest.mark.slow), 8, 9, 16],
)
def test_unused_lanes_do_not_matter(count: int, strict: tuple[Emitted, Library]) -> None:
    emitted, library = strict
    at = {name: values[:count] for name, values in states(emitted.module).items()}
    for signature in emitted.signatures():
        arguments = [at[name] for name in signature.arguments]
        garbage = [signalling_nan(np.float64), np.array(1e300), np.array(0.0)]
        found = [
            [array.tobytes() for array in library.batch(signature, arguments, unused)]
            for unused in garbage
        ]
        assert found[0] == found[1] == found[2]


@pytest.mark.parametrize("wanted", [0, 1])
def test_an_output_that_is_null_is_not_computed(
    wanted: int, strict: tuple[Emitted, Library]
) -> None:
    """For one state and for a block of states; the other output is NumPy's."""
    emitted, library = strict
    q, v = (states(emitted.module)[name][:LANES] for name in "qv")
    expected = emitted.module.mass_matrix_and_residual(q, v)[wanted]
    found = np.full((2, *expected.shape), np.nan)
    name = "mass_matrix_and_residual"
    for one_q, one_v, one in zip(q, v, found[0], strict=True):
        outputs = [one if place == wanted else None for place in (0, 1)]
        library.call(name, library.constants, one_q, one_v, *outputs)
    block = np.full(expected.size, np.nan)
    outputs = [block if place == wanted else None for place in (0, 1)]
    rows = [library.blocks(x, np.array(np.nan)) for x in (q, v)]
    library.call(f"{name}_batch", library.constants, LANES, *rows, *outputs)
    found[1] = block.reshape(-1, LANES).T.reshape(expected.shape)
    assert max(deviation(x, expected) for x in found) <= 1e-14


def test_no_states_are_none(strict: tuple[Emitted, Library]) -> None:
    emitted, library = strict
    for signature in emitted.signatures():
        unread = [np.empty(0)] * len(signature.arguments)
        outputs = [np.full(LANES, 7.0) for _ in signature.shapes]
        library.call(f"{signature.name}_batch", library.constants, 0, *unread, *outputs)
        assert all((output == 7.0).all() for output in outputs)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 21])
def test_pack_and_unpack(count: int, strict: tuple[Emitted, Library]) -> None:
    """Pack fills a last block up with the last state; unpack gives the states back."""
    library = strict[1]
    width = 5
    rows = np.random.default_rng(count).normal(size=(count, width))
    filled_up = np.concatenate([rows, np.repeat(rows[-1:], -count % LANES, axis=0)])
    blocks = np.full(filled_up.size, np.nan)
    library.call("pack", count, width, rows, blocks)
    np.testing.assert_array_equal(blocks, library.blocks(filled_up, np.array(np.nan)))
    back = np.full_like(rows, np.nan)
    library.call("unpack", count, width, blocks, back)
    np.testing.assert_array_equal(back, rows)


@pytest.mark.slow
def test_two_robots_in_one_program(emitted: Callable[[str], Emitted], tmp_path: Path) -> None:
    """One compiled as C, the other as C++; each gives the numbers that it gives alone."""
    robots = [emitted("random_3_1"), emitted("random_2_0")]
    objects = [
        compile_only(compiler, ["-O0"], robot.sources, tmp_path)[0]
        for compiler, robot in zip(("gcc", "g++"), robots, strict=True)
    ]
    main = tmp_path / "main.c"
    main.write_text(_program_of_two(robots), encoding="utf-8")
    folders = [f"-I{robot.folder}" for robot in robots]
    objects += compile_only("gcc", folders, [str(main)], tmp_path)
    run([tool("g++"), *objects, "-o", tmp_path / "main", "-lm"])
    printed = iter(map(float, run([tmp_path / "main"]).split()))
    for robot in robots:
        at = _first_state(robot)
        for signature in robot.signatures():
            arguments = [at[name] for name in signature.arguments]
            for expected in numpy_outputs(robot.module, signature.name, arguments):
                ours = np.array([next(printed) for _ in range(expected.size)])
                np.testing.assert_allclose(ours, expected.reshape(-1), rtol=1e-12, atol=1e-12)
    assert next(printed, None) is None


def _first_state(robot: Emitted) -> Arrays:
    return {name: values[0] for name, values in states(robot.module).items()}


def _program_of_two(robots: Sequence[Emitted]) -> str:
    """A program that prints what every function of every robot returns at a state."""
    lines = [f'#include "{robot.name}.h"' for robot in robots]
    lines += ["#include <stdio.h>", "", "int main(void)", "{"]
    for robot in robots:
        lines.append("    {")
        for name, values in _first_state(robot).items():
            numbers = ", ".join(value.hex() for value in values.ravel().tolist())
            lines.append(f"        const double {name}[] = {{{numbers}}};")
        for signature in robot.signatures():
            sizes = [math.prod(shape) for shape in signature.shapes]
            outputs = [f"output_{i}" for i in range(len(sizes))]
            arguments = ", ".join(
                [f"&{robot.name}_default_constants", *signature.arguments, *outputs]
            )
            lines.append("        {")
            lines += [f"            double {o}[{s}];" for o, s in zip(outputs, sizes, strict=True)]
            lines.append(f"            {robot.name}_{signature.name}({arguments});")
            for output, size in zip(outputs, sizes, strict=True):
                lines.append(f"            for (int i = 0; i < {size}; ++i) {{")
                lines.append(f'                printf("%.17g\\n", {output}[i]);')
                lines.append("            }")
            lines.append("        }")
        lines.append("    }")
    return "\n".join([*lines, "    return 0;", "}", ""])


# Constants


def test_default_parameters_and_constants_are_those_of_numpy(
    strict: tuple[Emitted, Library],
) -> None:
    emitted, library = strict
    defaults = emitted.module.PARAMETERS
    assert library.data("default_parameters", len(defaults)).tolist() == list(defaults.values())
    assert library.constants.tolist() == list(emitted.module.prepare({}))


def test_places_of_parameters_are_in_numpy_s_order(emitted: Callable[[str], Emitted]) -> None:
    small = emitted(SMALL)
    body = re.search(r"\benum \{(.*?)\};", small.text(".h"), re.DOTALL)
    assert body is not None
    places = re.findall(r"(\w+), /\*\*< (\S+(?: \S+)*) \*/", body[1])
    units = small.model.units
    assert places == [
        (f"{small.name}_{name}".upper(), units[name]) for name in small.module.PARAMETERS
    ]


def test_places_in_arguments_are_in_the_order_of_their_names(
    emitted: Callable[[str], Emitted], tmp_path: Path
) -> None:
    small = emitted(SMALL)
    module, prefix = small.module, small.name.upper()
    named = zip("QVU", (module.COORDINATES, module.COORDINATES, module.INPUTS), strict=True)
    macros = [[f"{prefix}_{letter}_{name}".upper() for name in names] for letter, names in named]
    lines = [f'#include "{small.name}.h"', "#include <stdio.h>", "", "int main(void)", "{"]
    lines += [f'    printf("%d\\n", (int){macro});' for macro in itertools.chain(*macros)]
    program = tmp_path / "places.c"
    program.write_text("\n".join([*lines, "    return 0;", "}", ""]), encoding="utf-8")
    built = build("gcc", [f"-I{small.folder}"], [str(program)], tmp_path / "places")
    assert [int(line) for line in run([built]).split()] == [
        place for names in macros for place in range(len(names))
    ]


def test_lengths_in_the_header_are_those_of_the_lists(emitted: Callable[[str], Emitted]) -> None:
    small = emitted(SMALL)
    module, prefix = small.module, small.name.upper()
    lists = ("COORDINATES", "HYBRID_COORDINATES", "INPUTS", "POINTS", "PARAMETERS")
    lengths = {f"{prefix}_{name}": str(len(getattr(module, name))) for name in lists}
    found = dict(re.findall(r"^#define (\w+) (\w+)$", small.text(".h"), re.MULTILINE))
    assert {name: found.get(name) for name in lengths} == lengths


def test_constants_of_other_parameters_are_those_of_numpy(strict: tuple[Emitted, Library]) -> None:
    """To the last bit: the operations are the same ones."""
    emitted, library = strict
    rng = np.random.default_rng(3)
    for _ in range(20):
        changed = {n: v * rng.uniform(0.5, 2.0) for n, v in emitted.module.PARAMETERS.items()}
        status, constants = library.init(list(changed.values()))
        assert status == 0
        assert constants.tolist() == list(emitted.module.prepare(changed))


def test_parameters_that_are_no_numbers_are_refused(strict: tuple[Emitted, Library]) -> None:
    robot, library = strict
    defaults = robot.module.PARAMETERS
    # What lies behind the parameters is not read.
    assert library.init([*defaults.values(), math.nan])[0] == 0
    for name, wrong in itertools.product(defaults, (math.nan, math.inf, -math.inf)):
        assert library.init(list((defaults | {name: wrong}).values()))[0] == 1, name


def test_parameters_whose_constants_overflow_are_refused(strict: tuple[Emitted, Library]) -> None:
    emitted, library = strict
    huge = emitted.module.PARAMETERS | {"link2_length": 1e200}
    assert library.init(list(huge.values()))[0] == 1


def test_parameters_that_leave_no_mass_are_refused(strict: tuple[Emitted, Library]) -> None:
    emitted, library = strict
    defaults = emitted.module.PARAMETERS
    massless = {name: 0.0 for name in defaults if name.endswith("mass_per_length")}
    assert library.init(list((defaults | massless).values()))[0] == 1
    with pytest.raises(ValueError, match="leave an acceleration undetermined"):
        emitted.module.prepare(massless)


def test_a_machine_may_weigh_grams(strict: tuple[Emitted, Library]) -> None:
    emitted, library = strict
    light = {
        name: value / 1e4 if name.endswith("mass_per_length") else value
        for name, value in emitted.module.PARAMETERS.items()
    }
    status, constants = library.init(list(light.values()))
    assert status == 0
    assert constants.tolist() == list(emitted.module.prepare(light))


# Sanitizers


@pytest.mark.slow
def test_sanitizers_find_nothing_in_random_calls(
    emitted: Callable[[str], Emitted], tmp_path: Path
) -> None:
    """Nor would they be silent about a buffer that is one number too short."""
    robot, compiler = emitted(SMALL), "gcc"
    (tmp_path / "driver.c").write_text(random_calls(robot), encoding="utf-8")
    options = ["-O0", *SANITIZERS, f"-I{robot.folder}"]
    source = compile_only(compiler, options, robot.functions, tmp_path)
    objects = compile_only(compiler, options, [str(tmp_path / "driver.c")], tmp_path)
    program = tmp_path / "driver"
    compiled([tool(compiler), *SANITIZERS, *source, *objects, "-lm"], program)
    # Looking for leaks needs rights to trace.
    environment = {"ASAN_OPTIONS": f"detect_leaks={int(finds_leaks(compiler, tmp_path))}"}
    run([program], **environment)
    with pytest.raises(pytest.fail.Exception, match="heap-buffer-overflow"):
        run([program, "short"], **environment)


@pytest.mark.slow
def test_constants_of_less_precision_than_the_rest_do_not_compile(
    emitted: Callable[[str], Emitted], tmp_path: Path
) -> None:
    """Functions would be off by 1e-7, without a word."""
    robot = emitted(SMALL)
    options = ["-O0", f"-I{robot.folder}", "-fsingle-precision-constant"]
    compile_only("gcc", [*options, robot.single], robot.sources[:1], tmp_path)
    with pytest.raises(pytest.fail.Exception, match="constants_are_double"):
        compile_only("gcc", options, robot.sources[:1], tmp_path)


def test_a_runtime_of_another_version_does_not_compile(
    emitted: Callable[[str], Emitted], tmp_path: Path
) -> None:
    robot = emitted(SMALL)
    text = (robot.folder / RUNTIME).read_text(encoding="utf-8")
    older = re.sub(r"(#define GIBBS_RUNTIME_VERSION) \d+", r"\1 1", text)
    for ending in (".h", ".c"):
        (tmp_path / f"{SMALL}{ending}").write_text(robot.text(ending), encoding="utf-8")
    (tmp_path / RUNTIME).write_text(older, encoding="utf-8")
    with pytest.raises(pytest.fail.Exception, match="is of another version: generate it and this"):
        compile_only("gcc", ["-fsyntax-only"], [str(tmp_path / f"{SMALL}.c")], tmp_path)


@pytest.mark.slow
def test_programs_of_the_other_precision_do_not_link(
    emitted: Callable[[str], Emitted], tmp_path: Path
) -> None:
    robot = emitted(SMALL)
    program = tmp_path / "program.c"
    program.write_text(
        f'#include "{robot.name}.h"\n'
        f"int main(void) {{ {robot.name}_real q[8] = {{0}}, energy;\n"
        f"{robot.name}_potential_energy(&{robot.name}_default_constants, q, &energy);\n"
        "return energy > 0; }\n",
        encoding="utf-8",
    )
    options = ["-O0", f"-I{robot.folder}"]
    source = compile_only("gcc", [*options, robot.single], robot.sources[:1], tmp_path)
    build("gcc", [*options, robot.single], [str(program), *map(str, source)], tmp_path / "same")
    with pytest.raises(pytest.fail.Exception, match="default_constants"):
        build("gcc", options, [str(program), *map(str, source)], tmp_path / "other")


# Symbols


def _symbols(path: Path) -> list[tuple[str, str]]:
    """Kind and name of each symbol of an object file."""
    lines = [line.split() for line in run([tool("nm"), path]).splitlines()]
    return [(line[-2], line[-1]) for line in lines]


def _declared(header: str) -> set[str]:
    """Names of the functions and data that a header declares."""
    code = re.sub(r"/\*.*?\*/|^#.*?$", "", header, flags=re.DOTALL | re.MULTILINE)
    functions = re.findall(r"(\w+)\s*\(", code)
    return {*functions, *re.findall(r"\bextern const \w+\s+(\w+)", code)}


@pytest.mark.slow
def test_symbols_and_stack(emitted: Callable[[str], Emitted], tmp_path: Path) -> None:
    """What is defined is declared and prefixed; nothing is written to, nothing is allocated.

    The stack is what the header promises.
    """
    robot = emitted(SMALL)
    options = ["-O1", *PLAIN, "-fstack-usage"]
    objects = compile_only("gcc", options, robot.functions, tmp_path)
    one, batch, each = map(_symbols, objects)
    for path, symbols in zip(objects, (one, batch, each), strict=True):
        assert {kind for kind, _ in symbols} <= set("TtRrU")
        data, bss = run([tool("size"), path]).splitlines()[1].split()[1:3]
        assert (data, bss) == ("0", "0")
    declared = _declared(robot.text(".h"))
    of_each = {name for name in declared if re.search("_batch_each$|_constants_batch", name)}
    assert {name for kind, name in each if kind in "TR"} == of_each
    of_blocks = {name for name in declared - of_each if re.search("_batch$|_(un)?pack$", name)}
    assert {name for kind, name in batch if kind in "TR"} == of_blocks
    assert {name for kind, name in one if kind in "TR"} == declared - of_each - of_blocks
    assert all(name.startswith(f"{robot.name}_") for name in declared)
    library = {"sin", "cos", "sincos"}
    moving = {"memcpy", "memset", "memmove"}
    assert {name for kind, name in (*one, *batch, *each) if kind == "U"} <= library | moving
    rows = [line.split("\t") for line in (tmp_path / f"{SMALL}.su").read_text().splitlines()]
    used = {row[0].rpartition(":")[2]: int(row[1]) for row in rows}
    promised = {
        f"{SMALL}_{function.name}": stack_bytes(gather_angles(function))
        for function in robot.model.program.functions
    }
    over = {n: (used[n], most) for n, most in promised.items() if used[n] > most}
    assert not over, f"bytes used and promised: {over}"


# Text


def test_text_is_portable_and_narrow(emitted: Callable[[str], Emitted]) -> None:
    robot = emitted(SMALL)
    texts = [robot.text(ending) for ending in (".h", ".c", "_batch.c", "_each.c")]
    for text in (*texts, (robot.folder / RUNTIME).read_text(encoding="utf-8")):
        assert "M_PI" not in text
        assert re.search(r"\bpow[fl]?\s*\(", text) is None
        assert max(map(len, text.splitlines())) <= 100
        assert text.isascii()


@pytest.mark.parametrize("ending", [".h", ".c", "_batch.c"])
def test_files_open_with_what_they_are(ending: str, emitted: Callable[[str], Emitted]) -> None:
    small = emitted(SMALL)
    digest = hashlib.sha256(read_robot(SMALL)[1].encode()).hexdigest()
    head = small.text(ending).split("\n\n", 1)[0].splitlines()
    assert head[0].startswith("/* Generated by gibbs_codegen")
    assert head[1] == f"/* Robot: {SMALL} */"
    assert head[2] == f"/* Robot file SHA-256: {digest} */"
    assert "without conditions" in head[-1]


def test_no_name_of_a_robot_begins_another_of_its_names(
    emitted: Callable[[str], Emitted],
) -> None:
    """Where C by hand has x_y, and a robot's C has name_y, no robot is called x."""
    made = emitted(SMALL)
    text = "".join(path.read_text() for path in made.folder.glob("*.[ch]"))
    name = made.model.robot.name
    ends = {*re.findall(rf"\b{name}_(\w+)\b(?!\.[ch])", text, re.IGNORECASE), *FUNCTIONS}
    assert {"real", "INPUTS", "COORDINATES"} <= ends
    by_hand = [*(ROOT / "gibbs_codegen/emitted").glob("*.c"), *(ROOT / "templates").glob("c_*")]
    aside = re.compile(r"/\*.*?\*/|\{[{%].*?[%}]\}|MODULE\(\w+\)", re.DOTALL)
    words = {
        word
        for path in by_hand
        for word in re.findall(r"\b[A-Za-z]\w*\b", aside.sub("", path.read_text()))
    }
    clashes = {
        (word, word[: -len(end) - 1].lower())
        for word in words
        for end in ends
        if word.endswith(f"_{end}") and word != f"{name}_{end}"
    }
    # A local name, which may hide the type.
    assert {word for word, robot in clashes if name_fault(robot) is None} == {"last_constants"}


def test_header_gives_every_coordinate_and_input_its_unit(
    emitted: Callable[[str], Emitted],
) -> None:
    robot = emitted(SMALL)
    opening = robot.text(".h").partition("#ifndef")[0]
    for coordinate in (*robot.model.description.coordinates, *robot.model.description.inputs):
        line = rf"^ \*     {coordinate.name} +\[{re.escape(coordinate.unit)}\]  \S"
        assert re.search(line, opening, re.MULTILINE), coordinate


def _comment(header: str, name: str) -> str:
    """The comment of a function in a header, in one line."""
    found = re.search(rf"/\*\*((?:(?!\*/).)*)\*/\s*void\s+{name}\(", header, re.DOTALL)
    assert found is not None, name
    return " ".join(re.sub(r"^ \*", "", found[1], flags=re.MULTILINE).split())


def test_comments_tell_arguments_shapes_units_and_cost(emitted: Callable[[str], Emitted]) -> None:
    robot = emitted(SMALL)
    header = robot.text(".h")
    for signature in robot.signatures():
        function = robot.model.program.function(signature.name)
        comment = _comment(header, f"{robot.name}_{signature.name}")
        described = FUNCTIONS[signature.name]
        said, _, rest = described.details.partition("{singularity}")
        assert comment.startswith(f"@brief {described.summary} {said}".rstrip())
        assert f"{rest} @param[in] constants " in comment
        assert f"@par Source {described.source}." in comment
        for name, width in zip(signature.arguments, signature.widths, strict=True):
            entries = comment.partition(f"@param[in] {name} ")[2].partition("@")[0]
            listed = _entries(robot.model.robot, name)
            assert f", {width} entries{listed}" in entries
        for output, shape in zip(described.outputs, signature.shapes, strict=True):
            assert f"@param[out] {output.name} {' x '.join(map(str, shape)) or '1'}" in comment
        assert _cost(function) in comment
        assert f"The same for `count` states in blocks. */\nvoid {robot.name}_" in header


def _entries(robot: Robot, argument: str) -> str:
    if argument in ("q", "v", "a", "u"):
        return ", as above"
    if argument == "W":
        frames = ", ".join(Description(robot).lists()["FRAMES"])
        return f": force [N] and torque [N m], a row for each of {frames}"
    rate = {"v_r": "/s", "a_r": "/s^2"}.get(argument, "")
    names = ((c.name, f"{c.unit}{rate}") for c in Description(robot).coordinates)
    listed = ", ".join(f"{argument}_{name} [{unit}]" for name, unit in names)
    return f": {listed}"


def _cost(function: Function) -> str:
    counts = count_operations(function.nodes())
    return (
        f"{counts.total} operations, {counts.sine_cosine_pairs} sine-cosine pairs; "
        f"about {stack_bytes(gather_angles(function))} bytes of stack"
    )
