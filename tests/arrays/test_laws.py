"""Laws at random states, of a robot that is made up: what they are to do, by NumPy and SciPy."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arrays.test_base import State
from conftest import ROOT
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation
from support.compiled import build, compile_only
from support.made_up import STEP, Array, close, skew

from gibbs_codegen.arrays import (
    Functions,
    Program,
    constant,
    evaluate,
    gradient,
    jacobian,
    variable,
)
from gibbs_codegen.arrays.c_file import c_files, opening
from gibbs_codegen.machine.allocation import nearest_thrusts, smallest_thrusts
from gibbs_codegen.machine.base import Motion
from gibbs_codegen.machine.law_functions import law_functions
from gibbs_codegen.machine.laws import (
    LAWS,
    Aim,
    CentrePath,
    Estimates,
    FrameAim,
    Gains,
    Limits,
    PushAim,
    Rotors,
    Weight,
    inputs_of,
    learning,
    push_shares,
    turns_servos,
    weight_of,
    within_limits,
)
from gibbs_codegen.runtime.load import load

FOLDER = ROOT / "generated" / "hexarotor_3link"
AXIS = np.array([0.6, 0.0, 0.8])
VECTORS = {
    "stiffness": 8, "damping": 8, "memory": 11, "path": 3, "path_v": 3, "path_a": 3, "weight": 3,
    "frame_stiffness": 3, "frame_damping": 3, "frame_inertia": 3, "wrench": 6, "direction": 3,
}  # fmt: skip
# Places of memory: of errors, and of the frame that is moved.
OF_ERRORS, OF_FRAME = slice(0, 8), slice(8, 11)
NUMBERS = {"mass": 1.7, "force": 4.0, "share": 0.7, "growth": 0.4, "integral": 0.3, "h": 0.1}


class Case(State):
    """A state with what laws are given, and what they are to do."""

    def __init__(self, attitude: str, seed: int = 2) -> None:
        super().__init__(attitude, seed)
        random = np.random.default_rng(seed)
        self.given |= {name: random.uniform(0.5, 2.0, size) for name, size in VECTORS.items()}
        self.given["memory"] -= 1.0
        self.given |= {name: np.array(value) for name, value in NUMBERS.items()}
        count = Functions(self.module).signatures["reference_regressor"].shapes[0][1]
        names = ("parameters", "adaptation", "least_parameters", "most_parameters")
        self.given |= {name: random.uniform(0.5, 2.0, count) for name in names}
        self.given["direction"] /= np.linalg.norm(self.given["direction"])

    def program(
        self, law: str, *, turned: bool = False, remembers: bool = True
    ) -> dict[str, Array]:
        """Force, and rates of what is remembered, of a law."""
        robot, given = Functions(self.module), {**self.given, "axis": AXIS}
        spaces = {"q": robot.space, "q_d": robot.space}
        g = {
            name: variable(name, *np.shape(x), space=spaces.get(name)) for name, x in given.items()
        }
        desired = Motion(g["q_d"], g["v_d"], g["a_d"])
        gains = Gains(g["stiffness"], g["damping"], g["integral"] if remembers else None)
        memory = g["memory"] if LAWS[law].moves_frame else g["memory"][OF_ERRORS]
        aim = Aim(desired, gains, memory if remembers else None)
        if LAWS[law].learns:
            aim = replace(aim, estimates=Estimates(g["parameters"], g["adaptation"]))
        if LAWS[law].leans:
            path = CentrePath(g["path"], g["path_v"], g["path_a"])
            aim = replace(aim, path=path, weight=Weight(g["mass"], g["weight"], g["axis"]))
        if LAWS[law].moves_frame:
            figures = (g[f"frame_{x}"] for x in ("stiffness", "damping", "inertia"))
            axes = constant(Rotation.from_rotvec([0.3, -0.4, 0.9]).as_matrix()) if turned else None
            push = PushAim(g["direction"], g["force"], g["share"], g["growth"], axes)
            frame = FrameAim(1, *figures, g["wrench"], push if LAWS[law].pushes else None)
            aim = replace(aim, frame=frame)
        force = LAWS[law].force(robot, g["q"], g["v"], aim)
        outputs = {"force": force, "learning": learning(robot, g["q"], g["v"], aim)}
        self.program_of_law = Program("law", tuple(g.values()), outputs)
        return evaluate(self.program_of_law, given, {"robot": self.module})

    def learnt(self, remembers: bool) -> Array:
        """What integral action adds to errors."""
        return NUMBERS["integral"] * self.given["memory"] if remembers else np.zeros(11)

    def errors(self) -> tuple[Array, Array]:
        """Errors and their rates as `test_base` knows them."""
        found = self.evaluated(
            lambda robot, base, v, desired, **_: dict(
                zip("er", base.errors(v, desired), strict=True)
            )
        )
        return found["e"], found["r"]

    def corrected(self, pull: Array) -> Array:
        """Accelerations of the desired motion and of a pull, as `test_base` knows them."""
        kept, self.given["f"] = self.given["f"], pull
        found = self.evaluated(
            lambda robot, base, v, desired, f, **_: {"a": base.corrected(v, desired, f)}
        )["a"]
        self.given["f"] = kept
        return found

    def frame(self, law: str, learnt: Array, turned: bool) -> Array:
        """Acceleration (3) that the tip is to have."""
        g, module = self.given, self.module
        tip, path = (module.frame_poses(g[x])[1, :3, 3] for x in ("q", "q_d"))
        own, ahead = (self.tip(end) for end in ("", "_d"))
        error, wrench = path - tip, g["wrench"][:3]
        spring, velocity = g["frame_stiffness"] * error, ahead[0]
        acceleration = ahead[1]
        if LAWS[law].pushes:
            axes = Rotation.from_rotvec([0.3, -0.4, 0.9]).as_matrix() if turned else np.eye(3)
            n, s = g["direction"], NUMBERS["share"]
            across = np.eye(3) - np.outer(n, n)
            spring = g["frame_stiffness"] * (error + across @ (axes @ learnt[OF_FRAME]))
            # Along the push the spring gives way to the force that is missing.
            memory = g["memory"] if learnt.any() else np.zeros(11)
            remembered = n @ (axes @ memory[OF_FRAME])
            missing = NUMBERS["force"] + NUMBERS["growth"] * remembered + n @ wrench
            share = np.eye(3) - s * np.outer(n, n)
            total = share @ (spring + (n @ wrench) * n) + s * missing * n
            velocity, acceleration = share @ velocity, share @ acceleration
        else:
            total = spring + wrench
        force = total + g["frame_damping"] * (velocity - own[0])
        return acceleration + force / g["frame_inertia"]

    def tip(self, end: str) -> tuple[Array, Array]:
        """Velocity and acceleration of the tip: of the robot itself without accelerations."""
        g, module = self.given, self.module
        q, v = g[f"q{end}"], g[f"v{end}"]
        a = g["a_d"] if end else np.zeros(8)
        jacobian = module.frame_jacobians(q)[1, :3]
        return jacobian @ v, jacobian @ a + module.frame_bias_accelerations(q, v)[1, :3]

    def felt(self) -> Array:
        """Generalised force of what the tip feels."""
        found: Array = self.module.frame_jacobians(self.given["q"])[1].T @ self.given["wrench"]
        return found


ROOTS = ("zyx", "quaternion")


@pytest.mark.parametrize("remembers", [True, False])
@pytest.mark.parametrize("attitude", ROOTS)
def test_computed_torque_lets_errors_decay(attitude: str, remembers: bool) -> None:
    case = Case(attitude)
    found, g = case.program("computed_torque", remembers=remembers), case.given
    error, rate = case.errors()
    pull = g["stiffness"] * (error + case.learnt(remembers)[OF_ERRORS]) + g["damping"] * rate
    wanted = case.module.inverse_dynamics(g["q"], g["v"], case.corrected(pull))
    np.testing.assert_allclose(found["force"], wanted, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["learning"], error, rtol=0, atol=1e-13)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("law", ["impedance", "force"])
@pytest.mark.parametrize("attitude", ROOTS)
def test_a_frame_moves_as_on_springs_and_all_else_as_near_as_can_be(
    attitude: str, law: str, turned: bool
) -> None:
    case = Case(attitude)
    case.given["stiffness"][case.joints.start] = 0.0  # A servo holds it.
    found, g, module = case.program(law, turned=turned), case.given, case.module
    q, v, learnt = g["q"], g["v"], case.learnt(True)
    error, rate = case.errors()
    near = case.corrected(g["stiffness"] * (error + learnt[OF_ERRORS]) + g["damping"] * rate)
    jacobian = module.frame_jacobians(q)[1, :3]
    lacking = case.frame(law, learnt, turned) - case.tip("")[1] - jacobian @ near
    # Weighed least squares of what is moved, by the conditions of Karush, Kuhn and Tucker.
    moving = g["stiffness"] > 0.0
    n, own = moving.sum(), jacobian[:, moving]
    matrix = np.block([[np.diag(g["stiffness"][moving]), own.T], [own, np.zeros((3, 3))]])
    a = near.copy()
    a[moving] += np.linalg.solve(matrix, np.concatenate([np.zeros(n), lacking]))[:n]
    wanted = module.inverse_dynamics(q, v, a) - case.felt()
    np.testing.assert_allclose(found["force"], wanted, rtol=0, atol=1e-10)
    error[case.lines] = 0.0
    rates = np.concatenate([error, remembered(case, law, turned)])
    np.testing.assert_allclose(found["learning"], rates, rtol=0, atol=1e-12)


def remembered(case: Case, law: str, turned: bool) -> Array:
    """Rates of what a law that pushes learns: errors across the push, and of the force along it."""
    if not LAWS[law].pushes:
        return np.zeros(3)
    g, n = case.given, case.given["direction"]
    tip, path = (case.module.frame_poses(g[x])[1, :3, 3] for x in ("q", "q_d"))
    felt = -n @ g["wrench"][:3]
    touching = np.clip(2.0 * felt / NUMBERS["force"], 0.0, 1.0)
    along = NUMBERS["share"] * touching * (NUMBERS["force"] - felt)
    found = np.cross(n, np.cross(path - tip, n)) + along * n
    return (Rotation.from_rotvec([0.3, -0.4, 0.9]).as_matrix().T if turned else np.eye(3)) @ found


@pytest.mark.parametrize("felt", [-0.5, -2.0, 3.0])
def test_what_hardly_touches_learns_little_of_its_force(felt: float) -> None:
    case = Case("zyx")
    case.given["wrench"][:3] = felt * case.given["direction"]
    found = case.program("force")["learning"][OF_FRAME]
    np.testing.assert_allclose(found, remembered(case, "force", False), rtol=0, atol=1e-12)


def leaning(case: Case, law: str, remembers: bool) -> Array:
    """What the geometric law is to give: by rotations of SciPy, and rates by complex steps."""
    g, module = case.given, case.module
    q, v, q_d, v_d, a_d = (g[x] for x in ("q", "v", "q_d", "v_d", "a_d"))
    mass, learnt = NUMBERS["mass"], case.learnt(remembers)
    k, d = g["stiffness"][case.lines], g["damping"][case.lines]
    held = LAWS[law].moves_frame
    weight = g["weight"] - (g["wrench"][:3] if held else 0.0)
    jacobian, turn, wanted_turn = module.centre_of_mass_jacobian(q), case.turn(q), case.turn(q_d)
    off, drift = g["path"] - module.centre_of_mass(q), g["path_v"] - jacobian @ v
    desired = mass * g["path_a"] + weight
    learned = NUMBERS["integral"] * off if remembers else 0.0 * off

    def correction(off: Array, drift: Array) -> Array:
        wish = mass * (k * off + d * drift)
        return wish / np.sqrt(1.0 + wish @ wish / (0.64 * desired @ desired))

    pull = correction(off + learnt[case.lines], drift)
    needed = desired + pull
    along = turn @ AXIS
    thrust = max(needed @ along, 0.0)
    slowing = (desired - thrust * along) / mass  # Of the drift, where errors are those of the path.
    pulled = correction(
        off + learnt[case.lines] + 1j * STEP * (drift + learned), drift + 1j * STEP * slowing
    )
    rate = np.imag(pulled) / STEP
    _, spin = case.twist(q, v)
    _, spin_d = case.twist(q_d, v_d)
    growth_d = case.along(lambda q, v: case.twist(q, v)[1], "_d")
    # The rotation that takes the axis to the force, in the desired base's frame, and its spin.
    own_force = wanted_turn.T @ needed
    own_rate = wanted_turn.T @ (rate - np.cross(spin_d, pull))

    def swing(force: Array) -> Array:
        unit = force / np.sqrt(force @ force)
        about = np.cross(AXIS, unit)
        return np.eye(3) + skew(about) + skew(about) @ skew(about) / (1.0 + AXIS @ unit)

    turning = np.imag(swing(own_force + 1j * STEP * own_rate)) / STEP @ swing(own_force).T
    lean = wanted_turn @ np.array([turning[2, 1], turning[0, 2], turning[1, 0]])
    ahead = turn.T @ (spin_d + lean)
    between = turn.T @ wanted_turn @ swing(own_force)
    error = np.cross(AXIS, between @ AXIS)
    sine, cosine = np.linalg.norm(error), AXIS @ between @ AXIS
    error = error / sine * np.arctan2(sine, cosine)
    x, y, z, w = Rotation.from_matrix(between).as_quat()
    heading = 2.0 * np.arctan2(AXIS @ [x, y, z], w)
    heading = (heading + np.pi) % (2.0 * np.pi) - np.pi
    error = error + 0.5 * (1.0 + cosine) * heading * AXIS

    def weighed(gain: str, x: Array) -> Array:
        about = AXIS @ x * AXIS
        return g[gain][case.places] * (x - about) + g[gain][case.lines] * about

    own_spin = turn.T @ spin
    angular = turn.T @ (growth_d + np.cross(spin_d, lean)) - np.cross(own_spin, ahead)
    angular = angular + weighed("stiffness", error) + weighed("damping", ahead - own_spin)
    a = np.zeros(8)
    if case.is_quaternion:
        a[3:6] = angular
    else:
        rows = [turn.T @ case.twist(q, unit)[1] for unit in np.eye(8)[:3]]
        bias = np.imag(own(case, q + 1j * STEP * v, v)) / STEP
        a[:3] = np.linalg.solve(np.stack(rows, 1), angular - bias)
    joints = slice(7, 9) if case.is_quaternion else slice(3, 5)
    e = (q_d - q)[joints] + learnt[case.joints]
    rates = (v_d - v)[case.joints]
    a[case.joints] = (
        a_d[case.joints] + g["stiffness"][case.joints] * e + g["damping"][case.joints] * rates
    )
    if held:
        resting = module.inverse_dynamics(q, v, np.zeros(8))
        resting = turn @ resting[:3] if case.is_quaternion else resting[5:8]
        drift = (resting - g["weight"]) / mass
        pushed = (thrust * along - weight) / mass
        relative = module.frame_jacobians(q)[1, :3] - jacobian
        lacking = case.frame(law, learnt, False) - case.tip("")[1]
        lacking = np.concatenate([lacking - (pushed - drift) - relative @ a, np.zeros(2)])
        stiff = g["stiffness"][case.joints]
        rest = np.where(stiff > 0.0, 4e-6 * stiff, 1e6)
        # Of all the joints may do it comes nearest, less what strays from the posture costs.
        tall = np.concatenate([relative[:, case.joints], np.diag(np.sqrt(rest))])
        a[case.joints] += np.linalg.lstsq(tall, lacking, rcond=None)[0]
    force = module.inverse_dynamics(q, v, a)
    if held:
        force = force - case.felt()
    exerted = turn @ force[:3] if case.is_quaternion else force[5:8]
    found: Array = force + jacobian.T @ (thrust * along - exerted)
    return found


def own(case: Case, q: Array, v: Array) -> Array:
    """Angular velocity in the base's frame."""
    found: Array = case.turn(q).T @ case.module.spin(q, v)
    return found


