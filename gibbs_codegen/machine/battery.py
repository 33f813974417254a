"""The battery: with the voltage U₀ of its charge and the resistance R it gives a power P.

Its voltage is U = (U₀ + √(U₀² − 4 R P))/2 and its current P/U. An empty battery keeps the charge 0,
and goes on with the least U₀.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

from gibbs_codegen.arrays.labels import named
from gibbs_codegen.arrays.nodes import Node, choose, is_all, maximum, minimum
from gibbs_codegen.machine.motor import positive_root

_WORDS = "voltage and current of the battery"


def discharge(numbers: Mapping[str, Any], charge: Node, rotors: Node) -> tuple[Node, Node]:
    """The voltage, V, and the rate of the charge, 1/s, while rotors take a power, W.

    `numbers` are by the keys of the robot file. No charge is left below 0.
    """
    power = named(rotors / numbers["efficiency"] + numbers["auxiliary"], "power")
    voltage, steps = numbers["voltages"][0], len(numbers["voltages"]) - 1.0
    for k, (low, high) in enumerate(pairwise(numbers["voltages"])):
        # Its ends go on straight, so that fits find back from charges beyond them.
        share = steps * charge - float(k)
        share = maximum(share, 0.0) if k else share
        share = minimum(share, 1.0) if k + 1.0 < steps else share
        voltage = voltage + share * (high - low)
    resistance = numbers["resistance"]
    if not is_all(resistance, 0.0):
        root = positive_root(voltage * voltage - 4.0 * resistance * power)
        voltage = 0.5 * (voltage + root)
    current = named(power / named(voltage, "voltage", _WORDS), "current", _WORDS)
    rate = -choose(0.0, charge, 0.0, current / (3600.0 * numbers["capacity"]))
    return voltage, named(rate, "charge_rate", "discharge of the battery")
