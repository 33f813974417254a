"""Names that entries of arguments have within emitted functions.

An entry that the robot file gives no name is called as in the lists of a module, such as theta_7
and v_theta_7. Names that people give may be anything: a word of C or Python, or what another
variable is called. They get endings that nothing else has: forearm_q, forearm_v, forearm_F.
"""

from __future__ import annotations

from gibbs_codegen.robot.coordinates import frame_names, inputs
from gibbs_codegen.robot.layout import layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import coordinate_of

# Components of a wrench.
WRENCH_PARTS = ("fx", "fy", "fz", "tx", "ty", "tz")
_ENDINGS = {"q": "q", "v": "v", "a": "rate", "q0": "q0", "q1": "q1"}
_BEGINNINGS = {"q": "", "v": "v_", "a": "a_", "q0": "q0_", "q1": "q1_"}


def local_names(robot: Robot) -> dict[str, tuple[str, ...]]:
    """Names of the entries of all arguments.

    Args:
        robot: The robot.

    Returns:
        By argument: q, v, a, u, W, q0 and q1.
    """
    layout = layout_of(robot)
    given = {
        coordinate_of(robot, i)
        for i in robot.moving
        if robot.links[i - 1].coordinate or robot.links[i - 1].name
    }
    names = {}
    for argument, ending in _ENDINGS.items():
        entries = (layout.v if argument in "va" else layout.q).names
        names[argument] = tuple(
            f"{entry}_{ending}" if entry in given else f"{_BEGINNINGS[argument]}{entry}"
            for entry in entries
        )
    names["u"] = _input_names(robot, given)
    names["W"] = tuple(f"W_{frame}_{part}" for frame in frame_names(robot) for part in WRENCH_PARTS)
    return names


def _input_names(robot: Robot, given: set[str]) -> tuple[str, ...]:
    """Names of the inputs: F_1, or rotor_F where it has a name, and likewise of the joints."""
    named = [rotor.name is not None for rotor in robot.thrusters] or [False] * robot.rotors
    named += [coordinate_of(robot, i) in given for i in robot.moving]
    names = []
    for entry, has_name in zip(inputs(robot), named, strict=True):
        letter, _, rest = entry.name.partition("_")
        names.append(f"{rest}_{letter}" if has_name else entry.name)
    return tuple(names)
