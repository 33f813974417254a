"""FMUs as FMPy sees them: descriptions, flights, derivatives, saved states."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator, Sequence
from ctypes import c_double
from pathlib import Path
from types import ModuleType
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Model, FMU2Slave
from fmpy.fmi3 import FMU3Model, FMU3Slave
from fmpy.validation import validate_fmu
from numpy.typing import NDArray
from support import actuated, blown
from support.kept import made_once
from support.tools import compiled, tool

from gibbs_codegen import Observation, Simulation, generate, load, read_scenario, simulate
from gibbs_codegen.arrays import Functions, evaluate, jacobian
from gibbs_codegen.arrays.nodes import Program
from gibbs_codegen.machine.first_order import System

Array = NDArray[np.float64]
Make = Callable[[str], tuple[ModuleType, Path]]
STAND = '[[constraint]]\nname = "stand"\ntype = "point"\nframe = "tip"\n'
PERCHED = f"{blown.TEXT.replace('blown', 'perched')}{STAND}"
TEXTS = {"actuated": actuated.TEXT, "blown": blown.TEXT, "perched": PERCHED}
# What acts in FMUs besides forces and torques.
ACTING = {
    "quadrotor": ":drag",
    "actuated": ":drag",
    "blown": ":drag,walls,payloads",
    "perched": ":walls,constraints",
}
# Step of the flights, s.
STEP = 0.002
WARNINGS = [
    *("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"),
    *("-Wdouble-promotion", "-Wstrict-prototypes", "-Wmissing-prototypes", "-fPIC", "-shared"),
]
CLASSES: dict[tuple[int, str], Any] = {
    (3, "modelExchange"): FMU3Model,
    (3, "coSimulation"): FMU3Slave,
    (2, "modelExchange"): FMU2Model,
    (2, "coSimulation"): FMU2Slave,
}


class Unit:
    """An instance of an FMU whose variables are the arrays of FMI 3.0, whatever its version."""

    def __init__(self, folder: Path, version: int, kind: str, unzipped: Path) -> None:
        name = folder.name
        self.version = version
        paths = {3: folder / f"{name}.fmu", 2: folder / f"{name}_fmi2.fmu"}
        arrays = fmpy.read_model_description(str(paths[3])).modelVariables
        self.places = {x.name: x.valueReference for x in arrays}
        self.sizes = {x.name: int(np.prod([int(d.start) for d in x.dimensions])) for x in arrays}
        description = fmpy.read_model_description(str(paths[version]))
        self.fmu = CLASSES[version, kind](
            guid=description.guid,
            unzipDirectory=fmpy.extract(str(paths[version]), str(unzipped)),
            modelIdentifier=getattr(description, kind).modelIdentifier,
            instanceName="unit",
        )
        self.fmu.instantiate()
        if version == 2:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()

    def begin(self) -> None:
        """End the initialisation."""
        self.fmu.exitInitializationMode()

    def parts(self, start: str) -> list[str]:
        """Names that begin so, in the order of their places."""
        return sorted((x for x in self.places if x.startswith(start)), key=lambda x: self.places[x])

    def references(self, names: Sequence[str]) -> list[int]:
        """Value references of arrays, or of all their entries."""
        if self.version == 3:
            return [self.places[name] for name in names]
        return [self.places[x] + k for x in names for k in range(self.sizes[x])]

    def set(self, start: str, values: Any) -> None:
        """Set all variables that begin so, one after the other."""
        names, flat = self.parts(start), [float(x) for x in np.ravel(values)]
        put = self.fmu.setFloat64 if self.version == 3 else self.fmu.setReal
        put(self.references(names), flat)

    def get(self, *starts: str) -> Array:
        """Values of all variables that begin so, one after the other."""
        names = [name for start in starts for name in self.parts(start)]
        if self.version == 2:
            return np.array(self.fmu.getReal(self.references(names)))
        size = sum(self.sizes[name] for name in names)
        return np.array(self.fmu.getFloat64(self.references(names), nValues=size))

    def along(self, unknowns: list[str], knowns: list[str], seed: Array) -> Array:
        """The directional derivative of all that begin so by all that begin so."""
        of, by = ([n for s in starts for n in self.parts(s)] for starts in (unknowns, knowns))
        references, flat = (self.references(of), self.references(by)), [float(x) for x in seed]
        if self.version == 2:
            return np.array(self.fmu.getDirectionalDerivative(*references, flat))
        size = sum(self.sizes[name] for name in of)
        return np.array(self.fmu.getDirectionalDerivative(*references, flat, size))

    def rates(self, x: Array) -> Array:
        """Rates of a state, as solvers ask for them."""
        states, rates = (c_double * len(x))(*x), (c_double * len(x))()
        self.fmu.setContinuousStates(states, len(x))
        if self.version == 3:
            self.fmu.getContinuousStateDerivatives(rates, len(x))
        else:
            self.fmu.getDerivatives(rates, len(x))
        return np.array(rates)

    def advance(self, time: float, h: float) -> None:
        """Take a communication step."""
        self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=h)


@pytest.fixture(scope="session")
def made(kept: Path) -> Make:
    """Generate a robot that ships, or one of `TEXTS`, with its FMUs."""

    def make(name: str) -> tuple[ModuleType, Path]:
        folder, source = kept / "fmu" / name, name
        if name in TEXTS:
            source = str(kept / f"{name}.toml")
            Path(source).write_text(TEXTS[name], encoding="utf-8")
        targets = ["numpy", "c", f"fmu{ACTING.get(name, '')}"]
        options: dict[str, Any] = {"force": True, "verify": False}
        if name == "perched":
            options["functions"] = ["default", "constraints"]
        made_once(folder, lambda: generate(source, folder.parent, targets, **options))
        return load(folder, backend="c"), folder

    return make


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Callable[..., Unit]]:
    """Open FMUs, each in a folder of its own, and free them in the end."""
    units: list[Unit] = []

    def unit(folder: Path, version: int = 3, kind: str = "modelExchange") -> Unit:
        units.append(Unit(folder, version, kind, tmp_path / f"unit{len(units)}"))
        return units[-1]

    yield unit
    for each in units:
        each.fmu.terminate()
        each.fmu.freeInstance()


def check(folder: Path, unzipped: Path) -> None:
    """Both FMUs pass validation, and their sources compile as they are, and are short."""
    for ending in ("", "_fmi2"):
        path = folder / f"{folder.name}{ending}.fmu"
        assert validate_fmu(str(path)) == []
        with zipfile.ZipFile(path) as archive:
            archive.extractall(unzipped / ending)
    sources = sorted((unzipped / "sources").glob("*.c"))
    assert sum(x.stat().st_size for x in (unzipped / "sources").iterdir()) < 1e6
    assert all(x.stat().st_size < 1e6 for x in unzipped.rglob("*.so"))
    compiled([tool("gcc"), "-O0", *WARNINGS, *sources, "-lm"], unzipped / "whole.so")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["quadrotor"])
def test_descriptions_and_sources(made: Make, name: str, tmp_path: Path) -> None:
    check(made(name)[1], tmp_path)


def law(robot: ModuleType, q: Array, v: Array, wanted: Sequence[Array]) -> Array:
    """Computed torque: the inputs that a tracking error asks for."""
    off, faster = robot.difference(q, wanted[0]), wanted[1] - v
    force = robot.inverse_dynamics(q, v, wanted[2] + 25 * off + 10 * faster)
    found: Array = np.linalg.solve(robot.input_matrix(q), force)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hexarotor_3link", "rover_arm"])
@pytest.mark.parametrize(("version", "kind"), [(3, "modelExchange"), (2, "coSimulation")])
def test_motions_are_those_of_simulate(
    made: Make, opened: Callable[..., Unit], name: str, version: int, kind: str
) -> None:
    """The law closes the loop in both: by itself a flight is unstable, and rounding grows."""
    (robot, folder), duration = made(name), 0.2
    integration = {"method": "rk4", "step": STEP, "rate": 1.0 / STEP}
    keys = {"duration": duration, "control.rate": 1.0 / STEP, "integration": integration}
    drives = name == "rover_arm"

    def own(seen: Observation) -> Array:
        return law(robot, seen.q, seen.v, (seen.q_desired, seen.v_desired, seen.a_desired))

    scenario = read_scenario("drive" if drives else "circle", keys)
    flight = simulate(robot, scenario, controller=None if drives else own)
    unit, n = opened(folder, version, kind), len(robot.COORDINATES)
    x = np.concatenate([flight.q[0], flight.v[0]])
    unit.set("q.", x[:n])
    unit.set("v.", x[n:])
    unit.set("step_size", STEP)
    unit.begin()
    if kind == "modelExchange" and version == 3:
        unit.fmu.enterContinuousTimeMode()
    worst = 0.0
    for k, time in enumerate(flight.time[:-1]):
        wanted = flight.q_desired[k], flight.v_desired[k], flight.a_desired[k]
        # A drive is stable: what the law of the scenario made is replayed.
        u = flight.applied[k] if drives else law(robot, x[:n], x[n:], wanted)
        unit.set("command.", u)
        if kind == "coSimulation":
            unit.advance(time, STEP)
            x = unit.get("q.", "v.")
        else:
            k1 = unit.rates(x)
            k2 = unit.rates(x + STEP / 2 * k1)
            k3 = unit.rates(x + STEP / 2 * k2)
            x = x + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + unit.rates(x + STEP * k3))
        worst = max(worst, np.abs(x - [*flight.q[k + 1], *flight.v[k + 1]]).max())
    assert len(flight.time) == round(duration / STEP) + 1
    assert worst < 1e-9


FLOOR = {"stiffness": 400.0, "damping": 8.0, "friction": 0.4, "ball_radius": 0.02}
SCENES: dict[str, dict[str, Any]] = {
    "blown": {
        "wind": {
            "velocity": [3.0, -1.0, 0.5],
            "drag": {"base": 0.4, "tip": 0.1},
            "rotational_drag": {"base": 0.03},
        },
        "payload": [{"frame": "tip", "mass": 0.3}],
        "wall": [{"kind": "floor", "frame": ["base", "tip"], "height": 0.75, **FLOOR}],
    },
    "perched": {"hold": [{"constraint": "stand"}]},
}
PARAMETERS: dict[str, dict[str, Any]] = {
    "blown": {
        "wind": [3.0, -1.0, 0.5],
        "drag": [0.4, 0.1],
        "rotational_drag": [0.03, 0.0],
        "payloads": [0.0, 0.3],
        "wall.point": [0, 0, 0.75] * 2,
        "wall.normal": [0, 0, 2.0] * 2,
        "wall.bristle_stiffness": [400.0] * 2,
        "wall.bristle_damping": [4.0] * 2,
        **{f"wall.{name}": [value] * 2 for name, value in FLOOR.items()},
    },
    "perched": {"active": [1.0]},
}


@pytest.mark.slow
@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize("name", ["blown", "perched"])
def test_what_acts_is_as_in_simulate(
    made: Make,
    opened: Callable[..., Unit],
    name: str,
    version: int,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Wind, drag, spin, a payload, a floor with friction, and a constraint that takes hold."""
    robot, folder = made(name)
    keys = SCENES[name] | {"integration": {"method": "rk4", "step": STEP, "rate": 1.0 / STEP}}
    simulation, u = Simulation(robot, read_scenario("hover", keys)), np.full(5, 3.2)
    q, v = np.array([0, 0, 1, 0, 0, 0, 1, 0.3]), np.array([0.5, 0, -1.0, 1, -2, 3, 0.5])
    simulation.reset(q, v)
    unit = opened(folder, version, "coSimulation")
    for start, values in (("q.", q), ("v.", v), ("actuators", u[:4]), ("command.", u)):
        unit.set(start, values)
    for start, value in PARAMETERS[name].items():
        unit.set(start, value)
    unit.set("step_size", STEP)
    if name == "blown":
        with pytest.raises(fmpy.fmi1.FMICallException):
            unit.set("wall.bristle_damping", [4.0, 0.0])
        assert "wall.bristle_damping: must be above 0, N s/m" in capfd.readouterr().out
    unit.begin()
    if name == "perched":  # The impact is at the beginning.
        assert np.abs(robot.constraint_jacobian(q) @ unit.get("v.")).max() < 1e-12
        assert np.abs(robot.constraint_jacobian(q) @ v).max() > 0.1
    stretched = 0.0
    for k in range(50):
        simulation.advance(u, STEP)
        unit.advance(k * STEP, STEP)
        found = unit.get("q.", "v.")
        found[3:7] /= np.linalg.norm(found[3:7])  # Its length drifts, and means nothing.
        np.testing.assert_allclose(found, [*simulation.q, *simulation.v], rtol=0.0, atol=1e-10)
        stretched = max(stretched, np.abs(unit.get("bristles")).max())
    assert np.abs(found - [*q, *v]).max() > 0.1
    assert name == "perched" or stretched > 1e-3


