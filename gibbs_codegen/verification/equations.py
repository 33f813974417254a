"""Everything that a module computes, compared with a formulation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from gibbs_codegen.robot.layout import StateEntries
from gibbs_codegen.verification.comparison import Comparison, Results, compared, explained
from gibbs_codegen.verification.constraints import ACCELERATION, Constraints, Row
from gibbs_codegen.verification.formulation import Formulation, Quantities
from gibbs_codegen.verification.newton_euler import wrench_sizes
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array, cross, times

# A few units in the last place.
_ROUNDING = 1e-15
# Roundings of single precision: as many may come together for each joint.
_ROUNDINGS = 4
# Nodes at which rotations of up to 100 rad are integrated to rounding.
_NODES = 48

Values = Mapping[str, Array]


class Expected:
    """Values of all functions at some states by a formulation, and the natural `sizes` there."""

    def __init__(self, formulation: Formulation, states: States, single: bool = False) -> None:
        """Compute what is expected; `single` is whether the module computes in single precision."""
        tree = formulation.tree
        quantities = formulation.at(states).with_passive(tree, states)
        self.sizes = Sizes(tree, states)
        self._name = formulation.name
        self._limit = max(formulation.limit, _ROUNDING * self.sizes.disparity**formulation.growth)
        self._rounding = float(np.finfo(np.float32 if single else np.float64).eps)
        if single:
            self._limit = _ROUNDINGS * self._rounding * tree.size
        inputs = input_matrix(tree, quantities)
        self._matrix = quantities.mass_matrix[:, tree.free][:, :, tree.free]
        driven = times(inputs, states.u)[:, tree.free]
        pushed = driven + wrench_forces(tree, quantities, states)
        # With the sizes of what is added to those that `Sizes.balance` knows.
        self._driven = {
            "forward_dynamics": (driven, 0.0 * driven),
            "forward_dynamics_with_wrenches": (pushed, self.sizes.free_pushed),
        }
        residual = quantities.residual[:, tree.free]
        held: list[Row] = []
        if tree.constraints:
            constraint_rows = Constraints(tree, self._rounding).rows(
                quantities, states, self.sizes, residual + driven
            )
            for label, value, size in constraint_rows:
                if label == ACCELERATION:
                    self._driven[label] = driven + value, size
                else:
                    held.append((label, value, size))
        rows = [
            *held,
            *((label, residual + by, size) for label, (by, size) in self._driven.items()),
            *_system(tree, quantities, inputs, states, self.sizes),
            *frame_rows(tree, quantities, states, self.sizes),
            *mass_rows(tree, quantities, states, self.sizes),
            *displacement_rows(tree, states),
        ]
        self.rows: dict[str, tuple[Array, Array]] = {
            label: (theirs, size) for label, theirs, size in rows
        }
        self.rows |= quantities.actuators or {}

    def compare_functions(
        self, evaluation: Results, states: States, against: str, singly: bool = False
    ) -> list[Comparison]:
        """Compare all functions of a module with what is expected, at the same states or the first.

        `against` replaces the formulation's name; `singly` is whether to compute state by state. A
        function that returned nothing fails with the reason.
        """
        rows = self.compare(evaluation.all(states, singly), against)
        return explained(rows, evaluation.faults)

    def compare(self, values: Values, against: str = "") -> list[Comparison]:
        """Compare results, under the names of `Results.results`, with what is expected.

        There may be fewer or more states at the end; errors are relative to the natural sizes.
        """
        count = min(*map(len, values.values()), len(self._matrix))
        # Where angles are large, rounding their sums is what limits the rest.
        angles = np.maximum(1.0, self._rounding * self.sizes.angles[:count] / self._limit)
        comparisons = []
        for label in filter(self.rows.__contains__, values):
            ours, (theirs, size) = values[label][:count], self.rows[label]
            if label in self._driven:  # Unlike the accelerations, M a is well-conditioned.
                size = self.sizes.balance(ours) + size[:count]
                with np.errstate(invalid="ignore"):  # Infinite ones are infinitely far off.
                    ours = times(self._matrix[:count], ours)
            size = size[:count] * angles.reshape(-1, *[1] * (size.ndim - 1))
            comparisons.append(
                compared(label, against or self._name, ours, theirs[:count], size, self._limit)
            )
        return comparisons


def input_matrix(tree: Tree, quantities: Quantities) -> Array:
    """Generalised forces (s, size, nu) of unit inputs, thrusts and then the arm's own efforts."""
    rotors = len(tree.motors)
    directions = np.array([motor.direction for motor in tree.motors]).reshape(-1, 3)
    thrusts = times(quantities.poses[:, :rotors, :3, :3], directions)
    drags = np.array([motor.drag for motor in tree.motors])[:, None] * thrusts
    wrenches = np.concatenate([thrusts, drags], axis=-1)
    driven = np.einsum("skij,ski->sjk", quantities.jacobians[:, :rotors], wrenches)
    gains = tree.gains[tree.driven].T
    return np.concatenate([driven, np.broadcast_to(gains, (len(driven), *gains.shape))], axis=-1)


