"""The map of a simulation: from a generated module and a scenario to a flight, stage by stage.

    Vehicle            module, parameters  → functions and layout of a robot (plant/vehicle)
      kinematics       layout              → errors and rates of angles or quaternion
    actuators_of       scenario, robot file → limits and lag              (plant/actuators)
    Environment        scenario            → figures of what acts         (plant/environment)
    timed_motion       scenario            → Reference: q, v, a in time   (desired/trajectory)
      desired_base     path, attitude      → coordinates of the base, exact
      desired_with_tip path of the tip     → coordinates of the arm
        arm_motion     knots               → joints, knot by knot
    law_of             rotors              → which law a robot is flown by (control/choice)
    Controller         reference           → inputs of a state: computed torque (control/laws)
    LeaningController  reference           → or by a law that leans       (control/geometric)
      law_in_time      law, rate, sensors  → inputs held between samples  (control/sampled_control)
    ClosedLoop         controller, limits  → derivative of a state        (integration/closed_loop)
      loop_program     ClosedLoop          → its array program, values    (integration/closed_loop)
    resting            loop, start         → start at rest on walls       (integration/rest)
    integrate          loop, start         → StateHistory: samples        (integration/integrators)
    flight_of          samples             → Flight: all time series      (record/recording)
      point_parents    module              → what hangs on what, for drawings (record/series)

All stages know a generated module and nothing of how it was derived.
"""

from __future__ import annotations

import logging
import math
import os
import warnings
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from types import ModuleType

import numpy as np

from gibbs_codegen.errors import UsageError, check_all
from gibbs_codegen.flight.control.choice import check_control, control_law, law_of
from gibbs_codegen.flight.control.sampled_control import (
    ControlLaw,
    OwnController,
    SampledControl,
    ZeroOrderHold,
    law_in_time,
)
from gibbs_codegen.flight.desired.demands import limits_of
from gibbs_codegen.flight.desired.trajectory import (
    Progress,
    TimedMotion,
    check_arm,
    check_base,
    starting_state,
    timed_motion,
)
from gibbs_codegen.flight.integration.closed_loop import ClosedLoop
from gibbs_codegen.flight.integration.compiled_loop import compiled_ahead
from gibbs_codegen.flight.integration.envelope import too_weak
from gibbs_codegen.flight.integration.integrators import integrate
from gibbs_codegen.flight.integration.rest import resting
from gibbs_codegen.flight.plant.actuators import actuators_of, check_charge
from gibbs_codegen.flight.plant.allocation import Allocation, AllocationError, allocation_of
from gibbs_codegen.flight.plant.environment import check_surroundings, open_loops
from gibbs_codegen.flight.plant.sensors import frames_of_sensors
from gibbs_codegen.flight.plant.vehicle import Array, RobotData, Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.record.recording import flight_of, timing_note
from gibbs_codegen.flight.reference import Motion, Reference
from gibbs_codegen.flight.scenario.file import AnyScenario, read_scenario
from gibbs_codegen.flight.scenario.parts import HOLDING, PREDICTIVE
from gibbs_codegen.flight.scenario.paths import check_path
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.interface import FUNCTIONS
from gibbs_codegen.machine.filters import CALLED
from gibbs_codegen.machine.laws import LAWS
from gibbs_codegen.runtime.c_library import CompilerError, ModuleLibrary, chosen_compiler
from gibbs_codegen.runtime.cache import CacheError
from gibbs_codegen.runtime.load import load
from gibbs_codegen.runtime.loaded_module import require_functions
from gibbs_codegen.runtime.predictive import DERIVATIVES, UNDER_WRENCHES

_log = logging.getLogger("gibbs_codegen")
# Time of a controller, s, from which on it is worth a word.
_LONG = 2.0
# The size that rounding may give an eigenvalue of zero, as a share of the largest.
_ROUNDING = 1e-13


