"""What each row of the equation map says, as a comparison of its functions with its cell.

A check gets the functions that the row names, what the cell shows, and the names that are known
after it. It calls the functions, and fails unless they give what the cell has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import sympy as sp
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from mpl_toolkits.mplot3d.art3d import Line3D, Poly3DCollection

from gibbs_codegen.derivation.forward_kinematics import mounted_frames
from gibbs_codegen.derivation.gibbs import ACCELERATION, OMEGA_DOT
from gibbs_codegen.derivation.hybrid import reduced_system
from gibbs_codegen.derivation.symbolic_robot import SymbolicRobot
from gibbs_codegen.equations.pages import as_markdown
from gibbs_codegen.equations.readable_chain import readable_chain
from gibbs_codegen.program.lower import Slice, lower
from gibbs_codegen.robot.description import Description
from gibbs_codegen.robot.file import read_robot
from gibbs_codegen.robot.model import Frame, Pose
from gibbs_codegen.symbolic.tape import Tape

Names = dict[str, Any]
Check = Callable[[list[Callable[..., Any]], Any, Names], None]
CHECKS: dict[str, Check] = {}

ROBOT, _ = read_robot("hexarotor_3link")
TIME = sp.Symbol("t")


def row(*labels: str) -> Callable[[Check], Check]:
    """Enter a check for rows of the table."""

    def enter(check: Check) -> Check:
        CHECKS.update(dict.fromkeys(labels, check))
        return check

    return enter


def symbols() -> SymbolicRobot:
    return SymbolicRobot.of(ROBOT, Tape())


def numbers(symbolic: SymbolicRobot, entries: Sequence[Any], **state: Any) -> Any:
    """Values of expressions on a robot's tape, for q, v, a and u by their names."""
    names = {letter: [s.name for s in getattr(symbolic, letter)] for letter in state}
    defaults = symbolic.parameters.defaults
    wanted = Slice("wanted", tuple(state), (((len(entries),), tuple(map(sp.sympify, entries))),))
    program = lower(symbolic.tape, {k: tuple(v) for k, v in names.items()}, [*defaults], [wanted])
    return np.array(program.evaluate("wanted", defaults, state)[0])


def system_in_numbers(symbolic: SymbolicRobot, system: Any, **state: Any) -> list[Any]:
    """Matrix, residual and columns of the inputs of a linear system."""
    parts = (system.matrix, [system.residual], system.inputs)
    flat = [numbers(symbolic, [e for r in part for e in r], **state) for part in parts]
    matrix, (residual,), columns = (
        x.reshape(np.shape(part)) for x, part in zip(flat, parts, strict=True)
    )
    return [matrix, residual, columns]


def value(expression: sp.Expr, state: Names) -> float:
    """An expression with numbers for its symbols, by their names."""
    known = {x: sp.Float(state[x.name]) for x in expression.free_symbols}
    return float(expression.xreplace(known))


def state_of(robot: Any, **vectors: Any) -> Names:
    """Numbers by the names of symbols: q, v, a and u of a robot, and its parameters."""
    symbolic = SymbolicRobot.of(robot, Tape())
    found: Names = dict(symbolic.parameters.defaults)
    for letter, vector in vectors.items():
        pairs = zip(getattr(symbolic, letter), vector, strict=True)
        found |= {symbol.name: entry for symbol, entry in pairs}
    return found


def content(figure: Any) -> list[Any]:
    """What is drawn in a figure, wherever its layout puts it."""
    assert isinstance(figure, Figure)
    found: list[Any] = []
    for artist in figure.findobj():
        if isinstance(artist, Text):
            found.append(artist.get_text())
        elif isinstance(artist, Line3D):
            found.extend(artist.get_data_3d())
        elif isinstance(artist, Line2D):
            found.append(artist.get_xydata())
        elif isinstance(artist, PolyCollection) and not isinstance(artist, Poly3DCollection):
            found.extend([artist.get_facecolors(), *(p.vertices for p in artist.get_paths())])
    return found


def same_picture(drawn: Any, shown: Any) -> None:
    FigureCanvasAgg(drawn).draw()
    FigureCanvasAgg(shown).draw()
    for ours, theirs in zip(content(drawn), content(shown), strict=True):
        if isinstance(ours, str):
            assert ours == theirs
        else:
            np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)


@row("Eq. 1")
def _(functions: Any, shown: Any, names: Names) -> None:
    (decompose,) = functions
    assert decompose(ROBOT) == names["chains"]


@row("Eq. 2")
def _(functions: Any, shown: Any, names: Names) -> None:
    (link_gibbs_function,) = functions
    difference = sp.expand(link_gibbs_function() - names["integral"])
    assert not difference.free_symbols & {*ACCELERATION, *OMEGA_DOT}


