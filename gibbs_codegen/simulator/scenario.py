"""A scenario: what is to be flown, from where, under which control, and how it is integrated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gibbs_codegen.simulator.control import Law
from gibbs_codegen.simulator.integrate import Settings
from gibbs_codegen.simulator.orientation import Level, Tangent
from gibbs_codegen.simulator.paths import Path, Vector
from gibbs_codegen.simulator.plant import TipForce


@dataclass(frozen=True)
class ArmTask:
    """What the arm is to do: bring the tip along a path, or keep a posture.

    With a `tip` path the joints follow from it, from `guess` on (many postures are tried where
    there is none). Without one, `posture` is held; None is the posture in which the arm hangs at
    rest. `posture`, `guess` and `limits` map names of joint coordinates to rad or m; a joint left
    out of `posture` is at 0, one left out of `limits` has none.
    """

    tip: Path | None = None
    posture: Mapping[str, float] | None = None
    guess: Mapping[str, float] | None = None
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Disturbance:
    """What is off at the start: base centre, m; attitude, a rotation vector, rad; world axes."""

    position: Vector = (0.0, 0.0, 0.0)
    rotation: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Control:
    """The control law, and for computed torque the errors' natural frequency and damping ratio.

    `frequency` is in rad/s.
    """

    law: Law = "computed_torque"
    frequency: float = 5.0
    damping_ratio: float = 1.0


@dataclass(frozen=True)
class Motors:
    """Least and greatest thrust of every motor, N, and the time constant of its lag, s; 0: none."""

    limits: tuple[float, float] | None = None
    time_constant: float = 0.0


@dataclass(frozen=True)
class Scenario:
    """A flight of `duration` s with the base centre on a path; SI units, rad, world axes.

    `parameters` are given to the module's `prepare`.
    """

    name: str
    duration: float
    base: Path
    attitude: Level | Tangent = field(default_factory=Level)
    arm: ArmTask = ArmTask()
    start: Disturbance = Disturbance()
    control: Control = Control()
    motors: Motors = Motors()
    tip_force: TipForce | None = None
    integration: Settings = field(default_factory=Settings)
    parameters: Mapping[str, float] = field(default_factory=dict)
    description: str = ""
