"""Loops for repeated blocks: what is found, and that the loops do the same as the steps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from support.derived import derived

from benchmarks.family import benchmark_robot
from gibbs_codegen.program.loops import reroll
from gibbs_codegen.program.nodes import Name, Node, Product, Statement, Sum, names_in, node_value
from gibbs_codegen.program.scratch import SlotAllocation, allocate_scratch
from gibbs_codegen.program.steps import Item, Loop, Step, Store, schedule_stores
from gibbs_codegen.program.trigonometry import gather_angles

Values = dict[str, float]
Stored = dict[tuple[int, int], float]


def sum_of(*terms: tuple[int, Sequence[str]]) -> Node:
    """Sum of signed products of names."""
    return Sum(tuple((sign, Product(tuple(map(Name, factors)))) for sign, factors in terms))


def run_steps(steps: Sequence[Step], values: Values, stored: Stored) -> None:
    for step in steps:
        value = node_value(step.value, values)
        if isinstance(step, Store):
            assert (step.output, step.place) not in stored
            stored[step.output, step.place] = value
        else:
            values[step.name] = value


def run_straight(steps: Sequence[Step], inputs: Values) -> Stored:
    """What steps store."""
    stored: Stored = {}
    run_steps(steps, dict(inputs), stored)
    return stored


def run_allocation(allocation: SlotAllocation, inputs: Values) -> Stored:
    """What sections store that know of each other only what is held."""
    held = [float("nan")] * allocation.slots
    stored: Stored = {}

    def sign(name: str) -> int:
        return -1 if name in allocation.negated else 1

    for section in allocation.sections:
        if isinstance(section.code, Loop):
            for i in range(section.code.count):
                values = dict(inputs)
                for name, slot in section.reloads.items():
                    here = (
                        held[slot + i] if name in section.code.operands else sign(name) * held[slot]
                    )
                    values[name] = here
                places = iter(zip(section.code.places, section.code.strides, strict=True))
                for step in section.code.body:
                    if isinstance(step, Store):
                        place, pitch = next(places)
                        step = Store(step.output, place + i * pitch, step.value)
                    run_steps([step], values, stored)
                for name, slot in section.spills.items():
                    held[slot + i] = values[name]
            continue
        values = inputs | {name: sign(name) * held[slot] for name, slot in section.reloads.items()}
        run_steps(section.code, values, stored)
        for name, slot in section.spills.items():
            held[slot] = sign(name) * values[name]
    return stored


def check(steps: Sequence[Step], limit: int = 30) -> list[Loop]:
    """Check that sections with loops store what the steps store; return the loops that are left."""
    made = {step.name for step in steps if isinstance(step, Statement)}
    read = dict.fromkeys(name for step in steps for name in names_in(step.value))
    numbers = np.random.default_rng(3).uniform(-2, 2, len(read)).tolist()
    inputs = {n: x for n, x in zip(read, numbers, strict=True) if n not in made}
    allocation = allocate_scratch(*reroll(steps), limit)
    assert run_allocation(allocation, inputs) == pytest.approx(
        run_straight(steps, inputs), rel=1e-12
    )
    return [section.code for section in allocation.sections if isinstance(section.code, Loop)]


def started(columns: int) -> list[Step]:
    """Names x0, y0, x1, y1 …, which nothing rolls: each is another expression."""
    steps: list[Step] = []
    for k in range(columns):
        steps.append(Statement(f"x{k}", sum_of((1, ["p"] * (k + 2)), (1, ["q"]))))
        steps.append(Statement(f"y{k}", sum_of((1, ["q"] * (k + 2)), (1, ["p"]))))
    return steps


def carried(joint: int, columns: Sequence[int], x: str = "x", y: str = "y") -> list[Step]:
    """Two numbers a column, turned, and one of them stored."""
    steps: list[Step] = []
    c, s = f"c{joint}", f"s{joint}"
    for k in columns:
        new = f"{joint}_{k}"
        steps += [
            Statement(f"u{new}", sum_of((1, [c, f"{x}{k}"]), (-1, [s, f"{y}{k}"]))),
            Statement(f"w{new}", sum_of((1, [s, f"{x}{k}"]), (1, [c, f"{y}{k}"]))),
            Store(0, 100 * joint + k, Name(f"u{new}")),
            Store(0, 100 * joint + 50 + 2 * k, Name(f"w{new}")),
        ]
    return steps


def test_a_run_is_found() -> None:
    loops = check([*started(12), *carried(1, range(12))])
    assert [(loop.count, len(loop.body), loop.strides) for loop in loops] == [(12, 4, (1, 2))]
    assert loops[0].results == {}


def test_loops_hand_on_rows() -> None:
    steps = [*started(12), *carried(1, range(12)), *carried(2, range(12), "u1_", "w1_")]
    loops = check(steps)
    assert [loop.count for loop in loops] == [12, 12]
    assert set(loops[0].results.values()) == set(loops[1].operands.values())


def test_new_rows_lie_where_the_old_ones_lay() -> None:
    steps = [*started(12), *carried(1, range(12)), *carried(2, range(12), "u1_", "w1_")]
    assert allocate_scratch(*reroll(steps), 1000).slots == 24


def test_a_row_is_not_made_where_one_lies_that_later_blocks_read() -> None:
    """Each block reads what the one before the last has read: nothing may lie there yet."""
    steps = started(14)
    for k in range(2, 14):
        steps += [
            Statement(f"r{k}", sum_of((1, ["c", f"x{k}"]), (1, ["s", f"x{k - 2}"]))),
            Statement(f"m{k}", sum_of((1, ["c", f"x{k - 2}"]), (-1, ["s", f"x{k}"]))),
            Store(0, k, Name(f"r{k}")),
            Store(0, 50 + 2 * k, Name(f"m{k}")),
        ]
    loops = check([*steps, *carried(1, range(2, 14), "r", "m")])
    assert [loop.count for loop in loops] == [12, 12]


def test_blocks_may_store_what_is_the_same_in_all() -> None:
    steps = started(12)
    for k in range(12):
        steps += [*carried(1, [k]), Store(1, k, Name("p"))]
    assert [(loop.count, len(loop.body)) for loop in check(steps)] == [(12, 5)]


def test_few_blocks_stay_straight() -> None:
    assert check([*started(3), *carried(1, range(3))]) == []


def test_rows_may_grow() -> None:
    """A later loop also takes columns that are new."""
    steps = [*started(14), *carried(1, range(2, 14))]
    for k in (0, 1):
        steps += [Statement(f"u1_{k}", Name(f"x{k}")), Statement(f"w1_{k}", Name(f"y{k}"))]
    loops = check([*steps, *carried(2, range(14), "u1_", "w1_")])
    assert [loop.count for loop in loops] == [12, 14]


def test_signs_do_not_matter() -> None:
    """Half the columns are carried negated, as the tape may leave them."""
    steps = started(12)
    for k in range(12):
        sign = 1 if k % 3 else -1
        steps += [
            Statement(f"u{k}", sum_of((1, ["c", f"x{k}"]), (-sign, ["s", f"y{k}"]))),
            Statement(f"w{k}", sum_of((sign, ["c", f"y{k}"]), (1, ["s", f"x{k}"]))),
            Store(0, 2 * k, Name(f"u{k}")),
            Store(0, 2 * k + 1, Name(f"w{k}")),
        ]
    assert [loop.count for loop in check(steps)] == [12]


def test_a_name_that_all_blocks_read_may_be_negated_in_a_row() -> None:
    steps = started(12)
    for k in range(12):
        sign = 1 if k % 3 else -1
        steps += [
            Statement(f"u{k}", sum_of((1, ["c", f"x{k}"]), (-sign, ["s", f"y{k}"]))),
            Statement(f"w{k}", sum_of((sign, ["c", f"y{k}"]), (1, ["s", f"x{k}"]))),
            Store(0, 2 * k, Name(f"u{k}")),
            Store(0, 2 * k + 1, Name(f"w{k}")),
        ]
    for k in range(12):
        steps += [
            Statement(f"a{k}", sum_of((1, ["y0", f"x{k}"]), (1, ["y1", f"u{k}"]))),
            Statement(f"b{k}", sum_of((1, ["y0", f"u{k}"]), (-1, ["y1", f"x{k}"]))),
            Store(1, 2 * k, Name(f"a{k}")),
            Store(1, 2 * k + 1, Name(f"b{k}")),
        ]
    assert [loop.count for loop in check(steps)] == [12, 12]


def test_signs_that_contradict_end_a_run() -> None:
    steps = started(48)
    for k in range(48):
        sign = 1 if k >= 24 else -1
        steps += [
            Store(0, 2 * k, sum_of((1, ["c", f"x{k}"]), (-1, ["s", f"y{k}"]))),
            Store(0, 2 * k + 1, sum_of((1, ["c", f"x{k}"]), (sign, ["s", f"y{k}"]))),
        ]
    assert [loop.count for loop in check(steps)] == [24]


def test_order_of_terms_and_factors_does_not_matter() -> None:
    steps = started(12)
    for k in range(12):
        terms = [(1, ["c", f"x{k}"]), (-1, [f"y{k}", "s"])]
        if k % 2:
            terms = [(-1, ["s", f"y{k}"]), (1, [f"x{k}", "c"])]
        steps += [
            Statement(f"u{k}", sum_of(*terms)),
            Statement(f"w{k}", sum_of((1, [f"u{k}"] * 2))),
        ]
        steps += [Store(0, 2 * k, Name(f"u{k}")), Store(0, 2 * k + 1, Name(f"w{k}"))]
    assert [loop.count for loop in check(steps)] == [12]


def test_a_recursion_is_no_loop() -> None:
    """Each block reads what the one before has made."""
    steps: list[Step] = [Statement("z0", sum_of((1, ["p", "q"])))]
    for k in range(40):
        steps.append(Statement(f"z{k + 1}", sum_of((1, ["c", f"z{k}"]), (1, ["s", "p"]))))
    assert check([*steps, Store(0, 0, Name("z40"))]) == []


def test_rows_that_clash_are_copied_or_left() -> None:
    """The same names forwards and then backwards cannot both lie side by side."""
    steps = [*started(12), *carried(1, range(12)), *carried(2, range(11, -1, -1), "u1_", "w1_")]
    loops = check(steps)
    assert [loop.count for loop in loops] == [12]


def test_what_lies_elsewhere_is_copied() -> None:
    """The first column is an input."""
    loops = check([*started(12)[2:], *carried(1, range(12))])
    assert [loop.count for loop in loops] == [12]


def test_a_name_whose_place_is_taken_leaves_the_steps() -> None:
    """In the second run x3 stands where y0 stood."""
    steps = [*started(12), *carried(1, range(12))]
    for k in range(12):
        second = "x3" if k == 0 else f"y{k}"
        steps += [
            Statement(f"a{k}", sum_of((1, ["c", f"x{k}"]), (1, ["s", second]))),
            Statement(f"b{k}", sum_of((1, ["c", second]), (1, ["s", f"x{k}"]))),
            Store(1, 2 * k, Name(f"a{k}")),
            Store(1, 2 * k + 1, Name(f"b{k}")),
        ]
    assert [loop.count for loop in check(steps)] == [12]


@pytest.mark.parametrize("seed", range(30))
def test_random_steps(seed: int) -> None:
    """Columns carried past joints, with coefficients, columns and order drawn at random."""
    rng = np.random.default_rng(seed)
    width = int(rng.integers(6, 16))
    steps = started(width)
    x, y = "x", "y"
    columns = np.arange(rng.integers(0, 3), width)
    for joint in range(int(rng.integers(1, 6))):
        columns = columns[rng.integers(2) :]
        if rng.random() < 0.1:
            columns = rng.permutation(columns)
        steps += carried(joint, columns.tolist(), x, y)
        if rng.random() < 0.8:
            x, y = f"u{joint}_", f"w{joint}_"
    check(steps, int(rng.integers(10, 80)))


def steps_of(links: int, function: str) -> list[Step]:
    program = derived(benchmark_robot(links), functions=(function,)).program
    parts = gather_angles(program.function(function))
    return schedule_stores(parts.statements, parts.outputs, [True] * len(parts.outputs))


@pytest.mark.slow
def test_a_robot() -> None:
    links = 4
    loops = check(steps_of(links, "mass_matrix"), 250)
    assert bool(loops) == (links == 16)


@pytest.mark.slow
def test_most_of_a_long_arm_is_rolled() -> None:
    """Work grows with the square of the links, the text of it in proportion to them."""
    sizes = []
    for links in (12, 24):
        items: Sequence[Item] = reroll(steps_of(links, "mass_matrix"))[0]
        sizes.append(sum(len(i.body) if isinstance(i, Loop) else 1 for i in items))
    assert sizes[1] < 2.3 * sizes[0]
