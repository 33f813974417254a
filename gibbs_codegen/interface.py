"""The table of emitted functions: what every generated module offers, one row per function.

A row says what a function takes and returns, what that means, and what derives each output. The
derivation, the targets, the loader, the verification and the simulator read it. To add a function,
add a row here and, for an array that nothing derives yet, an entry to `derivation.functions`.

Shapes are given by letters: q the coordinates, h the hybrid unknowns, u the inputs, k the points,
c the constrained joints; digits stand for themselves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

# States in a block of the C functions for batches: as many doubles as the widest registers hold.
LANES = 8
# Constants of every generated module.
DATA = ("NAME", "ATTITUDE", "COORDINATES", "HYBRID_COORDINATES", "INPUTS", "POINTS", "PARAMETERS")


@dataclass(frozen=True)
class Argument:
    """An argument, with an entry for each coordinate or input: `width` is the letter of those.

    An entry is named `prefix` and their name, and has their unit, followed by `per_time`.
    """

    width: str
    meaning: str
    prefix: str = ""
    per_time: str = ""


ARGUMENTS = {
    "q": Argument("q", "coordinates"),
    "v": Argument("q", "their rates", "v_", "/s"),
    "a": Argument("q", "their accelerations", "a_", "/s^2"),
    "u": Argument("u", "inputs"),
}


@dataclass(frozen=True)
class Output:
    """An array that a function returns: its name, its shape, and the unit of its entries.

    `derivation` is the name under which `derivation.functions` has what derives it. `entries` says
    what the entries are; `targets.documentation` puts a robot's lists in place of names in braces.
    """

    name: str
    shape: str
    unit: str
    derivation: str
    entries: str = "[{unit}]"

    def sizes(self, lengths: Mapping[str, int]) -> tuple[int, ...]:
        """The shape in numbers.

        Args:
            lengths: The length that each letter stands for.

        Returns:
            The size of each axis.
        """
        return tuple(int(x) if x.isdigit() else lengths[x] for x in self.shape)


@dataclass(frozen=True)
class Row:
    """A row of the table; `source` is the equation that the function implements."""

    name: str
    arguments: str
    outputs: tuple[Output, ...]
    summary: str
    source: str
    details: str = ""


_INERTIAS = "[kg m^2] between angles, [kg] between lengths, [kg m] between both"
_LEVERS = "[N/N], [N m/N] and [N m/(N m)], by row and column"
_TWISTS = "[m/rad] or [1] in the first rows, [1] or [rad/m] in the others"
_MOTIONS = "[m/s^2] in the first three, [rad/s^2] in the others"
_MASS_MATRIX = Output("mass_matrix", "qq", "kg m^2, kg or kg m", "mass_matrix", _INERTIAS)
_RESIDUAL = Output("residual", "q", "N m or N", "residual", "{forces}")
_ROWS = (
    Row(
        "mass_matrix_and_residual",
        "qv",
        (_MASS_MATRIX, _RESIDUAL),
        "Mass matrix M and residual R of M a = R + B u, in one pass.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        "R holds the velocity terms and gravity, with the sign of a force.",
    ),
    Row(
        "mass_matrix",
        "q",
        (_MASS_MATRIX,),
        "Mass matrix M of M a = R + B u, symmetric, both triangles filled.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        "The same matrix as Pinocchio's crba gives for these coordinates.",
    ),
    Row(
        "residual",
        "qv",
        (_RESIDUAL,),
        "Residual R of M a = R + B u: velocity terms and gravity, with the sign of a force.",
        "eqs. 5, 11 and 18, reduced to the free coordinates",
        "It is minus what Pinocchio calls nonLinearEffects.",
    ),
    Row(
        "input_matrix",
        "q",
        (Output("input_matrix", "qu", "N/N, N m/N or N m/(N m)", "input_matrix", _LEVERS),),
        "Input matrix B of M a = R + B u.",
        "eqs. 7-13",
        "Column k holds the generalised forces of a unit of input k.",
    ),
    Row(
        "forward_dynamics",
        "qvu",
        (Output("acceleration", "q", "rad/s^2 or m/s^2", "forward_dynamics", "{accelerations}"),),
        "Accelerations a of M a = R + B u.",
        "eq. 19, solved for the free coordinates",
        "Accurate at every attitude: next to +-90 degrees of the middle attitude angle the "
        "accelerations of the other two grow as the inverse of its cosine, and what is computed "
        "from them loses as many digits. Where links without mass or thickness let joints move "
        "nothing, as a massless wrist with two axes in line, results are huge, infinite or not a "
        "number.",
    ),
    Row(
        "inverse_dynamics",
        "qva",
        (Output("force", "q", "N m or N", "inverse_dynamics", "{forces}"),),
        "Generalised forces M a - R that the motion needs; B u supplies them.",
        "eqs. 4-6",
        "The partial derivatives of the Gibbs function by the accelerations.",
    ),
    Row(
        "hybrid_mass_matrix",
        "q",
        (Output("mass_matrix", "hh", "kg m^2, kg, kg m or 1", "hybrid_mass_matrix", _INERTIAS),),
        "Matrix I_H of the hybrid system I_H a_H = R_H + B_H u.",
        "eqs. 15, 18 and 19",
        "Rows and columns are in the order of HYBRID_COORDINATES; the last rows hold the "
        "constrained joints, the last columns their torques.",
    ),
    Row(
        "hybrid_residual",
        "qv",
        (Output("residual", "h", "N m, N or rad/s^2", "hybrid_residual", "{hybrid_forces}"),),
        "Residual R_H of the hybrid system I_H a_H = R_H + B_H u.",
        "eqs. 15, 18 and 19",
        "Entries are in the order of HYBRID_COORDINATES.",
    ),
    Row(
        "hybrid_input_matrix",
        "q",
        (Output("input_matrix", "hu", "N/N, N m/N or N m/(N m)", "hybrid_input_matrix", _LEVERS),),
        "Input matrix B_H of the hybrid system I_H a_H = R_H + B_H u.",
        "eqs. 12, 13 and 18",
        "Rows are in the order of HYBRID_COORDINATES, columns in that of INPUTS.",
    ),
    Row(
        "constraint_torques",
        "qvau",
        (Output("torque", "c", "N m", "constraint_torques", "{constraint_torques}"),),
        "Torques that keep the base arms 2 ... N from turning against arm 1.",
        "eqs. 14 and 15",
        "Linear in the accelerations and inputs, which need not fit each other.",
    ),
    Row(
        "gibbs",
        "qva",
        (Output("value", "", "W/s", "gibbs"),),
        "Gibbs function S up to terms free of accelerations, in W/s.",
        "eqs. 2 and 3",
        "Gravity enters as the upward acceleration of the base, so that dS/da = M a - R.",
    ),
    Row(
        "kinetic_energy",
        "qv",
        (Output("energy", "", "J", "kinetic_energy"),),
        "Kinetic energy in J.",
        "eq. 2 with rates for accelerations",
    ),
    Row(
        "potential_energy",
        "q",
        (Output("energy", "", "J", "potential_energy"),),
        "Potential energy in J, zero at world Z = 0.",
        "gravity times the first moment of mass",
    ),
    Row(
        "positions",
        "q",
        (Output("position", "k3", "m", "positions", "{points} [{unit}]"),),
        "World positions of POINTS in m, one row each.",
        "forward kinematics",
    ),
    Row(
        "tip_pose",
        "q",
        (Output("pose", "44", "1 or m", "tip_pose", "axes [1] and position [m]"),),
        "Homogeneous transform from the tip's frame to the world.",
        "forward kinematics",
        "The tip's frame has the last link's axes; without an arm it is arm 1's, at O2.",
    ),
    Row(
        "tip_jacobian",
        "q",
        (Output("jacobian", "6q", "m/rad, rad/m or 1", "tip_jacobian", _TWISTS),),
        "Jacobian of the tip: linear rows, then angular rows, in world axes.",
        "forward kinematics",
        "It takes v to the velocity of the tip in m/s and rad/s.",
    ),
    Row(
        "tip_bias_acceleration",
        "qv",
        (Output("bias_acceleration", "6", "m/s^2 or rad/s^2", "tip_bias_acceleration", _MOTIONS),),
        "Acceleration of the tip where a is zero, gravity left out, in world axes.",
        "forward kinematics",
        "It is the Jacobian's rate times v: the tip accelerates at tip_jacobian(q) a plus this, "
        "linear entries first, then angular.",
    ),
)
FUNCTIONS: dict[str, Row] = {row.name: row for row in _ROWS}


@dataclass(frozen=True)
class Signature:
    """A function of one module: its arguments with their widths, and the shapes of its outputs."""

    name: str
    arguments: tuple[str, ...]
    widths: tuple[int, ...]
    shapes: tuple[tuple[int, ...], ...]


def module_signatures(module: Any) -> list[Signature]:
    """Signatures of the functions of a module.

    Args:
        module: A generated module, or what lists the same constants.

    Returns:
        The signatures, in the order of the table.
    """
    lists = (module.COORDINATES, module.HYBRID_COORDINATES, module.INPUTS, module.POINTS)
    found = signatures(*map(len, lists))
    return [s for s in found if "tip" in module.POINTS or not s.name.startswith("tip_")]


def signatures(coordinates: int, hybrid: int, inputs: int, points: int) -> list[Signature]:
    """Signatures of all functions, given the lengths of what a module lists.

    Args:
        coordinates: Number of COORDINATES.
        hybrid: Number of HYBRID_COORDINATES.
        inputs: Number of INPUTS.
        points: Number of POINTS.

    Returns:
        The signatures, in the order of the table.
    """
    constrained = (hybrid - coordinates) // 2
    lengths = {"q": coordinates, "h": hybrid, "u": inputs, "k": points, "c": constrained}
    found = []
    for row in FUNCTIONS.values():
        widths = tuple(lengths[ARGUMENTS[argument].width] for argument in row.arguments)
        shapes = tuple(output.sizes(lengths) for output in row.outputs)
        found.append(Signature(row.name, tuple(row.arguments), widths, shapes))
    return found
