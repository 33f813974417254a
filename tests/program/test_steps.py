"""Rows of steps, their sections and slots, on functions built by hand and drawn at random."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st
from support.functions import (
    CONSTANTS,
    INPUTS,
    Values,
    evaluated,
    function,
    functions,
    sines_added,
    sum_of,
    values,
)

from gibbs_codegen.program.nodes import (
    Function,
    Name,
    Node,
    Number,
    Output,
    Product,
    Statement,
    names_in,
    node_value,
)
from gibbs_codegen.program.scratch import Section, allocate_scratch
from gibbs_codegen.program.steps import (
    Loop,
    Step,
    Store,
    headed,
    schedule_stores,
    split_into_sections,
)
from gibbs_codegen.program.trigonometry import GatheredFunction, gather_angles

X, Y, Z, P, ZERO = Name("x"), Name("y"), Name("z"), Name("p"), Number(0.0)
T1, T2, T3 = (Name(f"t{i}") for i in range(1, 4))
LIMITS = st.integers(1, 40)


def steps_of(parts: GatheredFunction) -> list[Step]:
    """All steps, zeros stored too."""
    return schedule_stores(parts.statements, parts.outputs, [True] * len(parts.outputs))


def sections_of(steps: Sequence[Step], limit: int) -> tuple[Section, ...]:
    """Pieces with slots of steps without loops."""
    return allocate_scratch(steps, {}, limit).sections


def straight(section: Section) -> tuple[Step, ...]:
    assert isinstance(section.code, tuple)
    return section.code


def statements(**rows: Node) -> list[Statement]:
    return [Statement(name, value) for name, value in rows.items()]


def last_uses(steps: Sequence[Step]) -> dict[str, int]:
    """The place of the last step that reads a name."""
    return {name: i for i, step in enumerate(steps) for name in names_in(step.value)}


def references(steps: Sequence[Step], start: int, stop: int) -> int:
    """Memory references of steps start … stop − 1, counted anew.

    One for each name read that they do not compute, for each entry stored, and for each name
    computed that a later step reads.
    """
    part, last = steps[start:stop], last_uses(steps)
    computed = {step.name for step in part if isinstance(step, Statement)}
    read = {name for step in part for name in names_in(step.value)}
    handed_on = sum(last.get(name, -1) >= stop for name in computed)
    return len(read - computed) + handed_on + sum(isinstance(step, Store) for step in part)


def evaluated_in_sections(
    sections: Sequence[Section], shapes: Sequence[int], at: Values
) -> list[list[float | None]]:
    """Entries of the outputs: a section knows `at` and what it takes from slots, nothing else."""
    outputs: list[list[float | None]] = [[None] * size for size in shapes]
    slots: dict[int, float] = {}
    for section in sections:
        known = at | {name: slots[slot] for name, slot in section.reloads.items()}
        for step in straight(section):
            value = node_value(step.value, known)
            if isinstance(step, Store):
                outputs[step.output][step.place] = value
                continue
            known[step.name] = value
            if step.name in section.spills:
                slots[section.spills[step.name]] = value
    return outputs


def test_an_entry_is_stored_right_after_what_it_needs() -> None:
    rows = statements(t1=sum_of(X, Y), t2=Product((T1, X)), t3=Product((T2, T2)))
    steps = schedule_stores(rows, [Output((3,), (T3, T1, sum_of(T2, T1)))], [True])
    stores = [Store(0, 1, T1), Store(0, 2, sum_of(T2, T1)), Store(0, 0, T3)]
    assert steps == [rows[0], stores[0], rows[1], stores[1], rows[2], stores[2]]


def test_what_needs_no_statement_is_stored_first() -> None:
    rows = statements(t1=sum_of(X, Y))
    outputs = [Output((2,), (T1, X)), Output((1,), (Number(3.0),))]
    assert schedule_stores(rows, outputs, [False, False])[:2] == [
        Store(0, 1, X),
        Store(1, 0, Number(3.0)),
    ]


def test_zeros_are_stored_only_where_they_are_wanted() -> None:
    outputs = [Output((2,), (X, ZERO)), Output((2,), (ZERO, Y))]
    assert schedule_stores([], outputs, [True, False]) == [
        Store(0, 0, X),
        Store(0, 1, ZERO),
        Store(1, 1, Y),
    ]


def test_a_short_row_is_one_section_without_slots() -> None:
    steps = steps_of(gather_angles(function({"t1": sum_of(X, Y)}, T1, Product((T1, T1)))))
    assert sections_of(steps, 900) == (Section(tuple(steps), {}, {}),)


def test_no_steps_are_one_empty_section() -> None:
    """So that a function without outputs is still a function."""
    assert split_into_sections([], 900) == [()]


def test_what_a_later_section_reads_is_handed_on_in_slots() -> None:
    rows = statements(t1=sum_of(X, Y), t2=Product((T1, T1)))
    store = Store(0, 0, sum_of(T2, T1, Z, P))
    assert sections_of([*rows, store], 4) == (
        Section(tuple(rows), {}, {"t1": 0, "t2": 1}),
        Section((store,), {"t2": 1, "t1": 0}, {}),
    )


def test_a_slot_is_used_again_once_its_name_is_not_needed() -> None:
    rows = statements(t1=sum_of(X, Y), t2=Product((T1, T1)), t3=Product((T2, X)))
    sections = sections_of([*rows, Store(0, 0, T3)], 2)
    assert [section.spills for section in sections] == [{"t1": 0}, {"t2": 0}, {"t3": 0}, {}]
    assert [section.reloads for section in sections] == [{}, {"t1": 0}, {"t2": 0}, {"t3": 0}]


def test_a_step_over_the_limit_is_a_section_by_itself() -> None:
    rows = statements(t1=sum_of(X, Y, Z), t2=sum_of(T1, P))
    sections = sections_of([*rows, Store(0, 0, T2)], 1)
    assert [len(straight(section)) for section in sections] == [1, 1, 1]


@given(function=functions(), at=values(), limit=LIMITS)
def test_sections_evaluate_as_the_function_does(function: Function, at: Values, limit: int) -> None:
    """To the last bit: the operations are the same ones. As text, since NaN is not itself."""
    parts = gather_angles(function)
    sizes = [len(output.entries) for output in parts.outputs]
    ours = evaluated_in_sections(sections_of(steps_of(parts), limit), sizes, sines_added(parts, at))
    assert str(ours) == str(evaluated(function, at))


@given(function=functions(), zeros=st.lists(st.booleans(), min_size=2, max_size=2))
def test_every_entry_is_stored_once_and_right_after_it_is_known(
    function: Function, zeros: list[bool]
) -> None:
    rows, outputs = function.statements, function.outputs
    wanted = [
        (number, place, entry)
        for number, output in enumerate(outputs)
        for place, entry in enumerate(output.entries)
        if zeros[number] or entry != ZERO
    ]
    steps = schedule_stores(rows, outputs, zeros[: len(outputs)])
    stores = [step for step in steps if isinstance(step, Store)]
    assert Counter((s.output, s.place, s.value) for s in stores) == Counter(wanted)
    assert [step for step in steps if isinstance(step, Statement)] == list(rows)
    computed: list[str] = []
    for step in steps:
        if isinstance(step, Statement):
            computed.append(step.name)
            continue
        needed = [name for name in names_in(step.value) if name not in (*INPUTS, *CONSTANTS)]
        assert set(needed) <= set(computed)
        assert computed[-1:] == sorted(set(needed), key=computed.index)[-1:]


@given(function=functions(), limit=LIMITS)
def test_sections_are_the_steps_in_order_within_the_limit(function: Function, limit: int) -> None:
    """None but a single step goes beyond the limit, and none ends before it has to."""
    steps = steps_of(gather_angles(function))
    sections = sections_of(steps, limit)
    assert [step for section in sections for step in straight(section)] == steps
    start = 0
    for section in sections:
        stop = start + len(straight(section))
        assert references(steps, start, stop) <= limit or len(straight(section)) == 1
        if stop < len(steps):
            assert references(steps, start, stop + 1) > limit
        start = stop


@given(function=functions(), limit=LIMITS)
def test_slots_are_as_few_as_names_alive_between_sections(function: Function, limit: int) -> None:
    """No two names that are alive at once have one slot, and there is no slot too many."""
    steps = steps_of(gather_angles(function))
    sections = sections_of(steps, limit)
    last = last_uses(steps)
    slot_of: dict[str, int] = {}
    stop, most = 0, 0
    for section in sections:
        stop += len(straight(section))
        assert section.reloads == {name: slot_of[name] for name in section.reloads}
        slot_of |= section.spills
        alive = [name for name in slot_of if last[name] >= stop]
        assert len({slot_of[name] for name in alive}) == len(alive)
        most = max(most, len(alive))
    held = {slot for section in sections for slot in section.spills.values()}
    assert held == set(range(most))


def test_a_group_has_its_words_where_it_begins_and_again_where_it_returns() -> None:
    rows = [Statement(name, X, group) for name, group in zip("abcde", "ppqqp", strict=True)]
    store = Store(0, 0, Name("a"))
    steps = [rows[0], store, *rows[1:3], store, *rows[3:]]
    assert [words for words, _ in headed(steps)] == ["p", "", "", "q", "", "", "p"]
    assert [step for _, step in headed(steps)] == steps


def test_a_loop_has_words_only_if_all_its_statements_are_of_one_group() -> None:
    def loop(*groups: str) -> Loop:
        straight = tuple(Statement(f"a{i}", X, group) for i, group in enumerate(groups))
        return Loop(len(groups), straight[-1:], {}, {}, (), (), straight)

    assert loop("p", "p").group == "p"
    assert loop("p", "q").group == ""
