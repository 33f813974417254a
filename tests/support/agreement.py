"""How far a module is from the oracle, function by function, in units of what rounding allows.

Sizes are those of the terms that a result is summed from, not of the result: where large terms
cancel, as they do in degenerate machines, rounding is that of the terms. Each coordinate has its
own, so that a light tip is compared as closely as the heavy base that carries it.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np

from gibbs_codegen.robot.model import Body, Robot
from support.pinocchio_oracle import Oracle, spatial_inertia

Array = np.ndarray
# Largest error that rounding leaves, of the size of the terms.
TOLERANCE = 1e-13


@dataclass(frozen=True)
class States:
    """Rows of q, v, a and u."""

    q: Array
    v: Array
    a: Array
    u: Array


def random_states(robot: Robot, count: int, seed: int) -> States:
    """Random states, away from the singularity of the attitude."""
    rng = np.random.default_rng(seed)
    n = 6 + len(robot.links)
    q = rng.uniform(-np.pi, np.pi, (count, n))
    q[:, 1] = rng.uniform(-1.2, 1.2, count)
    v, a = rng.normal(size=(2, count, n))
    return States(q, v, a, rng.normal(size=(count, robot.rotors + len(robot.links))))


def errors(robot: Robot, module: ModuleType, states: States) -> dict[str, float]:
    """Largest error of each function over all states, in units of `TOLERANCE` of its terms.

    What is not finite is an infinite error. Forward dynamics counts twice: by what it leaves of
    M a = R + B u, and by its distance from the oracle's solution as far as rounding lets one know.
    """
    q, v, a, u = states.q, states.v, states.a, states.u
    batch = {
        "M": module.mass_matrix(q),
        "R": module.residual(q, v),
        "B": module.input_matrix(q),
        "I_H": module.hybrid_mass_matrix(q),
        "R_H": module.hybrid_residual(q, v),
        "B_H": module.hybrid_input_matrix(q),
        "forward": module.forward_dynamics(q, v, u),
        "inverse": module.inverse_dynamics(q, v, a),
        "torques": module.constraint_torques(q, v, a, u),
        "positions": module.positions(q),
        "pose": module.tip_pose(q),
        "jacobian": module.tip_jacobian(q),
        "bias": module.tip_bias_acceleration(q, v),
        "gibbs": module.gibbs(q, v, a) - module.gibbs(q, v, np.zeros_like(a)),
        "kinetic": module.kinetic_energy(q, v),
        "potential": module.potential_energy(q),
    }
    both = module.mass_matrix_and_residual(q, v)
    batch |= {"M of both": both[0], "R of both": both[1]}
    worst: dict[str, float] = {}
    oracle = Oracle(robot)
    for i in range(len(q)):
        ours = {name: values[i] for name, values in batch.items()}
        for name, error in _state_errors(oracle, ours, q[i], v[i], a[i], u[i]).items():
            worst[name] = max(worst.get(name, 0.0), error if error >= 0.0 else np.inf)
    return worst


def _state_errors(
    oracle: Oracle, ours: dict[str, Array], q: Array, v: Array, a: Array, u: Array
) -> dict[str, float]:
    robot, free, held = oracle.robot, oracle.free, oracle.held
    matrix, inputs = oracle.mass_matrix(q), oracle.input_matrix(q)
    bias = oracle.inverse_dynamics(q, v, np.zeros_like(q))
    inverse = oracle.inverse_dynamics(q, v, a)
    kinetic, potential = oracle.energies(q, v)
    tip = oracle.frames["tip"]
    jacobian, placement = oracle.point_jacobian(q, tip)
    places = oracle.positions(q)
    size = len(oracle.order)
    roots, carried, reach = root_sizes(oracle, q)
    own = roots[free]
    weight = np.sqrt(robot.total_mass)
    rate = np.abs(v).sum()
    at_rest = float(own @ np.abs(v)) * rate + robot.gravity * weight
    moving = at_rest + float(own @ np.abs(a))
    # The oracle's moments about a joint contain v × m v, which is zero but for rounding.
    rounding = 0.01 * carried * ((1.0 + reach) * rate) ** 2
    lever = float(np.abs(inputs).max())
    pushed = lever * float(np.abs(u).sum())
    mass, right = matrix[np.ix_(free, free)], inputs[free] @ u - bias[free]
    scaled = mass / np.outer(own, own)
    solution = np.linalg.solve(scaled, right / own)
    forward = own * ours["forward"]
    gain = (
        float(np.abs(forward).sum())
        + at_rest
        + float(np.abs(inputs[free] / own[:, None] @ np.abs(u)).max())
    )
    known = np.linalg.cond(scaled) * (float(np.abs(solution).sum()) + at_rest)
    terms = {
        "M": (mass, np.outer(own, own)),
        "M of both": (mass, np.outer(own, own)),
        "R": (-bias[free], own * at_rest + rounding[free]),
        "R of both": (-bias[free], own * at_rest + rounding[free]),
        "B": (inputs[free], lever),
        "R_H": (-bias, roots * at_rest + rounding),
        "B_H": (inputs, lever),
        "I_H": (matrix, np.outer(roots, roots)),
        "inverse": (inverse[free], own * moving + rounding[free]),
        "torques": ((inverse - inputs @ u)[held], roots[held] * moving + rounding[held] + pushed),
        "positions": (places, reach + np.abs(q[-3:]).max()),
        "pose": (placement.homogeneous, 1 + reach + np.abs(q[-3:]).max()),
        "jacobian": (jacobian[:, free], 1 + reach),
        "bias": (oracle.bias_acceleration(q, v, tip), (1 + reach) * rate**2),
        "gibbs": (a @ (0.5 * mass @ a + bias[free]), moving**2),
        "kinetic": (kinetic, float(own @ np.abs(v)) ** 2),
        "potential": (potential, robot.gravity * weight * (own[0] + weight * abs(q[-1]))),
    }
    ours = ours | {name: ours[name][:size] for name in ("R_H", "B_H")}
    ours["I_H"] = ours["I_H"][:size, :size]
    found = {name: _error(ours[name], *term) for name, term in terms.items()}
    found["M a = R + B u"] = _error(mass @ ours["forward"], right, own * gain + rounding[free])
    found["forward"] = _error(forward, solution, known)
    return found


def _error(ours: Array, theirs: Array, size: Array | float) -> float:
    """Largest error in units of the tolerance; what has no terms is zero, as the oracle rounds."""
    error = np.abs(np.asarray(ours) - theirs)
    if not np.isfinite(error).all():
        return np.inf
    sizes = np.broadcast_to(size, error.shape)
    allowed = np.where(sizes > 0, TOLERANCE * sizes, 1e-15 * sizes.max(initial=0.0))
    relative = np.divide(error, allowed, out=np.where(error > 0, np.inf, 0.0), where=allowed > 0)
    return float(relative.max(initial=0.0))


def root_sizes(oracle: Oracle, q: Array) -> tuple[Array, Array, float]:
    """Roots of the inertias that each coordinate's terms are made of, the masses that it carries,
    and the machine's reach.

    For a rotation the inertia is what all that it carries would have at the end of straightened
    links, for a translation the mass. In all coordinates, in the hybrid order.
    """
    robot = oracle.robot
    base, n = robot.base, len(robot.links)
    arms = [_moments(base.arm(k)) for k in range(1, robot.rotors + 1)]
    links = [_moments(link.body) for link in robot.links]
    steps = _steps(robot, q)
    longest = max(base.arm(k).length for k in range(1, robot.rotors + 1))
    outward = [sum(link.mass for link in links[i:]) for i in range(n)]
    joints = []
    for i, link in enumerate(robot.links):
        turned = sum(links[j].at(sum(steps[i + 1 : j + 1])) for j in range(i, n))
        joints.append(turned if link.joint == "revolute" else outward[i])
    far = [arm.at(longest) for arm in arms]
    far += [links[j].at(base.arm(1).length + sum(steps[: j + 1])) for j in range(n)]
    mass = robot.total_mass
    held = [arm.at(0.0) for arm in arms[1:]]
    reach = longest + sum(steps) + (robot.links[-1].body.length if n else 0.0)
    inertias = [*[sum(far)] * 3, *held, *joints, *[mass] * 3]
    carried = [*[mass] * 3, *(arm.mass for arm in arms[1:]), *outward, *[mass] * 3]
    return np.sqrt(inertias), np.array(carried), reach


@dataclass(frozen=True)
class _Moments:
    """Mass, distance of its centre, and trace of the inertia about it."""

    mass: float
    distance: float
    trace: float

    def at(self, further: float) -> float:
        """Inertia about a point that is `further` away from the body's joint than it could be."""
        return self.trace + self.mass * (self.distance + further) ** 2


def _moments(body: Body) -> _Moments:
    inertia = spatial_inertia(body)
    return _Moments(
        inertia.mass, float(np.linalg.norm(inertia.lever)), float(np.trace(inertia.inertia))
    )


def _steps(robot: Robot, q: Array) -> list[float]:
    """Length of the way from each joint to the next, as its numbers add up."""
    steps, before = [], 0.0
    for i, link in enumerate(robot.links):
        travel = abs(q[3 + i]) if link.joint == "prismatic" else 0.0
        steps.append(abs(before if link.a is None else link.a) + abs(link.d) + travel)
        before = link.body.length
    return steps
