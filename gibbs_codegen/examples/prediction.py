"""What a controller predicts with: a time step and a point of the robot, as CasADi's functions.

The step is semi-implicit Euler's, which evaluates the forward dynamics once. Dampers would make it
unstable where links are light: a motion with a damper d and an inertia I decays within I / d, which
may be a hundredth of a step. The step is stable for every damper if the dampers' torques are those
at its end. Since these are linear in the rates, that is the usual step of a robot whose joints have
an armature that is larger by h d:

    M (v⁺ − v) / h = R − D v⁺ + B u    is    (M + h D) (v⁺ − v) / h = R − D v + B u
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import casadi

from gibbs_codegen.errors import UsageError
from gibbs_codegen.robot.model import Link, Robot

# What a module must have to be predicted with.
DERIVATIVES = ("step_euler", "step_euler_derivatives", "frame_poses_derivatives")


@dataclass(frozen=True)
class Prediction:
    """A time step (q, v, u) -> (q_next, v_next) and a point, both differentiable once.

    `point` takes q to a position (3), world axes, m.
    """

    step: casadi.Function
    point: casadi.Function


def predicted_robot(robot: Robot, h: float) -> Robot:
    """The robot whose semi-implicit Euler step treats the dampers of another one's joints stably.

    It is the same, named so, with joints of a larger armature; `h` is the step, s.
    """

    def damped(link: Link) -> Link:
        passive = link.passive
        armature = passive.armature + h * passive.damping
        return replace(link, passive=replace(passive, armature=armature))

    links = tuple(map(damped, robot.links))
    return replace(robot, name=f"{robot.name}_predicted", links=links)


def compiled(module: ModuleType, frame: str, h: float) -> Prediction:
    """Predict with a module's compiled C functions and their exact derivatives.

    It has the C back end and the functions of `DERIVATIVES`; the origin of `frame` is the point.
    """
    step, poses = (
        casadi.external(f"{module.NAME}_casadi_{name}", library(module))
        for name in ("step_euler", "frame_poses")
    )
    return Prediction(_step(step, h), _point(poses, module.FRAMES.index(frame)))


def library(module: ModuleType) -> str:
    """Path of the shared library of a module with the C back end.

    Raises `UsageError` for another, such as NumPy where nothing compiles.
    """
    path = Path(module.__file__ or "")
    if path.suffix in ("", ".py"):
        raise UsageError(
            f"{module.NAME}: its C source is not compiled, and the controller predicts with "
            'compiled functions; load the module with backend="c", where CC or the machine has a '
            "C compiler that works (the log gibbs_codegen says why it does not)"
        )
    return str(path)


def traced(module: ModuleType, frame: str, h: float) -> Prediction:
    """Predict with CasADi's own symbols, which it differentiates itself.

    The module has the CasADi back end and the functions of `DERIVATIVES`.
    """
    return Prediction(
        _step(module.step_euler, h), _point(module.frame_poses, module.FRAMES.index(frame))
    )


def _step(step: casadi.Function, h: float) -> casadi.Function:
    """A time step of fixed length, with the Jacobian that the step of any length has."""
    q, v, u = (casadi.MX.sym(step.name_in(i), step.sparsity_in(i)) for i in range(3))
    outputs = step.call([q, v, u, h])
    jacobian = step.jacobian()
    blocks = jacobian.call([q, v, u, h, *map(_nothing, outputs)])
    by_all_but_h = [block for place, block in enumerate(blocks) if place % 4 < 3]
    return _with_jacobian("step", [q, v, u], outputs, by_all_but_h)


def _point(poses: casadi.Function, place: int) -> casadi.Function:
    """The origin of a frame, with the rows of the poses' Jacobian that belong to it."""
    q = casadi.MX.sym("q", poses.sparsity_in(0))
    rows, columns = poses.size_out(0)
    blocks = poses(q)
    by_q = poses.jacobian()(q, _nothing(blocks))
    first, row = rows * (columns - 1), 4 * place
    point = blocks[row : row + 3, columns - 1]
    return _with_jacobian("point", [q], [point], [by_q[first + row : first + row + 3, :]])


def _with_jacobian(
    name: str, inputs: list[casadi.MX], outputs: list[casadi.MX], blocks: list[casadi.MX]
) -> casadi.Function:
    """A function that CasADi differentiates by given blocks and not through its expressions.

    They are the derivative of each output by each input, those of the first output first.
    """
    unused = [casadi.MX.sym(f"out{i}", _nothing(o).sparsity()) for i, o in enumerate(outputs)]
    jacobian = casadi.Function(f"jac_{name}", [*inputs, *unused], blocks)
    return casadi.Function(name, inputs, outputs, {"custom_jacobian": jacobian})


def _nothing(value: casadi.MX) -> casadi.MX:
    """What CasADi gives a Jacobian for an output that it need not know."""
    return casadi.MX(*value.shape)
