"""The recursions on branching trees, against Pinocchio's; zeros of M; words for subtrees.

How whole modules of trees agree with Pinocchio is in `tests/properties/test_pinocchio.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from support.comparison import assert_close
from support.pinocchio_oracle import Oracle
from support.random_robots import random_parents, random_robot, random_tree, rigid_body

from gibbs_codegen.derivation.forward_dynamics import articulated_dynamics, factorised_dynamics
from gibbs_codegen.derivation.inertia import NO_INERTIA
from gibbs_codegen.derivation.segment_tree import Segment, SegmentTree
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.derivation.tree_dynamics import generalised_inertia_forces, mass_matrix
from gibbs_codegen.program.lower import Slice, lower
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.parts.link import Link, Passive
from gibbs_codegen.symbolic.tape import Tape
from gibbs_codegen.symbolic.vectors import NO_ROTATION, Rotation

Parents = tuple[int, ...]


def on_parents(robot: Robot, parents: Parents) -> Robot:
    """The robot with its links on others: 0 is the base, i link i."""
    pairs = zip(robot.links, parents, strict=True)
    return replace(robot, links=tuple(replace(link, parent=parent) for link, parent in pairs))


def branched(seed: int) -> Robot:
    """Six links of any kind, on the base or on each other, by Denavit–Hartenberg parameters."""
    return on_parents(random_robot(seed, 2, 6), random_parents(seed, 6))


def made(parents: Parents, twists: Sequence[int], prismatic: Sequence[int] = ()) -> Robot:
    """Links with general inertias, twisted by so many degrees; `prismatic` numbers those joints."""
    rng = np.random.default_rng(len(parents))
    links = tuple(
        Link(
            rigid_body(rng),
            alpha_deg=Fraction(twist),
            a=float(rng.choice([0.0, 0.3])),
            d=float(rng.choice([0.0, 0.2])),
            theta_deg=Fraction(int(rng.choice([0, 40]))),
            joint="prismatic" if i in prismatic else "revolute",
        )
        for i, twist in enumerate(twists, start=1)
    )
    return on_parents(replace(random_robot(3, 3, 0), name="branched", links=links), parents)


MADE = {
    "two arms on the base normal": made((0, 1, 0, 3), (0, 90, 0, 90)),
    "one arm on the base normal, one across it": made((0, 1, 0, 3), (0, 0, 90, 0)),
    "a hand whose fingers are parallel": made((0, 1, 2, 2, 2), (90, 0, 0, 0, 0), (4,)),
    "a hand with one finger twisted": made((0, 1, 2, 2, 2), (90, 0, 0, 90, 0), (1, 5)),
    "one arm that turns about the base normal and branches": made((0, 1, 1, 2), (0, 90, 0, 0)),
}
RANDOM = [branched(seed) for seed in range(6)]
TREES = [*MADE.values(), *RANDOM]
EVERY_TREE = [
    *(pytest.param(tree, id=name) for name, tree in MADE.items()),
    *(
        pytest.param(tree, id=f"random {number}", marks=[pytest.mark.slow] if number else [])
        for number, tree in enumerate([*RANDOM, *map(random_tree, range(6))])
    ),
]


def in_symbols(robot: Robot) -> tuple[SymbolicRobot, Tape]:
    tape = Tape()
    return SymbolicRobot.of(robot, tape), tape


def supports(parents: Parents, i: int, j: int) -> bool:
    """Whether link i is on the way from link j to the base, or is link j."""
    return j > 0 and (i == j or supports(parents, i, parents[j - 1]))


def test_the_trees_have_every_structure() -> None:
    """Branches at the base and further out, and joints of both kinds at them."""
    found = set()
    for robot in TREES:
        parents = robot.parents
        for i, j in product(range(len(parents)), repeat=2):
            if i < j and parents[i] == parents[j]:
                turned = frozenset(robot.links[k].alpha_deg % 360 != 0 for k in (i, j))
                kinds = frozenset(robot.links[k].joint for k in (i, j))
                found.add((parents[i] > 0, turned, kinds))
    alike = [frozenset([True]), frozenset([False]), frozenset([True, False])]
    for turned in alike:
        assert {further for further, these, _ in found if these == turned} == {True, False}
    assert {kinds for *_, kinds in found} >= {
        frozenset(["revolute"]),
        frozenset(["revolute", "prismatic"]),
    }


def evaluated(
    symbolic: SymbolicRobot, tape: Tape, arrays: dict[str, list], values: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Numbers of arrays on a tape, at given q, v, a and u."""
    symbols = zip("qvau", (symbolic.q, symbolic.v, symbolic.a, symbolic.u), strict=True)
    inputs = {name: tuple(symbol.name for symbol in group) for name, group in symbols}
    outputs = tuple(((len(entries),), tuple(entries)) for entries in arrays.values())
    defaults = symbolic.parameters.defaults
    program = lower(tape, inputs, tuple(defaults), [Slice("arrays", tuple("qvau"), outputs)])
    arguments = {name: value.tolist() for name, value in values.items()}
    found = program.evaluate("arrays", defaults, arguments)
    return dict(zip(arrays, map(np.array, found), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("robot", [EVERY_TREE[0], EVERY_TREE[3]])
def test_both_forward_dynamics_and_trees_that_are_not_regrouped(robot: Robot) -> None:
    symbolic, tape = in_symbols(robot)
    tree = symbolic.reduced_tree
    arrays = {
        "articulated": articulated_dynamics(symbolic),
        "factorised": factorised_dynamics(symbolic, most=10**9),
    }
    for name, each in (("given", not_regrouped(symbolic)), ("regrouped", tree)):
        matrix = mass_matrix(tape, symbolic.root, each)
        arrays[f"M {name}"] = [entry for row in matrix for entry in row]
        forces = generalised_inertia_forces(tape, symbolic.root, each, symbolic.state)
        arrays[f"inverse {name}"] = forces
    rng = np.random.default_rng(1)
    n = len(symbolic.v)
    values = {name: rng.normal(size=len(getattr(symbolic, name))) for name in "qvau"}
    if layout_of(robot).is_quaternion:
        values["q"][layout_of(robot).q.attitude] /= np.linalg.norm(
            values["q"][layout_of(robot).q.attitude]
        )
    found = evaluated(symbolic, tape, arrays, values)

    q, v, a, u = values.values()
    oracle = Oracle(robot)
    exact = oracle.mass_matrix(q)[np.ix_(oracle.free, oracle.free)]
    right = (oracle.input_matrix(q) @ u - oracle.inverse_dynamics(q, v, 0 * a))[oracle.free]
    passive = Oracle(without_passive(robot))
    bare = passive.mass_matrix(q)[np.ix_(oracle.free, oracle.free)]
    inverse = passive.inverse_dynamics(q, v, a)[oracle.free]
    for name in ("given", "regrouped"):
        assert_close(f"M {name}", found[f"M {name}"].reshape(n, n), bare)
        assert_close(name, found[f"inverse {name}"], inverse)
    for name in ("articulated", "factorised"):
        assert_close(name, exact @ found[name], right)
        assert_close(name, found[name], np.linalg.solve(exact, right))


def not_regrouped(symbolic: SymbolicRobot) -> SegmentTree:
    """The tree with every link's own inertia."""
    base = symbolic.base_inertia().plus(symbolic.tape, symbolic.bodies.on_base)
    segments = zip(symbolic.reduced_tree.segments[1:], symbolic.bodies.links, strict=True)
    links = [
        replace(segment, inertia=link.inertia.mapped(symbolic.tape.let))
        for segment, link in segments
    ]
    return SegmentTree((replace(symbolic.reduced_tree.segments[0], inertia=base), *links))


def without_passive(robot: Robot) -> Robot:
    return replace(robot, links=tuple(replace(link, passive=Passive()) for link in robot.links))


@pytest.mark.parametrize("robot", [EVERY_TREE[0], EVERY_TREE[3]])
def test_joints_on_different_branches_do_not_couple(robot: Robot) -> None:
    """Zeros of M are known while the code is written: all that there are among the joints."""
    symbolic, tape = in_symbols(robot)
    matrix = mass_matrix(tape, symbolic.root, symbolic.reduced_tree)
    oracle = Oracle(robot, rigid_base=True)
    exact = oracle.mass_matrix(np.random.default_rng(2).normal(size=len(symbolic.q)))
    places = zip(robot.moving, layout_of(robot).v.joint_places, strict=True)
    for (i, k), (j, m) in product(list(places), repeat=2):
        assert (matrix[k][m] == 0) == (abs(exact[k, m]) < 1e-12), (i, j)
        if not (supports(robot.parents, i, j) or supports(robot.parents, j, i)):
            assert matrix[k][m] == 0, (i, j)


def rod_tree(*parents: int) -> SegmentTree:
    symbolic, _ = in_symbols(on_parents(paper_family(4, len(parents)), parents))
    return symbolic.reduced_tree


@pytest.mark.parametrize(
    ("parents", "k", "words"),
    [
        ((0, 1, 2), 0, "the base and links 1 to 3"),
        ((0, 1, 2), 2, "links 2 and 3, about joint 6"),
        ((0, 1, 2, 1), 2, "links 2 and 3, about joint 6"),
        ((0, 1, 2, 1), 4, "link 4, about joint 8"),
        ((0, 0, 1, 2, 2), 2, "links 2, 4 and 5, about joint 6"),
        ((0, 0, 1, 1, 1, 2, 3), 1, "links 1, 3 to 5 and 7, about joint 5"),
        ((0,), 0, "the base and link 1"),
        ((), 0, "the base"),
    ],
)
def test_words_for_a_subtree(parents: Parents, k: int, words: str) -> None:
    assert rod_tree(*parents).subtree_about_joint(k) == words


def test_a_tree_knows_its_paths_and_subtrees() -> None:
    tree = rod_tree(0, 0, 1, 2, 4)
    assert tree.children == ((1, 2), (3,), (4,), (), (5,), ())
    assert tree.path(5) == [5, 4, 2, 0]
    assert tree.subtree(2) == [2, 4, 5]
    assert tree.joints == 5


ROOT = Segment(NO_INERTIA, NO_ROTATION)
TWIST = Rotation.degrees(0, Fraction(90))


def on(parent: int, **changes: object) -> Segment:
    return replace(ROOT, parent=parent, **changes)


@pytest.mark.parametrize(
    ("segments", "fault"),
    [
        ((ROOT, on(0), on(2)), "segment 2: its parent 2 does not come before"),
        ((ROOT, ROOT), "segment 1: its parent -1"),
        ((on(0), on(0)), "segment 0: its parent 0"),
        ((ROOT, on(0), on(0, starts_group=False)), r"children \(1, 2\) some start groups"),
        ((ROOT, on(0, starts_group=False, twist=TWIST)), "segment 1 is twisted"),
    ],
)
def test_what_is_no_tree_is_refused(segments: tuple[Segment, ...], fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        SegmentTree(segments)


def test_a_twisted_sibling_makes_all_siblings_start_groups() -> None:
    """A child on a parallel axis is then turned by its own angle only, in its parent's frame."""
    symbolic, _ = in_symbols(made((0, 1, 1), (90, 0, 90)))
    tree = symbolic.reduced_tree
    assert [segment.starts_group for segment in tree.segments[1:]] == [True, True, True]
    assert tree.works_in_own_frame(1)
    symbolic, _ = in_symbols(made((0, 1, 1), (90, 0, 0)))
    tree = symbolic.reduced_tree
    assert [segment.starts_group for segment in tree.segments[1:]] == [True, False, False]
    assert not tree.works_in_own_frame(1)
