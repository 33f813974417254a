"""Control laws: the inputs that are commanded at a time and in a state.

Computed torque is the inverse dynamics of the desired acceleration, corrected by the tracking
error: with those inputs each coordinate's error e obeys ë + d ė + k e = 0. With a quaternion that
holds for position and joints, and for the rotation vector of the attitude while its axis stays.

Inverse dynamics: M a − R = B u for the free coordinates. The entries of attitude and position are a
wrench on the base, which the allocation turns into thrusts. Each joint torque acts on its own
coordinate alone, so it is that entry of the left side, less what thrusts of rotors on links
contribute to it.

Integral action: a law remembers the integral z of each error e, and corrects as if the error were
e + i z, with a rate i that is given. So ë + d ė + k (e + i z) = 0 where the model is exact, and
under a constant disturbance e⃛ + d ë + k ė + i k e = 0, which comes to rest at no error. By Routh
that is stable where i is less than d; of the geometric law, `error_polynomials` tells. While an
input is at a limit, what is remembered may shrink but not grow.

Lag compensation: a motor with time constant T gives a thrust F that obeys T Ḟ = u − F. For thrusts
F* that a law wants, the command u = F* + T Ḟ* makes T (Ḟ − Ḟ*) = F* − F: what a thrust is off
decays by itself, within T, and tracking errors obey the same equation as without lag. Ḟ* is the
derivative in time along the motion, of the desired motion and of all that the law feeds back but
for the wrench on a frame, which is taken as it is. The
accelerations that are part of the motion are those of the robot that flies, with all that acts on
it: inertial sensors measure them, and the thrusts must be measured too, or known from a model of
the motors. Beyond limits Ḟ* is that of the thrusts without limits, and fades: by as much as those
are beyond, as a share of T Ḟ*.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.arrays.functions import Functions
from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.flight.plant.allocation import EXACT, Allocation
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.reference import Reference
from gibbs_codegen.flight.scenario.parts import Force, Impedance
from gibbs_codegen.machine import closed_loop
from gibbs_codegen.machine.base import RETURN
from gibbs_codegen.machine.laws import LAWS, memory_size

# The wrench on a frame that nothing touches.
_NOTHING: Array = np.zeros(6)
# Errors, rad or m, of which accelerations are those that scale gains of adaptation.
_OFF = 0.1
# Regressors over roots of inertias: rounding, and the share of what is learnt faster.
_NONE, _LITTLE = 1e-6, 0.1


def required_inputs(
    vehicle: Vehicle, allocation: Allocation, q: Array, v: Array, a: Array
) -> Array:
    """Inputs u (…, nu) that a motion needs: thrusts, N, then joint torques, N m or N.

    Loops over joints that nothing drives hold. Raises `AllocationError` if no thrusts at all
    produce the wrench.
    """
    evaluator = evaluator_of(law_program(vehicle, allocation, "open_loop"), "required")
    arguments = _of_rotors(vehicle, allocation) | {"q": q, "v": v, "a": a, "leading": 1.0}
    results = evaluator(arguments, constants_of(vehicle, vehicle), allocation.externals)
    return _commanded(allocation, q, results)


def _commanded(allocation: Allocation, q: Array, results: Mapping[str, Array]) -> Array:
    """The inputs (…, nu) that a program has found.

    Raises `AllocationError` where it refuses a wrench.
    """
    if np.any(results["refused"] > 0.0):
        allocation.check(q, results["wrench"])
    return results["wanted"]


def inputs_and_constraint_torques(
    vehicle: Vehicle, allocation: Allocation, q: Array, v: Array, a: Array
) -> tuple[Array, Array]:
    """`required_inputs`, and the torques τ' (…, N − 1) of base arms 2 … N (eqs.

    14–17), N m. These hold the base arms.
    """
    inputs = required_inputs(vehicle, allocation, q, v, a)
    return inputs, vehicle.constraint_torques(q, v, a, inputs)


def law_program(
    vehicle: Vehicle,
    allocation: Allocation,
    law: str,
    moved: MovedFrame | None = None,
    **others: Any,
) -> closed_loop.LoopStructure:
    """The array program of a law of a robot, and `others` of what a closed loop consists of."""
    frames = (None, None) if moved is None else (moved.place, moved.axes)
    return closed_loop.LoopStructure(
        vehicle.module,
        law,
        len(vehicle.frames),
        shared=allocation.limits is not None,
        moves=vehicle.wrenches_vary,
        refuses=allocation.refuses and (bool(allocation.missing) or vehicle.wrenches_vary),
        moved=frames[0],
        axes=frames[1],
        **others,
    )


def curve_tables(motion: Reference, centre: Reference) -> list[Array]:
    """Tables of the curves that a law follows: of its motion, then of its centre of mass.

    The latter are read by the geometric law alone.
    """
    pieces = motion.begin, motion.step, len(motion.coefficients)
    return [np.concatenate([pieces, x.coefficients.ravel()]) for x in (motion, centre)]


@lru_cache(maxsize=64)
def program_of(whole: closed_loop.LoopStructure, name: str) -> Program:
    """A program of a closed loop by its name; many flights share one."""
    program: Program = getattr(whole, name)()
    return program


@lru_cache(maxsize=64)
def evaluator_of(whole: closed_loop.LoopStructure, name: str) -> Evaluator:
    """The evaluator of a program of a closed loop by its name; many flights share one."""
    return Evaluator(program_of(whole, name), dict.fromkeys(("plant", "model"), whole.module))


def constants_of(plant: Vehicle, model: Vehicle) -> dict[str, Any]:
    """Constants of a plant and of the model in a law, by owner."""
    return {"plant": plant.constants, "model": model.constants}


def _of_rotors(vehicle: Vehicle, allocation: Allocation) -> dict[str, Any]:
    """Values of the inputs of a law's program that are about its rotors."""
    values = {
        "known_centre": vehicle.lever,
        "known_wrenches": np.swapaxes(vehicle.input_wrenches(), -1, -2),
        "distribution": allocation.inverse,
        "exact": EXACT,
    }
    if allocation.limits is not None:
        limits = np.array(allocation.limits)
        limits = limits[:, np.newaxis] if limits.ndim == 1 else limits
        limits = np.broadcast_to(limits, (*limits.shape[:-1], len(vehicle.base_inputs)))
        values |= {"least_shared": limits[..., 0, :], "most_shared": limits[..., 1, :]}
    return values


