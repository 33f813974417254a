"""Controls of a robot in viser's panel, which are read, not listened to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gibbs_codegen.flight.record.series import Array

# Steps that a slider has at least.
_STEPS = 200
_NOTHING = 1e-9


class Sliders:
    """A folder of sliders, one for each of some numbers.

    `limits` are least and greatest values (2, n), which those to begin with, `start` (n), may
    exceed.
    """

    def __init__(self, gui: Any, labels: Sequence[str], limits: Array, start: Array) -> None:
        ends = zip(labels, *limits, start, strict=True)
        self._sliders = [_slider(gui, label, low, high, value) for label, low, high, value in ends]
        self._exact, self._set = start, self._read()

    @property
    def values(self) -> Array:
        """The numbers (n), in the order of the labels: exactly those that were put, until moved."""
        read = self._read()
        values: Array = np.where(read == self._set, self._exact, read)
        return values

    @property
    def moved(self) -> bool:
        """Whether somebody has moved one since they were made or put somewhere."""
        return not np.array_equal(self._read(), self._set)

    def put(self, values: Array) -> None:
        """Put the sliders at values (n), which may be beyond their ends."""
        for slider, value in zip(self._sliders, values, strict=True):
            # A share of a newton that rounding leaves is none.
            slider.value = rounded(value) if abs(value) > _NOTHING else 0.0
        self._exact, self._set = values, self._read()

    def _read(self) -> Array:
        return np.array([slider.value for slider in self._sliders], dtype=np.float64)


class Parameters:
    """A choice of one of many parameters, with defaults by name, and a slider for it."""

    def __init__(self, gui: Any, defaults: Mapping[str, float]) -> None:
        self._defaults = dict(defaults)
        self.given: dict[str, float] = {}
        self._name = next(iter(self._defaults))
        self._choice = gui.add_dropdown("parameter", list(self._defaults))
        self._slider = _slider(gui, "value, SI", *self._ends(), self._defaults[self._name])
        self._back = False
        button = gui.add_button("All parameters back to the robot file's")
        button.on_click(self._reset)

    def step(self) -> None:
        """Follow the controls."""
        if self._back:
            self._back, self.given = False, {}
            self._slider.value = rounded(self._defaults[self._name])
        elif self._choice.value != self._name:
            self._name = self._choice.value
            self._slider.min, self._slider.max = map(rounded, self._ends())
            self._slider.step = _step(*self._ends())
            self._slider.value = rounded(self._value)
        elif self._slider.value != rounded(self._value):
            self.given = self.given | {self._name: float(self._slider.value)}

    @property
    def _value(self) -> float:
        return self.given.get(self._name, self._defaults[self._name])

    def _ends(self) -> tuple[float, float]:
        """From nothing to twice the default; a parameter that is 0 goes both ways."""
        default = self._defaults[self._name]
        if default == 0.0:
            return -1.0, 1.0
        return min(0.0, 2.0 * default), max(0.0, 2.0 * default)

    def _reset(self, _: Any) -> None:
        self._back = True


def _slider(gui: Any, label: str, low: float, high: float, value: float) -> Any:
    """Add a slider to viser's GUI; its value may be beyond the ends."""
    low, high = rounded(low), rounded(high)
    # Between equal ends there is nothing to move.
    still = low == high
    start = float(np.clip(rounded(value), low, high))
    slider = gui.add_slider(label, low, high, _step(low, high), start, disabled=still)
    slider.value = rounded(value)
    return slider


def rounded(value: float) -> float:
    """A number with four digits, for which there is room beside a slider."""
    return float(f"{value:.4g}")


def _step(low: float, high: float) -> float:
    """A power of ten of which there are many between two ends; any number between equal ones."""
    return float(10.0 ** np.floor(np.log10((high - low) / _STEPS))) if low < high else 1.0