def simulate(
    robot: ModuleType | str | os.PathLike[str],
    scenario: AnyScenario,
    controller: OwnController | None = None,
    progress: Progress = lambda stage, share: None,
) -> Flight:
    """Fly a scenario with the robot of a generated module.

    Args:
        robot: A generated module with the back end "numpy" or "c", or the name or path of one,
            which is loaded with the C back end.
        scenario: A scenario, or what `read_scenario` takes: its name or path, or its tables.
        controller: What commands the inputs instead of the scenario's law: a callable that takes an
            `Observation` and returns inputs u (nu). See docs/howto/controllers.md.
        progress: Called with the name of the work and the share done, 0 to 1.

    Returns:
        The flight. If it had to end early, its `stopped` says why; `notes` have what else is to
            be said.

    Raises:
        UsageError: Or one of its kinds (`UnreachableError`, `SingularAttitudeError`,
            `AllocationError`), for a flight that cannot begin.
    """
    start = flight_start(robot, scenario, progress, controller is not None, integrates=True)
    loop, scenario = start.loop, start.scenario
    law = law_in_time(loop.controller, scenario, loop.actuators, loop.idles, controller)
    loop = replace(loop, controller=law)
    led = scenario.control.law not in ("off", "open_loop") and loop.vehicle.layout.moves_freely
    if led and (weakness := too_weak(loop)):
        _log.warning("%s: %s", loop.vehicle.name, weakness)
    begin = perf_counter()
    history = integrate(
        loop,
        loop.start(start.q, start.v, scenario.start.charge),
        scenario.duration,
        scenario.integration,
        lambda time, duration: progress(loop.vehicle.moving, time / duration),
    )
    if isinstance(law, SampledControl) and controller is not None:
        _log_controller_time(loop.vehicle.name, law.spent, perf_counter() - begin)
    return timing_note(flight_of(loop, scenario, history), start.motion)


def _log_controller_time(robot: str, spent: float, flown: float) -> None:
    """Log the time of a controller, s, where it is most of that of a flight, and long."""
    if spent > max(_LONG, 0.5 * flown):
        words = "%s: the controller took %.1f s of the %.1f s of computing (%.0f %%)"
        _log.warning(words, robot, spent, flown, 100.0 * spent / flown)


@dataclass(frozen=True)
class FlightStart:
    """The start of a flight: motion, closed loop, and coordinates (nq), velocities (nv)."""

    motion: TimedMotion
    loop: ClosedLoop
    q: Array
    v: Array

    @property
    def scenario(self) -> Scenario:
        """The scenario of the flight, on the clock of the flight."""
        return self.motion.scenario


def flight_start(
    robot: ModuleType | str | os.PathLike[str],
    scenario: AnyScenario,
    progress: Progress,
    custom_law: bool,
    integrates: bool = False,
) -> FlightStart:
    """Everything up to the start of a flight, with a law that is evaluated at all times.

    `custom_law`: whether the inputs come from elsewhere than the scenario's law. What `integrates`
    the flight is compiled meanwhile, if it is to be. Raises `UsageError` for a flight that cannot
    begin.
    """
    scenario = read_scenario(scenario)
    if custom_law:
        scenario = uncontrolled(scenario)
    # Checks that NumPy can make come first: to compile takes long.
    module = robot if isinstance(robot, ModuleType) else load(robot)
    check_flight(module, scenario)
    compiled = getattr(module, "compiled", None)
    if module is not robot:
        if scenario.control.law == "open_loop" and not custom_law:  # What rotors cannot do.
            _closed_loop(Vehicle(module, scenario.parameters), scenario, progress, custom_law)
        with suppress(CompilerError):
            compiled = ModuleLibrary(Path(module.__path__[0]), module, chosen_compiler())
    with ExitStack() as compiling:
        with suppress(CompilerError, CacheError):  # Functions say so that are asked for.
            if compiled:
                ahead = partial(_ahead, module, scenario, custom_law) if integrates else None
                compiling.enter_context(compiled.built(ahead))
        if module is not robot:
            module = load(robot, "c")
        vehicle = Vehicle(module, scenario.parameters)
        loop, motion = _closed_loop(vehicle, scenario, progress, custom_law)
        q, v = starting_state(vehicle, loop.controller.reference, scenario.start)
        if scenario.start.settled:
            # Controllers of one's own are not asked yet: as if motors did not run.
            own_span = (math.inf, math.inf) if custom_law else loop.actuators.span
            settling = replace(loop, actuators=replace(loop.actuators, span=own_span))
            (q, bristles), v = resting(settling, q, scenario.start.charge), np.zeros(len(v))
            loop = replace(loop, bristles=bristles)
        for machine in {vehicle, loop.vehicle}:
            check_mass_matrix(machine, q)
    if words := open_loops(module, motion.scenario.holds, motion.scenario.duration):
        _log.warning("%s: moves with %s", vehicle.name, words)
    return FlightStart(motion, loop, q, v)


