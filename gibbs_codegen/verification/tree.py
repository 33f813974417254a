"""The robot as a tree of rigid bodies on joints of one degree of freedom each, in plain numbers.

Coordinates here are those of all joints in the order of the hybrid system, such as θ₋₁, θ₀, θ₁,
θ₂ … θ_N, θ_{N+1} … θ_{N+n}, x, y, z. The position and the attitude of the base are joints without
mass, and what constraint torques hold are joints like any other. Whatever is welded to a body is
carried by the same joint.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import astuple, dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gibbs_codegen.robot.layout import frames_of, layout_of
from gibbs_codegen.robot.model import Robot
from gibbs_codegen.robot.names import link_label
from gibbs_codegen.robot.parts.body import Body, Rod
from gibbs_codegen.robot.parts.numbers import BASE, Vector3
from gibbs_codegen.robot.parts.pose import HERE, Pose
from gibbs_codegen.robot.parts.spring import SHORTEST
from gibbs_codegen.verification.actuators import ActuatorOracle
from gibbs_codegen.verification.vectors import COMPLEX_STEP, Array, about, cross, times

if TYPE_CHECKING:
    from gibbs_codegen.verification.states import States

WORLD = -1


class JointPart(NamedTuple):
    """One of the bodies that a joint carries, in the joint's frame: as `Joint` has all of them.

    `body` is its number, as of `Assembly`.
    """

    body: int
    joint: int
    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True)
class Joint:
    """A joint with the bodies that it carries, as one.

    `parent` is the number of the joint that it hangs on, or `WORLD`; `place` that of its
    coordinate; `axis` that of its own frame's axis about (revolute) or along which it moves. At
    coordinate zero, `rotation` (3, 3) leads from its frame's axes to its parent's and `offset`
    (3,), in m, from the parent's origin to its own. Of the bodies are `mass`, in kg, `com` (3,), in
    m, and `inertia` (3, 3) about that, in kg m², in the joint's axes.
    """

    parent: int
    place: int
    axis: int
    revolute: bool = True
    rotation: Array = field(default_factory=lambda: np.eye(3))
    offset: Array = field(default_factory=lambda: np.zeros(3))
    mass: float = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))

    def with_part(self, part: JointPart) -> Joint:
        """The joint with one body more."""
        mass, inertia = self.mass + part.mass, self.inertia + part.inertia
        if self.mass == 0.0 or mass == 0.0:
            return replace(self, mass=mass, com=part.com, inertia=inertia)
        apart = part.com - self.com
        reduced = self.mass * part.mass / mass
        inertia = inertia + reduced * (apart @ apart * np.eye(3) - np.outer(apart, apart))
        return replace(self, mass=mass, com=self.com + part.mass / mass * apart, inertia=inertia)


class Point(NamedTuple):
    """A frame fixed in that of a joint: its origin `local` (3,) in m, and `rotation` (3, 3)."""

    joint: int
    local: Array
    rotation: Array = np.eye(3)

    def within(self, rotation: Array, offset: Array) -> Point:
        """A frame fixed in this one, by the rotation to this one's axes and its origin, in m."""
        return Point(self.joint, self.local + self.rotation @ offset, self.rotation @ rotation)


class TreeMotor(NamedTuple):
    """The direction of a motor's thrust in the frame of its seat, and its drag in m.

    `body` is the number of the body that it sits on, as of `Assembly`.
    """

    direction: Array
    drag: float
    body: int