@pytest.mark.parametrize("remembers", [True, False])
@pytest.mark.parametrize("law", ["geometric", "geometric_impedance", "geometric_force"])
@pytest.mark.parametrize("attitude", ROOTS)
def test_a_base_leans_as_the_force_on_its_centre_of_mass_needs(
    attitude: str, law: str, remembers: bool
) -> None:
    for seed in (2, 3, 5):
        case = Case(attitude, seed)
        if seed == 3:
            case.given["stiffness"][case.joints.stop - 1] = 0.0
        found = case.program(law, remembers=remembers)
        np.testing.assert_allclose(found["force"], leaning(case, law, remembers), rtol=0, atol=1e-7)
        g = case.given
        rates, off = np.zeros(8), g["path"] - case.module.centre_of_mass(g["q"])
        rates[case.lines] = off
        if LAWS[law].moves_frame:
            rates = np.concatenate([rates, remembered(case, law, False)])
        else:
            joints = slice(7, 9) if case.is_quaternion else slice(3, 5)
            rates[case.joints] = (g["q_d"] - g["q"])[joints]
        np.testing.assert_allclose(found["learning"], rates, rtol=0, atol=1e-12)


@pytest.mark.parametrize("attitude", ROOTS)
def test_a_base_that_leans_as_it_must_has_derivatives(attitude: str) -> None:
    """And its small attitude errors are as such a little larger."""
    case = Case(attitude)
    case.given["q"] = case.given["q_d"]
    case.given["path"], case.given["path_v"] = (
        case.module.centre_of_mass(case.given["q"]),
        np.zeros(3),
    )
    turn = case.turn(case.given["q"])
    case.given["weight"] = 9.0 * turn @ AXIS - NUMBERS["mass"] * case.given["path_a"]
    found = case.program("geometric", remembers=False)["force"]
    assert np.isfinite(found).all()
    owners, inputs = {"robot": case.module}, {**case.given, "axis": AXIS}
    slope = evaluate(jacobian(case.program_of_law, ("path_a",)), inputs, owners)["force_by_path_a"]
    for k, unit in enumerate(np.eye(3)):
        moved = [
            evaluate(case.program_of_law, inputs | {"path_a": inputs["path_a"] + h * unit}, owners)[
                "force"
            ]
            for h in (1e-5, -1e-5)
        ]
        np.testing.assert_allclose(
            slope[:, k], (moved[0] - moved[1]) / 2e-5, rtol=0, atol=2e-4 * np.abs(slope).max()
        )