@row("Eq. 3")
def _(functions: Any, shown: Any, names: Names) -> None:
    """The library's S at the notebook's state, against its sum of the chains' S_j."""
    (gibbs_function,) = functions
    symbolic = symbols()
    whole = gibbs_function(symbolic.tape, symbolic.root, symbolic.reduced_tree, symbolic.state)
    at = {"q": names["q"], "v": names["v"]}
    still, moved = (numbers(symbolic, [whole], **at, a=k * names["a"])[0] for k in (0, 1))
    assert len(names["of_chains"]) == len(symbolic.open_chains)
    assert np.isclose(sum(names["of_chains"].values()), moved - still, rtol=1e-10)


@row("Eq. 4")
def _(functions: Any, shown: Any, names: Names) -> None:
    """The lowest point of S − Qᵀθ̈ in the notebook satisfies the library's rows."""
    (generalised_inertia_forces,) = functions
    robot, _ = read_robot(names["file"])
    symbolic = SymbolicRobot.of(robot, Tape())
    rows = generalised_inertia_forces(
        symbolic.tape, symbolic.root, symbolic.reduced_tree, symbolic.state
    )
    at = {
        "q": names["posture"],
        "v": names["rates"],
        "a": names["state"](*names["motion"]),
    }
    assert np.allclose(numbers(symbolic, rows, **at)[names["joints"]], names["torques"])


@row("Eq. 5")
def _(functions: Any, shown: Any, names: Names) -> None:
    """The recursion, and S₂ of the notebook differentiated by brute force."""
    (generalised_inertia_forces,) = functions
    readable, form = readable_chain(ROBOT, 2), names["form"]
    symbolic = readable.symbolic
    rows = generalised_inertia_forces(
        symbolic.tape, symbolic.root, symbolic.open_chains[1][1], readable.state
    )
    rng = np.random.default_rng(11)
    for found, acceleration in zip(rows, form.accelerations, strict=True):
        brute = sp.diff(form.gibbs, acceleration)
        every = {s.name for s in found.free_symbols | brute.free_symbols}
        at = dict(zip(sorted(every), rng.normal(size=len(every)), strict=True))
        assert np.isclose(value(found, at), value(brute, at), rtol=1e-9, atol=1e-12)


@row("Eq. 6")
def _(functions: Any, shown: Any, names: Names) -> None:
    (link_partials,) = functions
    for found, theirs in zip(link_partials(), ("eq_6_force", "eq_6_moment"), strict=True):
        assert sp.expand(sp.Matrix(found) - names[theirs]).is_zero_matrix


def forces_of_chain_five(generalised_forces: Any, names: Names) -> Any:
    """F₅ at the notebook's posture, with its thrust of motor 6."""
    readable = readable_chain(ROBOT, 5)
    inputs = [names["thrust"] if k == 5 else 0.0 for k in range(len(names["u"]))]
    known = state_of(ROBOT, q=names["q"], u=inputs) | {"theta_6": np.deg2rad(120)}
    known |= {str(symbol): float(number) for symbol, number in structural(readable).items()}
    return np.array([value(sp.sympify(f), known) for f in generalised_forces(readable)])


def structural(readable: Any) -> dict[Any, Any]:
    """Named constants of a chain by their definitions, in numbers."""
    known = state_of(ROBOT)
    found: dict[Any, Any] = {}
    for symbol, expression in readable.definitions:
        found[symbol] = value(sp.sympify(expression), known | {str(s): n for s, n in found.items()})
    return found


@row("Eq. 7")
def _(functions: Any, shown: Any, names: Names) -> None:
    (generalised_forces,) = functions
    forces = forces_of_chain_five(generalised_forces, names)
    work = names["change"] @ forces + names["change"][3] * names["torque"]
    assert np.isclose(work, names["work_by_displacement"], rtol=1e-8)


@row("Eq. 8")
def _(functions: Any, shown: Any, names: Names) -> None:
    (chain_matrix,) = functions
    border = [-float(entries[-1]) for entries in chain_matrix(symbols(), 5)[:-1]]
    assert border == names["zeta"].tolist()


@row("Eq. 9")
def _(functions: Any, shown: Any, names: Names) -> None:
    (decompose,) = functions
    unknowns = Description(ROBOT).hybrid_coordinates
    own = [unknowns[place.row + 1].name for place in names["five_places"]]
    assert own == [*decompose(ROBOT)[4].coordinates]