def _ahead(module: ModuleType, scenario: Scenario, custom_law: bool) -> Callable[[], object]:
    """What compiles the closed loop of a flight before its motion is known.

    That is a loop at rest, since what is compiled depends on no number of the motion.
    """
    vehicle = Vehicle(getattr(module, "in_numpy", module), scenario.parameters)
    q, rates = np.tile(vehicle.neutral, (2, 1)), np.zeros((2, vehicle.layout.v.size))
    motion = Motion(np.array([0.0, scenario.duration]), q, rates, rates)
    with suppress(UsageError), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # The flight's own loop says so.
        loop = _loop(vehicle, scenario, vehicle.kinematics.reference(motion), custom_law)
        law: ControlLaw = ZeroOrderHold(loop.controller, "own")
        if not custom_law and scenario.control.law != PREDICTIVE:
            law = law_in_time(loop.controller, scenario, loop.actuators, loop.idles)
        return compiled_ahead(replace(loop, controller=law), scenario)
    return lambda: None


def check_flight(module: ModuleType, scenario: Scenario) -> None:
    """Raise `UsageError` for what the constants of a module, or its functions, cannot fly."""
    if getattr(module, "backend", "") == "c":
        module = module.in_numpy
    vehicle = Vehicle(module)
    with suppress(UsageError):  # It is reported with all else.
        vehicle = Vehicle(module, scenario.parameters)
    check_scenario(vehicle, scenario)
    _check_functions(module, scenario)


def uncontrolled(scenario: Scenario) -> Scenario:
    """A scenario whose inputs come from elsewhere than its law."""
    control = replace(scenario.control, law="open_loop", impedance=None, force=None)
    return replace(scenario, control=control)


def check_scenario(robot: RobotData, scenario: Scenario) -> None:
    """Raise `UsageError` with all that a robot cannot fly, as far as its constants show."""
    paths = {"the path of the base": scenario.base} if scenario.base else {}
    for name, path in scenario.arm.paths.items():
        paths[f"the path of {'the tip' if name == 'tip' else name}"] = path
    # Which numbers of a robot file become parameters only its module knows.
    tables = ("parameters", "plant") if isinstance(robot, Vehicle) else ()
    check_all(
        [
            *(partial(Vehicle, robot.module, getattr(scenario, x), x) for x in tables),
            *(partial(check_path, x, scenario.duration, name) for name, x in paths.items()),
            partial(check_arm, robot, scenario),
            partial(limits_of, robot, scenario),
            partial(check_charge, robot, scenario.start.charge),
            partial(check_surroundings, robot, scenario),
            *([partial(frames_of_sensors, robot, scenario.sensors)] if scenario.sensors else []),
            partial(_check_law, robot, scenario),
        ]
    )
    if isinstance(robot, Vehicle):
        check_base(robot, scenario)


def _check_law(robot: RobotData, scenario: Scenario) -> None:
    """Raise `UsageError` for a law that the robot does not serve."""
    law = None
    if not robot.wrenches_vary:  # What they command is known before there is a motion.
        law = law_of(scenario.control.law, robot, robot.neutral, scenario.name)
    check_control(law, scenario.control, robot)


