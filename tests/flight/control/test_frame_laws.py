"""Laws that move a frame: impedance, and force and position, of bases of both kinds."""

from __future__ import annotations

import pickle
import runpy
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from scipy.integrate import solve_ivp

import gibbs_codegen
from gibbs_codegen import generate, load
from gibbs_codegen.errors import ScenarioFileError, UsageError
from gibbs_codegen.flight.control.sampled_control import Observation
from gibbs_codegen.flight.plant.vehicle import Array, Vehicle
from gibbs_codegen.flight.record.flight import Flight
from gibbs_codegen.flight.scenario.file import read_scenario
from gibbs_codegen.flight.simulation import flight_start, simulate
from gibbs_codegen.flight.stepping import Simulation

Load = Callable[[str], ModuleType]
ROBOTS = Path(gibbs_codegen.__file__).parent / "robots"

FIXED = {"method": "rk4", "step": 1e-3}
IMPEDANCE = {"stiffness": [40, 60, 80], "damping": [22, 30, 37], "inertia": [3, 4, 5]}
HEXTILT = ["base_link_link_1", *(f"link_{k}_link_{k + 1}" for k in range(1, 5))]
# Bent arms, whose joints can move the tip; of the second robot within a plane.
BENT = {
    "hexarotor_3link": {"theta_7": -100, "theta_9": 60},
    "hextilt_flying_arm_5": {"flying_arm_5__j_base_link_link_1": 70},
    "quadrotor_arm_2link": {"upper_arm": 12, "forearm": 68},
}


def flown(module: ModuleType, duration: float, **changes: Any) -> Flight:
    """A flight in hover with a bent arm, without lag if nothing else is said."""
    given = {"arm.posture_deg": BENT[module.NAME], "motors.time_constant": 0, "integration": FIXED}
    if module.NAME.startswith("hextilt"):  # Its joints bear less than a push along the arm.
        given["arm.effort"] = {f"flying_arm_5__j_{x}": 5.0 for x in HEXTILT}
    flight = simulate(module, read_scenario("hover", {"duration": duration, **given, **changes}))
    assert not flight.stopped
    return flight


def tips(module: ModuleType, flight: Flight) -> Array:
    """How far (s, 3), m, the tip is off where it is wanted."""
    place, count = module.FRAMES.index("tip"), len(flight.time)
    here, there = (module.frame_poses(q)[:, place, :3, 3] for q in (flight.q, flight.q_desired))
    return np.asarray(here - there[:count])


def wall(module: ModuleType, gap: float, **others: Any) -> dict[str, Any]:
    """A wall before the tip in hover, towards x."""
    still = flown(module, 0.01)
    tip = module.frame_poses(still.q[0])[module.FRAMES.index("tip"), :3, 3]
    point = (tip + np.array([gap, 0, 0])).tolist()
    return {"frame": "tip", "point": point, "normal": [-1, 0, 0], "stiffness": 1000.0, **others}


@pytest.mark.parametrize("name", ["hexarotor_3link"])
def test_a_frame_moves_as_a_body_on_springs(name: str, fast: Load) -> None:
    module, force = fast(name), np.array([0.5, 1.0, -2.0])
    push = {"force": force.tolist(), "torque": [0.05, -0.1, 0.02], "end": 100}
    control = {"law": "impedance", "impedance": IMPEDANCE}
    flight = flown(module, 6.0, control=control, push=push)
    inertia, damping, stiffness = (
        np.array(IMPEDANCE[x]) for x in ("inertia", "damping", "stiffness")
    )
    # Two roots of inertia s² + damping s + stiffness, which differ.
    root = np.sqrt((damping / (2 * inertia)) ** 2 - stiffness / inertia + 0j)
    first, second = -damping / (2 * inertia) + root, -damping / (2 * inertia) - root
    time = flight.time[:, np.newaxis]
    left = (second * np.exp(first * time) - first * np.exp(second * time)) / (second - first)
    off = tips(module, flight)
    assert off == pytest.approx((force / stiffness * (1 - left)).real, abs=1e-7)
    # Of all postures with the tip there it is the one nearest to that wanted.
    moved = module.difference(flight.q_desired[-1], flight.q[-1])
    slope = module.frame_jacobians(flight.q[-1])[module.FRAMES.index("tip"), :3]
    needed = np.linalg.lstsq(slope, slope @ moved, rcond=None)[0]
    assert moved == pytest.approx(needed, abs=0.01 * np.linalg.norm(moved))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hexarotor_3link"])
