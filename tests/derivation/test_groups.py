"""The words that statements carry: everywhere, few, true, and printed where a group begins."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import pytest
from support.random_robots import random_robot

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.program.model import Model
from gibbs_codegen.program.nodes import Statement, names_in
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.targets.registry import TARGETS, render_module


@pytest.fixture(scope="module")
def paper() -> Model:
    return derive(read_robot("hexarotor_3link")[0])


def groups(statements: Sequence[Statement]) -> list[str]:
    return [words for words, _ in groupby(statement.group for statement in statements)]


@pytest.mark.slow
def test_every_statement_belongs_to_a_group() -> None:
    """With joints and bodies of every kind, and with parameters that are zero."""
    check_groups(random_robot(1, 2, 0), keep_zeros=True)


def check_groups(robot: Robot, keep_zeros: bool) -> None:
    program = derive(robot, keep_zeros).program
    rows = [program.prepare, *(function.statements for function in program.functions)]
    assert all(statement.group for statements in rows for statement in statements)


def test_groups_help_and_do_not_flood(paper: Model) -> None:
    function = paper.program.function("mass_matrix_and_residual")
    assert 10 <= len(groups(function.statements)) <= 25
    assert 5 <= len(groups(paper.program.prepare)) <= 15


def test_groups_follow_the_recursions(paper: Model) -> None:
    found = groups(paper.program.function("mass_matrix_and_residual").statements)
    said = [
        "motion of the base",
        *(f"motion of link {i}" for i in (1, 2, 3)),
        "inertia forces of link 3, about joint 9",
        "inertia forces of links 2 and 3, about joint 8",
        "composite inertia of links 2 and 3, about joint 8",
        "composite inertia of links 1 to 3, about joint 7",
        "mass matrix of attitude and position",
    ]
    assert [words for words in found if words in said] == said


def test_motion_of_a_link_knows_no_joint_further_out(paper: Model) -> None:
    reads: dict[str, set[str]] = {}
    for statement in paper.program.function("residual").statements:
        names = names_in(statement.value)
        reads[statement.name] = {*names}.union(*(reads.get(name, set()) for name in names))
        for link in (1, 2, 3):
            if statement.group == f"motion of link {link}":
                further = {f"v_theta_{6 + i}" for i in range(link + 1, 4)}
                assert not reads[statement.name] & further


@pytest.mark.slow
def test_numpy_says_each_group_where_it_begins(paper: Model) -> None:
    text = render_module(paper, "", {"numpy": TARGETS["numpy"]})["numpy_module.py"]
    for function in paper.program.functions:
        body = text.partition(f"\ndef _{function.name}(")[2].partition("\ndef ")[0]
        said = [line[6:] for line in body.splitlines() if line.startswith("    # ")]
        assert said == groups(function.statements)