STATES, INPUTS = ["q.", "v.", "actuators", "bristles"], ["command.", "force", "torque", "wind"]
FIGURES = ["drag", "rotational_drag", "wall.", "payloads"]


def scattered(unit: Unit, seed: int = 0, drag: bool = False) -> np.random.Generator:
    """Set states and inputs, or also figures, to random values, with a quaternion of unit length.

    Constraints hold.
    """
    rng = np.random.default_rng(seed)
    names = [*STATES, *INPUTS, *(FIGURES if drag else ())]
    for start in names:
        size = sum(unit.sizes[name] for name in unit.parts(start))
        if size:
            unit.set(start, rng.uniform(0.2, 0.8, size))
    attitude = unit.get("q.attitude")
    if len(attitude) == 4:
        unit.set("q.attitude", attitude / np.linalg.norm(attitude))
    if unit.parts("active"):
        unit.set("active", [1.0])
    return rng


@pytest.mark.parametrize("version", [3, 2])
@pytest.mark.parametrize(
    "name",
    [
        "quadrotor",
        *(
            pytest.param(n, marks=pytest.mark.slow)
            for n in ("hexarotor_3link", "actuated", "blown", "perched", "rover_arm")
        ),
    ],
)
def test_directional_derivatives(
    made: Make, opened: Callable[..., Unit], name: str, version: int
) -> None:
    """They are those of the program by matrices, in NumPy, and what differences of values show."""
    _, folder = made(name)
    unit = opened(folder, version)
    rng = scattered(unit, drag=True)
    unknowns, knowns = ["der(", "frames.", "imu.", "loads."], [*STATES, *INPUTS, *FIGURES]
    present = [k for k in knowns if unit.parts(k)]
    x = np.concatenate([unit.get(k) for k in present])
    seed = rng.uniform(-1.0, 1.0, len(x))
    if len(quaternion := unit.get("q.attitude")) == 4:  # A direction that keeps its length.
        seed[3:7] -= quaternion * (quaternion @ seed[3:7])
    found = unit.along(unknowns, present, seed)

    def values(move: float) -> Array:
        begin = 0
        for start in present:
            size = len(unit.get(start))
            unit.set(start, (x + move * seed)[begin : begin + size])
            begin += size
        return unit.get(*unknowns)

    h = 1e-4
    near, far = ((values(k * h) - values(-k * h)) / (2 * k * h) for k in (1, 2))
    size = np.abs(found).max()
    np.testing.assert_allclose(found, (4 * near - far) / 3, rtol=0.0, atol=1e-7 * size)
    values(0.0)
    if not unit.parts("active"):  # What takes hold then changes velocities.
        unit.begin()
    assert np.array_equal(unit.along(unknowns, present, seed), found)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["quadrotor"])
