"""Verification of a generated module: its comparisons and their order.

compare_contents    names and parameters       with the robot file            (contents)
Expected            every function at states   with formulations that share   (equations)
                                               no code with the derivation
    Newton–Euler, again for one state, any angles, other parameters           (newton_euler)
    Lagrange                                                                  (lagrange)
    Pinocchio and MuJoCo, if they are installed              (pinocchio_tree, mujoco_tree)
Invariants          functions                  with each other                (invariants)
compare_derivatives functions on request       with complex steps of others  (derivatives)
compare_with_itself what no formulation gives  with itself                    (invariants)
    all functions with constants of each state
"""

from __future__ import annotations

import importlib
import importlib.abc
import itertools
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from types import ModuleType
from typing import Any, TypeVar

from gibbs_codegen.errors import WrongModuleError
from gibbs_codegen.interface import LANES
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.verification import invariants
from gibbs_codegen.verification.comparison import (
    Comparison,
    Results,
    explained,
    failed,
    failure_text,
    merged,
)
from gibbs_codegen.verification.complex_steps import ComplexSteps
from gibbs_codegen.verification.contents import compare_contents
from gibbs_codegen.verification.derivatives import compare_derivatives
from gibbs_codegen.verification.equations import Expected
from gibbs_codegen.verification.formulation import Formulation, NotApplicableError, formulated
from gibbs_codegen.verification.lagrange import MOST_POINTS, Lagrange
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.parameters import InOwnUnits, prepared, variation, variations
from gibbs_codegen.verification.states import States
from gibbs_codegen.verification.tree import Tree

Progress = Callable[[str], None]
# What is expected of a module, whatever its back end.
Known = dict[Hashable, Any]
Made = TypeVar("Made")

ONE_STATE, ANY_ANGLES, OTHER_PARAMETERS = (
    f"{NewtonEuler.name}, {words}"
    for words in ("one state at a time", "any angles", "other parameters")
)
# Formulations by libraries, whose names their modules in this package begin with.
_LIBRARIES = {"Pinocchio": "pinocchio", "MuJoCo": "mujoco"}
# A module that was just emitted is compared at so many: a few reveal a wrong one.
_FEW_STATES = 3
# How many numbers Lagrange's equations may keep at once: states times coordinates times points.
_MOST_NUMBERS = 3_000_000
# How many entries the mass matrices of all states that are computed at once may have.
_MOST_ENTRIES = 400_000


@dataclass(frozen=True)
class Extent:
    """The states to compare beyond the random ones.

    `others` states have other parameters, of `variations` sets, and more with `zeros`, where
    parameters are zero; `singly` of all states are computed one by one as well; derivatives are
    compared at so many states with each set of parameters; `of_each` states have constants each.
    """

    others: int
    singly: int
    variations: int
    zeros: bool
    any_angles: bool
    derivatives: int
    of_each: int


# States with constants of their own fill one block, and part of another.
THOROUGH = Extent(6, 6, variations=4, zeros=True, any_angles=True, derivatives=3, of_each=LANES + 3)
# For a module that was just emitted. States with other parameters have any angles.
QUICK = Extent(3, 1, variations=1, zeros=False, any_angles=False, derivatives=1, of_each=0)


@dataclass
class Verification:
    """Comparisons by back end, and what could not be compared, with the reason."""

    robot: str
    seed: int
    comparisons: dict[str, list[Comparison]] = field(default_factory=dict)
    not_done: dict[str, str] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of comparisons."""
        return sum(map(len, self.comparisons.values()))

    @property
    def failures(self) -> list[tuple[str, Comparison]]:
        """Comparisons that failed, each with its back end."""
        return [
            (backend, comparison)
            for backend, comparisons in self.comparisons.items()
            for comparison in comparisons
            if not comparison.passed
        ]

    @property
    def passed(self) -> bool:
        """True if there were comparisons, and none failed."""
        return self.count > 0 and not self.failures


def formulations(robot: Robot) -> tuple[list[Formulation], dict[str, str]]:
    """Every formulation of a robot, Newton and Euler's first, and why each other cannot be had."""
    tree = Tree(robot)
    available: list[Formulation] = [formulated(NewtonEuler(tree)), formulated(Lagrange(tree))]
    not_done = {}
    for name, library in _LIBRARIES.items():
        try:
            there = importlib.import_module(f"gibbs_codegen.verification.{library}_tree")
            available.append(InOwnUnits(getattr(there, name), robot))
        except ModuleNotFoundError:
            not_done[name] = f"{library} is not installed"
        except (ImportError, NotApplicableError) as error:
            not_done[name] = str(error)
    return available, not_done