@row("Eq. 10")
def _(functions: Any, shown: Any, names: Names) -> None:
    (chain_system,) = functions
    symbolic = symbols()
    _, _, columns = system_in_numbers(
        symbolic, chain_system(symbolic, 5), q=names["q"], v=names["v"]
    )
    forces = columns[:7, 5] * names["thrust"] + names["zeta"] * names["torque"]
    assert np.isclose(names["change"] @ forces, names["work_by_columns"], rtol=1e-12)


@row("Eq. 11")
def _(functions: Any, shown: Any, names: Names) -> None:
    """What is missing in the rows of each chain in hover."""
    (chain_system,) = functions
    for chain in names["chains"]:
        symbolic = symbols()
        matrix, residual, columns = system_in_numbers(
            symbolic, chain_system(symbolic, chain.number), q=names["level"], v=names["rest"]
        )
        torques = [names["torques"][arm - 2] for arm in chain.constrained]
        unknowns = np.array([*np.zeros(len(chain.coordinates)), *torques])
        left = matrix @ unknowns - residual - columns @ names["hover"]
        shown_left = list(names["missing"][chain.number].values())
        assert np.allclose(left[: len(shown_left)], shown_left, atol=1e-12)
        assert len(shown_left) == len(chain.coordinates)


def same_forces(found: Sequence[Any], equation: Any) -> None:
    """Whether a chain's forces are those of the equation in print, by its definitions."""
    lines = dict(equation.lines)
    for force, entry in zip(found, equation.forces, strict=True):
        difference = sp.sympify(force) - lines.get(entry, entry)
        at = {s.name: 0.1 + 0.3 * i for i, s in enumerate(sorted(difference.free_symbols, key=str))}
        assert abs(value(difference, at)) < 1e-12


@row("Eq. 12")
def _(functions: Any, shown: Any, names: Names) -> None:
    (generalised_forces,) = functions
    same_forces(generalised_forces(readable_chain(ROBOT, 1)), names["chain_one"])


@row("Eq. 13")
def _(functions: Any, shown: Any, names: Names) -> None:
    rotor_column, motor_torque_about_rod = functions
    symbolic = symbols()
    chain, serial = symbolic.open_chains[4]
    column = rotor_column(symbolic, serial, symbolic.chain_bodies(chain), 6)
    column[3] = motor_torque_about_rod(symbolic, 6)
    assert np.allclose(numbers(symbolic, column, q=names["q"]), names["psi"][6], atol=1e-12)


@row("Eq. 14")
def _(functions: Any, shown: Any, names: Names) -> None:
    (constraint_torques,) = functions
    symbolic = symbols()
    state = {letter: names[letter] for letter in "qvau"}
    found = numbers(symbolic, constraint_torques(symbolic), **state)
    assert np.isclose(found[6 - 2], names["torque_by_row_4"], rtol=1e-10)


@row("Eq. 15")
def _(functions: Any, shown: Any, names: Names) -> None:
    """Chain 5 alone in hover, all eight unknowns."""
    (chain_system,) = functions
    symbolic = symbols()
    matrix, residual, columns = system_in_numbers(
        symbolic, chain_system(symbolic, 5), q=names["level"], v=names["rest"]
    )
    assert np.allclose(matrix @ names["alone"], residual + columns @ names["hover"], atol=1e-9)
    assert matrix[3, 7] == -1
    assert matrix[7, 3] == 1


@row("Eq. 16")
def _(functions: Any, shown: Any, names: Names) -> None:
    chain, generalised_forces = functions
    _, unknowns, _, forces = names["five"].bordered
    readable = chain(ROBOT, 5)
    assert unknowns == [*readable.state.accelerations, *readable.torques]
    same_forces(generalised_forces(readable), names["five"])
    assert forces == [*names["five"].forces, 0]


def without_definitions(equation: Any) -> str:
    return as_markdown(replace(equation, lines=(), closed=True)).split("**Symbols**")[0]


@row("Eq. 17")
def _(functions: Any, shown: Any, names: Names) -> None:
    (chain_equation,) = functions
    assert names["five"] == chain_equation(ROBOT, 5, 15)
    assert shown.data == without_definitions(chain_equation(ROBOT, 6, 15))


@row("Eq. 18")
def _(functions: Any, shown: Any, names: Names) -> None:
    hybrid_from_chains, hybrid_system = functions
    symbolic = symbols()
    systems = {
        "added": hybrid_from_chains(symbolic),
        "emitted": hybrid_system(symbolic, reduced_system(symbolic)),
    }
    for theirs, system in systems.items():
        found = system_in_numbers(symbolic, system, q=names["q"], v=names["v"])
        for ours, array in zip(found, names[theirs], strict=True):
            np.testing.assert_allclose(ours, array, atol=1e-12)