def test_derivatives_are_those_of_the_program(
    kept: Path, opened: Callable[..., Unit], made: Make, name: str
) -> None:
    """They equal matrices of the module's other functions, for all entries, in NumPy."""
    folder = kept / "matrices" / name
    made_once(
        folder, lambda: generate(name, folder.parent, ["numpy"], derivatives="all", verify=False)
    )
    module, unit = load(folder), opened(made(name)[1])
    scattered(unit, seed=1, drag=True)
    unit.begin()
    times = getattr(module, "TIME_CONSTANTS", {})
    system = System(
        Functions(module),
        {module.INPUTS.index(rotor): time for rotor, time in times.items()},
        acting=("drag",),
    )
    x, given, gravity = system.programs()["Rates of the state."].inputs
    outputs = {"rate": system.rate(x, given)["slope"], "y": system.output(x, given)}
    program = jacobian(Program("both", (x, given, gravity), outputs), ("x", "given"))
    states = ["q.", "v.", "actuators"]
    inputs = ["command.", "force", "torque", "wind", "drag", "rotational_drag"]
    values = [np.concatenate([unit.get(s) for s in starts]) for starts in (states, inputs)]
    at = {"x": values[0], "given": values[1], "gravity": 9.81}
    matrices = evaluate(program, at, {"robot": module})
    for by, starts in (("x", states), ("given", inputs)):
        wanted = np.vstack([matrices[f"rate_by_{by}"], matrices[f"y_by_{by}"]])
        starts = [start for start in starts if unit.parts(start)]
        found = [
            unit.along(["der(", "frames.", "imu.", "loads."], starts, unit_direction)
            for unit_direction in np.eye(wanted.shape[1])
        ]
        scale = np.abs(wanted).max()
        np.testing.assert_allclose(np.transpose(found), wanted, rtol=0.0, atol=1e-12 * scale)


