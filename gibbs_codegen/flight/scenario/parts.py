"""Parts of a scenario: laws, motors, sensors, what acts from outside, the start, integration.

A part is one class, whose fields are the keys of its table in a scenario file; see `files.table`.
Angles are in rad here, and in degrees in a file, under keys that end in `_deg`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from gibbs_codegen.files.table import (
    Bounds,
    Flag,
    OneOf,
    Place,
    Table,
    Tables,
    Whole,
    entry,
    key,
    listed,
    needed,
    table,
)
from gibbs_codegen.flight.scenario.devices import FRAME as FRAME
from gibbs_codegen.flight.scenario.devices import (
    Barometer,
    Delay,
    Device,
    Encoders,
    Gps,
    Imu,
    Magnetometer,
    PoseSensor,
    WrenchSensor,
)
from gibbs_codegen.flight.scenario.numbers import (
    IN_DEGREES,
    LEAST,
    Angles,
    Direction,
    Endless,
    JointName,
    NotNegative,
    Number,
    Positive,
    Positives,
    Vector,
)
from gibbs_codegen.flight.vectors import Array, Flags
from gibbs_codegen.machine.base import RETURN
from gibbs_codegen.machine.laws import LAWS
from gibbs_codegen.machine.sensors import MEASUREMENTS

MAX_DURATION = 3600.0  # s
# The law that plans: `flight.control.predictive`.
PREDICTIVE = "predictive"
# Functions that flights call in which constraints hold.
HOLDING = (
    *("constrained_forward_dynamics", "impact"),
    *("constraint_jacobian", "constraint_errors", "constraint_bias"),
)


def functions_for(holds: bool, laws: Iterable[str] = ()) -> tuple[str, ...] | None:
    """Words for the functions of modules that fly under some laws; None for those by default."""
    words = ["constraints"] if holds else []
    words += dict.fromkeys(x for law in laws if law in LAWS for x in LAWS[law].calls)
    return ("default", *words) if words else None


Law = Annotated[str, OneOf(("tracking", *LAWS, PREDICTIVE, "open_loop", "off"))]
# Laws of scenarios that move a frame, and of these those that control its force.
_MOVING = [name for name, law in LAWS.items() if law.moves_frame]
_PUSHING = [name for name, law in LAWS.items() if law.pushes]
Method = Literal["adaptive", "rk4"]
TimingLaw = Literal["uniform", "fastest"]
Thrusts = Annotated[
    tuple[Number, Number],
    listed(2),
    needed(lambda limits: limits[0] < limits[1], "the least thrust must be below the greatest"),
]
_Frequency = Annotated[Number, Bounds(LEAST, 1e4)]
_Rate = Annotated[Number, Bounds(0.0, 1e4)]
Share = Annotated[Number, Bounds(0.0, 1.0)]
_ZERO = (0.0, 0.0, 0.0)
# Axes that are no frame's.
WORLD = "world"


@table
class JointControl(Table):
    """Decay of the error of one joint."""

    frequency: _Frequency | None = entry(
        "natural frequency of its error dynamics, rad/s; default: that of control", None
    )
    damping_ratio: _Rate | None = entry(
        "damping ratio of its error dynamics; default: that of control", None
    )


class _ForATime:
    """Something that acts from `begin` to `end`, s."""

    begin: float
    end: float

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """The fault of an end that is not after the begin."""
        if not self.end > self.begin:
            yield ("end",), f"must be after begin, {self.begin:g} s"

    def acts_at(self, times: Array) -> Flags:
        """True for times (…), s, at which it acts."""
        return (times >= self.begin) & (times < self.end)


@table
class Impedance(Table):
    """A frame under the laws "impedance" and "force": it moves as a body on springs and dampers.

    They are those along the axes of the world. Under the law "predictive" a frame that pushes is
    named here, and nothing else is used.
    """

    frame: str = entry(f"the frame that moves like this: {FRAME}", "tip")
    stiffness: Positives | None = entry(
        "stiffness towards the path, [x, y, z] in N/m; default: that of control.frequency"
    )
    damping: Positives | None = entry(
        "damping, [x, y, z] in N s/m; default: that of control.damping_ratio"
    )
    inertia: Positives | None = entry(
        "apparent mass, [x, y, z] in kg; default: the mass of the machine, which needs the "
        "least thrust"
    )


@table
class Force(_ForATime, Table):
    """The push of the frame of `impedance` under the law "force", for a time.

    Under the law "predictive" it pushes on walls that the law knows, and nothing is learned.
    """

    value: Annotated[NotNegative, key("the force on its surroundings, N")]
    direction: Annotated[Direction, key("the direction in which it pushes, [x, y, z]")]
    axes: str = entry(
        f"axes of the direction: world, or moving axes of a frame, {FRAME}",
        WORLD,
    )
    begin: NotNegative = entry("when the push begins, s", 0.0)
    end: Endless = entry("when the push ends, s; default: never", math.inf)
    rise: Positive = entry("rise and fall time of the force, s", 0.5)
    integral: _Rate = entry("integral gain of the measured force, 1/s", 2.0)


@table
class Filter(Table):
    """What is estimated besides coordinates, velocities and biases of sensors, and its noise.

    Loads walk at random, by a density times the root of the time. Joints have efforts besides their
    inputs.
    """

    by: Literal["model", "imu"] = entry(
        "source of the prediction: the robot's dynamics, or an IMU on the base", "model"
    )
    wrench: str = entry(
        f'the frame on which an unknown wrench acts: {FRAME}; "": none, as "base" if that is fixed',
        "base",
    )
    payload: str = entry(f'the frame that carries an unknown mass: {FRAME}; "": none', "")
    acceleration: NotNegative = entry(
        "density of noise of the accelerations, m/s²/√Hz and rad/s²/√Hz", 0.05
    )
    force: NotNegative = entry("density at which the force walks, N/√s", 0.3)
    torque: NotNegative = entry("density at which the torque walks, N m/√s", 0.03)
    effort: NotNegative = entry("density at which efforts of joints walk, N m/√s or N/√s", 0.03)
    mass: NotNegative = entry("density at which the mass of the payload walks, kg/√s", 0.1)
    joints: NotNegative = entry(
        "density of noise of accelerations of joints when an IMU predicts, rad/s²/√Hz, m/s²/√Hz",
        10.0,
    )
    start: Positive = entry(
        "standard deviation of coordinates and velocities at the start, m, rad, m/s, rad/s", 0.01
    )
    outliers: Annotated[Share, Bounds(0.0, 0.5)] = entry(
        "share of correct readings that are rejected as outliers; 0: no rejection", 1e-4
    )

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """Faults of what nothing estimates."""
        led = values.get("by", "model") == "imu"
        loads = ("wrench", "payload", "force", "torque", "effort", "mass")
        for item in values.keys() & {*(loads if led else ("joints",))}:
            yield item, f'must be left out, or by be "{"model" if led else "imu"}"'


@table
class Control(Table):
    """The control law, and for laws that correct errors how the errors are to decay.

    "tracking" is computed torque where the rotors command all six directions of a wrench, and the
    geometric law where they command the force along one axis and three moments. The inputs of a law
    with a rate are held in between.
    """

    law: Law = entry("law that commands the motors and joints", "tracking")
    frequency: _Frequency = entry(
        "natural frequency of the error dynamics of position and joints, rad/s", 5.0
    )
    damping_ratio: _Rate = entry("damping ratio of the error dynamics", 1.0)
    attitude_frequency: _Frequency | None = entry(
        "natural frequency of the error dynamics of the attitude, rad/s; default: frequency "
        "under computed torque, four times frequency under laws by which the base leans"
    )
    integral: _Rate = entry("integral gain against constant disturbances, 1/s; 0: none", 0.0)
    rate: Annotated[Number, Bounds(0.1, 1e6)] | None = entry(
        "rate at which the law is evaluated, Hz; default: continuously"
    )
    delay: Delay = entry(
        "delay from the evaluation of the law to its inputs, s; needs a rate; the predictive "
        "law has one and compensates a delay of up to a period",
        0.0,
    )
    joints: Mapping[JointName, JointControl] = entry(
        "gains of single joints by name, if they differ from those of the base", dict
    )
    impedance: Impedance | None = entry(
        'motion of a frame under the laws "impedance" and "force"; default: the tip, with '
        "control.frequency"
    )
    force: Force | None = entry(
        'push of the frame under the law "force", which needs it, or "predictive"'
    )
    adaptation: _Frequency = entry('greatest learning rate of the law "adaptive", rad/s', 5.0)
    return_rate: _Rate = entry(
        "rate at which a base with a drive returns to its path from the side, 1/s", RETURN[0]
    )
    return_speed: _Frequency = entry(
        "speed at which that rate is half, m/s; it falls with the speed", RETURN[1]
    )
    estimate: Flag = entry(
        "whether the law uses the state that a filter estimates from sensors", False
    )
    filter: Filter | None = entry(
        "estimated quantities and noise of the filter; default: those of an empty table"
    )

    @property
    def back(self) -> tuple[float, float]:
        """Rate, 1/s, and speed, m/s, of the return from the side."""
        return self.return_rate, self.return_speed

    @property
    def estimation(self) -> Filter | None:
        """What a filter estimates, if one tells the state."""
        return (self.filter or Filter()) if self.estimate else None

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """Faults of a delay of a law at all times, and of what is said of a contact."""
        law = values.get("law", "tracking")
        has_rate = "rate" in values or law == PREDICTIVE
        if values.get("delay") and not has_rate:
            yield "rate", "missing: a delay needs the rate of the law, Hz"
        if "filter" in values and not values.get("estimate"):
            yield "filter", "must be left out, or estimate be true"
        if law in _PUSHING and "force" not in values:
            yield "force", "missing: give the push of the frame, { value = …, direction = … }"
        if values.get("integral") and law in LAWS and LAWS[law].learns:
            yield "integral", "must be left out, because the adaptive law learns parameters instead"
        planned = [PREDICTIVE] if "force" in values else []
        for item, laws in (("impedance", _MOVING + planned), ("force", _PUSHING + planned)):
            if item in values and law not in laws:
                names = [LAWS[name].task if name in LAWS else name for name in laws]
                tasks = " or ".join(dict.fromkeys(f'"{name}"' for name in names))
                yield item, f"must be left out, or the law be {tasks}"


@table
class Motors(_ForATime, Table):
    """Limits and lag of every motor, and when they run."""

    limits: Thrusts | None = entry("least and greatest thrust, N; default: those of the robot file")
    time_constant: NotNegative | None = entry(
        "time constant of the lag, s; 0: no lag; default: that of the robot file"
    )
    compensation: Flag = entry("whether the law compensates the lag, if it can", True)
    begin: NotNegative = entry("when they start, s; before, thrusts are the least", 0.0)
    end: Endless = entry("when they stop, s, after which thrusts are the least", math.inf)
    disc_radius: Positive | None = entry(
        "radius of the discs of all rotors, m, for collisions with links; default: that of the "
        "robot file"
    )


# Keys of lists of sensors in the table of sensors.
DEVICES = tuple(MEASUREMENTS)


def _devices(kind: str) -> Tables:
    return Tables(f"sensors.{kind}", 20, "sensors")


@table
class Sensors(Table):
    """Noise and delay of what a sampled law of control observes, and sensors of the robot."""

    position: NotNegative = entry("standard deviation of each coordinate of the base, m", 0.0)
    attitude: Annotated[
        Number,
        Bounds(0.0, 90.0, "°"),
        IN_DEGREES,
        key("standard deviation of the attitude about each axis, degrees", "attitude_deg"),
    ] = 0.0
    joints: NotNegative = entry("standard deviation of each joint, rad or m", 0.0)
    velocity: NotNegative = entry(
        "standard deviation of the base's velocity along each axis, m/s", 0.0
    )
    angular_velocity: NotNegative = entry(
        "standard deviation of the base's angular velocity about each axis, rad/s", 0.0
    )
    joint_rates: NotNegative = entry(
        "standard deviation of the rate of each joint, rad/s or m/s", 0.0
    )
    delay: Delay = entry("delay of the observed state, s", 0.0)
    seed: Annotated[Whole, Bounds(0, 2**63 - 1)] = entry(
        "seed of the noise; the same seed gives the same noise", 0
    )
    acceleration: NotNegative = entry(
        "standard deviation of the base's acceleration along each axis, m/s²", 0.0
    )
    angular_acceleration: NotNegative = entry(
        "standard deviation of the base's angular acceleration about each axis, rad/s²", 0.0
    )
    joint_accelerations: NotNegative = entry(
        "standard deviation of the acceleration of each joint, rad/s² or m/s²", 0.0
    )
    force: NotNegative = entry("standard deviation of the force on a frame along each axis, N", 0.0)
    torque: NotNegative = entry(
        "standard deviation of the torque on a frame about each axis, N m", 0.0
    )
    imu: Annotated[tuple[Imu, ...], _devices("imu")] = entry("accelerometers and gyroscopes", ())
    barometer: Annotated[tuple[Barometer, ...], _devices("barometer")] = entry("barometers", ())
    magnetometer: Annotated[tuple[Magnetometer, ...], _devices("magnetometer")] = entry(
        "magnetometers", ()
    )
    gps: Annotated[tuple[Gps, ...], _devices("gps")] = entry("satellite receivers", ())
    pose: Annotated[tuple[PoseSensor, ...], _devices("pose")] = entry(
        "cameras that measure poses of frames", ()
    )
    encoders: Annotated[tuple[Encoders, ...], _devices("encoders")] = entry(
        "encoders of joints", ()
    )
    wrench: Annotated[tuple[WrenchSensor, ...], _devices("wrench")] = entry(
        "sensors of forces and torques on frames", ()
    )

    synonyms: ClassVar[Mapping[str, str]] = {
        "pos": "position",
        "vel": "velocity",
        "gyro": "angular_velocity",
    }

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """The faults of names that sensors share."""
        names: set[str] = set()
        for kind in DEVICES:
            for place, device in enumerate(getattr(self, kind)):
                if device.name in names:
                    words = f"there is a sensor {device.name} already; give each a unique name"
                    yield (kind, place, "name"), words
                names.add(device.name)

    @property
    def devices(self) -> tuple[Device, ...]:
        """All sensors of the robot."""
        return tuple(device for kind in DEVICES for device in getattr(self, kind))

    @property
    def observes(self) -> bool:
        """True if more is set than the sensors and the seed of their errors."""
        bare = Sensors(seed=self.seed, **{kind: getattr(self, kind) for kind in DEVICES})
        return not self.devices or self != bare


def estimation_faults(control: Control, sensors: Sensors | None) -> Iterator[tuple[Place, str]]:
    """The fault of a state that is estimated without sensors, or that has noise besides."""
    if control.estimate and (sensors is None or not sensors.devices):
        yield ("control", "estimate"), "needs sensors to estimate by, such as [[sensors.imu]]"
    elif control.estimate and sensors and sensors.observes:
        words = (
            "must be false if [sensors] itself has noise or a delay, because each sensor has "
            "its own"
        )
        yield ("control", "estimate"), words


@table
class Timing(Table):
    """When the paths are flown: as they say, or as fast as limits allow.

    Limits are kept beside those of the robot.
    """

    law: TimingLaw = entry(
        "uniform: the paths at their times; fastest: as fast as limits allow", "uniform"
    )
    limits: Thrusts | None = entry(
        "least and greatest thrust of the desired motion, N; default: of the motors"
    )
    thrust_rate: Positive | None = entry(
        "greatest rate of change of every thrust, N/s; default: no limit"
    )
    effort: Mapping[JointName, Positive] = entry(
        "greatest torque or force of joints, N m or N; default: of the arm", dict
    )
    velocity: Mapping[JointName, Positive] = entry(
        "greatest desired rate of joints, rad/s or m/s; default: of the arm", dict
    )

    synonyms: ClassVar[Mapping[str, str]] = {
        "rate": "thrust_rate",
        "thrust": "limits",
        "torque": "effort",
    }

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """Faults of limits that nothing would keep."""
        if values.get("law", "uniform") == "uniform":
            for item in ("limits", "thrust_rate", "effort", "velocity"):
                if item in values:
                    yield item, 'is a limit of the law "fastest"; leave it out with "uniform"'


@table
class StartOffset(Table):
    """The start: deviation from the desired motion, and the battery's charge."""

    position: Annotated[Vector, key("deviation of the base centre, world axes, m", "offset")] = (
        _ZERO
    )
    rotation: Annotated[
        Angles, key("deviation of the attitude: rotation vector, world axes, degrees", "turn_deg")
    ] = _ZERO
    charge: Share = entry("charge of the battery, 1 when full", 1.0)
    settled: Flag = entry(
        "whether the robot starts at rest on walls, lowered or lifted onto them", False
    )