@dataclass(frozen=True)
class Gains:
    """Stiffness k (1/s²) and damping d (1/s) of the tracking errors, each (nv).

    `integral` (1/s) is the rate of integral action, 0 for none, and `adaptation` (rad/s) how fast
    errors and what a law learns swing at most; `back` is as of `RETURN`.
    """

    stiffness: Array
    damping: Array
    integral: float = 0.0
    adaptation: float = 0.0
    back: tuple[float, float] = RETURN

    @classmethod
    def of(cls, frequency: float | Array, damping_ratio: float | Array, coordinates: int) -> Gains:
        """Gains of natural frequencies, rad/s, and damping ratios of errors, each one or (nv)."""
        frequencies = np.broadcast_to(np.asarray(frequency, dtype=np.float64), coordinates)
        return cls(frequencies**2, 2.0 * damping_ratio * frequencies)


@dataclass(frozen=True)
class MovedFrame:
    """The frame that a law moves by its number, that whose axes a push has, None of the world.

    `impedance` and `force` are of the scenario; `gains` (3) are those of errors of positions.
    """

    place: int
    axes: int | None
    impedance: Impedance
    gains: Gains
    force: Force | None = None

    def values(self, mass: float) -> dict[str, Any]:
        """Values of what its program is given, of a machine's mass, kg."""
        frame, stiffness, damping = self.impedance, self.gains.stiffness, self.gains.damping
        inertia = np.full(3, mass) if frame.inertia is None else np.array(frame.inertia)
        stiff = inertia * stiffness if frame.stiffness is None else np.array(frame.stiffness)
        damped = damping * np.sqrt(inertia * stiff / stiffness)
        values = {
            "frame_inertia": inertia,
            "frame_stiffness": stiff,
            "frame_damping": damped if frame.damping is None else np.array(frame.damping),
        }
        if (push := self.force) is None:
            return values
        direction = np.array(push.direction) / np.linalg.norm(push.direction)
        values |= {"push_direction": direction, "push_force": push.value}
        return values | {
            f"push_{x}": getattr(push, x) for x in ("begin", "end", "rise", "integral")
        }


