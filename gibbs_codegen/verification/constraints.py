"""Effects of constraints of frames, by dense matrices from a formulation's masses and Jacobians.

Forces are the least by the pseudo-inverse of J M⁻¹ Jᵀ. An error of theirs is a share of the terms
that they are made of, times how badly that is conditioned; where it is not clear which rank it has,
nothing is compared.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gibbs_codegen.robot.parts.constraint import ROWS, Constraint
from gibbs_codegen.verification.comparison import UNKNOWN
from gibbs_codegen.verification.formulation import Quantities
from gibbs_codegen.verification.states import Sizes, States
from gibbs_codegen.verification.tree import Tree
from gibbs_codegen.verification.vectors import Array, Sized, cross, times

# Name of an array that a function returns, its value, and the sizes of its entries.
Row = tuple[str, Array, Array]
ACCELERATION = "constrained_forward_dynamics.acceleration"
# Singular values of rows, as shares of the largest, that are zero; and how many times the rounding
# error of a module the squares of those are that are not, clearly.
_ZERO, _CLEAR = 1e-13, 1e3
# As many times rounding are rows of nothing else, and shares of rows that are not zero.
_LOST = 100.0


class FrameMotion(NamedTuple):
    """Placement (s, 3, 3) and (s, 3), Jacobian (s, 6, nv) and bias (s, 6) of a frame; its number.

    The bias is zero where the formulation has none.
    """

    rotation: Array
    position: Array
    jacobian: Array
    bias: Array


class Constraints:
    """The constraints of a robot, whose module computes with some rounding error."""

    def __init__(self, tree: Tree, rounding: float) -> None:
        self._tree, self._ties, self._rounding = tree, tree.constraints, rounding

    def rows(
        self, values: Quantities, states: States, sizes: Sizes, driven: Array
    ) -> Iterator[Row]:
        """Each array that a function returns, with sizes of its entries.

        In place of the accelerations come the generalised forces Jᵀ f. `driven` (s, nv) is R + B u.
        """
        tree = self._tree
        parts = [self._rows(tie, values, states, sizes) for tie in self._ties]
        errors, jacobian, bias, back = (
            Sized(*(np.concatenate(x, axis=1) for x in zip(*terms, strict=True)))
            for terms in zip(*parts, strict=True)
        )
        yield "constraint_errors", *errors
        yield "constraint_jacobian", *jacobian
        if values.bias_accelerations is not None:
            yield "constraint_bias", *bias
        owners = np.repeat(range(len(self._ties)), [len(ROWS[tie.holds]) for tie in self._ties])
        held = states.active[:, owners]
        matrix = values.mass_matrix[:, tree.free][:, :, tree.free]
        jacobian = Sized(*(part * held[:, :, None] for part in jacobian))
        j = jacobian.value
        moved = np.linalg.solve(matrix, np.swapaxes(j, -1, -2))
        inverse, condition = self._inverse(matrix, jacobian, sizes)
        clear = np.isfinite(condition)
        unknown = np.where(clear, 0.0, UNKNOWN)
        condition = np.where(clear, condition, 1.0)
        size = _largest(inverse) * condition[:, None, None] + unknown[:, None, None]
        yield "operational_inertia", inverse, size

        units = sizes.free_units

        def taken(right: Sized) -> tuple[Sized, Sized]:
            """Forces that take accelerations or velocities away, and their effect on v."""
            size = times(np.abs(inverse), held * right.size) * condition[:, None]
            size = held * size.max(axis=-1, keepdims=True)  # Some rows may hold what cannot move.
            forces = -times(inverse, held * right.value)
            moves = units * times(np.abs(moved), size)
            moves = moves.max(axis=-1, keepdims=True) / units + unknown[:, None]
            return Sized(forces, size + unknown[:, None]), Sized(times(moved, forces), moves)

        moving = Sized(times(j, states.v), times(jacobian.size, np.abs(states.v)))
        left = 1.0 + states.restitution[:, owners]
        impulses, gain = taken(Sized(left * moving.value, left * moving.size))
        yield "impact.velocities_after", states.v + gain.value, np.abs(states.v) + gain.size
        yield "impact.impulses", *impulses
        _, way = taken(errors)
        yield "constraint_projection", *way
        if values.bias_accelerations is not None:
            free = np.linalg.solve(matrix, driven[..., None])[..., 0]
            value = times(j, free) + bias.value + back.value
            size = times(jacobian.size, np.abs(free)) + bias.size + back.size
            forces, _ = taken(Sized(value, size))
            yield "constrained_forward_dynamics.forces", *forces
            pushed = np.einsum("slj,sl->sj", jacobian.size, forces.size)
            yield ACCELERATION, np.einsum("slj,sl->sj", j, forces.value), pushed

    def conditions(self, values: Quantities, states: States, sizes: Sizes) -> tuple[Array, Array]:
        """By how much errors of forces are stretched, (s,), and M⁻¹ Jᵀ (s, nv, l) of the active.

        The first is infinity where that is not clear.
        """
        rows = [self._rows(tie, values, states, sizes)[1] for tie in self._ties]
        owners = np.repeat(range(len(rows)), [row.value.shape[1] for row in rows])
        held = states.active[:, owners, None]
        jacobian = Sized(*(np.concatenate(x, axis=1) * held for x in zip(*rows, strict=True)))
        matrix = values.mass_matrix[:, self._tree.free][:, :, self._tree.free]
        moved = np.linalg.solve(matrix, np.swapaxes(jacobian.value, -1, -2))
        return self._inverse(matrix, jacobian, sizes)[1], moved

    def _inverse(self, matrix: Array, jacobian: Sized, sizes: Sizes) -> tuple[Array, Array]:
        """The pseudo-inverse of J M⁻¹ Jᵀ, and by how much it stretches errors."""
        units = sizes.free_units[:, None]
        shares, axes = np.linalg.eigh(matrix / sizes.free_matrix)
        shares = np.maximum(shares, np.finfo(float).tiny)
        # Digits that M takes, next to a singular attitude nearly all.
        lost = shares[:, -1] / shares[:, 0]
        ends = np.cumsum([len(ROWS[tie.holds]) for tie in self._ties])
        vectors = jacobian.value / units @ axes / np.sqrt(shares)[:, None]
        natural = np.linalg.norm(jacobian.size / units, axis=-1) / np.sqrt(shares[:, -1:])
        return _pseudo_inverse(vectors, natural, ends, lost, self._rounding)

    def _rows(
        self, tie: Constraint, values: Quantities, states: States, sizes: Sizes
    ) -> list[Sized]:
        """Errors, Jacobian, bias, and return of errors to zero, of one constraint."""
        from scipy.spatial.transform import Rotation  # Late, as SciPy takes long to import.

        frame, carrier = (self._frame(name, values, states) for name in (tie.frame, tie.to))
        turn = Rotation.from_quat(tie.anchor.quaternion).as_matrix()
        axes = np.swapaxes(carrier.rotation @ turn, -1, -2)
        arm = frame.position - carrier.position
        way = arm - times(carrier.rotation, np.array(tie.anchor.xyz))
        lift = np.broadcast_to(np.eye(6), (len(arm), 6, 6)).copy()
        lift[:, :3, 3:] = np.swapaxes(cross(arm[:, None], np.eye(3)), -1, -2)
        lift[:, :3, 3:] *= -1.0
        jacobian = frame.jacobian - lift @ carrier.jacobian
        moving = times(jacobian, states.v)
        spin, own_spin = (times(x.jacobian, states.v)[:, 3:] for x in (carrier, frame))
        relative = frame.bias - times(lift, carrier.bias)
        relative[:, :3] -= cross(spin, cross(spin, arm)) + 2.0 * cross(spin, moving[:, :3])
        relative[:, 3:] -= cross(spin, own_spin)
        apart = axes @ frame.rotation
        sine = np.stack(
            [apart[:, i - 1, i - 2] - apart[:, i - 2, i - 1] for i in range(3)], axis=-1
        )
        linear, angular = np.zeros((2, len(arm), 3, 6))
        linear[:, :, :3] = angular[:, :, 3:] = axes
        rows, errors = linear, times(axes, way)
        reach = (sizes.reach + np.linalg.norm(tie.anchor.xyz))[:, None]
        rate, added = sizes.rate[:, None], np.zeros((len(arm), 1))
        if tie.holds == "frame":
            rows, errors = _under(linear, angular), np.hstack([errors, 0.5 * sine])
        if tie.holds == "hinge":
            axis = np.array(tie.axis) / np.linalg.norm(tie.axis)
            across = _across(axis)
            rows = _under(linear, across @ angular)
            errors = np.hstack([errors, cross(axis, apart @ axis) @ across.T])
        if tie.holds == "plane":
            normal = np.array(tie.normal) / np.linalg.norm(tie.normal)
            rows, errors = normal[None] @ linear, errors @ normal[:, None]
        length = sizes.length * np.ones_like(reach)
        if tie.holds == "distance":
            rows = way[:, None, :] @ np.broadcast_to(np.eye(3, 6), (len(way), 3, 6)) / tie.distance
            errors = (np.sum(way**2, -1, keepdims=True) - tie.distance**2) / (2.0 * tie.distance)
            added = np.sum(moving[:, :3] ** 2, axis=-1, keepdims=True) / tie.distance
            stretch = reach / tie.distance
            length, reach = length * stretch, reach * stretch + tie.distance
        count = errors.shape[-1]
        turns = np.arange(count) >= (3 if tie.holds in ("frame", "hinge") else count)
        unit = np.where(turns, 1.0, length)
        speed = unit * rate
        w, z = tie.frequency, tie.damping_ratio
        error = Sized(errors, np.where(turns, 1.0, reach))
        back = 2.0 * z * w * times(rows, moving) + w**2 * errors
        quick = speed * rate * np.where(turns, 1.0, np.maximum(1.0, reach / sizes.length))
        return [
            error,
            Sized(rows @ jacobian, unit[:, :, None] / sizes.scales),
            Sized(times(rows, relative) + added, 4.0 * quick + np.abs(added)),
            Sized(back, 2.0 * z * w * speed + w**2 * error.size),
        ]

    def _frame(self, name: str | None, values: Quantities, states: States) -> FrameMotion:
        """A frame of the robot, or the world."""
        tree = self._tree
        count, width = len(states), len(tree.free)
        if name is None:
            still = np.broadcast_to(np.eye(3), (count, 3, 3)), np.zeros((count, 3))
            return FrameMotion(*still, np.zeros((count, 6, width)), np.zeros((count, 6)))
        k = tree.names.index(name)
        pose = values.poses[:, len(tree.motors) + k]
        jacobian = values.jacobians[:, len(tree.motors) + k][..., tree.free]
        bias = values.bias_accelerations
        frame_bias = np.zeros((count, 6)) if bias is None else bias[:, k]
        return FrameMotion(pose[:, :3, :3], pose[:, :3, 3], jacobian, frame_bias)


def _under(first: Array, second: Array) -> Array:
    return np.concatenate([first, second], axis=1)


def _across(axis: Array) -> Array:
    """The first two axes (2, 3) of the frame turned by R_z·R_x whose third is an axis."""
    from scipy.spatial.transform import Rotation  # Late, as SciPy takes long to import.

    x, y, z = axis
    level = np.hypot(x, y)
    about_z = np.arctan2(x, -y) if level > 0.0 else 0.0
    turn = Rotation.from_euler("ZX", [about_z, np.arctan2(level, z)]).as_matrix()
    return turn.T[:2]


def _largest(matrices: Array) -> Array:
    return np.abs(matrices).max(axis=(-1, -2), keepdims=True) * np.ones_like(matrices)


def _pseudo_inverse(
    vectors: Array, natural: Array, ends: Array, lost: Array, rounding: float
) -> tuple[Array, Array]:
    """Pseudo-inverses (s, l, l) of V Vᵀ, and by how much they stretch errors, inf if unclear.

    `natural` (s, l) are lengths beside which those of rows of zeros are rounding, and `lost` (s,)
    is how much larger the errors of the vectors are than that. Modules take one constraint after
    the other, so the rank of all up to each of the `ends` must be clear, and what is least clear on
    the way loses digits of redundant rows that follow.
    """
    shape = *vectors.shape[:2], vectors.shape[1]
    inverses, conditions = np.zeros(shape), np.ones(len(vectors))
    for k, rows in enumerate(vectors):
        lengths, worst = np.linalg.norm(rows, axis=-1), 1.0
        least = np.maximum(natural[k], np.linalg.norm(lengths))
        there = np.flatnonzero(lengths > _LOST * rounding * least)
        if not len(there):
            continue
        zero = _ZERO * lost[k]
        clear = max(_CLEAR * rounding, (_LOST * zero * lengths.max() / lengths[there].min()) ** 2)
        for end in ends:
            some = there[there < end]
            if not len(some):
                continue
            shares = np.linalg.svd(rows[some] / lengths[some, None], compute_uv=False)
            shares = (shares / shares[0]) ** 2
            kept = shares > zero**2
            if not clear < 1.0 or (kept & (shares < clear)).any():
                worst = np.inf
                break
            worst = max(worst, 1.0 / shares[kept][-1])
        conditions[k] = lost[k] * worst
        if np.isfinite(worst):
            axes, values, _ = np.linalg.svd(rows[there], full_matrices=False)
            axes, values = axes[:, : np.sum(kept)], values[: np.sum(kept)]
            inverses[k][np.ix_(there, there)] = axes / values**2 @ axes.T
    return inverses, conditions