def _check_functions(module: ModuleType, scenario: Scenario) -> None:
    """Raise `MissingFunctionError` with all functions on request that a module lacks."""
    names = [*HOLDING] if scenario.holds else []
    if scenario.control.law in LAWS:
        names += LAWS[scenario.control.law].calls
    names += CALLED if scenario.control.estimate else ()
    if scenario.control.law == PREDICTIVE:
        pressed = scenario.control.force is not None or bool(getattr(module, "ROTOR_AIR", ()))
        names += [*DERIVATIVES, *(UNDER_WRENCHES if pressed else ())]
    has = {name: all(getattr(module, x, ()) for x in FUNCTIONS[name].needs) for name in names}
    require_functions(module, [name for name in names if has[name]])


def _closed_loop(
    vehicle: Vehicle, scenario: Scenario, progress: Progress, custom_law: bool
) -> tuple[ClosedLoop, TimedMotion]:
    """Plant, controller, motors and environment of a scenario, and the motion to follow.

    `vehicle` is the robot as the controller knows it.
    """
    motion = timed_motion(vehicle, scenario, progress)
    return _loop(vehicle, scenario, motion.reference, custom_law), motion


def _loop(
    vehicle: Vehicle, scenario: Scenario, reference: Reference, custom_law: bool
) -> ClosedLoop:
    """The closed loop of a scenario that follows a motion."""
    control = scenario.control
    actuators = actuators_of(vehicle, scenario)
    allocation = allocation_of(vehicle, limits=actuators.pushes)
    knots = reference(reference.knots)[0]
    law = law_of(control.law, vehicle, knots, scenario.name)
    if law == "open_loop" and not custom_law:
        _check_open_loop(vehicle, allocation, reference)
    controller = control_law(law, control, vehicle, reference, allocation)
    if open_loops(vehicle.module, scenario.holds, scenario.duration):
        controller = replace(controller, leads=False)
    loop = ClosedLoop(vehicle, controller, actuators, None, scenario.motors.compensation)
    # The robot that flies is the one that the controller knows but for some parameters.
    return loop.with_plant(scenario.plant, actuators.lag, scenario)


def check_mass_matrix(vehicle: Vehicle, q: Array) -> None:
    """Raise `UsageError` for a robot whose mass matrix is not positive definite at `q` (nq)."""
    matrix = vehicle.mass_matrix(q)
    if is_positive_definite(matrix):
        return
    eigenvalues = np.linalg.eigvalsh(matrix) if np.isfinite(matrix).all() else [-1.0, 1.0]
    if eigenvalues[0] > -_ROUNDING * eigenvalues[-1]:
        raise UsageError(
            f"{vehicle.name}: the mass matrix is singular at the start, where some joint motion "
            "moves no mass; start in another posture, or give the links mass and thickness"
        )
    raise UsageError(
        f"{vehicle.name}: with these parameters the mass matrix is not positive definite; give "
        "physically possible masses and inertias"
    )


def is_positive_definite(matrices: Array) -> bool:
    """True if all of some matrices (…, n, n) are positive definite, none with what is no number."""
    try:
        np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        return False
    return bool(np.isfinite(matrices).all())


def _check_open_loop(vehicle: Vehicle, allocation: Allocation, reference: Reference) -> None:
    """Raise `AllocationError`, with the time, if the motion needs what rotors cannot produce.

    It looks at the knots.
    """
    time = reference.knots
    q, v, a = reference(time)
    wrenches = vehicle.base_wrench(q, vehicle.needed_force(q, v, a))
    impossible = np.flatnonzero(allocation.residual_at(q, wrenches))
    if len(impossible):
        try:
            allocation.check(q[impossible], wrenches[impossible])
        except AllocationError as error:
            first = f"from t = {time[impossible[0]]:.6g} s on "
            raise AllocationError(f"{vehicle.name}: {first}{error}", error.missing) from None