@table
class Settings(Table):
    """The integration of the motion, and the rate of its samples.

    Samples are kept at whole multiples of 1 / rate, and at the last instant. Tolerances are 1e-6
    and 1e-7 at least while thrusts are at their limits. A coordinate that is off by the divergence,
    or has a rate that would carry it as far off even under control, ends the flight, unless nothing
    is controlled.
    """

    method: Method = entry("steps of adaptive or of equal length", "adaptive")
    step: Annotated[Number, Bounds(1e-6)] = entry("greatest step of rk4, s", 1e-3)
    # SciPy raises smaller ones to about this.
    relative_tolerance: Annotated[Number, Bounds(3e-14, 0.1)] = entry(
        "relative tolerance of adaptive steps", 1e-10
    )
    absolute_tolerance: Annotated[Number, Bounds(1e-16, 0.1)] = entry(
        "absolute tolerance of adaptive steps; m, rad, m/s and rad/s", 1e-11
    )
    rate: Annotated[Number, Bounds(0.1)] = entry("recorded samples per second", 100.0)
    divergence: Annotated[Endless, Bounds(LEAST)] = entry(
        "deviation from the desired motion at which control counts as lost, m or rad", 20.0
    )


@table
class TipForce(_ForATime, Table):
    """A force on the tip for a time: what `push` was before it had a frame and a torque."""

    force: Annotated[Vector, key("[x, y, z] in N, world axes")]
    begin: NotNegative = entry("when it begins, s", 0.0)
    end: Endless = entry("when it ends, s", MAX_DURATION)