def test_a_push_is_a_mass_that_pushes_a_spring(name: str, fast: Load) -> None:
    """From before the wall into it, with what integral action learns."""
    module = fast(name)
    mass, damping, stiffness, integral = 2.0, 60.0, 1000.0, 3.0
    push = {"value": 1.5, "direction": [2, 0, 0], "begin": 0.1, "rise": 0.4, "integral": integral}
    impedance = {"inertia": [mass] * 3, "damping": [damping] * 3, "stiffness": [50] * 3}
    control = {"law": "force", "force": push, "impedance": impedance}
    gap, step = 0.002, 2e-4
    flight = flown(
        module,
        1.5,
        control=control,
        wall=[wall(module, gap)],
        integration={"method": "rk4", "step": step},
    )

    def rate(time: float, state: Array) -> list[float]:
        x, speed, learnt = state
        part = np.clip((time - 0.1) / 0.4, 0.0, 1.0)
        share, pressed = part**2 * (3.0 - 2.0 * part), max(stiffness * (x - gap), 0.0)
        pull = share * (1.5 + integral * learnt) - (1.0 - share) * 50.0 * x - pressed
        learning = share * np.clip(2.0 * pressed / 1.5, 0.0, 1.0)
        return [speed, (pull - damping * speed) / mass, learning * (1.5 - pressed)]

    oracle = solve_ivp(
        rate, (0, 1.5), [0, 0, 0], t_eval=flight.time, rtol=1e-10, atol=1e-12, max_step=1e-3
    )
    assert flight.wall_forces[:, 0].max() > 1.4
    assert tips(module, flight)[:, 0] == pytest.approx(oracle.y[0], abs=1e-6)


@pytest.mark.slow
def test_a_frame_that_begins_deep_in_a_wall_is_noted(fast: Load) -> None:
    module = fast("hexarotor_3link")
    walls = [wall(module, gap) for gap in (0.01, -0.01, -0.18)]
    (note,) = flown(module, 0.01, wall=walls).notes
    assert note.startswith("tip begins 0.18 m inside wall 3, which pushes it with 180 N")


PUSHES: dict[str, dict[str, Any]] = {
    "hexarotor_3link": {"frequency": 8},
    "quadrotor_arm_2link": {
        "frequency": 5,
        "impedance": {"stiffness": [100] * 3, "damping": [60, 20, 20], "inertia": [1] * 3},
    },
}


@pytest.mark.slow
def test_servos_push_with_the_force_that_is_asked_for(tmp_path: Path, fast: Load) -> None:
    """Joints that are sent positions bear what the law wants, in NumPy as in C."""
    text = (ROBOTS / "quadrotor_arm_2link.toml").read_text(encoding="utf-8")
    servo = "servo = { stiffness = 30, damping = 0.6, delay = 0.02, rate = 6 }"
    text = text.replace("\nmass       = ", f"\n{servo}\nmass = ")
    (tmp_path / "served.toml").write_text(text.replace(name := "quadrotor_arm_2link", "served"))
    folder = generate(str(tmp_path / "served.toml"), str(tmp_path), verify=False)
    module, plain = load(folder, "c"), load(folder, "numpy")
    assert module.COMMANDS[-1] == "forearm_position"
    push = {"value": 3.0, "direction": [1, 0, 0], "begin": 0.1, "rise": 0.5, "integral": 4}
    given = {
        "control": {"law": "force", "force": push, **PUSHES[name]},
        "arm.posture_deg": BENT[name],
        "wall": [wall(fast(name), 0.005, damping=20)],
        "plant": {x: 1.1 * v for x, v in module.PARAMETERS.items() if x.endswith("_mass")},
        "integration": FIXED,
    }
    flight = simulate(module, read_scenario("hover", {"duration": 5.0, **given}))
    assert not flight.stopped
    assert flight.wall_forces[-1, 0] == pytest.approx(3.0, rel=0.02)
    short = read_scenario("hover", {"duration": 0.02, **given})
    in_c, in_numpy = (simulate(each, short).commands for each in (module, plain))
    assert in_c == pytest.approx(in_numpy, abs=1e-6)


@pytest.mark.slow
def test_a_joint_that_a_push_turns_far_is_noted(fast: Load) -> None:
    """By more than a quarter of its range, here by 1.6 of 6.28 rad."""
    flight = flown(
        module := fast("quadrotor_arm_2link"),
        0.05,
        control={"law": "force", "force": {"value": 1.0, "direction": [1, 0, 0]}},
        wall=[wall(module, 0.01)],
    )
    assert flight.notes == ()
    q = flight.q.copy()
    low, high = flight.joint_limits[:, -1]
    q[-1, -1] += 0.26 * min(high - low, 2.0 * np.pi)
    (note,) = replace(flight, q=q).notes
    assert note.startswith("forearm leaves its posture by ")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hexarotor_3link"])
