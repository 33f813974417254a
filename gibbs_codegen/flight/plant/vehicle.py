"""A generated module as flights see it: its functions with their constants, and its layout.

This is all that a flight knows of a robot.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, lru_cache, partial
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gibbs_codegen.arrays import Functions, Program, variable
from gibbs_codegen.arrays.evaluation import Evaluator
from gibbs_codegen.errors import UsageError, near, printable
from gibbs_codegen.flight.plant.kinematics import kinematics_of
from gibbs_codegen.flight.vectors import Array as Array
from gibbs_codegen.flight.vectors import Flags as Flags
from gibbs_codegen.flight.vectors import times
from gibbs_codegen.interface import DATA, FUNCTIONS
from gibbs_codegen.interface.actuators import trivial
from gibbs_codegen.machine.base import base_of
from gibbs_codegen.robot.layout import Layout
from gibbs_codegen.runtime.load import BACKENDS
from gibbs_codegen.runtime.loaded_module import gravity_of

# Angles, rad, that count as the same.
_SAME_ANGLE = 1e-9


class RobotData:
    """Constants of a module about its robot, which a robot file alone has too.

    `wrenches` (6, N) are those of unit thrusts, as of `Vehicle.thrust_wrenches` but for what does
    not move of the base, where no joint moves a rotor.
    """

    def __init__(self, module: ModuleType, wrenches: Array | None = None) -> None:
        self.module, self._wrenches = module, wrenches
        self.name: str = module.NAME
        self.attitude: str = module.ATTITUDE
        self.coordinates: tuple[str, ...] = module.COORDINATES
        self.layout = Layout.of_module(module)
        hybrid, held = module.HYBRID_COORDINATES, self.layout.constrained
        self.constraint_names: tuple[str, ...] = hybrid[len(hybrid) - held.stop + held.start :]
        self.kinematics = kinematics_of(self.layout)
        # By coordinate (nq): an angle, in rad, rather than a length, in m.
        self.is_angle: Flags = np.array([unit == "rad" for unit in self.layout.q.units])
        self.inputs: tuple[str, ...] = module.INPUTS
        # Commands of motors and servos, in the order of inputs; without actuators the inputs.
        self.commands: tuple[str, ...] = getattr(module, "COMMANDS", ()) or module.INPUTS
        self.is_driven = bool(getattr(module, "COMMANDS", ()))
        self.actuator_states: tuple[str, ...] = getattr(module, "ACTUATOR_STATES", ())
        self.points: tuple[str, ...] = module.POINTS
        self.frames: tuple[str, ...] = module.FRAMES
        # Places of the joints among coordinates, and among velocities and accelerations.
        self.arm, self.arm_rates = self.layout.q.joints, self.layout.v.joints
        # The point that wrenches on the base are about.
        self.centre = "O2" if "O2" in self.points else "base"
        self.has_tip = "tip" in self.points
        self.joints = len(self.joint_names)
        count, wheels = len(self.inputs), self.layout.q.wheels
        self.rotors = count - self.joints - wheels
        # Places of inputs that move the base: thrusts, and then torques of wheels.
        self.base_inputs = [*range(self.rotors), *range(count - wheels, count)]
        along, about = self.layout.driven_axes
        if self._wrenches is not None:
            still = np.delete(np.arange(6), [*along, *(3 + axis for axis in about)])
            self._wrenches[still] = 0.0

    @property
    def moving(self) -> str:
        """What the robot does, in a word."""
        return "flying" if self.rotors else "moving"

    @property
    def input_units(self) -> tuple[str, ...]:
        """Units of the inputs (nu): N of thrusts, then N m or N of the joints, N m of wheels."""
        return ("N",) * self.rotors + self.layout.effort_units

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the arm's coordinates, from the base outwards."""
        return self.coordinates[self.arm]

    @property
    def neutral(self) -> Array:
        """Coordinates (nq) of zero, the base level."""
        return np.array(self.layout.neutral)

    def thrust_wrenches(self, q: Array | None = None) -> Array:
        """Wrenches (…, 6, N) of unit thrusts: force, torque about the base centre, its frame."""
        return self.input_wrenches(q)[..., : self.rotors]

    def input_wrenches(self, q: Array | None = None) -> Array:
        """Wrenches (…, 6, N + w) of unit thrusts, and then of unit torques of wheels, as those."""
        before = () if q is None else q.shape[:-1]
        if not self.base_inputs:
            return np.zeros((*before, 6, 0))
        if self._wrenches is None:
            raise UsageError(
                f"{self.name}: joints move its rotors, whose wrenches are not constant"
            )
        return np.broadcast_to(self._wrenches, (*before, *self._wrenches.shape))

    def frame_place(self, frame: str, key: str) -> int:
        """The place of a frame among those of the module; `UsageError` names the key without it."""
        if frame not in self.frames:
            hint = near(frame, self.frames) or ";"
            raise UsageError(
                f"{key}: {self.name} has no frame {printable(frame)}{hint} its frames: "
                f"{', '.join(self.frames)}"
            )
        return self.frames.index(frame)

    def description(self, constant: str) -> Any:
        """A constant of the module about its robot, one of `interface.DESCRIPTION`.

        Raises `UsageError` for a module of an earlier version, which has none.
        """
        if not hasattr(self.module, constant):
            raise UsageError(
                f"{self.name}: has no {constant}, because an earlier version made it; generate "
                "it again with this version"
            )
        return getattr(self.module, constant)

    @cached_property
    def carriers(self) -> NDArray[np.intp]:
        """By point (k) the place of the joint's point that carries it, or of the base centre."""
        return np.array([self.points.index(name) for name in self.description("CARRIERS")])

    @cached_property
    def rotors_move(self) -> bool:
        """True if joints move rotors."""
        centre = self.points.index(self.centre)
        return bool(np.any(self.carriers[centre + 1 : centre + 1 + self.rotors] != centre))

    @property
    def wrenches_vary(self) -> bool:
        """True if what thrusts do to what moves of the base differs from place to place."""
        return self.rotors > 0 and (self.rotors_move or not self.layout.carries_wrenches)