def compare_module(
    module: ModuleType,
    robot: Robot,
    against: Sequence[Formulation],
    count: int,
    seed: int,
    progress: Progress = lambda _: None,
    extent: Extent = THOROUGH,
    numpy: ModuleType | None = None,
    known: Known | None = None,
) -> list[Comparison]:
    """Compare everything about one back end; the contents alone where these are wrong.

    `against` begins with Newton and Euler's formulation; `progress` is called with the name of each
    step. `numpy` is the NumPy back end, if `module` is another: what no formulation gives is
    compared with it. `known` keeps what is expected for the next back end of the same module.
    """
    known = {} if known is None else known
    contents = compare_contents(module, robot)
    if not all(comparison.passed for comparison in contents):
        # With other coordinates, or none, there is nothing that could be compared.
        return [
            c if c.passed else replace(c, fault=f"{c.fault} (no function was compared)")
            for c in contents
        ]
    tree = against[0].tree
    most = most_states(tree)
    comparisons, steps = contents, ComplexSteps(numpy or module, robot)
    for number, first in enumerate(range(0, count, most)):
        some, singly = min(most, count - first), extent.singly
        comparisons += _compare_functions(
            module, steps, against, some, (seed, number), singly, progress, {} if number else known
        )
    others = min(most, extent.others)
    evaluation = Results(module)
    unknown = invariants.without_formulation(evaluation.signatures, comparisons, against[0].name)
    states = States.random(tree, others, (seed, 5))
    there = Results(numpy) if numpy else None
    comparisons += invariants.compare_with_itself(evaluation, there, robot, unknown, states)
    comparisons += compare_derivatives(evaluation, steps, robot, states.first(extent.derivatives))
    if extent.any_angles:
        progress(ANY_ANGLES)
        count = min(most, max(count, others))
        again = _once(known, ANY_ANGLES, lambda: _Case(robot, count, (seed, 2)))
        comparisons += _compare_again(evaluation, again, extent.singly, ANY_ANGLES)
    progress(OTHER_PARAMETERS)
    comparisons += _with_other_parameters(
        module, numpy, robot, unknown, others, seed, extent, known
    )
    if extent.of_each:
        progress(invariants.OF_EACH)
        numbers = range(min(most, extent.of_each))
        robots = [variation(robot, module.PARAMETERS, seed, number) for number in numbers]
        states = States.random(Tree(robot), len(robots), (seed, 6))
        comparisons += invariants.compare_constants_of_each(module, robots, states)
    return merged(comparisons)