@pytest.mark.parametrize("version", [3, 2])
def test_saved_states_and_reset_are_exact(
    made: Make, opened: Callable[..., Unit], version: int
) -> None:
    _, folder = made("actuated")
    unit = opened(folder, version, "coSimulation")
    fresh = unit.get(*unit.places)
    scattered(unit)
    unit.begin()
    unit.advance(0.0, 0.01)
    ending = "FMUState" if version == 3 else "FMUstate"
    get, put, free, dump = (
        getattr(unit.fmu, what + ending) for what in ("get", "set", "free", "serialize")
    )
    parse = getattr(unit.fmu, ("deserialize" if version == 3 else "deSerialize") + ending)
    state = get()
    content = dump(state)
    before = unit.get(*unit.places)
    unit.advance(0.01, 0.03)
    after = unit.get(*unit.places)
    assert not np.array_equal(before, after)
    for again in (state, parse(content)):
        put(again)
        np.testing.assert_array_equal(unit.get(*unit.places), before)
        unit.advance(0.01, 0.03)
        np.testing.assert_array_equal(unit.get(*unit.places), after)
        free(again)
    unit.fmu.reset()
    np.testing.assert_array_equal(unit.get(*unit.places), fresh)


def test_steps_that_are_no_multiple(made: Make, opened: Callable[..., Unit]) -> None:
    """They are cut into the fewest equal steps, none of them longer than the greatest."""
    _, folder = made("quadrotor")
    ends = []
    for greatest, cuts in ((0.001, [0.0037]), (0.0037 / 4, [0.0037 / 4] * 4), (0.0037, [0.0037])):
        unit = opened(folder, 3, "coSimulation")
        scattered(unit)
        unit.set("step_size", greatest)
        unit.begin()
        for k, h in enumerate(cuts):
            unit.advance(k * h, h)
        assert unit.get("time")[0] == pytest.approx(0.0037, abs=1e-15)
        ends.append(unit.get("q.", "v.", "actuators"))
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=1e-15)
    assert np.abs(ends[0] - ends[2]).max() > 1e-13