def test_names_and_shares() -> None:
    time = variable("t")
    shares = push_shares(time, constant(1.0), constant(4.0), constant(2.0))
    found = evaluate(
        Program("p", (time,), dict(zip("cg", shares, strict=True))),
        {"t": np.array([0.5, 1.5, 3.5, 4.5, 7.0])},
        {},
    )
    np.testing.assert_allclose(found["c"], [0.0, 3 / 16 - 2 / 64, 1.0, 1.0, 1.0])
    np.testing.assert_allclose(found["g"], [0.0, 0.0, 0.0, 3 / 16 - 2 / 64, 1.0])
    servos = {"geometric_impedance", "geometric_force"}
    assert {law for law in (*LAWS, "off") if turns_servos(law)} == servos
    assert {law for law in LAWS if LAWS[law].leans} == servos | {"geometric"}
    assert {law for law in LAWS if LAWS[law].pushes} == {"force", "geometric_force"}
    assert {law for law in LAWS if LAWS[law].hindrance(0, "tip")} == servos
    assert not any(x.hindrance(1, "tip") for x in LAWS.values())


def smallest(columns: Array, wrench: Array) -> Array:
    return np.linalg.pinv(columns.T) @ wrench


def nearest(thrusts: Array, wrench: Array, columns: Array, least: Array, most: Array) -> Array:
    """Bounded least squares by SciPy, torque divided by the mean lever, small thrusts preferred."""
    if np.all((least <= thrusts) & (thrusts <= most)):
        return thrusts
    weights = np.repeat([1.0, np.linalg.norm(columns[:, :3]) / np.linalg.norm(columns[:, 3:])], 3)
    matrix = weights[:, None] * columns.T
    small = 1e-5 * np.linalg.norm(matrix) * np.eye(len(columns))
    right = np.concatenate([weights * wrench, np.zeros(len(columns))])
    found: Array = lsq_linear(
        np.concatenate([matrix, small]), right, (least, most), method="bvls"
    ).x
    return found