def most_states(tree: Tree) -> int:
    """The largest number of states at once, at least 1, that keeps memory within bounds."""
    return max(1, _MOST_ENTRIES // tree.size**2)


def _compare_functions(
    module: ModuleType,
    steps: ComplexSteps,
    against: Sequence[Formulation],
    count: int,
    seed: tuple[int, int],
    singly: int,
    progress: Progress,
    known: Known,
) -> list[Comparison]:
    """Compare all functions with every formulation and with each other.

    `singly` of the states are computed one by one as well. The order of the comparisons does not
    depend on count and seed.
    """
    tree = against[0].tree
    states = States.random(tree, count, seed)
    evaluation = Results(module)
    values = evaluation.all(states)
    progress(against[0].name)

    def expected(formulation: Formulation, states: States) -> Expected:
        return _once(known, (id(formulation), seed), lambda: Expected(formulation, states))

    first = expected(against[0], states)
    comparisons = first.compare(values)
    alone = evaluation.all(states.first(singly), singly=True)
    one_state = first.compare(alone, ONE_STATE)
    for formulation in against[1:]:
        progress(formulation.name)
        few = count
        if formulation.name == Lagrange.name:
            few = max(1, min(count, _MOST_NUMBERS // (MOST_POINTS * tree.size**2)))
        comparisons += expected(formulation, states.first(few)).compare(values)
    progress("invariants")
    relations = invariants.Invariants(evaluation, steps, values, states, first.sizes, tree)
    comparisons += relations.comparisons()
    return explained(comparisons + one_state, evaluation.faults)


class _Case:
    """A robot with far angles, with what Newton and Euler's equations expect there."""

    def __init__(self, robot: Robot, count: int, seed: tuple[int, ...]) -> None:
        self.robot, self.tree = robot, Tree(robot)
        self.states = States.extreme(self.tree, count, seed)
        self.expected = Expected(formulated(NewtonEuler(self.tree)), self.states)


def _once(known: Known, key: Hashable, make: Callable[[], Made]) -> Made:
    """What is known under a key, made if it is not."""
    if key not in known:
        known[key] = make()
    made: Made = known[key]
    return made


def _compare_again(evaluation: Results, case: _Case, few: int, against: str) -> list[Comparison]:
    """Compare all functions with what is expected in other circumstances, `against`.

    The states are computed all together, `few` of them one by one as well.
    """
    expected, states = case.expected, case.states
    batched = expected.compare_functions(evaluation, states, against)
    return batched + expected.compare_functions(evaluation, states.first(few), against, True)


def _with_other_parameters(
    module: ModuleType,
    numpy: ModuleType | None,
    robot: Robot,
    unknown: Sequence[str],
    count: int,
    seed: int,
    extent: Extent,
    known: Known,
) -> Iterator[Comparison]:
    """Compare once more, with every parameter changed at run time, and zero by turns.

    Functions that no formulation gives, `unknown`, are compared with themselves.
    """
    names = tuple(module.PARAMETERS)

    def cases() -> list[_Case]:
        others = variations(robot, names, seed, extent.variations, extent.zeros)
        seeds = ((seed, 1, number) for number in itertools.count())
        return [_Case(x, count, s) for x, s in zip(others, seeds, strict=False)]

    for number, case in enumerate(_once(known, names, cases)):
        other = case.robot
        try:
            evaluation = Results(module, prepared(module, other))
            there = Results(numpy, prepared(numpy, other)) if numpy else None
        except (Exception, SystemExit) as error:  # Whatever was done to the module.
            yield failed("prepare", OTHER_PARAMETERS, f"{type(error).__name__}: {error}")
            return
        yield from _compare_again(evaluation, case, extent.singly, OTHER_PARAMETERS)
        usual = States.random(case.tree, count, (seed, 1, number))
        also = ", other parameters"
        yield from invariants.compare_with_itself(evaluation, there, other, unknown, usual, also)
        few = usual.first(extent.derivatives)
        yield from compare_derivatives(
            evaluation, ComplexSteps(numpy or module, other), other, few, also
        )


def refuse_wrong(robot: Robot, numpy_source: str, progress: Progress = lambda _: None) -> None:
    """Verify emitted NumPy functions quickly, before they are written.

    Raises `WrongModuleError` if a comparison fails.
    """
    progress("verifying")
    try:
        module = module_of(numpy_source)
        comparisons = compare_module(
            module, robot, [formulated(NewtonEuler(Tree(robot)))], _FEW_STATES, 0, extent=QUICK
        )
    except (Exception, SystemExit) as error:  # Whatever was emitted.
        comparisons = [failed("the module", "", error)]
    failures = [failure_text(c) for c in comparisons if not c.passed]
    if failures:
        raise WrongModuleError(robot.name, failures, len(comparisons))


class _Text(importlib.abc.InspectLoader):
    """A loader of a module whose source is at hand."""

    def __init__(self, source: str) -> None:
        self._source = source

    def get_source(self, fullname: str) -> str:
        """The source, whatever the name."""
        return self._source


def module_of(source: str) -> ModuleType:
    """The module of emitted NumPy source."""
    module = ModuleType("emitted")
    _Text(source).exec_module(module)
    return module