@row("Eq. 19")
def _(functions: Any, shown: Any, names: Names) -> None:
    hybrid_names, chain_equation = functions
    found = hybrid_names(ROBOT)
    assert names["in_system"] == " & ".join(found[name].latex for name in names["module"].INPUTS)
    pairs = [pair for j in range(1, 7) for pair in chain_equation(ROBOT, j, 18).inputs]
    assert names["pairs"] == pairs


def assert_follows(motion: Any, t: Any, x: sp.Expr, y: sp.Expr, z: sp.Expr) -> None:
    """Whether a motion (k, 3, 3) has the place, velocity and acceleration of a path in TIME."""
    for order in range(3):
        for axis, place in enumerate((x, y, z)):
            wanted = [float(place.diff(TIME, order).subs(TIME, now)) for now in t[::50]]
            np.testing.assert_allclose(motion[::50, order, axis], wanted, rtol=1e-12, atol=1e-12)


@row("Eq. 20")
def _(functions: Any, shown: Any, names: Names) -> None:
    """The formulas as the paper has them, against the notebook's and the scenario's path."""
    (read_scenario,) = functions
    path = (
        2 * sp.exp(-TIME / 20) * sp.cos(TIME),
        2 * sp.exp(-TIME / 20) * sp.sin(TIME),
        sp.exp(TIME / 10),
    )
    for motion in (names["centre"], read_scenario("paper").base(names["t"])):
        assert_follows(motion, names["t"], *path)


@row("Eq. 21")
def _(functions: Any, shown: Any, names: Names) -> None:
    (read_scenario,) = functions
    path = -2 * sp.cos(sp.pi / 2 + TIME), sp.Integer(-2), -2 * sp.sin(2 * TIME)
    for motion in (names["tip"], read_scenario("paper").arm.tip(names["t"])):
        assert_follows(motion, names["t"], *path)


@row("Fig. 1", "Fig. 2")
def _(functions: Any, shown: Any, names: Names) -> None:
    (draw,) = functions
    same_picture(draw(ROBOT), shown)


@row("Fig. 3")
def _(functions: Any, shown: Any, names: Names) -> None:
    """The Jacobian of a frame in the seat of motor 6, and of the notebook's seat."""
    (frame_jacobians,) = functions
    # On the base frames are given from its centre O₂.
    place = names["seat"] - names["level"][-3:] - np.array([ROBOT.base.arm(1).length, 0.0, 0.0])
    robot = replace(ROBOT, frames=(Frame("seat", 0, Pose(tuple(map(float, place)))),))
    symbolic = SymbolicRobot.of(robot, Tape())
    mounted = mounted_frames(symbolic)
    jacobian = frame_jacobians(symbolic, mounted)[[m.name for m in mounted].index("seat")]
    entries = [entry for line in jacobian[:3] for entry in line]
    found = numbers(symbolic, entries, q=names["level"]).reshape(3, -1)
    theirs = names["jacobian"](names["joints"], names["seat"])
    assert np.allclose(found[:, [0, 1, 2, 6, 7, 8]], theirs[:, [0, 1, 2, 4, 5, 6]], atol=1e-12)


def same_zeros(entries: Any, equation: Any, part: int) -> None:
    """Whether a chain's array is zero where the equation in print has a 0."""
    written = equation.bordered[part]
    for ours, theirs in zip(entries, written, strict=True):
        pairs = zip(ours, theirs, strict=True) if isinstance(theirs, list) else [(ours, theirs)]
        assert all((mine == 0) == (other == 0) for mine, other in pairs)


@row("Fig. 4")
def _(functions: Any, shown: Any, names: Names) -> None:
    chain_equation, chain_matrix = functions
    assert shown.data == without_definitions(chain_equation(ROBOT, 6, 15))
    same_zeros(chain_matrix(symbols(), 5), names["five"], 0)
    same_zeros(chain_matrix(symbols(), 6), names["arm_chain"], 0)


@row("Fig. 5")
def _(functions: Any, shown: Any, names: Names) -> None:
    chain_equation, chain_system = functions
    assert shown.data == without_definitions(chain_equation(ROBOT, 6, 15))
    for number, equation in ((5, names["five"]), (6, names["arm_chain"])):
        system = chain_system(symbols(), number)
        same_zeros(system.residual, equation, 2)
        same_zeros([any(line) for line in system.inputs], equation, 3)


@row("Fig. 6", "Fig. 7", "Fig. 8", "Fig. 9")
def _(functions: Any, shown: Any, names: Names) -> None:
    (draw,) = functions
    same_picture(draw(ROBOT), shown)


@row("Fig. 10", "Fig. 11")
def _(functions: Any, shown: Any, names: Names) -> None:
    (draw,) = functions
    same_picture(draw(names["flight"]), shown)