@table
class Push(TipForce):
    """A force and a torque at a frame for a time."""

    force: Vector = entry("[x, y, z] in N, world axes", _ZERO)
    torque: Vector = entry("[x, y, z] in N m, world axes", _ZERO)
    frame: str = entry(
        f"the frame at whose origin they act: {FRAME}, such as base, tip, or that of a "
        "[[frame]] of the robot file",
        "tip",
    )


@table
class Payload(_ForATime, Table):
    """A point mass at a frame, for a time. The controller does not know of it."""

    frame: Annotated[str, key(f"the frame at whose origin it is: {FRAME}")]
    mass: Annotated[NotNegative, key("the mass, kg")]
    begin: NotNegative = entry("when it appears, s", 0.0)
    end: Endless = entry("when it disappears, s; default: it stays", math.inf)


@table
class Hold(_ForATime, Table):
    """A constraint of the robot that holds for a time.

    It begins with an impact. A frame is held where it is then, and drawn to its anchor only if the
    constraint has a frequency. With a restitution the constraint acts from one side alone, as a
    stop: it keeps a frame above a plane, or no further than a distance, and never pulls back.
    """

    constraint: Annotated[str, key("the constraint: a name of CONSTRAINTS of the module")]
    begin: NotNegative = entry("when it takes hold, s", 0.0)
    end: Endless = entry("when it lets go, s; default: it stays", math.inf)
    idle: Flag = entry("whether the motors idle during the hold", False)
    restitution: Share | None = entry(
        "restitution: share of its speed with which a frame rebounds; default: held from both "
        "sides",
        None,
    )


