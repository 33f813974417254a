"""The battery."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any

from gibbs_codegen.files.table import Bounds, Place
from gibbs_codegen.robot.parts.numbers import NotNegative, Positive
from gibbs_codegen.robot.parts.part import Parameter, Part, number, sized

MAX_VOLTAGES = 64


@dataclass(frozen=True, kw_only=True)
class Battery(Part):
    """The battery that all rotors share; a throttle then gives what its voltage allows."""

    voltages: tuple[Positive, ...] = sized(
        "voltages without load at equal steps of charge, from empty to full, {V}",
        ...,
        key="voltage",
    )
    resistance: NotNegative = number("internal resistance, with wires, {ohm}", ..., keeps_sign=True)
    capacity: Positive = sized("charge from full to empty, {A h}", ...)
    # Full speed is that at this voltage.
    nominal: Positive = sized(
        "voltage at which thrusts of throttles are given, {V}; default: that without load when "
        "full",
        unsaid=None,
    )
    efficiency: Annotated[Positive, Bounds(0.0, 1.0)] = sized(
        "share of the electric power of motors and their controllers that reaches the rotors",
        0.75,
        unit="1",
    )
    auxiliary: NotNegative = number("power of all other devices, {W}", 0.0, keeps_sign=True)

    def parameters(self) -> dict[str, Parameter]:
        """Numbers that can be parameters, voltages first."""
        marks = super().parameters()
        return {key: marks[key] for key in ("voltages", "nominal")} | marks

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of a single voltage."""
        voltages = values.get("voltage")
        if isinstance(voltages, list) and not 2 <= len(voltages) <= MAX_VOLTAGES:
            yield "voltage", f"must be 2 to {MAX_VOLTAGES} voltages, from empty to full"

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """The fault of voltages that fall with the charge."""
        for low, high in pairwise(self.voltages):
            if high < low:
                yield (
                    ("voltage",),
                    f"must rise with the charge, from empty to full, but {high:g} V follow "
                    f"{low:g} V",
                )
                return

    def _completed(self) -> Battery:
        return self if self.nominal is not None else replace(self, nominal=self.voltages[-1])