def wrench_of(state: State, q: Array, centre: Array, force: Array) -> Array:
    """The wrench about a point that does the work of a force on the base, however that moves."""
    turn, columns = state.turn(q), []
    for unit in np.eye(8):
        linear, spin = (turn.T @ x for x in state.twist(q, unit))
        columns.append(np.concatenate([linear + np.cross(spin, centre), spin]))
    base = [*range(8)[state.lines], *range(8)[state.places]]
    found: Array = np.linalg.solve(np.stack(columns)[base], force[base])
    return found


EXTERNALS = {"smallest_thrusts": smallest, "nearest_thrusts": nearest}


@pytest.mark.parametrize("count", [4, 6, 8])
def test_allocation_by_formulas_has_the_values_and_slopes_of_scipy(count: int) -> None:
    random = np.random.default_rng(6)
    given = {
        "columns": random.normal(size=(count, 6)),
        "wrench": random.normal(size=6),
        "least": random.uniform(-0.4, -0.2, count),
        "most": random.uniform(0.1, 0.3, count),
    }
    inputs = {name: variable(name, *x.shape) for name, x in given.items()}
    small = smallest_thrusts(inputs["columns"], inputs["wrench"])
    near = nearest_thrusts(small, *(inputs[x] for x in ("wrench", "columns", "least", "most")))
    program = Program("p", tuple(inputs.values()), {"small": small, "near": near})
    for wide in (1.0, 30.0):
        own = given | {"least": wide * given["least"], "most": wide * given["most"]}
        found = evaluate(jacobian(program, tuple(own)), own, {}, externals=EXTERNALS)
        bars = {f"{x}_bar": random.normal(size=count) for x in ("small", "near")}
        back = evaluate(gradient(program, tuple(own)), own | bars, {}, externals=EXTERNALS)
        for name, x in own.items():
            way = random.normal(size=x.shape)
            for output in ("small", "near"):
                ends = [
                    evaluate(program, own | {name: x + h * way}, {}, externals=EXTERNALS)[output]
                    for h in (1e-6, -1e-6)
                ]
                slope = found[f"{output}_by_{name}"] @ way.ravel()
                np.testing.assert_allclose(slope, (ends[0] - ends[1]) / 2e-6, rtol=0, atol=1e-4)
            total = sum(bars[f"{o}_bar"] @ found[f"{o}_by_{name}"] for o in ("small", "near"))
            np.testing.assert_allclose(back[f"{name}_bar"].ravel(), total, rtol=0, atol=1e-8)
        assert (
            np.any((found["near"] == own["most"]) | (found["near"] == own["least"])) or wide > 1.0
        )