@table
class Gust(Table):
    """Wind that rises and falls once: amplitude · (1 − cos 2πs) / 2, s from 0 to 1."""

    amplitude: Annotated[Vector, key("greatest velocity of the gust, [x, y, z] in m/s")]
    duration: Annotated[Positive, key("how long it lasts, s")]
    begin: NotNegative = entry("when it begins, s", 0.0)


@table
class Wind(Table):
    """Steady wind and gusts, and the drag of the frames that they blow on.

    A frame is dragged by the force −c (v − w): its velocity is v, the wind's is w, both in world
    axes, and c its coefficient.
    """

    drag: Annotated[
        Mapping[str, NotNegative],
        needed(bool, "names no frame; give frames and their coefficients, such as base = 0.3"),
        key("coefficients of drag, N s/m, by frame: base = 0.3, say, in [wind.drag]"),
    ]
    velocity: Vector = entry("velocity of the steady wind, [x, y, z] in m/s", _ZERO)
    gusts: Annotated[tuple[Gust, ...], Tables("wind.gusts", 1000, "gusts")] = entry(
        "gusts on top of the steady wind", ()
    )
    rotational_drag: Mapping[str, NotNegative] = entry(
        "coefficients of rotational drag, N m s/rad, by frame", dict
    )


@table
class Move(Table):
    """A move of a joint from rest to rest, with minimum jerk; in a task it is in m or rad."""

    to: Annotated[Number, key("where the joint moves, m or degrees")]
    duration: Annotated[Positive, key("how long the move takes, s")]
    begin: NotNegative = entry("when the move begins, s", 0.0)


def late(part: Move | Hold, duration: float) -> Iterator[str]:
    """The fault of what begins after the end of a flight, if it does."""
    if part.begin >= duration:
        yield f"must be before {duration:g}, when the flight ends, not {part.begin:g}"
