"""Steps of time, said once for attitude angles and quaternions."""

from __future__ import annotations

from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Node, Program, variable

State = tuple[Node, Node]


def semi_implicit_euler(robot: Functions, q: Node, v: Node, u: Node, h: Node) -> State:
    """v_next = v + h a, and q_next is q after the displacement h v_next."""
    v_next = v + h * robot.forward_dynamics(q, v, u)
    return robot.integrate(q, h * v_next), v_next


def runge_kutta_4(robot: Functions, q: Node, v: Node, u: Node, h: Node) -> State:
    """A Runge-Kutta method of fourth order (Celledoni, Marthinsen and Owren, 2003).

    A quaternion moves by exponentials alone, without commutators; for attitude angles it is the
    classical method.
    """
    half = 0.5 * h
    a1 = robot.forward_dynamics(q, v, u)
    q2, v2 = robot.integrate(q, half * v), v + half * a1
    a2 = robot.forward_dynamics(q2, v2, u)
    q3, v3 = robot.integrate(q, half * v2), v + half * a2
    a3 = robot.forward_dynamics(q3, v3, u)
    q4, v4 = robot.integrate(q2, h * (v3 - 0.5 * v)), v + h * a3
    a4 = robot.forward_dynamics(q4, v4, u)
    sixth = h / 6.0
    q_half = robot.integrate(q, half * (v + sixth * (a1 + a2 - a3)))
    q_next = robot.integrate(q_half, half * (v + sixth * (a1 + a2 + 3.0 * a3)))
    return q_next, v + sixth * (a1 + 2.0 * a2 + 2.0 * a3 + a4)


METHODS = {"euler": semi_implicit_euler, "rk4": runge_kutta_4}


def step_program(robot: Functions, method: str) -> Program:
    """A step with constant inputs: q (nq), v (nv), u (nu) and h to q_next and v_next."""
    q, v = robot.state()
    u, h = variable("u", robot.inputs), variable("h", uniform=True)
    q_next, v_next = METHODS[method](robot, q, v, u, h)
    return Program(f"step_{method}", (q, v, u, h), {"q_next": q_next, "v_next": v_next})
