"""What controllers are told."""

from __future__ import annotations

from dataclasses import dataclass

from gibbs_codegen.flight.plant.vehicle import Array


@dataclass(frozen=True)
class Observation:
    """What a controller is told; its arrays are read-only.

    - `time`: of the sample, s
    - `q` (nq) and `v` (nv): the state as the sensors measure it
    - `q_desired` (nq), `v_desired` and `a_desired` (nv): the desired motion at `time`
    """

    time: float
    q: Array
    v: Array
    q_desired: Array
    v_desired: Array
    a_desired: Array

    def __post_init__(self) -> None:
        for array in (self.q, self.v, self.q_desired, self.v_desired, self.a_desired):
            array.setflags(write=False)