def test_integral_action_makes_the_force_exact(name: str, fast: Load) -> None:
    """The machine is heavier than the law knows, motors lag, and the wall has friction."""
    module = fast(name)
    push = {"value": 3.0, "direction": [1, 0, 0], "begin": 0.5, "rise": 1.0, "integral": 4}
    heavier = {x: 1.1 * v for x, v in module.PARAMETERS.items() if x.endswith("_mass")}
    flight = flown(
        module,
        12.0,
        control={"law": "force", "force": push, "integral": 1.0, **PUSHES[name]},
        wall=[wall(module, 0.01, damping=20, friction=0.5)],
        plant=heavier or {"gravity": 10.5},
        **{"motors.time_constant": 0.02},
    )
    assert flight.law == "force"
    # What makes up for the lag follows the friction's creep, too: 4e-5 N are left of it after 12 s,
    # where 1e-5 were when it followed the acceleration that the law expects.
    assert flight.wall_forces[-1, 0] == pytest.approx(3.0, abs=1e-4)


@pytest.mark.slow
def test_compiled_flights_are_those_of_python(fast: Load, shipped: Load) -> None:
    module = fast(name := "quadrotor_arm_2link")
    push = {"value": 2.0, "direction": [1, 0, 0.2], "rise": 0.02}
    changes = {
        "duration": 0.05,
        "arm.posture_deg": BENT[name],
        "control": {"law": "force", "integral": 0.5, "force": push},
        "wall": [wall(module, -0.01, damping=10, friction=0.4)],
        "motors.time_constant": 0.02,
        "start": {"offset": [0.002, 0.001, 0], "turn_deg": [0, 1, 2]},
        "integration": {"method": "rk4", "step": 2.5e-3, "rate": 400},
    }
    scenario = read_scenario("hover", changes)
    compiled, plain = simulate(module, scenario), simulate(shipped(name), scenario)
    assert np.abs(compiled.wall_forces).max() > 0.5
    for each in ("q", "v", "commanded"):
        wanted = getattr(plain, each)
        assert getattr(compiled, each) == pytest.approx(wanted, abs=1e-8 * np.abs(wanted).max())


@pytest.mark.slow
def test_a_sampled_law_feels_what_sensors_tell(fast: Load) -> None:
    module = fast("hexarotor_3link")
    control = {"law": "impedance", "rate": 250, "impedance": IMPEDANCE}
    push = {"force": [0, 0, 2], "end": 100}
    flight = flown(module, 4.0, control=control, push=push)
    assert tips(module, flight)[-1] == pytest.approx([0, 0, 2 / 80], abs=1e-6)
    noisy, again = (
        flown(module, 0.2, control=control, push=push, sensors={"force": 0.2, "seed": 1})
        for _ in range(2)
    )
    assert np.abs(noisy.q - flight.q[: len(noisy.q)]).max() > 1e-5
    assert np.array_equal(noisy.q, again.q)


class Keeps:
    """Holds the inputs of hover, and keeps what it is told."""

    rate = 100.0

    def __init__(self, u: Array) -> None:
        self.u, self.seen = u, list[Observation]()

    def __call__(self, seen: Observation) -> Array:
        """The inputs."""
        self.seen.append(seen)
        return self.u