def _system(
    tree: Tree, quantities: Quantities, inputs: Array, states: States, sizes: Sizes
) -> Iterator[Row]:
    """The equations of motion M a = R + B u, torques of the constraints, energies, hybrid system.

    Each array that a function returns has its name, its value, and the sizes of its entries.
    """
    free, constrained = tree.free, tree.constrained
    matrix = quantities.mass_matrix[:, free][:, :, free]
    residual = quantities.residual[:, free]
    inverse = quantities.inverse_dynamics
    driven = times(inputs, states.u)
    yield "mass_matrix", matrix, sizes.free_matrix
    yield "mass_matrix_and_residual.mass_matrix", matrix, sizes.free_matrix
    yield "residual", residual, sizes.free_effort
    yield "mass_matrix_and_residual.residual", residual, sizes.free_effort
    yield "input_matrix", inputs[:, free], sizes.inputs[:, free]
    yield "inverse_dynamics", inverse[:, free], sizes.free_inertial_effort
    effort = sizes.inertial_effort + sizes.driven
    yield "constraint_torques", (inverse - driven)[:, constrained], effort[:, constrained]
    by_parts = np.sum(states.a * (0.5 * times(matrix, states.a) - residual), axis=-1)
    yield "gibbs", by_parts, sizes.gibbs
    yield "kinetic_energy", quantities.kinetic_energy, sizes.kinetic
    yield "potential_energy", quantities.potential_energy, sizes.potential
    # The hybrid system: all joints, the torques of the constraints, and θ̈ = 0 for those.
    moving, more = slice(tree.count), (0, len(tree.constrained))
    row, square = ((0, 0), more), ((0, 0), more, more)
    torques = tree.count + np.arange(len(tree.constrained))
    matrix = np.pad(quantities.mass_matrix[:, moving, moving], square)
    matrix[:, tree.constrained, torques] = -1.0
    matrix[:, torques, tree.constrained] = 1.0
    yield (
        "hybrid_mass_matrix",
        matrix,
        np.pad(sizes.matrix[:, moving, moving], square, constant_values=1.0),
    )
    size = np.pad(sizes.effort[:, moving], row, constant_values=1.0)
    yield "hybrid_residual", np.pad(quantities.residual[:, moving], row), size
    columns = ((0, 0), more, (0, 0))
    size = np.pad(sizes.inputs[:, moving], columns, constant_values=1.0)
    yield "hybrid_input_matrix", np.pad(inputs[:, moving], columns), size