@pytest.mark.parametrize(
    ("moves", "refuses", "limited"), [(False, True, True), (True, True, False), (True, False, True)]
)
@pytest.mark.parametrize("attitude", ROOTS)
def test_inputs_share_a_wrench_among_rotors(
    attitude: str, moves: bool, refuses: bool, limited: bool
) -> None:
    state = State(attitude)
    robot, module, random = Functions(state.module), state.module, np.random.default_rng(9)
    q, f = robot.coordinates(), robot.velocities("f")
    columns = random.normal(size=(4, 6))
    given = {
        "centre": random.normal(size=3),
        "distribution": np.linalg.pinv(columns.T),
        "wrenches": columns,
        "least": np.full(4, -0.5),
        "most": np.full(4, 0.6),
    }
    own = {name: variable(name, *x.shape) for name, x in given.items()}
    rotors = Rotors(*own.values(), limited=limited, move=moves, refuse=refuses, exact=0.01)
    u, refused = inputs_of(robot, q, f, rotors)
    asked = {"mass": variable("mass"), "axis": variable("axis", 3), "weight": variable("weight", 3)}
    known = weight_of(robot, q, lambda name, *shape: asked[name], rotors)
    limits = Limits(constant(np.full(6, -0.2)), constant(np.full(6, 0.3)))
    outputs = {"u": u, "refused": refused, "within": within_limits(u, limits)}
    outputs |= {"axis_of": known.axis, "mass_of": known.mass}
    program = Program("p", (q, f, *own.values(), *asked.values()), outputs)
    values = {x: state.given[x] for x in "qf"} | given
    values |= {"mass": np.array(2.0), "axis": AXIS, "weight": AXIS}
    by_hand: dict[str, Any] = {**EXTERNALS, "force_axis": lambda x: x.sum(0)[:3]}
    found = evaluate(program, values, {"robot": module}, externals=by_hand)

    def wrench(force: Array) -> Array:
        return wrench_of(state, values["q"], given["centre"], force)

    loads = module.input_matrix(values["q"])
    if moves:
        columns = np.stack([wrench(column) for column in loads.T[:4]])
    asked_for = wrench(values["f"])
    thrusts = smallest(columns, asked_for)
    left = np.linalg.norm(asked_for - columns.T @ thrusts)
    left = left - 0.01 * (1.0 + np.linalg.norm(asked_for))
    if limited:
        thrusts = nearest(thrusts, asked_for, columns, given["least"], given["most"])
    efforts = values["f"][state.joints] - (loads[state.joints, :4] @ thrusts if moves else 0.0)
    wanted = np.concatenate([thrusts, efforts])
    close(found["u"], wanted, 1e-6)
    close(found["within"], np.clip(wanted, -0.2, 0.3), 1e-6)
    close(found["refused"], max(left, 0.0) if refuses else 0.0, 1e-9)
    close(found["axis_of"], columns.sum(0)[:3] if moves else AXIS)
    lost = {**by_hand, "nearest_thrusts": lambda thrusts, *_: np.full(4, np.nan)}
    if limited:
        assert np.isnan(evaluate(program, values, {"robot": module}, externals=lost)["refused"])
    values["f"], lost["smallest_thrusts"] = np.full(8, np.nan), lambda c, w: np.full(4, np.nan)
    assert evaluate(program, values, {"robot": module}, externals=lost)["refused"] == 0.0


