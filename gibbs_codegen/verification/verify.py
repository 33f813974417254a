"""Verification of a generated module: what is compared with what, in which order.

compare_contents    names and parameters          against the robot file      (contents)
compare_equations   every function, at states     against formulations that share no code with
                                                  the derivation              (equations)
    Newton–Euler, and again for other parameters                              (newton_euler)
    Lagrange                                                                  (lagrange)
    Pinocchio, MuJoCo where installed                        (pinocchio_tree, mujoco_tree)
compare_invariants  every function                against the others          (invariants)
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from types import ModuleType

from gibbs_codegen.robot import Robot
from gibbs_codegen.verification.comparison import Comparison, worst
from gibbs_codegen.verification.contents import compare_contents
from gibbs_codegen.verification.equations import compare_equations
from gibbs_codegen.verification.evaluation import Evaluation
from gibbs_codegen.verification.formulation import Formulation, NotApplicableError
from gibbs_codegen.verification.invariants import compare_invariants
from gibbs_codegen.verification.lagrange import Lagrange
from gibbs_codegen.verification.newton_euler import NewtonEuler
from gibbs_codegen.verification.own_units import InOwnUnits
from gibbs_codegen.verification.parameters import parameter_values
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree

Progress = Callable[[str], None]

OTHER_PARAMETERS = "other parameters"
# Module of this package, and the library that it needs.
_LIBRARIES = (
    ("Pinocchio", "pinocchio_tree", "pinocchio"),
    ("MuJoCo", "mujoco_tree", "mujoco"),
)
# Numbers that Lagrange's equations keep at once: states times coordinates times points.
_MOST_NUMBERS = 3_000_000
# Of the matrices of all states of a part.
_MOST_ENTRIES = 400_000


@dataclass
class Verification:
    """Comparisons by back end; what could not be done, and why."""

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
        """Whether there were comparisons, and none failed."""
        return self.count > 0 and not self.failures


def formulations(robot: Robot) -> tuple[list[Formulation], dict[str, str]]:
    """Every formulation that can be had for a robot; for the others, why not."""
    tree = Tree(robot)
    found: list[Formulation] = [NewtonEuler(tree), Lagrange(tree)]
    not_done = {}
    for name, module, library in _LIBRARIES:
        if importlib.util.find_spec(library) is None:
            not_done[name] = f"{library} is not installed"
            continue
        try:
            there = importlib.import_module(f"gibbs_codegen.verification.{module}")
            found.append(InOwnUnits(getattr(there, name), tree))
        except (ImportError, NotApplicableError) as error:
            not_done[name] = str(error)
    return found, not_done


def compare_module(
    module: ModuleType,
    robot: Robot,
    against: Sequence[Formulation],
    count: int,
    seed: int,
    progress: Progress = lambda _: None,
) -> list[Comparison]:
    """Everything about one back end, at the `count` random states of a seed.

    `against` are formulations of the robot, of which the first gives the natural sizes of things.
    """
    contents = compare_contents(module, robot)
    if not all(comparison.passed for comparison in contents):
        # With other coordinates, or none, there is nothing that could be compared.
        return [
            c if c.passed else replace(c, fault=f"{c.fault} (no function was compared)")
            for c in contents
        ]
    # A part at a time, so that no number of states takes all memory.
    most = max(1, _MOST_ENTRIES // against[0].tree.size ** 2)
    parts = []
    for number, first in enumerate(range(0, count, most)):
        some = min(most, count - first)
        parts.append(_compare_functions(module, robot, against, some, (seed, number), progress))
    return contents + worst(parts)


def _compare_functions(
    module: ModuleType,
    robot: Robot,
    against: Sequence[Formulation],
    count: int,
    seed: tuple[int, int],
    progress: Progress,
) -> list[Comparison]:
    tree = against[0].tree
    states = States.random(tree, count, seed)
    evaluation = Evaluation(module)
    values = evaluation.all(states)
    sizes = Sizes(against[0], states)
    comparisons = []
    for formulation in against:
        progress(formulation.name)
        few = count
        if isinstance(formulation, Lagrange):
            few = max(1, min(count, _MOST_NUMBERS // (formulation.points * tree.size)))
        comparisons += compare_equations(
            {name: value[:few] for name, value in values.items()},
            formulation,
            states.first(few),
            sizes if few == count else Sizes(against[0], states.first(few)),
        )
    progress("invariants")
    comparisons += compare_invariants(evaluation, values, states, sizes, tree)
    progress(OTHER_PARAMETERS)
    other, faults = _with_other_parameters(module, robot, count, seed)
    return _explained(comparisons, evaluation.faults) + _explained(other, faults)


def _with_other_parameters(
    module: ModuleType, robot: Robot, count: int, seed: tuple[int, int]
) -> tuple[list[Comparison], dict[str, str]]:
    """The equations once more, with every number of the robot file changed at run time."""
    from gibbs_codegen.verification.variation import variation
    other = variation(robot, module.PARAMETERS, seed[0], 0)
    numbers = parameter_values(other)
    try:
        constants = module.prepare({name: numbers[name] for name in module.PARAMETERS})
    except (Exception, SystemExit) as error:  # Whatever was done to the module.
        fault = f"{type(error).__name__}: {error}"
        return [Comparison("prepare", OTHER_PARAMETERS, 0, float("inf"), 0.0, fault)], {}
    formulation = NewtonEuler(Tree(other))
    states = States.random(formulation.tree, count, (*seed, 1))
    evaluation = Evaluation(module, constants)
    values = evaluation.all(states)
    sizes = Sizes(formulation, states)
    comparisons = compare_equations(values, formulation, states, sizes)
    return [replace(c, against=OTHER_PARAMETERS) for c in comparisons], evaluation.faults


def _explained(comparisons: list[Comparison], faults: dict[str, str]) -> list[Comparison]:
    """Comparisons with the reason why a function gave nothing."""
    return [
        comparison
        if comparison.passed
        else replace(comparison, fault=faults.get(comparison.what.split(".")[0], comparison.fault))
        for comparison in comparisons
    ]
