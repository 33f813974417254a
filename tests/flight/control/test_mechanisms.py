"""Laws of machines with loops over joints that nothing drives: four bars, on the ground and not."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from support.emitted import emitted_module, module_with_derivatives
from support.machines import PAIR, base, constraint, frame, link, machine

from gibbs_codegen import (
    UsageError,
    linearise,
    lqr,
    parse_robot,
    read_scenario,
    simulate,
    trim,
)
from gibbs_codegen.flight import Allocation, required_inputs
from gibbs_codegen.flight.plant.vehicle import Vehicle
from gibbs_codegen.robot.posture import default_posture, robot_frames

BARS = (
    link("crank", "y", [0, 0, 0], 0.3, [0, 0, 0], [0, 1e-3, 1e-3], parent="base")
    + link("coupler", "y", [0.2, 0, 0], 0.2, [0.2, 0, 0], [0, 1e-3, 1e-3], parent="crank", effort=0)
    + link("rocker", "y", [1.0, 0, 0], 0.4, [1.0, 0, 0], [0, 1e-3, 1e-3], parent="base", effort=0)
)
LOOP = (
    frame("tip", "coupler", [0.6, 0, 0])
    + frame("pin", "rocker", [0.5, 0, 0])
    + constraint("closure", "loop", "tip", to="pin", joint="spherical")
)


def text_of(motion: str) -> str:
    moving = base(2, [0.05, 0.05, 0.05], motion=json.loads(motion))
    return machine(f"four_bar_{len(motion)}", moving, BARS, LOOP, PAIR * ("pitch" in motion))


def four_bar(motion: str) -> Any:
    return emitted_module(parse_robot(text_of(motion)), "default", "constraints")


@pytest.mark.parametrize("motion", ['"fixed"', '["x", "z", "pitch"]'])
def test_the_driven_joint_follows_and_no_other_is_asked_for_torques(motion: str) -> None:
    module = four_bar(motion)
    begin = dict(zip(module.COORDINATES, np.degrees(module.POSTURE), strict=True))["crank"]
    tables = {"name": "turn", "duration": 0.6, "hold": [{"constraint": "closure"}]}
    tables["arm"] = {"moves_deg": {"crank": [{"to": begin + 30, "duration": 0.5}]}}
    tables["integration"] = {"method": "rk4", "step": 0.002}
    flight = simulate(module, read_scenario(tables))
    assert not flight.stopped
    off = np.abs(flight.q - flight.q_desired).max(axis=0)
    assert off[-3:].max() < 1e-6
    assert off.max() < 1e-4  # A base that leans follows a plan that is less exact.
    assert np.ptp(flight.q[:, flight.coordinates.index("crank") + 1]) > 0.3
    assert np.abs(module.constraint_errors(flight.q)).max() < 1e-5
    undriven = [module.INPUTS.index(f"tau_{name}") for name in ("coupler", "rocker")]
    assert np.abs(flight.commanded[:, undriven]).max() < 1e-8
    # At rest the crank bears by how much it lifts all that moves.
    if motion == '"fixed"':
        q, jacobian = flight.q[-1], module.constraint_jacobian(flight.q[-1])
        turns = np.append(1.0, np.linalg.lstsq(jacobian[:, 1:], -jacobian[:, 0])[0])
        lift = -module.gravity_forces(q) @ turns
        np.testing.assert_allclose(flight.applied[-1, 0], lift, rtol=1e-4)


def test_trims_are_of_closed_loops_and_open_loop_torques_hold_them() -> None:
    module = four_bar('"fixed"')
    at_rest = trim(module, posture_deg={"crank": -20})
    assert np.abs(module.constraint_errors(at_rest.q)).max() < 1e-9
    assert np.abs(at_rest.u[1:]).max() < 1e-12
    # Held by a torque alone, the crank is where the potential energy of the loop is stationary.
    low, high = (
        module.potential_energy(trim(module, posture_deg={"crank": x}).q) for x in (-20.01, -19.99)
    )
    assert at_rest.u[0] == pytest.approx((high - low) / np.radians(0.02), rel=1e-5)
    with pytest.raises(UsageError, match=r"free: crank: loops .* must stay closed"):
        trim(module, free="crank")
    assert trim(four_bar('["x", "z", "pitch"]')).residual < 1e-9
    tables = {"name": "still", "duration": 0.3, "hold": [{"constraint": "closure"}]}
    tables |= {"control": {"law": "open_loop"}, "integration": {"method": "rk4", "step": 0.002}}
    flight = simulate(module, read_scenario(tables))
    assert np.abs(flight.q - flight.q_desired).max() < 1e-8
    assert not flight.impact_summaries
    with pytest.raises(UsageError, match="the predictive law does not support loops"):
        simulate(module, read_scenario(tables | {"control": {"law": "predictive"}}))


def test_torques_and_fastest_motions_are_of_closed_loops() -> None:
    module = four_bar('"fixed"')
    vehicle, q = Vehicle(module), trim(module, posture_deg={"crank": -20}).q
    jacobian, levers = module.constraint_jacobian(q), module.constraint_jacobian(q)[:, 1:]
    turns = np.append(1.0, np.linalg.lstsq(levers, -jacobian[:, 0])[0])
    v, a = 1.3 * turns, 0.7 * turns
    a[1:] -= np.linalg.lstsq(levers, module.constraint_bias(q, v))[0]
    # What the crank does is all the work.
    wanted = [turns @ module.inverse_dynamics(q, v, a), 0.0, 0.0]
    u = required_inputs(vehicle, Allocation(vehicle.thrust_wrenches()), q, v, a)
    np.testing.assert_allclose(u, wanted, atol=1e-10)
    tables = {"name": "turn", "duration": 0.6, "hold": [{"constraint": "closure"}]}
    tables["arm"] = {"moves_deg": {"crank": [{"to": 0, "duration": 0.5}]}}
    tables["timing"] = {"law": "fastest", "effort": {"crank": 20.0}}
    tables["integration"] = {"method": "rk4", "step": 0.002}
    flight = simulate(module, read_scenario(tables))
    assert 19.0 < np.abs(flight.commanded[:, 0]).max() < 20.0


def test_linear_models_of_mechanisms_hold_loops_or_warn() -> None:
    soft = text_of('"fixed"').replace('"spherical"', '"spherical"\nfrequency = 5')
    for text, words in (
        (text_of('"fixed"'), "keep loops closed by constraints with a freq"),
        (soft, ""),
    ):
        module = module_with_derivatives(parse_robot(text.replace("four_bar", f"b{len(text)}")))
        hover = trim(module)
        with pytest.warns(RuntimeWarning, match="loops open: closure; give surroundings"):
            linearise(module, hover)
        held = {"duration": 1, "hold": [{"constraint": "closure"}]}
        given = {"Q": np.ones(6), "R": np.ones(3), "surroundings": held | {"name": "held"}}
        given["surroundings"] = read_scenario(given["surroundings"])
        if words:
            with pytest.raises(UsageError, match=words):
                lqr(module, hover, **given)
        else:
            assert lqr(module, hover, **given).eigenvalues.real.max() < -1e-3


def test_loops_that_are_open_or_out_of_reach_are_told(caplog: pytest.LogCaptureFixture) -> None:
    module = four_bar('"fixed"')
    tables = {"name": "still", "duration": 0.02, "control": {"law": "off"}}
    simulate(module, read_scenario(tables))
    for span in ({"begin": 0.01}, {"end": 0.01}, {}):  # All of it is held by the last alone.
        simulate(module, read_scenario(tables | {"hold": [{"constraint": "closure", **span}]}))
    told = "four_bar_7: moves with its loops open: closure; give the scenario a [[hold]] for each"
    assert [message.startswith(told) for message in caplog.messages] == 3 * [True]
    for arm, words in (
        (
            {"tip": {"kind": "fixed", "position": [0.3, 0, 0.3]}},
            "cannot follow paths, because its loops",
        ),
        ({"posture_deg": {"crank": 180}}, "t = 0 s its loops do not close at"),
        (
            {"moves_deg": {"rocker": [{"to": 9, "duration": 0.01}]}},
            "rocker: loops move this joint of",
        ),
    ):
        with pytest.raises(UsageError, match=words):
            simulate(module, read_scenario(tables | {"arm": arm}))


def test_no_law_leads_loops_that_no_hold_keeps_closed() -> None:
    module = four_bar('"fixed"')
    tables = {"name": "open", "duration": 0.02, "integration": {"method": "rk4", "step": 0.002}}
    flight = simulate(module, read_scenario(tables))
    # Each joint is asked for what it needs as of a tree.
    np.testing.assert_allclose(flight.commanded[0], -module.gravity_forces(flight.q[0]))
    tables |= {"duration": 1, "integration": tables["integration"] | {"divergence": 0.5}}
    assert "; it moves with its loops open: closure; give" in simulate(module, tables).stopped


def test_loops_close_as_near_as_they_can_to_what_is_asked(caplog: pytest.LogCaptureFixture) -> None:
    module = four_bar('"fixed"')
    tables = {"name": "still", "duration": 0.02, "hold": [{"constraint": "closure"}]}
    for crank in range(-100, 101, 40):
        arm = {"posture_deg": {"crank": crank}}
        begin = simulate(module, read_scenario(tables | {"arm": arm})).q[0]
        assert np.abs(module.constraint_errors(begin)).max() < 1e-12
        # The pin is under the line from crank to rocker, as in POSTURE, and nothing is wound.
        assert np.abs(begin - module.POSTURE).max() < np.pi
        assert (
            np.sin(begin[2] - begin[0] - begin[1])
            * np.sin(module.POSTURE[2] - module.POSTURE[0] - module.POSTURE[1])
            > 0
        )
    assert not caplog.messages
    simulate(module, read_scenario(tables | {"arm": {"posture_deg": {"rocker": -100}}}))
    assert caplog.messages == [
        "four_bar_7: arm.posture: closed loops determine joints without a drive: rocker"
    ]


def test_two_drives_rest_in_a_loop_and_are_told_where_they_break_it() -> None:
    robot = "".join(text_of('"fixed"').rsplit("effort = 0\n", 1))
    module = emitted_module(parse_robot(robot), "default", "constraints")
    assert module.LOOPS == {"closure": ("coupler",)}
    tables = {"name": "still", "duration": 0.1, "hold": [{"constraint": "closure"}]}
    tables["integration"] = {"method": "rk4", "step": 0.002}
    flight = simulate(module, read_scenario(tables))
    assert np.abs(flight.q - flight.q_desired).max() < 1e-6
    assert np.abs(flight.commanded[:, 1]).max() < 1e-8
    moves = {"moves_deg": {"rocker": [{"to": -90, "duration": 0.1}]}}
    with pytest.raises(UsageError, match="its loops do not close"):
        simulate(module, read_scenario(tables | {"arm": moves}))


def test_loops_that_do_not_tell_how_joints_move_are_refused() -> None:
    bars = text_of('"fixed"')
    same = bars.replace("1.0, 0, 0]", "0.6, 0, 0]").replace("0.5, 0, 0]", "0.2, 0, 0]")
    roll = (
        '[[link]]\nname = "rod"\nparent = "coupler"\nxyz = [0, 0, 0]\naxis = "x"\n'
        "effort = 0\nmass = 0.1\ncom = [0.1, 0.05, 0]\n"
        "inertia = [1e-4, 1e-4, 1e-4, 0, 0, 0]\n[[frame]]"
    )
    free = bars.replace("[[frame]]", roll, 1).replace('on = "coupler"', 'on = "rod"')
    turn = {"posture_deg": {"crank": 60, "coupler": -60, "rocker": 60}}
    turn["moves_deg"] = {"crank": [{"to": 240, "duration": 1}]}
    tables = {"name": "turn", "duration": 1, "hold": [{"constraint": "closure"}]}
    for robot, arm, words in (
        (same, turn, "s loops closure do not lead coupler, rocker; they pass a dead centre"),
        (free, {}, "t = 0 s loops closure do not determine rod; give"),
    ):
        module = emitted_module(parse_robot(robot), "default", "constraints")
        with pytest.raises(UsageError, match=words):
            simulate(module, read_scenario(tables | {"arm": arm}))


def test_limits_of_joints_that_nothing_drives_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    module = four_bar('"fixed"')
    monkeypatch.setitem(module.COORDINATE_LIMITS, "rocker", (-2.3, -2.2))
    tables = {"name": "turn", "duration": 0.5, "hold": [{"constraint": "closure"}]}
    tables["arm"] = {"moves_deg": {"crank": [{"to": 10, "duration": 0.5}]}}
    with pytest.raises(UsageError, match=r"its loops take rocker to .* beyond its limits"):
        simulate(module, read_scenario(tables))


def test_joints_without_a_range_stay_where_loops_close() -> None:
    limits = 'axis = "y"\nlimits_deg = [-20, -20]'
    robot = parse_robot(text_of('"fixed"').replace('axis = "y"', limits, 1))
    q = default_posture(robot)
    assert abs(q[0] - np.deg2rad(-20.0)) < 1e-7
    frames = robot_frames(robot, q).named
    np.testing.assert_allclose(frames["tip"].origin, frames["pin"].origin, atol=1e-6)
