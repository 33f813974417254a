"""Machines of one robot that are flown decision by decision, each with parameters of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gibbs_codegen.errors import UsageError
from gibbs_codegen.rollouts.given import Given, whole
from gibbs_codegen.rollouts.problem import Array, Method, Motors, Precision, Problem
from gibbs_codegen.rollouts.rollout import check_settings, known_inputs
from gibbs_codegen.rollouts.task import Flags, Moment
from gibbs_codegen.simulator.plant.actuators import robot_file_actuators
from gibbs_codegen.simulator.plant.vehicle import Vehicle


class Fleet:
    """n machines: where they are, and what they are told.

    Until an episode begins, all are at rest where they are wanted, at `hover` (nq) or zero, and
    motors that lag have settled at the inputs that hold a machine there, or come nearest to it.
    Limits, N and N m, and lag, s, are those of the robot file if None. The last arguments are how a
    decision is flown. Raises `UsageError` if something does not fit the robot.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        count: int,
        *,
        hover: ArrayLike | None,
        limits: tuple[ArrayLike, ArrayLike] | None,
        time_constants: ArrayLike | None,
        dt: float,
        steps: int,
        method: Method,
        bounds: ArrayLike | None,
        precision: Precision,
        threads: int,
    ) -> None:
        nq, nv = len(vehicle.coordinates), len(vehicle.layout.v.names)
        given = Given(vehicle.module, whole("steps", steps))
        check_settings(steps, steps, dt, method, precision)
        self.vehicle, self._threads = vehicle, whole("threads", threads)
        hovers = given.states("hover", vehicle.neutral if hover is None else hover, nq)
        self.motors = motors = _motors(given, vehicle, limits, time_constants)
        if given.count() != 1:
            raise UsageError("hover, time_constants: they are the same for all environments")
        [self._hover] = given.normalised("hover", hovers)
        self._begin = np.clip(_holding_inputs(vehicle, self._hover), motors.least, motors.most)
        flown: Any = {"steps": given.steps, "dt": dt, "method": method, "precision": precision}
        self._problem = Problem(
            vehicle.module,
            vehicle.constants,
            np.tile(self._hover, (count, 1)),
            np.zeros((count, nv)),
            np.tile(self._begin, (count, 1, 1)),
            every=steps,
            bounds=None if bounds is None else given.range("bounds", bounds, nq + nv),
            **flown,
        )
        self._thrusts = np.tile(self._begin[: vehicle.rotors], (count, 1))
        self.decisions = np.zeros(count, dtype=np.int64)
        self.parameters: dict[str, Array] = {}

    @property
    def duration(self) -> float:
        """Of a decision, s."""
        return self._problem.steps * self._problem.dt

    def restart(self, rows: Flags, away: Array, v: Array, parameters: Mapping[str, Array]) -> None:
        """Put m of the machines, `rows` (n), where an episode begins.

        They are displaced by `away` (m, nv) from where they are wanted, with velocities (m, nv).
        Parameters (m) by name have the same names in each call, of which the first is for all
        machines. Raises `UsageError` if no machine can have them.
        """
        now = self._problem
        now.q[rows] = self.vehicle.integrate(self._hover, away)
        now.v[rows] = v
        now.inputs[rows] = self._begin
        self._thrusts[rows] = self._begin[: self.vehicle.rotors]
        self.decisions[rows] = 0
        for name, values in parameters.items():
            self.parameters.setdefault(name, np.empty(len(rows)))[rows] = values
        if not parameters:
            return
        prepare = self.vehicle.module.prepare
        try:
            if isinstance(now.constants, np.ndarray):  # The C back end has a row for each machine.
                now.constants[rows] = prepare(dict(parameters))
            else:
                self._problem = replace(now, constants=prepare(self.parameters))
        except (TypeError, ValueError) as error:
            raise UsageError(f"{self.vehicle.name}: parameters: {error}") from None

    def advance(self, inputs: Array) -> NDArray[np.int8]:
        """Fly all through a decision of inputs (n, nu): why each has ended (n), as of `Rollout`."""
        told = np.clip(inputs, self.motors.least, self.motors.most)
        motors = replace(self.motors, thrusts=self._thrusts)
        decision = replace(self._problem, inputs=told[:, np.newaxis], motors=motors)
        flown = known_inputs(decision, self._threads)
        last = flown.thrusts if flown.thrusts is None else flown.thrusts[:, -1]
        self._thrusts = (told[:, : self.vehicle.rotors] if last is None else last).copy()
        self._problem = replace(
            self._problem,
            q=flown.q[:, -1].copy(),
            v=flown.v[:, -1].copy(),
            inputs=told[:, np.newaxis],
        )
        self.decisions += 1
        return flown.ended

    def moment(self) -> Moment:
        """Where the machines are, in arrays of its own."""
        now, places = self._problem, self.vehicle.layout.v
        return Moment(
            np.asarray(self.decisions * self.duration, dtype=np.float64),
            now.q.copy(),
            now.v.copy(),
            np.asarray(self.vehicle.module.difference(self._hover, now.q)),
            now.inputs[:, 0].copy(),
            self._thrusts.copy(),
            places.attitude,
            places.position,
        )


def _holding_inputs(vehicle: Vehicle, q: Array) -> Array:
    """Inputs (nu) that hold a machine at rest at q (nq), or come nearest to it."""
    still = np.zeros(len(vehicle.layout.v.names))
    force = vehicle.inverse_dynamics(q, still, still)
    return np.asarray(np.linalg.lstsq(vehicle.input_matrix(q), force, rcond=None)[0])


def _motors(given: Given, vehicle: Vehicle, limits: Any, time_constants: Any) -> Motors:
    """Limits and lag of a fleet's machines, as of `Fleet`, with thrusts of zero.

    Raises `UsageError` if a least input is above the greatest, or lag is less than none.
    """
    actuators = robot_file_actuators(vehicle)
    ends = actuators.inputs if limits is None else limits
    least, most = given.range("limits", ends, given.inputs)
    lag = given.lag(actuators.lag if time_constants is None else time_constants)
    return Motors(least, most, lag, np.zeros_like(lag))