class Assembly:
    """A robot put together from the base outwards.

    Bodies have numbers: 0 the base, with the rod that nothing holds against it, i link i, and −k
    rod k.

    - `joints`: from the world outwards, each after that which it hangs on.
    - `bodies`: frames that the file gives the base, rods that are held, and links, by their
      numbers.
    - `carriers`: for each of these but the base, the number of the body that carries it.
    - `arm`: places of the joints with coordinates, in the order of their links; `held`: how many
      are held; `places`: of all joints that move, by their links; `rotors`: of those of rotors of
      motors behind gears.
    - `motors`: where they sit, and what each does there, in the order of the thrusts.
    - `frames`: the named frames; `points`: those of a module's POINTS, in order.
    """

    def __init__(self, robot: Robot) -> None:
        layout = layout_of(robot)
        self.held = layout.constrained.stop - layout.constrained.start
        count = len(layout.free) + self.held
        self.joints: list[Joint] = []
        self.parts: list[JointPart] = []
        self.arm = layout.free[layout.v.joints]
        self.places: dict[int, int] = {}
        self.rotors: dict[int, int] = {}
        self._robot = robot
        others = itertools.count(count)
        self._constrained = iter(range(count)[layout.constrained])
        root = WORLD
        travels = layout.q.names[layout.q.position]
        moved = itertools.chain(layout.free[layout.v.position], others)  # Less with a drive.
        for letter, place in zip(travels, moved, strict=False):
            root = self._add(Joint(root, place, "xyz".index(letter), revolute=False))
        sequence = "xyz" if layout.is_quaternion else layout.angle_axes
        for place, letter in zip(layout.free[layout.v.attitude], sequence, strict=True):
            root = self._add(Joint(root, place, "xyz".index(letter)))
        if root == WORLD:  # A joint that never moves carries what is fixed.
            root = self._add(Joint(root, next(others), 0, revolute=False))
        base, centre = robot.base, np.zeros(3)
        if base.origin == "motor1":
            angles = base.azimuth_deg or (180,)  # The first rod is seen from its motor.
            centre = -base.arm(1).length * _turn("z", float(angles[0]))[:, 0]
        self.centre = Point(root, centre).within(_posed(base.pose)[0], np.zeros(3))
        self.bodies = {BASE: self.centre}
        self.carriers: dict[int, int] = {}
        if base.body is not None:
            self._carry(BASE, self.centre, base.body)
        rods = [self._rod(k) for k in range(1, base.rotors + 1)]
        moving = iter(self.arm)
        for i, link in enumerate(robot.links, start=1):
            parent = robot.parents[i - 1]
            if link.pose is None:
                before = 0.0 if parent == BASE else robot.links[parent - 1].body.length
                twist = _turn("x", float(link.alpha_deg))
                step = np.array([before if link.a is None else link.a, 0.0, 0.0])
                seat = twist @ _turn("z", float(link.theta_deg)), step + link.d * twist[:, 2]
            else:
                seat = _posed(link.pose)
            at = self.bodies[parent].within(*seat)
            if link.joint != "fixed":
                self.places[i] = next(others if link.gear or link.rolling else moving)
                if link.motor:
                    self.rotors[i] = next(others)
                    turning = self._jointed(at, link.axis, self.rotors[i])
                    for held, share in ((turning, 1.0), (at, -1.0)):
                        along = held.rotation @ np.array(link.axis)
                        inertia = share * link.motor.rotor_inertia * np.outer(along, along)
                        self._add_part(JointPart(parent, held.joint, 0.0, held.local, inertia))
                at = self._jointed(at, link.axis, self.places[i], link.joint == "revolute")
            elif link.constrained:
                at = self._jointed(at, link.axis, next(self._constrained))
            self.bodies[i], self.carriers[i] = at, parent
            self._carry(i, at, link.body)
        self.motors: list[tuple[Point, TreeMotor]] = []
        for k, (rod, direction) in enumerate(zip(rods, base.thrust, strict=True), start=1):
            body = -k if k > 1 else BASE
            self.motors.append((rod, TreeMotor(np.array(direction), base.drag[k - 1], body)))
        for rotor in robot.thrusters:
            at = self.bodies[rotor.on].within(np.eye(3), np.array(rotor.position))
            self.motors.append((at, TreeMotor(np.array(rotor.direction), rotor.drag, rotor.on)))
        self.frames = {
            frame.name: self.bodies[frame.on].within(*_posed(frame.pose))
            for frame in frames_of(robot)
        }
        joints = [self.bodies[i] for i in robot.gearing]
        seats = [at for at, _ in self.motors]
        frames = [point for name, point in self.frames.items() if name != "base"]
        self.points = [*rods[:1], self.centre, *seats, *joints, *frames]

    def _add(self, joint: Joint) -> int:
        self.joints.append(joint)
        return len(self.joints) - 1

    def _carry(self, number: int, at: Point, body: Body) -> None:
        """Add a body, whose frame is at `at`, to the joint that this is fixed on."""
        if isinstance(body, Rod):
            mass, length = body.mass_per_length * body.length, body.length
            thin = mass * length**2 / 12
            x, y, z = body.section_inertia
            at_com, inertia = (length / 2, 0.0, 0.0), np.diag([x, y + thin, z + thin])
        else:
            xx, yy, zz, xy, xz, yz = body.inertia
            mass, at_com = body.mass, body.com
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        turn = at.rotation
        com, inertia = at.local + turn @ np.array(at_com), turn @ inertia @ turn.T
        self._add_part(JointPart(number, at.joint, mass, com, inertia))

    def _add_part(self, part: JointPart) -> None:
        self.joints[part.joint] = self.joints[part.joint].with_part(part)
        self.parts.append(part)

    def _jointed(self, at: Point, axis: Vector3, place: int, revolute: bool = True) -> Point:
        """Add a joint; return the frame of the body that it carries, fixed on it.

        `at` is the body's frame at coordinate zero, on the joint that carries this one, and `axis`
        is in the body's frame. The joint's own frame is turned so that its axis is a coordinate
        axis.
        """
        along = np.array(axis) / np.linalg.norm(axis)
        if along.max() == 1.0:
            number, turn = int(along.argmax()), np.eye(3)
        else:
            across = np.cross(np.eye(3)[np.abs(along).argmin()], along)
            across /= np.linalg.norm(across)
            number, turn = 2, np.stack([across, np.cross(along, across), along], axis=-1)
        joint = self._add(Joint(at.joint, place, number, revolute, at.rotation @ turn, at.local))
        return Point(joint, np.zeros(3), turn.T)

    def _rod(self, k: int) -> Point:
        """Add a rod of the base; return where its motor sits."""
        base = self._robot.base
        end = np.array([base.arm(k).length, 0.0, 0.0])
        if k == 1 and base.azimuth_deg is None:
            # It is seen from its motor.
            motor = self.centre.within(np.eye(3), -end)
            self._carry(BASE, motor, base.arm(1))
            return motor
        angle = -180.0 + 360.0 * (k - 1) / base.rotors
        if base.azimuth_deg is not None:
            angle = float(base.azimuth_deg[k - 1])
        rod = self.centre.within(_turn("z", angle), np.zeros(3))
        if k > 1:
            rod = self._jointed(rod, (0.0, 0.0, 1.0), next(self._constrained))
            self.bodies[-k], self.carriers[-k] = rod, BASE
        self._carry(-k if k > 1 else BASE, rod, base.arm(k))
        return rod.within(np.eye(3), end)