def test_parameters_and_outputs(made: Make, opened: Callable[..., Unit]) -> None:
    """Outputs are what the module's functions return with other parameters."""
    robot, folder = made("hexarotor_3link")
    unit = opened(folder)
    scattered(unit, seed=2)
    unit.begin()
    unit.set("parameters.gravity", 1.62)
    unit.set("parameters.link2_mass_per_length", 1.3)
    constants = robot.prepare({"gravity": 1.62, "link2_mass_per_length": 1.3})
    q, v, u = (unit.get(start) for start in ("q.", "v.", "command."))
    wrenches = np.hstack([unit.get(x).reshape(-1, 3) for x in ("force", "torque")])
    a = robot.forward_dynamics_with_wrenches(q, v, u, wrenches, constants=constants)
    np.testing.assert_allclose(unit.get("der(v."), a, rtol=1e-12)
    poses = robot.frame_poses(q, constants=constants)
    velocities = robot.frame_velocities(q, v, constants=constants)
    axes = poses[:, :3, :3]
    found = robot.frame_jacobians(q, constants=constants) @ a
    found += robot.frame_bias_accelerations(q, v, constants=constants)
    felt = np.einsum("fji,fj->fi", axes, found[:, :3] + [0.0, 0.0, 1.62])
    spins = np.einsum("fji,fj->fi", axes, velocities[:, 3:])
    wanted = {
        "frames.position": poses[:, :3, 3],
        "frames.rotation": axes,
        "frames.velocity": velocities[:, :3],
        "frames.angular_velocity": velocities[:, 3:],
        "imu.specific_force": felt,
        "imu.angular_velocity": spins,
    }
    loads = robot.joint_wrenches_with_wrenches(q, v, a, u, wrenches, constants=constants)
    wanted |= {"loads.force": loads[:, :3], "loads.torque": loads[:, 3:]}
    for name, value in wanted.items():
        np.testing.assert_allclose(unit.get(name), np.ravel(value), rtol=0.0, atol=1e-12)


