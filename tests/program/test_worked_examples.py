"""The worked examples with which modules of `gibbs_codegen.program` open are true."""

from __future__ import annotations

from dataclasses import replace

import sympy as sp
from support.program_text import entries, examples, node, statements, steps

from gibbs_codegen.program import inlining, loops, lower, nodes, scratch, trigonometry
from gibbs_codegen.program import steps as schedule
from gibbs_codegen.program.nodes import Function, Name, Number, Output, Product, Statement, Sum
from gibbs_codegen.program.steps import Loop, Step
from gibbs_codegen.symbolic.tape import Stage, Tape


def output(lines: list[str]) -> Output:
    values = entries(lines)
    return Output((len(values),), values)


def function(lines: list[str]) -> Function:
    return Function("f", ("q",), (), statements(lines), (output(lines),))


def names(letter: str, numbers: range) -> tuple[str, ...]:
    return tuple(f"{letter}{i}" for i in numbers)


def without_sections(lines: list[str]) -> list[str]:
    """Lines without the number of their section in front."""
    assert all(line.startswith(f"section {i}:") for i, line in enumerate(lines))
    return [line.partition(":")[2].strip() for line in lines]


def test_nodes() -> None:
    example, _ = examples(nodes)
    twice = Product((Number(2.0), Name("y")))
    assert steps(example) == [Statement("t1", Sum(((1, Name("x")), (-1, twice))))]


def test_operations() -> None:
    _, example = examples(nodes)
    assert nodes.count_operations(map(node, example)) == nodes.Operations(1, 1, 1, 1)


def test_schedule() -> None:
    before, after = examples(schedule)
    scheduled = schedule.schedule_stores(statements(before), [output(before)], [True])
    assert scheduled == steps(after)
    sections = schedule.split_into_sections(scheduled, 4)
    assert sections == [tuple(scheduled[:2]), tuple(scheduled[2:])]


def test_live_ranges() -> None:
    _, example, _ = examples(scratch)
    live = scratch.LiveRanges([[step] for step in steps(without_sections(example))])
    assert live.first_definition == {"t1": 0, "t2": 1, "t3": 2}
    assert live.last_use == {"t1": 2, "t2": 2, "t3": 2}
    assert not live.can_share("t1", "t2")
    assert live.can_share("t1", "t3")
    assert live.can_share("t3", "t2")


def test_scratch() -> None:
    example, _, _ = examples(scratch)
    lines = [line.split("  ")[0] for line in without_sections(example)]
    allocation = scratch.allocate_scratch(steps(lines), {}, 2)
    assert allocation.slots == 1
    for line, step, section in zip(example, steps(lines), allocation.sections, strict=True):
        assert section.code == (step,)
        words = [f"reloads {name}" for name in section.reloads]
        words += [f"spills {name} to slot {slot}" for name, slot in section.spills.items()]
        assert line.endswith(f"  {', '.join(words)}")


def test_repeated_blocks() -> None:
    _, example, _ = examples(loops)
    lines = [line.replace("0", str(k)) for k in range(20) for line in example[:2]]
    assert lines[-2:] == example[-2:]
    lines[2:4] = example[2:4]
    (found,) = loops.find_repeated_blocks(steps(lines))
    assert (found.start, found.length, len(found.blocks)) == (0, 2, 20)


def test_loops() -> None:
    example, _, _ = examples(loops)
    lines = [example[0].replace("0", str(k)) for k in range(40)]
    assert (lines[2], lines[-1]) == (example[2], example[-1])
    lines[1] = example[1]
    used_later = [Statement("t", Product(tuple(map(Name, names("u", range(40))))))]
    (loop, *_), signs = loops.reroll([*steps(lines), *used_later])
    assert isinstance(loop, Loop)
    assert loop.count == 40
    assert loop.body == tuple(steps(example[-1:]))
    assert loop.operands == {f"{letter}39": names(letter, range(40)) for letter in "xy"}
    assert loop.results == {"u39": names("u", range(40))}
    assert [name for name, sign in signs.items() if sign < 0] == ["u1"]


def test_rows() -> None:
    _, _, example = examples(loops)
    first, second = names("x", range(8)), (*names("x", range(1, 8)), "p")
    assert [line.split(":")[2].strip() for line in example] == ["x0 x1 … x7", "x1 … x7 p"]
    items: list[Step | Loop] = [
        Statement(name, Product((Name("p"),) * k)) for k, name in enumerate(first, start=2)
    ]
    for result, row in (("u", first), ("w", second)):
        made = names(result, range(8))
        straight = tuple(steps(f"{name} = c*{x}" for name, x in zip(made, row, strict=True)))
        body = (straight[-1],)
        items.append(Loop(8, body, {row[-1]: row}, {made[-1]: made}, (), (), straight))
    tuples = loops.SlotTuples()
    placed, copies = loops.insert_copies(items, tuples)
    (copy,) = copies
    assert placed[-2] == Statement(copy, Name("p"))
    (members,) = (m for m in tuples.members.values() if [copy] in m.values())
    lowest = min(members)
    assert [members[lowest + i] for i in range(9)] == [[name] for name in (*first, copy)]


def test_inlining() -> None:
    before, after = examples(inlining)
    kept = inlining.inline_single_uses(list(statements(before)), [])
    assert tuple(kept) == statements(after)


def test_lowering() -> None:
    (example,) = examples(lower)
    tape = Tape()
    symbols = {"p": tape.symbol("p", Stage.PARAMETER)}
    symbols |= {name: tape.symbol(name, Stage.CONFIGURATION) for name in "xy"}
    for line in example[:4]:
        target, _, value = line.partition(" (")[0].partition(" = ")
        symbols[target] = tape.let(sp.sympify(value, symbols))
    values = example[4].removeprefix("out = [").removesuffix("]").split(", ")
    outputs = tuple(tape.let(sp.sympify(value, symbols)) for value in values)
    slices = [lower.Slice("f", ("q",), (((2,), outputs),))]
    program = lower.lower(tape, {"q": ("x", "y")}, ("p",), slices)
    words = "constant terms and factors of the functions"
    (doubled,) = statements(["k1 = 2*p"])
    assert program.prepare == (replace(doubled, group=words),)
    lowered = statements(["t1 = sin(x)", "t2 = t1*t1", "t3 = k1*t2"])
    assert program.functions[0].statements == lowered
    assert program.functions[0].outputs[0].entries == (Name("t3"), Name("t2"))


def test_trigonometry() -> None:
    (example,) = examples(trigonometry)
    gathered = trigonometry.gather_angles(function(example))
    assert gathered.angles == (Name("t1"), Name("x"))
    assert gathered.angle_statements == statements(["t1 = x + y"])
    assert gathered.statements == statements(["t2 = p*c1"])
    assert gathered.outputs[0].entries == entries(["out = [t2, s2]"])


def test_stack() -> None:
    _, _, example = examples(scratch)
    assert scratch.stack_bytes(trigonometry.gather_angles(function(example))) == 160
