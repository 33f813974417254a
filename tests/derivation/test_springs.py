"""Springs between frames, against the distances of these, and by all that verification knows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from derivation.test_hybrid import check_chains
from support.emitted import emitted_module, module_with_derivatives
from support.machines import base, frame, link, machine, spring
from support.random_robots import sprung_robot

from gibbs_codegen.equations.show import chain_equation
from gibbs_codegen.errors import RobotFileError, UsageError
from gibbs_codegen.flight.scenario.parts import Control, Settings
from gibbs_codegen.flight.scenario.paths import Fixed
from gibbs_codegen.flight.scenario.scenario import Scenario
from gibbs_codegen.flight.simulation import simulate
from gibbs_codegen.robot.file import parse_robot
from gibbs_codegen.robot.parts.frame import Frame
from gibbs_codegen.robot.parts.pose import Pose
from gibbs_codegen.robot.text import robot_text
from gibbs_codegen.verification.verify import QUICK, compare_module, formulations

TEXT = machine(
    "sprung",
    base(1.2, [0.01, 0.01, 0.02], attitude="quaternion"),
    link("upper", "y", [0, 0, -0.05], 0.2, [0, 0.01, -0.1], [0.0003, 0.0003, 2e-05]),
    link(
        *("slider", "z", [0.05, 0, -0.1], 0.1, [0.01, 0, -0.08], [3e-4, 3e-4, 2e-5]),
        joint="prismatic",
    ),
    frame("anchor", "base", [0.1, 0.02, 0.03]),
    frame("hand", "slider", [0, 0.02, -0.13]),
    spring("tendon", "hand", "anchor", stiffness=30, length=0.1, damping=0.4),
)
ROBOT = parse_robot(TEXT)
TENDON = ROBOT.springs[0]
FINITE = ("mass_matrix", "potential_energy", "gibbs", "joint_wrenches")
FUNCTIONS = ("residual", "potential_energy", "frame_poses", "frame_velocities", "inverse_dynamics")


def test_forces_are_what_the_distance_of_the_frames_makes() -> None:
    """Power is that of a pull along the line between the frames, for any motion."""
    module, free = (
        emitted_module(replace(robot, name=name), *FUNCTIONS)
        for name, robot in (("sprung", ROBOT), ("free", replace(ROBOT, springs=())))
    )
    rng = np.random.default_rng(1)
    hand, anchor = (module.FRAMES.index(name) for name in ("hand", "anchor"))
    for _ in range(4):
        q, v = rng.normal(size=9), rng.normal(size=8)
        q[3:7] /= np.linalg.norm(q[3:7])
        poses, twists = module.frame_poses(q), module.frame_velocities(q, v)
        way = poses[hand, :3, 3] - poses[anchor, :3, 3]
        length = np.linalg.norm(way)
        rate = way @ (twists[hand, :3] - twists[anchor, :3]) / length
        tension = TENDON.stiffness * (length - TENDON.length) + TENDON.damping * rate
        forces = module.residual(q, v) - free.residual(q, v)
        assert forces @ v == pytest.approx(-tension * rate, abs=1e-12)
        assert np.abs(forces[:6]).max() <= 1e-14  # It moves no base.
        stored = module.potential_energy(q) - free.potential_energy(q)
        assert stored == pytest.approx(0.5 * TENDON.stiffness * (length - TENDON.length) ** 2)


def test_springs_are_read_as_they_are_written() -> None:
    assert parse_robot(robot_text(ROBOT)) == ROBOT


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('to = "anchor"', 'to = "anchr"', "to: must be the name of a frame, not 'anchr'"),
        ('to = "anchor"', 'to = "hand"', "to: 'hand' is the frame at the other end"),
        ('to = "anchor"', 'to = "world"', "to: must be the name of a frame, not 'world'"),
        ('to = "anchor"', "", "to: missing: the frame at the other end"),
        ('"hand"\nto ', '"base"\nto ', "to: both frames are on the same body"),
        ("stiffness = 30", "", "stiffness: missing"),
    ],
)
def test_springs_that_pull_at_nothing_are_refused(old: str, new: str, words: str) -> None:
    assert old in TEXT
    with pytest.raises(RobotFileError, match=words):
        parse_robot(TEXT.replace(old, new))


# With attitude angles and quaternions, links that are held and welded, joints that slide, springs
# of no length, and dampers.
@pytest.mark.slow
@pytest.mark.parametrize("seed", [37, 48])
def test_sprung_robots_pass_with_derivatives(seed: int) -> None:
    """They take seconds to derive."""
    robot = sprung_robot(seed)
    module, (known, _) = module_with_derivatives(robot), formulations(robot)
    comparisons = compare_module(module, robot, known, 1, 0, extent=QUICK)
    assert [c.what for c in comparisons if not c.passed] == []
    names = {c.what for c in comparisons}
    assert {"forward_dynamics_derivatives.acceleration_dq", "constraint_torques"} <= names


def test_springs_over_links_that_are_held_belong_to_their_chains() -> None:
    robot = sprung_robot(37)
    assert robot.constrained
    assert robot.springs
    check_chains(robot)


@pytest.mark.slow  # Robots are derived with all functions.
def test_frames_that_meet_leave_all_results_finite() -> None:
    """A spring has no direction there, and does not pull."""
    robot = replace(
        ROBOT,
        frames=(*ROBOT.frames, Frame("pin", 1), Frame("hinge", 0, Pose((0.0, 0.0, -0.05)))),
        springs=(replace(TENDON, frame="pin", to="hinge"),),
    )
    module, free = (
        emitted_module(replace(x, name=name), "residual", *FINITE)
        for name, x in (("met", robot), ("unmet", ROBOT))
    )
    q, v = np.array([0.1, 0.2, 0.3, 0.0, 0.6, 0.0, 0.8, 0.4, 0.1]), np.linspace(-1.0, 1.0, 8)
    slack = {f"spring_tendon_{number}": 0.0 for number in ("stiffness", "damping")}
    apart = free.residual(q, v, constants=free.prepare(slack))
    assert module.residual(q, v) == pytest.approx(apart, abs=1e-12)
    for function in FINITE:
        arguments = {"mass_matrix": (q,), "potential_energy": (q,), "gibbs": (q, v, v)}
        values = getattr(module, function)(*arguments.get(function, (q, v, v, np.ones(2))))
        assert np.all(np.isfinite(values)), function


@pytest.mark.slow  # Robots are derived with all functions.
@pytest.mark.parametrize("damping", [0.0, 0.4])
def test_energy_balances_over_a_flight(damping: float) -> None:
    """A spring that is let go moves joints by a joule; only a damper takes energy."""
    robot = replace(ROBOT, name="let_go", springs=(replace(TENDON, stiffness=90.0),))
    module = emitted_module(robot, "default")
    steady = Settings(relative_tolerance=1e-10, absolute_tolerance=1e-11)
    flight = simulate(
        module,
        Scenario(
            "let_go",
            0.5,
            Fixed((0.0, 0.0, 2.0)),
            control=Control(law="off"),
            integration=steady,
            parameters={"spring_tendon_damping": damping},
        ),
    )
    swing = np.ptp(flight.kinetic_energy)
    total = flight.kinetic_energy + flight.potential_energy
    assert swing > 0.5
    assert np.abs(flight.energy_error).max() <= 1e-7 * swing
    assert (total[0] - total[-1] > 0.05) == (damping > 0.0)


def test_chains_that_springs_leave_are_not_shown() -> None:
    with pytest.raises(UsageError, match="sprung: chains cannot be shown with springs"):
        chain_equation(ROBOT, 1, 2)