@dataclass(frozen=True)
class Controller:
    """Inputs for a state, so that the vehicle follows a reference.

    The laws of `machine.laws` correct by the gains; "open_loop" commands the inputs of the desired
    motion, whatever the state; "off" commands zeros. `vehicle` is the model that the law knows,
    which need not be the plant. `memory` is how many numbers it remembers, which are integrated
    with the state: nv with integral action, np where it learns. `moved` is the frame that the law
    moves, if it does. `leads`: loops of mechanisms are closed at all times, so that it leads them.
    """

    vehicle: Vehicle
    reference: Reference
    allocation: Allocation
    gains: Gains
    law: str = "computed_torque"
    memory: int = 0
    moved: MovedFrame | None = None
    leads: bool = True

    @cached_property
    def values(self) -> dict[str, Any]:
        """Values of the inputs of its program, by name."""
        gains = self.gains
        of_frame = self.moved.values(float(self.vehicle.mass)) if self.moved else {}
        return _of_rotors(self.vehicle, self.allocation) | {
            "stiffness": gains.stiffness,
            "damping": gains.damping,
            "integral": gains.integral,
            "back": np.array(gains.back),
            "end": self.reference.end,
            "leading": float(self.leads),
            **({"adaptation": self._adaptation()} if self.learns else {}),
            **of_frame,
        }

    @property
    def learns(self) -> bool:
        """True if the law learns base parameters."""
        return self.law in LAWS and LAWS[self.law].learns

    @property
    def memory_size(self) -> int:
        """Numbers that its program has room for, of what the law remembers or might."""
        return memory_size(Functions(self.vehicle.module), self.law)

    def _adaptation(self) -> Array:
        """Gains (np, np) of adaptation: nothing is learnt faster than `gains` say.

        With errors s of velocities and ε of parameters, M ṡ = Y ε − … and ε̇ = −Γ Yᵀ s, so that both
        swing by Y Γ Yᵀ M⁻¹, which is ω² or less for Γ⁻¹ = Σ Yᵀ M⁻¹ Y / ω². The sum is over what
        gravity has, and accelerations by which errors of 0.1 rad or m decay, with joints as at the
        start and a radian to either side. What that shows little is learnt a little faster.
        """
        vehicle, (start, v, _) = self.vehicle, self.reference(0.0)
        rest, total = np.zeros(v.shape), np.zeros(())
        turn, regressor = rest.copy(), vehicle.function("reference_regressor")
        turn[vehicle.layout.v.joints] = 1.0
        for side in (0.0, 1.0, -1.0):
            q = vehicle.function("integrate")(start, side * turn)
            still = regressor(q, rest, rest, rest)
            moved = (
                regressor(q, rest, rest, a) - still for a in np.diag(_OFF * self.gains.stiffness)
            )
            inverse = np.linalg.inv(vehicle.mass_matrix(q))
            for columns in (still, *moved):
                total = total + np.swapaxes(columns, -1, -2) @ inverse @ columns
        sizes = np.sqrt(np.diagonal(total, axis1=-2, axis2=-1))
        # What never acts need not be learnt.
        scales = np.divide(1.0, sizes, out=np.zeros(sizes.shape), where=sizes > _NONE)
        scales = scales[..., np.newaxis] * np.swapaxes(scales[..., np.newaxis], -1, -2)
        whole = np.linalg.inv(scales * total + _LITTLE * np.eye(sizes.shape[-1]))
        return self.gains.adaptation**2 * scales * whole

    @cached_property
    def externals(self) -> dict[str, Callable[..., Any]]:
        """Functions written by hand that its program calls."""
        return {**self.allocation.externals, "desired": self.reference.curves}

    @property
    def tables(self) -> list[Array]:
        """Curves that its program in C reads in their place."""
        return curve_tables(self.reference, self.reference)

    def program(self, **others: Any) -> closed_loop.LoopStructure:
        """The array program of the law, as `law_program` has it."""
        integral = self.memory > 0
        return law_program(
            self.vehicle, self.allocation, self.law, self.moved, integral=integral, **others
        )

    def commanded(
        self,
        time: float | Array,
        q: Array,
        v: Array,
        memory: Array,
        limits: Mapping[str, Array],
        felt: Array = _NOTHING,
    ) -> tuple[Array, Array]:
        """Inputs u (…, nu) at times (…), s, states q (…, nq), v (…, nv), and memory (…, memory).

        And the time derivative (…, memory) of what it remembers, which does not grow while an input
        is at its `limits`, as `Actuators.values` has them, if there are any. `felt` (…, 6) is the
        wrench on the frame that it moves, if it moves one.

        Raises `AllocationError` if no thrusts at all produce the wrench.
        """
        state = {"time": time, "q": q, "v": v, "memory": memory, "felt": felt}
        evaluator = evaluator_of(self.program(limited=bool(limits)), "command")
        constants = constants_of(self.vehicle, self.vehicle)
        results = evaluator({**self.values, **limits, **state}, constants, self.externals)
        at = self.reference(time)[0] if self.law == "open_loop" else q
        inputs = _commanded(self.allocation, at, results)
        shape = (*q.shape[:-1], inputs.shape[-1])
        return np.array(np.broadcast_to(inputs, shape)), results.get("growth", memory)

    def __call__(
        self, time: float | Array, q: Array, v: Array, memory: Array | None = None
    ) -> Array:
        """Inputs u (…, nu) for states q (…, nq), v (…, nv), and memory (…, m)."""
        learnt = np.zeros((*v.shape[:-1], self.memory)) if memory is None else memory
        return self.commanded(time, q, v, learnt, {})[0]
