"""Faults put into the package on purpose: that they are made as meant, and that tests find them."""

from __future__ import annotations

import ast

import pytest
from mutation.mutants import python_mutants
from mutation.suites import NAMED
from mutation.survivors import drawn, mutants, source_path
from mutation.templates import template_mutants


def faulty(source: str) -> set[str]:
    """What stands in the place of a statement of Python."""
    return {make().after for make in python_mutants(source)}


@pytest.mark.parametrize(
    ("source", "faults"),
    [
        ("x = a - b", {"x = a + b", "x = a", "x = -b"}),
        ("x = a < b", {"x = a <= b"}),
        ("x = not a", {"x = a"}),
        ("x = a and b", {"x = a or b", "x = a", "x = b"}),
        ("x = -a", {"x = a"}),
        ("x = a[0]", {"x = a[1]", "x = a[-1]"}),
        ("x = f(tape, a, b)", {"x = f(tape, b, a)"}),
        ("x = a.rotated(turn)", {"x = a"}),
        ("x = sp.S.Zero", {"x = sp.S.One"}),
        ("x = a if b else c", {"x = c if b else a"}),
        ("f(a)", {"pass"}),
        ("if a:\n    f(a)", {"if not a:", "pass"}),
        ("x = f'{a + b}c'", {"x = f'{a - b}c'", "x = f'{a}c'", "x = f'{b}c'"}),
    ],
)
def test_faults_of_a_statement(source: str, faults: set[str]) -> None:
    assert faulty(source) == faults


@pytest.mark.parametrize(
    "source",
    [
        "import a",
        '"""A docstring: 1 + 2."""',
        "x: tuple[int, 3]",
        "Pair = tuple[int, float]",
        "assert a < b",
        "zip(strict=True).x",
    ],
)
def test_what_is_left_alone(source: str) -> None:
    assert faulty(source) <= {"pass"}


def test_faults_of_a_template_are_in_its_code() -> None:
    template = "/* a + 1 */\n#define A 2 + 3\n    x = {{ name + 1 }} * y;\n    f(x);\n"
    assert [make().text for make in template_mutants(template)] == [
        template.replace("    x = {{ name + 1 }} * y;", ""),
        template.replace("}} * y", "}} + y"),
        template.replace("    f(x);", ""),
    ]


def test_each_fault_changes_what_the_module_says_and_no_more_than_a_statement() -> None:
    source = source_path("targets.printers").read_text(encoding="utf-8")
    whole = ast.unparse(ast.parse(source)) + "\n"
    made = [make() for make in python_mutants(source)]
    assert len(made) > 20
    assert all(mutant.text != whole for mutant in made)
    assert len({mutant.text for mutant in made}) == len(made)
    # What was put in was taken out again.
    assert python_mutants(source)[0]().text == made[0].text


def test_faults_are_drawn_evenly_and_alike_from_one_seed() -> None:
    modules = ("targets.printers", "program.trigonometry", "c_source.c.jinja")
    first = [fault.name for fault in drawn(modules, 1, 9)]
    assert first == [fault.name for fault in drawn(modules, 1, 9)]
    assert first != [fault.name for fault in drawn(modules, 2, 9)]
    assert [sum(name.startswith(module) for name in first) for module in modules] == [3, 3, 3]


def test_every_module_that_is_named_has_faults() -> None:
    for modules in NAMED.values():
        for module in modules:
            assert mutants(module), module


CLASSIC = {
    "derivation.gibbs": ("- _dot(r, _cross(w, _cross(first, w)))\n", "\n"),
    "derivation.motion": ("let(y * spin) - yz", "let(y * spin) + yz"),
    "derivation.hybrid": ("inertia_force - active", "inertia_force + active"),
    "derivation.root.tait_bryan": ("tape.let(z - gravity)", "z"),
    "program.inlining": ("(sign * inner, node)", "(inner, node)"),
    "targets.c.function": ("load(name, argument, i)", "load(name, argument, i + 1)"),
}
