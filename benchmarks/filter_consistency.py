"""Whether a filter is as sure as it may be: python -m benchmarks.filter_consistency RUNS SECONDS.

A quadrotor with an arm flies with noise on its accelerations, and with an unknown wrench, efforts
of joints and biases that walk. SEED and "imu" may follow: with the latter the IMU leads, nothing
else acts, and joints, whose accelerations are no noise, are not judged. Prints in how many instants
the mean over all runs of the normalised squared error (NEES), and of that of each sensor's
innovations (NIS), is in the band that has 95 % of them where covariances are right.
"""

from __future__ import annotations

import sys
import tempfile
from collections import defaultdict
from types import ModuleType

import numpy as np
from scipy.stats import chi2

from gibbs_codegen import Estimator, SensorSuite, compile_program, generate, load, read_scenario

Array = np.ndarray
H = 0.004
SENSORS = {
    "imu": [
        {
            "rate": 250,
            "accelerometer_noise": 0.02,
            "accelerometer_walk": 1e-3,
            "accelerometer_bias": [0.05, 0.05, 0.05],
            "gyroscope_noise": 1e-3,
            "gyroscope_walk": 1e-4,
            "gyroscope_bias": [0.01, 0.01, 0.01],
        }
    ],
    "encoders": [{"rate": 125, "noise": 1e-3}],
    "pose": [{"rate": 50, "position_noise": 2e-3, "attitude_noise": 5e-3}],
    "gps": [{"rate": 10, "horizontal_noise": 0.02, "vertical_noise": 0.03, "velocity_noise": 0.05}],
}
FILTERS = {
    "model": {"acceleration": 0.1, "force": 1.0, "torque": 0.05, "effort": 0.05},
    "imu": {"by": "imu", "acceleration": 0.1, "joints": 5.0},
}


def module_of(folder: str) -> ModuleType:
    """The robot with derivatives, in C."""
    return load(generate("quadrotor_arm_2link", folder, derivatives=True, verify=False), "c")


class Runs:
    """Runs of a robot side by side, and a filter on the readings of each."""

    def __init__(self, module: ModuleType, runs: int, seed: int, by: str) -> None:
        self.module, self.rng = module, np.random.default_rng(seed)
        tables = {"name": "sensed", "duration": 1.0, "control": {"estimate": True}}
        tables["control"]["filter"] = FILTERS[by]
        scenario = read_scenario(tables | {"sensors": SENSORS})
        self.suite = SensorSuite(module, scenario.sensors)
        self.estimator = Estimator(module, scenario.sensors, scenario.control.filter)
        self.programs = {
            name.removeprefix("imu_"): (program.names, compile_program(program, module))
            for name, program in self.estimator.programs.items()
        }
        q, v = np.zeros((runs, 9)), np.zeros((runs, 8))
        q[:, 6], q[:, 7], q[:, 8] = 1.0, 1.2, 0.3
        self.estimator.begin(q[0], v[0])
        self.known = self.estimator.memory
        self.known = {key: np.broadcast_to(x, (runs, *x.shape)) for key, x in self.known.items()}
        self.spread = np.sqrt(np.diagonal(self.known["covariance"][0]))
        off = self.spread * self.rng.standard_normal((runs, len(self.spread)))
        self.q, self.v = module.integrate(q, off[:, :8]), v + off[:, 8:16]
        self.first = 16 + self.known["loads"].shape[1]
        self.loads, self.biases = off[:, 16 : self.first], off[:, self.first :]
        self.judged = [k for k in range(off.shape[1]) if by == "model" or k not in (6, 7, 14, 15)]
        matrix = module.input_matrix(q[0])
        self.hover = np.linalg.lstsq(matrix, -module.residual(q[0], v[0]))[0]
        self.levelling = np.linalg.pinv(matrix[2:6, :4])[:, 1:]

    def inputs(self, time: float) -> Array:
        """Inputs that keep the robot about level, and swing its arm."""
        u = np.tile(self.hover, (len(self.q), 1))
        u[:, :4] -= (3.0 * self.q[:, 3:6] + 0.8 * self.v[:, 3:6]) @ self.levelling.T
        angles = self.q[:, 7:] - [1.2 + 0.5 * np.sin(3 * time), 0.3]
        u[:, 4:] -= 0.6 * angles + 0.08 * self.v[:, 6:]
        return u

    def acceleration(self, q: Array, v: Array, u: Array) -> tuple[Array, Array]:
        """Accelerations under inputs and loads, and wrenches of the latter."""
        wrenches, acting = np.zeros((len(q), 2, 6)), u
        if self.loads.size:
            wrenches[:, 0] = self.loads[:, :6]
            acting = u + np.c_[np.zeros((len(q), 4)), self.loads[:, 6:]]
        return self.module.forward_dynamics_with_wrenches(q, v, acting, wrenches), wrenches

    def step(self, u: Array) -> None:
        """The true motion of a step, by Runge and Kutta's method, and noise at its end."""
        q, v, module = self.q, self.v, self.module
        a1, _ = self.acceleration(q, v, u)
        q2, v2 = module.integrate(q, 0.5 * H * v), v + 0.5 * H * a1
        a2, _ = self.acceleration(q2, v2, u)
        a3, _ = self.acceleration(module.integrate(q, 0.5 * H * v2), v + 0.5 * H * a2, u)
        q4 = module.integrate(q, H * (v + 0.5 * H * a2))
        a4, _ = self.acceleration(q4, v + H * a3, u)
        self.q = module.integrate(q, H * (v + H * (a1 + a2 + a3) / 6.0))
        noise = np.sqrt(H * self.estimator.noise) * self.rng.standard_normal(
            (len(q), len(self.spread))
        )
        self.v = v + H * (a1 + 2 * a2 + 2 * a3 + a4) / 6.0 + noise[:, 8:16]
        self.loads = self.loads + noise[:, 16 : self.first]
        self.biases = self.biases + noise[:, self.first :]

    def run(self, name: str, **given: Array | float) -> Array:
        """Run a program of the filter in all runs; what it tells of a reading."""
        inputs = {**self.known, **given, "gravity": np.array([0.0, 0.0, -9.81])}
        names, program = self.programs[name]
        found = program({key: x for key, x in inputs.items() if key in names})
        self.known |= {key.removesuffix("_next"): x for key, x in found.items() if key != "nis"}
        return found.get("nis", np.zeros(0))

    def errors(self) -> Array:
        """Normalised squared errors (runs)."""
        known = self.known
        off = np.concatenate(
            [
                self.module.difference(known["q"], self.q),
                self.v - known["v"],
                self.loads - known["loads"],
                self.biases - known["biases"],
            ],
            axis=1,
        )[:, self.judged]
        covariance = known["covariance"][:, self.judged][..., self.judged]
        solved = np.linalg.solve(covariance, off[..., np.newaxis])[..., 0]
        return np.einsum("ni,ni->n", off, solved)