@pytest.mark.parametrize("real", [np.float64, np.float32])
def test_laws_for_firmware(real: Any, tmp_path: Path) -> None:
    """What laws know of the rotors, and inputs, in structures of C."""
    module = load(FOLDER)
    robot, name = Functions(module), module.NAME
    made = law_functions(robot, ("computed_torque", "force"), module.POINTS.index("O2"), 1, False)
    for file, text in c_files(robot, f"{name}_laws", "Laws.", made, opening(robot)).items():
        assert max(map(len, text.partition("SPDX")[2].splitlines())) <= 100
        (tmp_path / file).write_text(text, encoding="utf-8")
    options = ["-O0", "-fPIC", f"-I{FOLDER}", "-Wno-unused-function"]
    options += [f"-D{name.upper()}_FLOAT"] if real is np.float32 else []
    sources = [str(FOLDER / f"{name}.c"), str(tmp_path / f"{name}_laws.c")]
    objects = compile_only("gcc", options, sources, tmp_path)
    build("gcc", ["-shared"], ["-x", "none", *map(str, objects)], tmp_path / "laws.so")
    library, mark = ctypes.CDLL(str(tmp_path / "laws.so")), "_float" if real is np.float32 else ""
    constants = ctypes.c_char.in_dll(library, f"{name}_default_constants{mark}")

    def called(function: Any, given: dict[str, Array], output: Array) -> Array:
        parts = [
            np.concatenate([np.ravel(given[member.value]) for member in structure.members])
            for structure in function.structures
            if structure.members[0].value in given
        ]
        arrays = [*(x.astype(real) for x in parts), output]
        pointers = (ctypes.c_void_p(x.ctypes.data) for x in arrays)
        library[f"{name}_{function.program.name}"](ctypes.byref(constants), *pointers)
        return output

    init, *laws = made
    sizes = [x.size for x in init.program.outputs.values()]
    packed = np.split(called(init, {}, np.full(sum(sizes), np.nan, real)), np.cumsum(sizes)[:-1])
    outputs = init.program.outputs.items()
    rotors = {n: p.reshape(x.shape) for (n, x), p in zip(outputs, packed, strict=True)}
    near, level = 1e-12 if real is np.float64 else 1e-4, np.zeros(9)
    centre = module.positions(level)[module.POINTS.index("O2")]

    def wrench(q: Array, force: Array) -> Array:
        turn, twists, base = module.frame_poses(q)[0, :3, :3], [], [0, 1, 2, 6, 7, 8]
        for unit in np.eye(9)[base]:
            linear, spin = turn.T @ unit[6:], turn.T @ module.frame_velocities(q, unit)[0, 3:]
            twists.append(np.concatenate([linear + np.cross(spin, centre), spin]))
        found: Array = np.linalg.solve(np.stack(twists), force[base])
        return found

    columns = np.stack([wrench(level, x) for x in module.input_matrix(level).T[:6]])
    close(rotors["centre"], centre, near)
    close(rotors["wrenches"], columns, near)
    close(rotors["distribution"], np.linalg.pinv(columns.T, rcond=1e-9), near)
    own, (torque, force) = {n: np.asarray(x, float) for n, x in rotors.items()}, laws
    random = np.random.default_rng(3)
    for bounds in (np.inf, 3.0):
        inputs = dict(zip(force.program.names, force.program.inputs, strict=True))
        given = {n: random.uniform(-0.4, 0.4, x.shape) for n, x in inputs.items()} | own
        given |= {n: np.abs(given[n]) + 1.0 for n in ("frame_inertia", "stiffness", "damping")}
        given |= {"least": np.full(9, -bounds), "most": np.full(9, bounds)}
        values = {n: given[n] for n in force.program.names}
        wanted = evaluate(force.program, values, {"robot": module}, externals=EXTERNALS)["u"]
        rough = near if bounds > 3.0 else 1e3 * near
        close(called(force, given, np.full(9, np.nan, real)), wanted, rough)
        q, v = given["q"], given["v"]
        pull = given["stiffness"] * (given["desired_q"] - q) + given["damping"] * (
            given["desired_v"] - v
        )
        needed = module.inverse_dynamics(q, v, given["desired_a"] + pull)
        asked = wrench(q, needed)
        thrusts = nearest(
            own["distribution"] @ asked,
            asked,
            own["wrenches"],
            *([x] * 6 for x in (-bounds, bounds)),
        )
        right = np.clip(np.concatenate([thrusts, needed[3:6]]), -bounds, bounds)
        close(called(torque, given, np.full(9, np.nan, real)), right, rough)