def test_wrong_calls_end_in_words(
    made: Make, opened: Callable[..., Unit], capfd: pytest.CaptureFixture[str]
) -> None:
    _, folder = made("quadrotor")
    unit = opened(folder, 3, "coSimulation")
    early = unit.fmu.getFMUState()
    unit.begin()
    with pytest.raises(fmpy.fmi1.FMICallException):
        unit.set("imu.specific_force", np.zeros(unit.sizes["imu.specific_force"]))
    assert "only states, inputs and parameters can be set" in capfd.readouterr().out
    with pytest.raises(fmpy.fmi1.FMICallException):
        unit.set("q.position", np.zeros(3))
    assert "until initialisation ends" in capfd.readouterr().out
    unit.fmu.setFMUState(early)
    unit.fmu.freeFMUState(early)
    unit.set("q.position", np.zeros(3))
    unit.begin()
    unit.advance(0.0, 0.1)
    with pytest.raises(fmpy.fmi1.FMICallException):
        unit.advance(0.1001, 0.1)
    assert "must begin at the time where the last one ended" in capfd.readouterr().out
    unit.advance(0.1 + 1e-15, 0.1)
    state = unit.fmu.getFMUState()
    content = bytearray(unit.fmu.serializeFMUState(state))
    unit.fmu.freeFMUState(state)
    content[1] ^= 1
    with pytest.raises(fmpy.fmi1.FMICallException):
        unit.fmu.deserializeFMUState(bytes(content))
    assert "of another model" in capfd.readouterr().out
    for name in unit.parts("parameters."):
        if name.endswith("mass"):
            unit.set(name, [0.0])
    with pytest.raises(fmpy.fmi1.FMICallException):
        unit.advance(0.2, 0.01)
    assert "the robot has no mass" in capfd.readouterr().out


def test_servos_hold_the_joints_where_they_start(made: Make) -> None:
    module, folder = made("actuated")
    place = module.POSTURE[module.COORDINATES.index("upper")]
    assert place < -0.5
    found = fmpy.read_model_description(str(folder / "actuated_fmi2.fmu"), validate=False)
    start = {each.name: each.start for each in found.modelVariables}
    for name in ("q.joints.upper", "actuators.upper_reference", "command.joints.upper_position"):
        assert float(start[name]) == place
    assert (float(start["actuators.charge"]), float(start["command.joints.tau_wrist"])) == (
        1.0,
        0.0,
    )


def test_units_have_sizes_in_the_si(made: Make) -> None:
    description = fmpy.read_model_description(str(made("actuated")[1] / "actuated.fmu"))
    found = {
        unit.name: [getattr(unit.baseUnit, x) for x in ("factor", "kg", "m", "s", "A", "rad")]
        for unit in description.unitDefinitions
    }
    assert found["N/(rad/s)^2"] == [1.0, 1, 1, 0, 0, -2]
    assert found["N m s/rad"] == [1.0, 1, 2, -1, 0, -1]
    assert found["ohm"] == [1.0, 1, 2, -3, -2, 0]
    assert found["A h"] == [3600.0, 0, 0, 1, 1, 0]