@pytest.mark.slow
@pytest.mark.parametrize("late", [0.02])
def test_observations_have_accelerations_wrenches_and_actuators(late: float, fast: Load) -> None:
    module = fast("quadrotor_arm_2link")
    push = {"force": [1, 2, 3], "torque": [0.1, 0, 0], "begin": 0.045, "frame": "tip"}
    changes = {
        "duration": 0.1,
        "push": push,
        "wind": {"velocity": [1, 0, 0], "drag": {"base": 0.3}},
        "wall": [{"frame": "base", "point": [0, 0, 2.01], "normal": [0, 0, 1], "stiffness": 90}],
        "sensors": {"delay": late},
        "integration": {"method": "rk4", "step": 1e-3, "rate": 1000},
    }
    own = Keeps(np.array([6.0, 6.0, 6.0, 7.0, 0.1, 0.0]))
    flight = simulate(module, read_scenario("hover", changes), own)
    assert len(own.seen) >= 10
    for seen in own.seen[3:]:
        row = round((seen.time - late) * 1000)
        touching = flight.frame_wrenches[row].copy()
        touching[0, :3] -= [0.3, 0, 0] - 0.3 * module.frame_velocities(flight.q, flight.v)[
            row, 0, :3
        ]
        assert seen.wrenches == pytest.approx(touching, abs=1e-9)
        assert seen.a == pytest.approx(flight.a[row], abs=1e-9)
        assert seen.actuators == pytest.approx(flight.applied[row, :4], abs=1e-9)
        assert not seen.wrenches.flags.writeable
    kept = pickle.loads(pickle.dumps(own.seen[5]))  # noqa: S301 - its own
    assert np.array_equal(kept.wrenches, own.seen[5].wrenches)
    loop = Simulation(module, read_scenario("hover", changes))
    loop.reset()
    seen = [loop.step(own.u, 0.01) for _ in range(6)][-1]
    same = next(each for each in own.seen if abs(each.time - 0.06) < 1e-9)
    assert seen.a == pytest.approx(same.a, abs=1e-9)
    assert seen.wrenches == pytest.approx(same.wrenches, abs=1e-9)
    with pytest.raises(UsageError, match="accelerations, wrenches and actuators are missing"):
        _ = Observation(0.0, *[np.zeros(1)] * 5).a


def test_noise_of_wrenches_and_accelerations_has_its_deviations(fast: Load) -> None:
    module, count = fast("hexarotor_3link"), 400
    sensors = {
        "force": 0.3,
        "torque": 0.02,
        "acceleration": 0.1,
        "joint_accelerations": 0.5,
        "angular_acceleration": 0.2,
    }
    told = Keeps(np.zeros(9))
    told.rate = 1e4
    integration = {"method": "rk4", "step": 1e-4, "rate": 1e4}
    changes = {"duration": count / 1e4, "sensors": sensors, "integration": integration}
    flight = simulate(module, read_scenario("hover", changes), told)
    wrenches = np.array([each.wrenches for each in told.seen])
    # At the first sample no inputs act yet.
    off = np.array([each.a for each in told.seen])[1:count] - flight.a[1:count]
    places = Vehicle(module).layout.v
    for values, deviation in (
        (wrenches[..., :3], 0.3),
        (wrenches[..., 3:], 0.02),
        (off[:, places.position], 0.1),
        (off[:, places.joints], 0.5),
        (off[:, places.attitude], 0.2),
    ):
        spread = values.std(axis=0)
        assert spread == pytest.approx(deviation, rel=5 / np.sqrt(2 * count))


@pytest.mark.parametrize(
    ("control", "words"),
    [
        ({"law": "force"}, "control.force: missing: give the push of the frame"),
        (
            {"impedance": {}},
            'control.impedance: must be left out, or the law be "impedance" or "force"',
        ),
        (
            {"law": "impedance", "force": {"value": 1, "direction": [0, 0, 1]}},
            'control.force: must be left out, or the law be "force"',
        ),
    ],
)
def test_what_is_said_of_a_contact_needs_its_law(control: dict[str, Any], words: str) -> None:
    with pytest.raises(ScenarioFileError, match=words):
        read_scenario("hover", {"control": control})


def test_a_frame_and_a_joint_that_are_none_are_refused_together(fast: Load) -> None:
    control = {"law": "impedance", "impedance": {"frame": "tup"}, "joints": {"elbow": {}}}
    words = r"control\.joints\.elbow: .*\ncontrol\.impedance\.frame: .* did you mean tip\?"
    with pytest.raises(UsageError, match=words):
        flown(fast("hexarotor_3link"), 0.1, control=control)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"damping": [6000, 30, 40]}, "integration.step"),
        ({"damping": [1, 1, 1], "stiffness": [9, 9, 9]}, "control.integral: 2 1/s makes errors"),
    ],
)
def test_gains_of_a_frame_that_no_step_follows_are_refused(
    changes: dict[str, Any], words: str, fast: Load
) -> None:
    push = {"value": 1, "direction": [1, 0, 0]}
    impedance = {"inertia": [2, 2, 2], **changes}
    control = {"law": "force", "force": push, "impedance": impedance, "integral": 2}
    with pytest.raises(UsageError, match=words):
        flown(fast("hexarotor_3link"), 0.1, control=control)