class Vehicle(RobotData):
    """A generated module with the constants of some parameters, and its functions by their names.

    The back end is "numpy" or "c". Parameters left out keep their defaults; arrays have a value for
    each state: they broadcast to the states' leading axes. `key` of a scenario file gave them.
    Raises `UsageError` for a module of another back end or of an older version, and for parameters
    that `prepare` rejects.
    """

    def __init__(
        self,
        module: ModuleType,
        parameters: Mapping[str, ArrayLike] | None = None,
        key: str = "parameters",
    ) -> None:
        _check(module)
        self._gravity = {**module.PARAMETERS, **(parameters or {})}.get("gravity", 0.0)
        try:
            self.constants: Any = module.prepare(dict(parameters)) if parameters else None
        except (ValueError, TypeError) as error:
            words = f"{error}{_about_parameters(module, parameters or {}, str(error))}"
            raise UsageError(f"{module.NAME}: {key}: {words}") from None
        super().__init__(module)
        if self.has_tip:
            self.tip_pose = self._of_tip("frame_poses")
            self.tip_jacobian = self._of_tip("frame_jacobians")
            self.tip_bias_acceleration = self._of_tip("frame_bias_accelerations", axes=1)

    def __getattr__(self, name: str) -> Callable[..., Array]:
        """A function of the module, as `function` gives it."""
        if name not in FUNCTIONS:
            raise AttributeError(f"{type(self).__name__} has no attribute {name}")
        return self.__dict__.setdefault(name, self.function(name))

    def function(self, name: str) -> Callable[..., Array]:
        """A function of the module, or what stands for it, with the constants of the parameters."""
        if (entries := trivial(self.module).get(name)) is not None:
            return lambda *arguments: np.asarray(arguments[-1])[..., entries]
        function: Callable[..., Array] = getattr(self.module, name)
        return function if self.constants is None else partial(function, constants=self.constants)

    def _of_tip(self, name: str, axes: int = 2) -> Callable[..., Array]:
        """The tip's entries, of so many axes, of a function that has all frames."""
        of_frames, place = self.function(name), self.module.FRAMES.index("tip")

        def of_tip(*arguments: ArrayLike) -> Array:
            return of_frames(*arguments)[(..., place, *[slice(None)] * axes)]

        return of_tip

    def base_rotation(self, q: ArrayLike) -> Array:
        """R (…, 3, 3), from the base's frame, arm 1's if there are arms, to the world.

        The frame of a base that does not move freely is as of `Kinematics`.
        """
        return self.kinematics.rotation(np.asarray(q))

    def centre_offset(self, q: ArrayLike) -> Array:
        """Vector (…, 3), m, world axes, from where x, y, z are to the base centre."""
        at_origin = np.array(q, dtype=np.float64)
        at_origin[..., self.layout.q.position] = 0.0
        return self.positions(at_origin)[..., self.points.index(self.centre), :]

    @cached_property
    def base_turn(self) -> Array:
        """R (3, 3), from the base's frame, as of `frame_poses`, to that of `base_rotation`."""
        if self.layout.moves_freely:
            return np.eye(3)
        poses: Array = self.module.frame_poses(self.neutral)
        return poses[0, :3, :3]

    @property
    def lever(self) -> Array:
        """Vector (…, 3), m, base's axes, from the point whose velocity v has to the base centre."""
        return self.centre_offset(self.neutral) if self.layout.moves_freely else np.zeros(3)

    def arm_angles(self) -> Array:
        """Angles (…, N), rad, of the base arms about z of the base, in the order of the rotors.

        Arms point away from the centre; but where azimuths are equal, by the paper's rule, angles
        are against arm 1, which points at the centre, so that it and the arm across are both at 0.
        A base without arms has none.
        """
        if "motor1" not in self.points or self.centre != "O2":
            return np.zeros(0)
        places, first = self.positions(self.neutral), self.points.index("motor1")
        centre = places[..., [self.points.index(self.centre)], :]
        arms = places[..., first : first + self.rotors, :] - centre
        angles: Array = np.arctan2(arms[..., 1], arms[..., 0])
        by_rule = -np.pi + 2.0 * np.pi * np.arange(self.rotors) / self.rotors
        if np.any(np.abs(np.sin(0.5 * (angles - by_rule))) > _SAME_ANGLE):
            return angles
        by_rule[0] = 0.0
        return by_rule

    def base_wrench(self, q: Array, generalised_force: Array) -> Array:
        """The wrench (…, 6) on the base that a generalised force (…, nv) amounts to.

        Force, N, and torque about the base centre, N m, in the base's frame.
        """
        wrenches = self._evaluated("wrench", q=q, force=generalised_force, centre=self.lever)
        # Nothing of a base that does not move depends on where it is.
        return np.broadcast_to(wrenches, (*np.shape(generalised_force)[:-1], 6))

    def input_wrenches(self, q: Array | None = None) -> Array:
        """Wrenches (…, 6, N + w) of unit thrusts, and then of unit torques of wheels.

        They are force, and torque about the base centre, in its frame. Attitude and position make
        no difference, nor do the joints unless rotors move with them; zero if None. Wheels without
        effort have none.
        """
        if not self.base_inputs:
            return super().input_wrenches(q)
        q = self.neutral if q is None else q
        # The inputs come first, since constants may differ along the axes of the states.
        columns = np.moveaxis(self.input_matrix(q)[..., self.base_inputs], -1, 0)
        if self.layout.q.wheels:
            limits = self.description("INPUT_LIMITS")
            driven = [limits.get(self.inputs[k]) != (0.0, 0.0) for k in self.base_inputs]
            columns = columns * np.reshape(driven, (-1, *[1] * (columns.ndim - 1)))
        places = np.broadcast_to(q, (*columns.shape[:-1], q.shape[-1]))
        return np.moveaxis(self.base_wrench(places, columns), 0, -1)

    def needed_force(self, q: Array, v: Array, a: Array, acting: Array | float = 0.0) -> Array:
        """Generalised force (…, nv) of inputs that a motion needs beside what is `acting`.

        Loops over joints that nothing drives hold, and bear their part of it.
        """
        force, robot = self.inverse_dynamics(q, v, a) - acting, Functions(self.module)
        if not robot.leads_loops:
            return force
        # As of `mechanism.carried`, but for rounding.
        jacobian, free = self.function("constraint_jacobian")(q), robot.free_joints
        levers = np.swapaxes(robot.loop_rows @ jacobian, -1, -2)
        return force - times(levers @ np.linalg.pinv(free @ levers), times(free, force))

    def displacement(self, q0: Array, q: Array) -> Array:
        """The displacement (…, nd) between coordinates (…, nq), with a drive sideways too."""
        return self._evaluated("displacement", q=q0, other=q)

    def displaced(self, q: Array, displacement: Array) -> Array:
        """Coordinates (…, nq) after a displacement (…, nd), to which `displacement` leads back."""
        return self._evaluated("displaced", q=q, way=displacement)

    def _evaluated(self, name: str, **arguments: Array) -> Array:
        """What the program of a name makes of its arguments."""
        results = _evaluator(self.module, name)(arguments, {"robot": self.constants})
        return np.asarray(results[name])

    @property
    def wheels(self) -> Array:
        """Angles (w, 3) of wheels that turn by the way along the base's axes, rad/m."""
        layout = self.layout
        turned = np.zeros((layout.q.wheels, 3))
        if layout.q.wheels:
            ways = np.eye(layout.v.size)[layout.v.position]
            rates = self.coordinate_rates(np.tile(self.neutral, (len(ways), 1)), ways)
            turned[:, layout.driven_axes[0]] = rates[:, layout.q.angles].T
        return turned

    @property
    def wheel_points(self) -> tuple[str, ...]:
        """Names (w) of the points where wheels turn, which come after those of joints."""
        last = len(self.points) + 1 - len(self.frames)
        return self.points[last - self.layout.q.wheels : last]

    def smooth_place(self, frame: str, key: str) -> int:
        """As `frame_place`, for what takes derivatives; `UsageError` of a frame on a wheel too."""
        place = self.frame_place(frame, key)
        carrier = self.carriers[len(self.points) - len(self.frames) + place] if place else 0
        if self.points[carrier] in self.wheel_points:
            raise UsageError(
                f"{key}: {frame} of {self.name} turns with a wheel, and there are no derivatives "
                "by angles of wheels; give a frame on another body"
            )
        return place

    def check_wheels(self) -> None:
        """Raise `UsageError` if wheels that have turned make the robot move otherwise."""
        turned = np.zeros((2, self.layout.q.size))
        turned[1, self.layout.q.angles] = 1.0
        v, u = (np.ones((2, size)) for size in (self.layout.v.size, len(self.inputs)))
        if self.layout.q.wheels and np.ptp(self.forward_dynamics(turned, v, u), axis=0).any():
            raise UsageError(
                f"{self.name}: a spring or a rotor turns with a wheel, and there are no "
                "derivatives by angles of wheels; move it to the base or a link in the robot "
                "file"
            )

    def rolled(self, time: Array, q: Array, v: Array, a: Array) -> Array:
        """Angles (s, w) of wheels, rad, which roll from 0 along a motion at times (s)."""
        angles, step = self.layout.q.angles, np.diff(time)[:, np.newaxis]
        rates, growth = (self.coordinate_rates(q, x)[:, angles] for x in (v, a))
        slopes = 0.5 * (rates[1:] + rates[:-1]) + step / 12.0 * (growth[:-1] - growth[1:])
        return np.concatenate([0.0 * rates[:1], np.cumsum(step * slopes, axis=0)])

    @cached_property
    def damping(self) -> Array:
        """Damping (…, nv) of joints, N m s/rad or N s/m: of forces, the part odd in velocities."""
        q, v = self.neutral, np.ones(self.layout.v.size)
        forward, backward = (self.inverse_dynamics(q, sign * v, 0.0 * v) for sign in (1.0, -1.0))
        return 0.5 * (forward - backward)

    @property
    def weight(self) -> float:
        """Weight, N."""
        return -float(self.mass * self.gravity)

    @property
    def mass(self) -> Array:
        """Mass (…) of the robot, kg; NaN where neither motions of the base nor gravity tell it."""
        place, (along, _) = self.layout.v.position.start, self.layout.own_axes
        if along and not self.layout.q.wheels:  # These turn as it moves.
            return self.mass_matrix(self.neutral)[..., place, place]
        # In no posture that is symmetric: gravity lifts the centre of mass by its own slope.
        q = self.neutral + 0.3 + 0.1 * np.arange(self.layout.q.size)
        lift = self.centre_of_mass_jacobian(q)[..., 2, :]
        square = self.gravity * np.sum(lift**2, axis=-1)
        work = np.sum(self.gravity_forces(q) * lift, axis=-1)
        return np.divide(work, square, out=np.full_like(work, np.nan), where=square != 0.0)

    @property
    def gravity(self) -> Array:
        """The acceleration of gravity along z (…), m/s², world axes; negative where things fall."""
        if 2 not in self.layout.own_axes[0]:
            return -np.asarray(self._gravity, dtype=np.float64)
        return gravity_of(self.module, self.layout, self.constants)