def _posed(pose: Pose) -> tuple[Array, Array]:
    """Rotation and origin of a pose."""
    x, y, z = (_turn(axis, float(a)) for axis, a in zip("xyz", pose.rpy_deg, strict=True))
    return z @ y @ x, np.array(pose.xyz)


def _turn(axis: str, degrees: float) -> Array:
    return about("xyz".index(axis), np.array(np.deg2rad(degrees)))


class PassiveForces:
    """What acts on all joints by itself: of each alone, and of springs between named frames.

    Arrays of joints are (size,), zero for those of the base and those that are held. `reflected` is
    what rotors of motors add to `armature`, beside what counts for base parameters. Forces of
    springs are what complex steps of their lengths make of the tensions (Squire and Trapp, 1998).
    """

    def __init__(self, tree: Tree, robot: Robot) -> None:
        self._tree, constants = tree, np.zeros((tree.size, 4))
        for i, place in tree.places.items():
            constants[place] = astuple(robot.links[i - 1].passive)
        self._damping, self.armature, self._stiffness, self._rest = constants.T
        self.reflected = np.zeros(tree.size)
        for i, place in tree.places.items():
            if motor := robot.links[i - 1].motor:
                more = motor.gear_ratio * (motor.gear_ratio - 1.0)
                self.reflected[place] = more * motor.rotor_inertia
        names, ties = [frame.name for frame in frames_of(robot)], robot.springs
        self._ends = [(names.index(tie.frame), names.index(tie.to)) for tie in ties]
        self._springs = np.reshape([(x.stiffness, x.length, x.damping) for x in ties], (-1, 3)).T

    def _ways(self, frames: Frames) -> Array:
        """Vectors (…, springs, 3) from their ends to their frames, m, world axes."""
        places = self._tree.positions(frames, self._tree.named)
        return np.stack([places[..., i, :] - places[..., j, :] for i, j in self._ends], axis=-2)

    def _lengths(self, q: Array) -> Array:
        if not self._ends:
            return np.zeros((*q.shape[:-1], 0))
        return np.sqrt(np.sum(self._ways(self._tree.frames(q)) ** 2, axis=-1) + SHORTEST**2)

    def _tensions(self, q: Array, v: Array) -> Array:
        """Forces (…, springs), N, that draw ends together, at q and v of all joints."""
        stiffness, rest, damping = self._springs
        rates = np.imag(self._lengths(q + 1j * COMPLEX_STEP * v)) / COMPLEX_STEP
        return stiffness * (self._lengths(q) - rest) + damping * rates

    def forces(self, q: Array, v: Array) -> Array:
        """Forces (…, size), N m and N, of dampers and springs, at q and v of all joints."""
        moved = q[..., None, :] + 1j * COMPLEX_STEP * np.eye(self._tree.size)
        slopes = np.imag(self._lengths(moved)) / COMPLEX_STEP
        efforts = self._damping * v + self._stiffness * (q - self._rest)
        return -efforts - times(slopes, self._tensions(q, v))

    def damped(self, q: Array, v: Array) -> Array:
        """The part of these (…, size) that velocities make, against them."""
        return self._tree.folded(self.forces(q, 0.0 * v) - self.forces(q, v))

    def sizes(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Sizes of the terms of these forces (…, size), and of the springs' energy (…), J."""
        stretch = np.abs(q) + np.abs(self._rest)
        pulling = np.abs(self._stiffness) * stretch
        between, reach = self.pull_sizes(q, v), self._tree.reach
        levers = np.where(self._tree.turns, reach, 1.0)
        forces = np.abs(self._damping * v) + pulling + between[..., None] * levers
        longest = reach + np.sum(self._springs[1])
        return forces, np.sum(pulling * stretch, axis=-1) + between * longest

    def pull_sizes(self, q: Array, v: Array) -> Array:
        """Sizes (…) of all tensions, N; the direction of a short spring is known less exactly."""
        (stiffness, rest, damping), tree = np.abs(self._springs), self._tree
        lengths, speed = self._lengths(q), np.sum(np.abs(v) * tree.scales, axis=-1, keepdims=True)
        pulling = stiffness * (tree.reach + lengths + rest) + damping * speed
        return np.sum(pulling * (1.0 + tree.reach / lengths), axis=-1)

    def energies(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Kinetic energy of drives that turn with joints, and the springs' potential, (…), J."""
        stiffness, rest, _ = self._springs
        stored = np.sum(self._stiffness * (q - self._rest) ** 2, axis=-1)
        stored += np.sum(stiffness * (self._lengths(q) - rest) ** 2, axis=-1)
        return 0.5 * np.sum(self.armature * v**2, axis=-1), 0.5 * stored

    def pulls(self, q: Array, v: Array, frames: Frames) -> Array:
        """Wrenches (s, frames, 6) of springs on all named frames, N and N m, world axes."""
        wrenches, pulls = np.zeros((len(q), len(self._tree.named), 6)), self._tensions(q, v)
        for k, (first, second) in enumerate(self._ends):
            pull = (pulls / self._lengths(q))[:, k, None] * self._ways(frames)[:, k]
            wrenches[:, first, :3] -= pull
            wrenches[:, second, :3] += pull
        return wrenches


class Frames(NamedTuple):
    """World rotations (…, 3, 3) and positions (…, 3) of joints' frames, in the joints' order.

    `steps` (…, 3) lead to each from its parent: short ones keep digits that differences of
    positions would lose.
    """

    rotations: list[Array]
    positions: list[Array]
    steps: list[Array]


class Tree:
    """Joints from the world outwards, named points, motors, and which joints are constrained.

    - `layout`: of the reduced coordinates.
    - `placement`: where the world's first joints begin, rotation (s, 3, 3) and position (s, 3), for
      each of s states, or one for all.
    - `free`, `constrained`, `arm`: places of the velocities, of the constrained joints and of the
      arm's with coordinates among all joints; `places`: of the arm's that move, by links, of
      which `labels` has words;
      `driven`: of those that inputs drive, the `wheels` last.
    - `gains`, `offsets`: coordinates of all joints are the former (size, size) times those of the
      free ones, and the latter (size,). Gears make other joints follow, and the ground wheels.
    - `dragged`: accelerations (s, size) of joints by velocities alone, in a placed tree.
    - `count`, `size`: how many joints the hybrid system has; with one that carries a fixed base.
    - `turns`, `scales`: for each coordinate whether it is an angle; 1 if so, else the reach.
    - `reach`, `tempo`: a length of the robot's own size, in m; what rates are of the order of, in
      1/s.
    - `parts`, `bodies`, `carriers`: the bodies of the joints one by one, and as of `Assembly`.
    - `points`, `named`: points in the order of a module's POINTS, and frames in that of FRAMES,
      with `names`, and `mounts`, the numbers of the bodies that they are on.
    - `seats`: where the motors sit, and then the named frames.
    - `tip`: number of the frame of that name, or None.
    - `passive`: what acts on the joints by themselves; `actuators`, or None where u is commanded.
    - `constraints`: of frames, as in the robot file.
    """

    def __init__(self, robot: Robot) -> None:
        self.gravity = robot.gravity
        self.mass = robot.total_mass
        self.layout = layout_of(robot)
        self.placement = np.eye(3)[None], np.array(robot.base.pose.xyz)[None]
        self.dragged: Array = np.zeros(())
        self.free = self.layout.free
        built = Assembly(robot)
        self.joints, self.parts, self.arm = built.joints, built.parts, built.arm
        self.places = built.places
        self.labels = {place: link_label(robot, i) for i, place in built.places.items()}
        self.bodies, self.carriers = built.bodies, built.carriers
        self.size, self.count = len(self.joints), len(self.free) + built.held
        self.constrained = [*range(self.count)[self.layout.constrained]]
        ratios, offsets = np.zeros((self.size, self.size)), np.zeros(self.size)
        self.driven = [self.places[i] for i in robot.driven]
        self.wheels = [self.places[i] for i in robot.wheels]
        for i in robot.wheels:
            # The speed of the centre along the wheel's x axis, over the radius.
            turn, (x, y, _) = _posed(robot.links[i - 1].pose or HERE)
            speeds = {"vx": turn[0, 0], "vy": turn[1, 0], "wz": turn[1, 0] * x - turn[0, 0] * y}
            for name, place in zip(self.layout.v.names, self.free, strict=True):
                ratios[self.places[i], place] = speeds.get(name, 0.0) * robot.gearing[i].ratio
        for i, place in self.places.items():
            if gear := robot.links[i - 1].gear:
                offsets[place] = gear.offset
                for mover, ratio in gear.ratios.items():
                    ratios[place, self.places[mover]] = ratio
        for i, place in built.rotors.items():
            if motor := robot.links[i - 1].motor:
                ratios[place, self.places[i]] = motor.gear_ratio
        self.gains = np.linalg.inv(np.eye(self.size) - ratios)
        self.offsets: Array = self.gains @ offsets
        self.turns = np.zeros(self.size, bool)
        self.turns[[joint.place for joint in self.joints if joint.revolute]] = True
        self.points = built.points
        steps = [np.linalg.norm(joint.offset) for joint in self.joints]
        bodies = [np.linalg.norm(joint.com) for joint in self.joints]
        fixed = [np.linalg.norm(point.local) for point in self.points]
        # How far from the base anything of the robot may be, or 1 if it is a point.
        self.reach = float(sum(steps) + max(bodies) + max(fixed)) or 1.0
        # At the rate at which a pendulum of that length swings, weight and inertia are alike.
        self.tempo = float(np.sqrt(abs(self.gravity) / self.reach)) or 1.0
        self.scales = np.where(self.turns, 1.0, self.reach)
        self.motors = [motor for _, motor in built.motors]
        self.named = [*built.frames.values()]
        self.seats = [*(seat for seat, _ in built.motors), *self.named]
        self.names = [*built.frames]
        self.mounts = [frame.on for frame in frames_of(robot)]
        self.tip = self.names.index("tip") if "tip" in self.names else None
        self.passive = PassiveForces(self, robot)
        self.actuators = ActuatorOracle(robot) if robot.has_actuators else None
        self.constraints = robot.constraints

    @property
    def efforts(self) -> Array:
        """Inputs u of natural size, (nu,): of the robot's weight, N and N m."""
        force = self.mass * self.reach * self.tempo**2
        levers = np.where(self.turns[self.driven], self.reach, 1.0)
        return force * np.concatenate([np.ones(len(self.motors)), levers])

    @property
    def middle_angle(self) -> int | None:
        """Place in v of the middle of three angles of the attitude, as `coordinates` takes it."""
        places = range(self.size)[self.layout.v.attitude]
        return places[1] if len(places) == 3 else None

    def coordinates(self, angles: Array) -> Array:
        """Coordinates (…, nq) as the robot's module takes them.

        `angles` (…, nv) are in the order of v, with the attitude as three angles.
        """
        if not self.layout.is_quaternion:
            # What has no velocity of its own is anything.
            numbers = np.arange(self.layout.q.size)
            entries = np.sin(np.sum(angles, axis=-1, keepdims=True) + numbers)
            entries[..., self.layout.paired] = angles
            return entries
        from scipy.spatial.transform import Rotation  # Late, as SciPy takes long to import.

        base, joints = self.layout.v, angles[..., self.layout.v.joints]
        attitude = Rotation.from_euler("XYZ", angles[..., base.attitude]).as_quat()
        return np.concatenate([angles[..., base.position], attitude, joints], axis=-1)

    def spread(self, values: Array) -> Array:
        """Rates (…, nv) as those (…, size) of all joints, zero at the constrained ones."""
        whole = np.zeros((*values.shape[:-1], self.size), values.dtype)
        whole[..., self.free] = values
        return times(self.gains, whole)

    def motion(self, states: States) -> tuple[Array, Array, Array]:
        """Coordinates, rates and accelerations (…, size) of all joints."""
        accelerations = self.spread(states.a) + self.dragged
        return self.spread(states.q) + self.offsets, self.spread(states.v), accelerations

    def folded(self, values: Array) -> Array:
        """Forces on, or columns of, all joints (…, size) with those that gears move on the others.

        They are added to those of the joints that move these.
        """
        return values @ self.gains

    def at_joints(self, q: Array) -> Array:
        """Coordinates (…, size) of the arm's joints from q (…, nq), whatever the base's are.

        They are zero at the joints of the base and at the constrained ones.
        """
        angles = np.zeros((*q.shape[:-1], self.size))
        angles[..., self.arm] = q[..., self.layout.q.joints]
        return times(self.gains, angles) + self.offsets + self.rolled(q)

    def rolled(self, q: Array) -> Array:
        """Angles (…, size) of the wheels, at the places of their joints."""
        angles = np.zeros((*q.shape[:-1], self.size))
        angles[..., self.wheels] = q[..., self.layout.q.angles]
        return angles

    def frames(self, q: Array) -> Frames:
        """Frames of all joints at coordinates q (…, size) of all, which may be complex."""
        rotations: list[Array] = []
        positions: list[Array] = []
        steps: list[Array] = []
        for joint in self.joints:
            rotation, step, travel = joint.rotation, joint.offset, q[..., joint.place]
            if joint.parent != WORLD:
                parent = rotations[joint.parent]
                rotation, step = parent @ rotation, parent @ step
            else:
                ones = (1,) * (travel.ndim - 1)
                rotation, step = (x.reshape(-1, *ones, *x.shape[1:]) for x in self.placement)
            if joint.revolute:
                rotation = rotation @ about(joint.axis, travel)
            else:
                step = step + rotation[..., joint.axis] * travel[..., None]
            rotations.append(np.broadcast_to(rotation, (*travel.shape, 3, 3)))
            steps.append(np.broadcast_to(step, (*travel.shape, 3)))
            begin = 0.0 if joint.parent == WORLD else positions[joint.parent]
            positions.append(begin + steps[-1])
        return Frames(rotations, positions, steps)

    @staticmethod
    def positions(frames: Frames, points: Sequence[Point]) -> Array:
        """World positions of points, in m, (…, points, 3)."""
        rotations, positions, _ = frames
        return np.stack(
            [positions[p.joint] + rotations[p.joint] @ p.local for p in points], axis=-2
        )

    def poses(self, frames: Frames) -> Array:
        """Homogeneous transforms (…, seats, 4, 4) of the seats to the world."""
        positions = self.positions(frames, self.seats)
        poses = np.zeros((*positions.shape[:-1], 4, 4))
        turns = [frames.rotations[seat.joint] @ seat.rotation for seat in self.seats]
        poses[..., :3, :3] = np.stack(turns, axis=-3)
        poses[..., :3, 3] = positions
        poses[..., 3, 3] = 1.0
        return poses


@dataclass(frozen=True)
class BodyMotion:
    """Motion of a joint's frame in world axes, each (…, 3)."""

    velocity: Array
    angular_velocity: Array
    acceleration: Array
    angular_acceleration: Array

    def at(self, lever: Array) -> tuple[Array, Array]:
        """Velocity and acceleration of a point fixed in the frame, m/s and m/s², (…, 3).

        `lever` (…, 3) leads to it from the frame's origin, in m, in world axes.
        """
        turning = cross(self.angular_velocity, lever)
        return (
            self.velocity + turning,
            self.acceleration
            + cross(self.angular_acceleration, lever)
            + cross(self.angular_velocity, turning),
        )


def joint_motions(tree: Tree, v: Array, a: Array, frames: Frames) -> list[BodyMotion]:
    """Motions of the joints' frames, from the world outwards.

    Rates `v` and accelerations `a` of all joints are (…, size), in rad and m; leading axes of the
    frames broadcast against theirs.
    """
    still = BodyMotion(*(np.zeros((*v.shape[:-1], 3)) for _ in range(4)))
    motions: list[BodyMotion] = []
    for number, joint in enumerate(tree.joints):
        parent = still if joint.parent == WORLD else motions[joint.parent]
        axis = frames.rotations[number][..., joint.axis]
        rate = axis * v[..., joint.place, None]
        gain = axis * a[..., joint.place, None]
        dragged = cross(parent.angular_velocity, rate)
        velocity, acceleration = parent.at(frames.steps[number])
        if joint.revolute:
            motion = BodyMotion(
                velocity,
                parent.angular_velocity + rate,
                acceleration,
                parent.angular_acceleration + gain + dragged,
            )
        else:
            motion = BodyMotion(
                velocity + rate,
                parent.angular_velocity,
                acceleration + gain + 2.0 * dragged,
                parent.angular_acceleration,
            )
        motions.append(motion)
    return motions