@pytest.mark.parametrize("attitude", ROOTS)
@pytest.mark.parametrize("moves", [True, False])
def test_functions_of_laws(attitude: str, moves: bool) -> None:
    """What they know of the rotors, and that each is its law within limits."""
    case = Case(attitude)
    module, robot = case.module, Functions(case.module)
    init, *made = law_functions(robot, LAWS, 0, 1, moves)
    structures = [structure for function in made for structure in function.structures]
    assert all(x.name.isidentifier() for each in structures for x in each.members)
    by_hand = {**EXTERNALS, "force_axis": lambda x: x.sum(0)[:3]}
    level = np.array(robot.layout.neutral)
    known = evaluate(init.program, {}, {"robot": module}, externals=by_hand)
    centre, still = module.positions(level)[0], np.zeros(8)
    loads = module.input_matrix(level).T[:4]
    columns = np.stack([wrench_of(case, level, centre, x) for x in loads])
    place = case.lines.start
    wanted = {
        "centre": centre,
        "wrenches": columns,
        "distribution": np.linalg.pinv(columns.T),
        "axis": np.sum(columns, 0)[:3],
        "mass": module.mass_matrix(level)[place, place],
        "weight": module.inverse_dynamics(level, still, still)[case.lines],
    }
    for name, value in known.items():
        close(value, wanted[name], 1e-9, name)
    assert {*known} >= {"centre", "mass", "weight"}
    assert ("distribution" in known) != moves
    g = case.given | wanted | {"weight": case.given["weight"], "mass": np.array(NUMBERS["mass"])}
    g |= {"axis": AXIS, "push": g["force"], "least": np.full(6, -2.0), "most": np.full(6, 2.5)}
    for name, x in (("position", "path"), ("velocity", "path_v"), ("acceleration", "path_a")):
        g[f"centre_{name}"] = g[x]
    g |= {f"desired_{x}": g[f"{x}_d"] for x in "qva"}
    for function in made:
        law = function.program.name
        given = {n: g[n] for n in function.program.names}
        found = evaluate(function.program, given, {"robot": module}, externals=by_hand)["u"]
        assert np.all((found >= -2.0) & (found <= 2.5))
        if moves and LAWS[law].leans:
            continue  # The axis is that of the posture.
        asked = case.program(law, remembers=False)["force"]
        q, f = robot.coordinates(), robot.velocities("f")
        own = centre, wanted["distribution"], columns, g["least"][:4], g["most"][:4]
        rotors = Rotors(*map(constant, own), move=moves)
        u = Program("u", (q, f), {"u": inputs_of(robot, q, f, rotors)[0]})
        right = evaluate(u, {"q": g["q"], "f": asked}, {"robot": module}, externals=by_hand)["u"]
        close(found, np.clip(right, -2.0, 2.5), 1e-9, law)