@lru_cache(maxsize=256)
def _evaluator(module: ModuleType, name: str) -> Evaluator:
    """Evaluation of the wrench of a force, of a displacement, or of coordinates after one."""
    robot = Functions(module)
    q, other, force = robot.coordinates(), robot.coordinates("other"), robot.velocities("force")
    centre, way = variable("centre", 3), variable("way", robot.space.displacements)
    function, inputs = {
        "wrench": (base_of(robot, q).wrench, (centre, force)),
        "displacement": (robot.displacement, (q, other)),
        "displaced": (robot.displaced, (q, way)),
    }[name]
    program = Program(name, tuple(dict.fromkeys((q, *inputs))), {name: function(*inputs)})
    return Evaluator(program, {"robot": module})


def _check(module: ModuleType) -> None:
    """Raise `UsageError` for a module of another back end or of an older version."""
    # A module that was imported rather than loaded is NumPy's.
    if (backend := getattr(module, "backend", "numpy")) not in BACKENDS:
        backends = " or ".join(f'"{name}"' for name in BACKENDS)
        raise UsageError(
            f"{module.NAME}: this needs NumPy arrays, and the back end is {backend}; load the "
            f"module with backend={backends}"
        )
    # A robot with several arms has no tip.
    always = (r.name for r in FUNCTIONS.values() if not r.needs and not r.on_request)
    wanted = (*DATA, *always)
    if missing := [name for name in wanted if not hasattr(module, name)]:
        raise UsageError(
            f"{module.NAME}: has no {', '.join(missing)}; generate it again with this version"
        )


def _about_parameters(module: ModuleType, numbers: Mapping[str, Any], words: str) -> str:
    """An addition to the `words` in which `prepare` rejects parameters.

    A clause that begins with "; ", or "": names that may be meant, or all that were given.
    """
    names = list(module.PARAMETERS)
    unknown = [name for name in numbers if name not in names]
    if not unknown:
        listed = ", ".join(
            f"{name} = {value:g}" if np.ndim(value) == 0 else f"{name} of shape {np.shape(value)}"
            for name, value in numbers.items()
        )
        return "" if any(name in words for name in numbers) else f"; given: {listed}"
    ends = {f"_{name.rpartition('_')[2]}" for name in unknown if "_" in name}
    alike = [name for name in names if name.endswith(tuple(ends)) and name not in words]
    if not alike and "did you mean" not in words:
        return f"; its parameters: {', '.join(names)}"
    also = f"; others that end alike: {', '.join(alike)}" if alike else ""
    return f"{also}; PARAMETERS of the module lists all {len(names)}"
