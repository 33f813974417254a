"""Steps of time, said once for attitude angles and quaternions."""

from __future__ import annotations

from collections.abc import Callable

from gibbs_codegen.arrays.forward import jacobian
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.labels import labelled, named
from gibbs_codegen.arrays.nodes import Node, Program, beside, join, variable, zeros

State = tuple[Node, Node]
# Coordinates after a displacement (nv).
Move = Callable[[Node, Node], Node]
# Accelerations (nv) at q and v, so many halves of a step after its start.
Accelerate = Callable[[Node, Node, int], Node]


def semi_implicit_euler(move: Move, accelerate: Accelerate, q: Node, v: Node, h: Node) -> State:
    """v_next = v + h a, and q_next is q after the displacement h v_next."""
    a = named(accelerate(q, v, 0), "acceleration", "accelerations at the beginning")
    v_next = named(v + h * a, "v_next", "velocities after the step")
    return move(q, named(h * v_next, "displacement", "displacement by these")), v_next


def runge_kutta_4(move: Move, accelerate: Accelerate, q: Node, v: Node, h: Node) -> State:
    """A Runge-Kutta method of fourth order (Celledoni, Marthinsen and Owren, 2003).

    A quaternion moves by exponentials alone, without commutators; for attitude angles it is the
    classical method.
    """
    half = named(0.5 * h, "half")
    a1 = named(accelerate(q, v, 0), "acceleration", "accelerations at the beginning")
    q2 = named(move(q, half * v), "q2", "second stage, after half of the step")
    v2 = named(v + half * a1, "v2")
    a2 = named(accelerate(q2, v2, 1), "a2")
    q3 = named(move(q, half * v2), "q3", "third stage, there again, with its rates")
    v3 = named(v + half * a2, "v3")
    a3 = named(accelerate(q3, v3, 1), "a3")
    q4 = named(move(q2, h * (v3 - 0.5 * v)), "q4", "fourth stage, at the end")
    v4 = named(v + h * a3, "v4")
    a4 = named(accelerate(q4, v4, 2), "a4")
    sixth = named(h / 6.0, "sixth")
    halfway = move(q, half * (v + sixth * (a1 + a2 - a3)))
    q_half = named(halfway, "q_half", "both halves of the step, by the stages together")
    q_next = move(q_half, half * (v + sixth * (a1 + a2 + 3.0 * a3)))
    return q_next, v + sixth * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


def trapezoidal(move: Move, accelerate: Accelerate, q: Node, v: Node, h: Node) -> State:
    """Exact where accelerations are constant, and as stable as the semi-implicit Euler method."""
    v_next = v + h * accelerate(q, v, 0)
    return move(q, 0.5 * h * (v + v_next)), v_next


def classical_step(rate: Callable[[Node, int], Node], x: Node, h: Node) -> Node:
    """The state after h by the classical method of Runge and Kutta.

    `rate` gives the time derivative of a state so many halves of the step after its start.
    """
    k1 = rate(x, 0)
    k2 = rate(x + 0.5 * h * k1, 1)
    k3 = rate(x + 0.5 * h * k2, 1)
    k4 = rate(x + h * k3, 2)
    return x + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


def constrained_motion(
    robot: Functions, motion: State, u: Node, active: Node, pushed: Node | None
) -> State:
    """Accelerations (nv) under active constraints (g), and the forces of these.

    `pushed` are those without constraints under wrenches, if there are any.
    """
    a, forces = robot.constrained_forward_dynamics(*motion, u, active)
    if pushed is not None:
        # Constraints take of accelerations by wrenches what an impact takes of velocities.
        free = robot.forward_dynamics(*motion, u)
        left, more = robot.impact(motion[0], pushed - free, active, zeros(robot.constraints))
        a, forces = a + left, forces + more
    return a, forces


def projected(robot: Functions, move: Move, q: Node, v: Node, active: Node) -> State:
    """A state brought to where active constraints (g) are met: by a Newton step, and an impact."""
    q = move(q, robot.constraint_projection(q, active))
    return q, robot.impact(q, v, active, zeros(robot.constraints))[0]


METHODS = {"euler": semi_implicit_euler, "rk4": runge_kutta_4}


@labelled
def step_program(robot: Functions, method: str, *, one_length: bool = True) -> Program:
    """A step with constant inputs: q (nq), v (nv), u (nu) and h to q_next and v_next.

    All states share h, or if not of `one_length` each has its own.
    """
    q, v = robot.state()
    u, h = variable("u", robot.inputs), variable("h", uniform=one_length)

    def accelerate(q: Node, v: Node, _: int) -> Node:
        acceleration: Node = robot.forward_dynamics(q, v, u)
        return acceleration

    q_next, v_next = METHODS[method](robot.integrate, accelerate, q, v, h)
    return Program(f"step_{method}", (q, v, u, h), {"q_next": q_next, "v_next": v_next})


def emitted_step(robot: Functions, name: str) -> Program:
    """A step of time as a row of the table has it, by itself or with its derivatives.

    These are A (2 nv, 2 nv) by q and v, and B (2 nv, nu) by u.
    """
    method = name.removeprefix("step_").removesuffix("_derivatives")
    step = step_program(robot, method, one_length=False)
    if not name.endswith("_derivatives"):
        return step
    derived = jacobian(step, ("q", "v", "u"))
    derivatives = derived.outputs
    of_state, of_inputs = (
        join(*(beside(*(derivatives[f"{x}_next_by_{y}"] for y in by)) for x in "qv"))
        for by in ("qv", "u")
    )
    results = {x: derivatives[x] for x in step.outputs}
    return Program(name, step.inputs, {**results, "A": of_state, "B": of_inputs}, derived.labels)
