"""The laws of Slotine and Li: the energy of what velocities are off falls as they say."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.emitted import module_of
from support.random_robots import random_tree

from gibbs_codegen.arrays import Functions, Node, Program, evaluate, variable
from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.machine.base import Motion
from gibbs_codegen.machine.laws import LAWS, Aim, Estimates, Gains, adaptation

Array = np.ndarray
FUNCTIONS = ("default", "passivity")
# A step of differences of the energy, s, and how well they tell its rate.
SHORT, CLOSE = 1e-5, 1e-6


class Case:
    """A robot, its desired motion, and gains."""

    def __init__(self, attitude: str) -> None:
        robot = random_tree(6, attitude)
        self.module: ModuleType = module_of(
            derive(robot, functions=FUNCTIONS, derivatives=["base_parameters"])
        )
        rng, self.size = np.random.default_rng(5), len(self.module.VELOCITIES)
        self.q, self.wanted_q = rng.uniform(-0.5, 0.5, (2, len(self.module.COORDINATES)))
        self.is_quaternion = attitude == "quaternion"
        if self.is_quaternion:  # Without an error of the attitude rates of errors are exact.
            self.q[3:7] /= np.linalg.norm(self.q[3:7])
            self.wanted_q[3:7] = self.q[3:7]
        self.v, self.wanted_v, self.wanted_a = rng.normal(size=(3, self.size))
        self.stiffness = rng.uniform(1.0, 4.0, self.size)
        self.damping = rng.uniform(1.0, 6.0, self.size)
        self.learnt = rng.normal(size=len(self.module.BASE_PARAMETERS))
        self.adaptation = rng.uniform(0.1, 1.0, len(self.learnt))

    def results(self, law: str) -> dict[str, Array]:
        """The generalised force of a law, and rates of what it learns."""
        robot = Functions(self.module)
        q, v = robot.state()
        desired = Motion(robot.coordinates("q_d"), robot.velocities("v_d"), robot.velocities("a_d"))
        names = {"stiffness": self.size, "damping": self.size}
        names |= dict.fromkeys(("parameters", "adaptation"), len(self.learnt))
        own: dict[str, Node] = {name: variable(name, size) for name, size in names.items()}
        aim = Aim(
            desired,
            Gains(own["stiffness"], own["damping"]),
            estimates=Estimates(own["parameters"], own["adaptation"]),
        )
        outputs = {"force": LAWS[law].force(robot, q, v, aim)}
        outputs["rates"] = adaptation(robot, q, v, aim)
        inputs = q, v, desired.q, desired.v, desired.a, *own.values()
        given = {"q": self.q, "v": self.v, "q_d": self.wanted_q, "v_d": self.wanted_v}
        given |= {"a_d": self.wanted_a, "stiffness": self.stiffness, "damping": self.damping}
        given |= {"parameters": self.learnt, "adaptation": self.adaptation}
        return evaluate(Program("p", inputs, outputs), given, {"robot": self.module})

    @property
    def poles(self) -> tuple[Array, Array]:
        """λ and d − λ of the errors."""
        roots = np.roots
        pairs = [roots([1.0, d, k]) for k, d in zip(self.stiffness, self.damping, strict=True)]
        real = np.array([np.sort(-np.real(pair)) for pair in pairs])
        return real[:, 0], real[:, 1]

    def ahead(self, time: float, a: Array) -> tuple[Array, Array]:
        """Coordinates, and what velocities are behind those of the reference, a time later."""
        module, slow = self.module, self.poles[0]
        q = module.integrate(self.q, time * self.v + 0.5 * time**2 * a)
        wanted = module.integrate(
            self.wanted_q, time * self.wanted_v + 0.5 * time**2 * self.wanted_a
        )
        v, v_d = self.v + time * a, self.wanted_v + time * self.wanted_a
        if not self.is_quaternion:
            return q, v_d - v + slow * (wanted - q)
        here, there = (Rotation.from_quat(x[3:7]) for x in (q, wanted))
        drift = there.apply(v_d[:3]) - here.apply(v[:3]) + slow[:3] * (wanted[:3] - q[:3])
        turn = here.inv() * there
        spin = turn.apply(v_d[3:6]) - v[3:6] + slow[3:6] * turn.as_rotvec()
        joints = v_d[6:] - v[6:] + slow[6:] * (wanted[7:] - q[7:])
        return q, np.concatenate([here.inv().apply(drift), spin, joints])

    def fall(self, force: Array) -> tuple[float, float]:
        """The rate of ½ sᵀ M s under a force, and what the law damps of it."""
        module = self.module
        matrix = module.mass_matrix(self.q)
        a = np.linalg.solve(matrix, module.residual(self.q, self.v) + force)
        energies = []
        for time in (-SHORT, SHORT):
            q, s = self.ahead(time, a)
            energies.append(0.5 * s @ module.mass_matrix(q) @ s)
        _, s = self.ahead(0.0, a)
        root = np.sqrt(self.poles[1])
        undamped = module.prepare({x: 0.0 for x in module.PARAMETERS if x.endswith("_damping")})
        dampers = module.residual(self.q, s, undamped) - module.residual(self.q, s)
        damped = s @ (root * (matrix @ (root * s)) + dampers)
        return (energies[1] - energies[0]) / (2 * SHORT), damped


@pytest.mark.slow
@pytest.mark.parametrize("attitude", ["tait_bryan", "quaternion"])
def test_energy_falls_by_what_is_damped_and_by_what_is_not_learnt(attitude: str) -> None:
    """½ sᵀ M s loses sᵀ (D M D + dampers) s, and gains −sᵀ Y δ by parameters that are off by δ."""
    case = Case(attitude)
    found = case.results("passive")
    rate, damped = case.fall(found["force"])
    assert rate == pytest.approx(-damped, rel=CLOSE)
    # What is learnt takes from the second energy what the first one gains: both fall together.
    learning = case.results("adaptive")
    rate, damped = case.fall(learning["force"])
    gained = (case.learnt / case.adaptation) @ learning["rates"]
    assert rate + gained == pytest.approx(-damped, rel=CLOSE)
    assert abs(gained) > 0.01 * damped