def consistency(
    module: ModuleType, runs: int, seconds: float, seed: int = 5, by: str = "model"
) -> dict[str, tuple[float, float, float]]:
    """By "nees" and sensors the mean over its expected value, its deviation, and the share inside.

    The deviation is that of χ² of all readings; errors of a run last, and count as one.
    """
    flown, found = Runs(module, runs, seed, by), defaultdict(list)
    size, before = len(flown.judged), np.zeros(0)
    for k in range(1, round(seconds / H) + 1):
        u = flown.inputs(k * H)
        flown.step(u)
        a, wrenches = flown.acceleration(flown.q, flown.v, u)
        exact, come = flown.suite.measurements(flown.q, flown.v, a, wrenches), {}
        for device, rows, variances in zip(
            flown.suite.devices, flown.suite.places, flown.suite.variances, strict=True
        ):
            if k % round(1 / (H * device.rate)):
                continue
            noise = np.sqrt(variances) * flown.rng.standard_normal(exact[:, rows].shape)
            reading = exact[:, rows] + noise
            if device.measures == "imu":
                reading = reading + flown.biases
            come[device.name] = {"reading": reading, "variances": variances}
        led = {"before": before if k > 1 else come["imu"]["reading"], **come["imu"]}
        flown.run("filter_predict", u=u, h=H, noise=flown.estimator.noise, **led)
        before = led["reading"]
        for name, given in come.items():
            if by == "model" or name != "imu":
                nis = flown.run(f"filter_update_{name}", u=u, gate=np.inf, **given)
                found[name].append((nis.mean(), len(given["variances"])))
        if k % 5 == 0:
            found["nees"].append((flown.errors().mean(), size))
    shares = {}
    for name, rows in found.items():
        means, counts = np.array(rows).T
        low, high = chi2.ppf([[0.025], [0.975]], counts * runs) / runs
        independent = runs * (size if name == "nees" else counts.sum())
        inside = np.mean((means > low) & (means < high))
        shares[name] = (means / counts).mean(), np.sqrt(2.0 / independent), inside
    return shares


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as made:
        runs, seconds, seed, by = *sys.argv[1:], *("5", "model")[len(sys.argv) - 3 :]
        found = consistency(module_of(made), int(runs), float(seconds), int(seed), by)
        for name, (mean, _, share) in found.items():
            print(f"{name}: mean {mean:.3f} of what is expected, {share:.3f} inside the 95 % band")
