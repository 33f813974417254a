"""The battery: with the voltage U₀ of its charge and the resistance R it gives a power P.

Its voltage is U = (U₀ + √(U₀² − 4 R P))/2 and its current P/U. An empty battery keeps the charge 0,
and goes on with the least U₀.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from gibbs_codegen.arrays.labels import named
from gibbs_codegen.arrays.nodes import Node, choose, is_all, maximum
from gibbs_codegen.machine.motor import positive_root

_WORDS = "voltage and current of the battery"


def discharge(numbers: Mapping[str, Any], charge: Node, rotors: Node) -> tuple[Node, Node]:
    """The voltage, V, and the rate of the charge, 1/s, while rotors take a power, W.

    `numbers` are by the keys of the robot file. No charge is left below 0.
    """
    power = named(rotors / numbers["efficiency"] + numbers["auxiliary"], "power")
    voltages, steps = numbers["voltages"], len(numbers["voltages"]) - 1.0
    rises = [high - low for low, high in pairwise(voltages)]
    # It bends in between, and beyond its ends goes on straight, so that fits find back from there.
    voltage = voltages[0] + steps * charge * rises[0]
    for k, (before, after) in enumerate(pairwise(rises), 1):
        voltage = voltage + maximum(steps * charge - float(k), 0.0) * (after - before)
    resistance = numbers["resistance"]
    if not is_all(resistance, 0.0):
        root = positive_root(voltage * voltage - 4.0 * resistance * power)
        voltage = 0.5 * (voltage + root)
    current = named(power / named(voltage, "voltage", _WORDS), "current", _WORDS)
    rate = -choose(0.0, charge, 0.0, current / (3600.0 * numbers["capacity"]))
    return voltage, named(rate, "charge_rate", "discharge of the battery")
