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
# How names end of entries that people named, and how other names begin, by argument.
_ENDINGS = {"q": "q", "a": "rate"}
_BEGINNINGS = {"q": ""}
_OF_COORDINATES = ("q", "q0", "q1")
_OF_VELOCITIES = ("v", "a", "w", "q_dot", "v_dot", "a_dot")


def local_names(robot: Robot) -> dict[str, tuple[str, ...]]:
    """Names of the entries of all arguments, by the names of `interface.ARGUMENTS`."""
    layout = layout_of(robot)
    given = {
        coordinate_of(robot, i)
        for i in robot.moving
        if robot.links[i - 1].coordinate or robot.links[i - 1].name
    }
    names = {}
    for argument in (*_OF_COORDINATES, *_OF_VELOCITIES):
        entries = (layout.v if argument in _OF_VELOCITIES else layout.q).names
        ending = _ENDINGS.get(argument, argument)
        beginning = _BEGINNINGS.get(argument, f"{argument}_")
        names[argument] = tuple(
            f"{entry}_{ending}" if entry in given else f"{beginning}{entry}" for entry in entries
        )
    names["u"] = _input_names(robot, given)
    names["u_dot"] = tuple(f"{name}_dot" for name in names["u"])
    names["h"] = ("time_step",)
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