@pytest.mark.parametrize(
    ("changes", "refused"),
    [
        ({"direction": [0, 1, 0]}, True),
        ({"direction": [0, 2, 0], "axes": "base"}, True),
        ({"direction": [0, 0.1, 1]}, False),
        pytest.param({"direction": [0, 0, 1], "begin": 2}, True, marks=pytest.mark.slow),
    ],
)
def test_a_push_that_no_joint_can_exert_is_refused(
    changes: dict[str, Any], refused: bool, fast: Load
) -> None:
    module, straight = fast("quadrotor_arm_2link"), [{"to": 0, "duration": 1}]
    given: dict[str, Any] = {"arm.posture_deg": BENT[module.NAME], "duration": 3}
    if "begin" in changes:
        given["arm.moves_deg"] = dict.fromkeys(BENT[module.NAME], straight)
    given["control"] = {"law": "force", "force": {"value": 3, **changes}}
    words = "control.force.direction: quadrotor_arm_2link leans.* at . s none moves tip along"
    expected = pytest.raises(UsageError, match=words) if refused else nullcontext()
    with expected:
        flight_start(module, read_scenario("hover", given), lambda *_: None, custom_law=False)


def test_a_base_that_leans_needs_joints_to_move_a_frame(fast: Load) -> None:
    control = {"law": "impedance", "impedance": {"frame": "base"}}
    words = "quadrotor: geometric impedance control moves base by joints"
    with pytest.raises(UsageError, match=words):
        simulate(fast("quadrotor"), read_scenario("hover", {"control": control}))


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("hexarotor_3link", "force"),
        pytest.param("quadrotor_arm_2link", "impedance", marks=pytest.mark.slow),
    ],
)
def test_what_nothing_touches_follows_its_motion(name: str, law: str, fast: Load) -> None:
    """A base on a circle, and joints that move, with all that this does to each other."""
    module = fast(name)
    path = {"kind": "circle", "centre": [0, 0, 2], "radius": 0.6, "period": 4}
    joint = next(iter(BENT[name]))
    rest = {x: angle for x, angle in BENT[name].items() if x != joint}
    moves = {joint: [{"to": BENT[name][joint] + 25, "begin": 0.2, "duration": 1}]}
    push = {"force": {"value": 1, "direction": [1, 0, 0], "begin": 50}} if law == "force" else {}
    flight = flown(
        module,
        1.5,
        control={"law": law, **push},
        **{"base.path": path, "arm.moves_deg": moves, "arm.posture_deg": BENT[name] | rest},
    )
    assert np.ptp(flight.q[:, module.COORDINATES.index(joint)]) > 0.4
    assert np.linalg.norm(flight.v, axis=1).max() > 0.8
    assert tips(module, flight) == pytest.approx(0.0, abs=1e-5)
    assert np.abs(flight.errors).max() < 1e-5


@pytest.mark.parametrize("name", ["hexarotor_3link"])
def test_the_posture_comes_back(name: str, fast: Load) -> None:
    module = fast(name)
    start = {"offset": [0.05, -0.02, 0.03], "turn_deg": [3, 4, 5]}
    flight = flown(module, 6.0, control={"law": "impedance"}, start=start)
    assert np.abs(flight.errors[0]).max() > 0.04
    assert np.abs(flight.errors[-1]).max() < 1e-5


@pytest.mark.slow
def test_a_base_leans_against_what_its_tip_feels(fast: Load) -> None:
    """The centre of mass stays without integral action, and the tip yields within its plane."""
    module, force = fast("quadrotor_arm_2link"), np.array([1.0, 0.0, -0.5])
    impedance = {"stiffness": [50] * 3, "damping": [20] * 3, "inertia": [1] * 3}
    control = {"law": "impedance", "impedance": impedance}
    with pytest.warns(
        UserWarning, match=r"none moves tip along \[0, 1, 0\].* of the base holds the frame"
    ):
        flight = flown(module, 5.0, control=control, push={"force": force.tolist(), "end": 100})
    here, there = (module.centre_of_mass(q[-1]) for q in (flight.q, flight.q_desired))
    assert here == pytest.approx(there, abs=1e-6)
    # Weight and force together are along the axis of the rotors.
    pull = force - np.array([0, 0, flight.weight])
    axis = flight.base_rotation[-1][:, 2]
    assert np.cross(axis, pull / np.linalg.norm(pull)) == pytest.approx(0.0, abs=1e-6)
    # The posture takes a little of it.
    assert tips(module, flight)[-1] == pytest.approx(force / 50, abs=3e-4)


@pytest.mark.slow
def test_a_ball_finds_its_hole(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    found = runpy.run_path(str(ROOT / "examples" / "peg_in_a_hole.py"))
    assert not found["flight"].stopped
    assert found["deep"] > 0.055  # m
    assert found["sideways"].max() < 1  # N