def displacement_rows(tree: Tree, states: States) -> Iterator[tuple[str, Array, Array]]:
    """Name, value and sizes of entries of what each function of displacements should return.

    The velocities of the states serve as displacements as well.
    """
    layout = tree.layout
    if layout.is_quaternion:
        from scipy.spatial.transform import Rotation  # Late, as SciPy takes long to import.

        q, v = layout.q, layout.v
        attitude = states.q[:, q.attitude]
        turn, step = states.v[:, v.attitude], states.v[:, v.position]
        rotation = Rotation.from_quat(attitude)
        rates, moved = np.zeros_like(states.q), np.zeros_like(states.q)
        vector, scalar = attitude[:, :3], attitude[:, 3:]
        turning = scalar * turn + cross(vector, turn)
        falling = -np.sum(vector * turn, axis=-1, keepdims=True)
        rates[:, q.attitude] = 0.5 * np.concatenate([turning, falling], axis=-1)
        rates[:, q.position] = rotation.apply(step)
        rates[:, q.joints] = states.v[:, v.joints]
        ends = (rotation * Rotation.from_rotvec(turn)).as_quat()
        ends *= np.where(np.sum(ends * attitude, axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
        moved[:, q.attitude] = ends
        moved[:, q.position] = states.q[:, q.position] + rotation.apply(times(_gains(turn), step))
        moved[:, q.joints] = states.q[:, q.joints] + states.v[:, v.joints]
        back = Rotation.from_quat(states.q0[:, q.attitude]).inv()
        way = back.apply(states.q1[:, q.position] - states.q0[:, q.position])
        turns = (back * Rotation.from_quat(states.q1[:, q.attitude])).as_rotvec()
        apart = np.zeros_like(states.v)
        apart[:, v.attitude] = turns
        apart[:, v.position] = np.linalg.solve(_gains(turns), way[..., None])[..., 0]
        apart[:, v.joints] = states.q1[:, q.joints] - states.q0[:, q.joints]
    elif layout.turns_with_base:
        yield from _level_rows(tree, states)
        return
    else:
        rates, moved, apart = states.v, states.q + states.v, states.q1 - states.q0
    places, twists = _largest(layout.q, states.q), _largest(layout.v, states.v)
    yield "coordinate_rates", rates, twists[:, _kinds(layout.q)]
    yield "integrate", moved, (places + twists)[:, _kinds(layout.q)]
    yield "difference", apart, (places + places[:1])[:, _kinds(layout.v)]


def _level_rows(tree: Tree, states: States) -> Iterator[tuple[str, Array, Array]]:
    """The same of a base that stays level, whose x and y, and velocities, are complex numbers."""
    layout = tree.layout
    yaw = range(layout.q.size)[layout.q.attitude][0]
    start, end, v = states.q0, states.q1, np.zeros_like(states.q)
    v[:, layout.paired] = states.v
    v[:, layout.q.angles] = tree.spread(states.v)[:, tree.wheels]
    turned, turning = np.exp(1j * start[:, yaw]), end[:, yaw] - start[:, yaw]
    rates, moved, apart = v.copy(), start + v, end - start

    def swept(angle: Array) -> Array:
        """The mean of the directions while the base turns by an angle."""
        return np.where(angle == 0.0, 1.0, np.expm1(1j * angle) / (1j * angle + (angle == 0.0)))

    step, way = v[:, 0] + 1j * v[:, 1], apart[:, 0] + 1j * apart[:, 1]
    gain = swept(turning)
    for rows, begin, plane in (
        (rates, 0.0, turned * step),
        (moved, start, turned * swept(v[:, yaw]) * step),
        (apart, 0.0, way / turned / gain),
    ):
        rows[:, :2] = np.stack([plane.real, plane.imag], axis=-1) + (begin + 0.0 * start)[:, :2]
    places, twists = _largest(layout.q, states.q), _largest(layout.q, v)
    kinds = _kinds(layout.q)
    yield "coordinate_rates", rates, twists[:, kinds]
    yield "integrate", moved, (places + twists)[:, kinds]
    # Next to whole turns hardly any displacement leads far, so that errors grow.
    size, gain = (places + places[:1])[:, kinds], np.abs(gain)[:, None]
    growth = 1.0 / gain + 2.0 / gain**2 / np.maximum(1.0, np.abs(turning))[:, None]
    size = size * np.where(kinds == 0, np.maximum(1.0, growth), 1.0)
    yield "difference", apart[:, layout.paired], size[:, layout.paired]


def _kinds(entries: StateEntries) -> Array:
    """For each entry 0 if it is a length, else 1."""
    return np.array([int(unit[0] != "m") for unit in entries.units])


def _largest(entries: StateEntries, values: Array) -> Array:
    """The largest length of each state, and the largest of the other entries and 1, (s, 2)."""
    kinds = _kinds(entries)
    along, about = (np.abs(values[:, kinds == kind]).max(axis=-1, initial=0.0) for kind in (0, 1))
    return np.stack([along, np.maximum(about, 1.0)], axis=-1)


def _gains(turns: Array) -> Array:
    """Matrices (s, 3, 3) by which turns (s, 3) of a displacement change its linear part.

    It is the integral of the rotation over the turn, by Gauss and Legendre's nodes.
    """
    from scipy.spatial.transform import Rotation  # Late, as SciPy takes long to import.

    places, weights = np.polynomial.legendre.leggauss(_NODES)
    shares = np.multiply.outer(0.5 * (1.0 + places), turns)
    turned = Rotation.from_rotvec(shares.reshape(-1, 3)).as_matrix()
    return np.tensordot(0.5 * weights, turned.reshape(*shares.shape, 3), 1)


def frame_rows(tree: Tree, quantities: Quantities, states: States, sizes: Sizes) -> Iterator[Row]:
    """Points, the motion of the named frames, and what wrenches on these do.

    Each array that a function returns has its name, its value, and the sizes of its entries.
    """
    rotors = len(tree.motors)
    poses, jacobians = quantities.poses[:, rotors:], quantities.jacobians[:, rotors:]
    jacobians = jacobians[..., tree.free]
    reach = sizes.reach[:, None, None]
    if quantities.positions is not None:
        yield "positions", quantities.positions, reach
    size = np.ones_like(poses)
    size[..., :3, 3:] = reach[..., None]
    yield from _of_frames(tree, "pose", poses, size)
    # Gears and wheels turn faster than what moves them.
    turns = np.abs(tree.gains[tree.turns][:, tree.free]).max(axis=0, initial=0.0)
    size = np.maximum(1.0, turns) * np.ones_like(jacobians)
    size[..., :3, :] = sizes.length * np.maximum(1.0 / sizes.scales, turns)
    yield from _of_frames(tree, "jacobian", jacobians, size)
    rate, twist = sizes.rate[:, None, None], np.repeat([sizes.length, 1.0], 3)
    velocities = times(jacobians, states.v[:, None])
    size = rate * np.broadcast_to(twist, velocities.shape)
    yield "frame_velocities", velocities, size
    yield "wrench_forces", wrench_forces(tree, quantities, states), sizes.free_pushed
    if quantities.bias_accelerations is not None:
        yield from _of_frames(tree, "bias_acceleration", quantities.bias_accelerations, rate * size)


def _of_frames(tree: Tree, label: str, values: Array, size: Array) -> Iterator[Row]:
    """Rows of the functions of all frames, `values` (s, frames, …), and of the tip by itself."""
    yield f"frame_{label}s", values, size
    if tree.tip is not None:
        yield f"tip_{label}", values[:, tree.tip], size[:, tree.tip]


def wrench_forces(tree: Tree, quantities: Quantities, states: States) -> Array:
    """Generalised forces (s, nv), N m and N, of the wrenches on the named frames."""
    jacobians = quantities.jacobians[:, len(tree.motors) :][..., tree.free]
    return np.einsum("sfij,sfi->sj", jacobians, states.W)


def mass_rows(tree: Tree, quantities: Quantities, states: States, sizes: Sizes) -> Iterator[Row]:
    """The centre of mass, momentum, gravity, and the wrenches that joints pass on."""
    if quantities.centre_of_mass is not None:
        reach = sizes.reach[:, None] + sizes.length
        yield "centre_of_mass", quantities.centre_of_mass, np.repeat(reach, 3, axis=-1)
    if quantities.centre_jacobian is not None:
        jacobian = quantities.centre_jacobian[..., tree.free]
        size = np.broadcast_to(sizes.length / sizes.scales, jacobian.shape)
        yield "centre_of_mass_jacobian", jacobian, size
    if quantities.momentum is not None:
        turning = (sizes.units[:, tree.turns] ** 2).max(axis=-1, initial=0.0)
        size = np.stack([np.full_like(turning, tree.mass * sizes.length), turning], axis=-1)
        size = np.repeat(size * sizes.rate[:, None], 3, axis=-1)
        yield "centroidal_momentum", quantities.momentum, size
    if quantities.gravity_forces is not None:
        weight = abs(tree.gravity) * np.sqrt(tree.mass)
        yield "gravity_forces", quantities.gravity_forces[:, tree.free], sizes.free_units * weight
    if quantities.joint_wrenches is not None:
        spin = sizes.rate**2 + np.abs(states.a / sizes.scales).sum(axis=-1)
        acceleration = abs(tree.gravity) + sizes.length * spin
        size = wrench_sizes(tree, acceleration, spin, states.u)
        pulled = tree.passive.pull_sizes(tree.at_joints(states.q), tree.spread(states.v))
        size = size + (1.0 + tree.reach) * pulled[:, None, None]
        yield "joint_wrenches", quantities.joint_wrenches, size
        if quantities.loaded_joint_wrenches is not None:
            forces, moments = (np.abs(x).sum(axis=1) for x in np.split(states.W, 2, axis=-1))
            moments = moments + tree.reach * forces.sum(axis=-1, keepdims=True)
            size = size + np.concatenate([forces, moments], axis=-1).max(axis=0)[None, None, :]
            yield "joint_wrenches_with_wrenches", quantities.loaded_joint_wrenches, size
