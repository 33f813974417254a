"""What a flight tells of the limits of its inputs: which were reached, and the worst of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gibbs_codegen.flight.record.flight import Flight

if TYPE_CHECKING:
    from gibbs_codegen.flight.record.flight import Flight


# Limits that the terminal shows of those that a timing reaches.


# Of inputs that are named; and the share of a limit that is too little to have left it.
_MOST_NAMES = 12
_ROUND_OFF = 1e-9


def reached_limits(flight: Flight) -> str:
    """Name the inputs that were asked for their limits or more, and the one asked for the most.

    Such as "F_1, F_3 (F_1 was asked for 88 N of 14 N at t = 0.03 s)"; empty if none was. Inputs
    that their limits leave no choice, such as 0 to 0, are named only if asked for more.
    """
    low, high = flight.input_limits
    # Infinite differences are limits that there are not; NaN, values after control was lost.
    over = np.stack([low - flight.commanded_least, flight.commanded_greatest - high])
    over = np.where(np.isfinite(over), over, -np.inf)
    limits = np.where(np.isfinite(flight.input_limits), np.abs(flight.input_limits), 0.0)
    share = over / np.maximum(limits.max(axis=0), _ROUND_OFF)
    least = np.where(low == high, _ROUND_OFF, -_ROUND_OFF)
    reached = np.flatnonzero((share >= least).any(axis=(0, 1)))
    if not len(reached):
        return ""
    side, sample, place = np.unravel_index(int(share.argmax()), share.shape)
    asked = (flight.commanded_least, flight.commanded_greatest)[side][sample, place]
    numbers = asked, flight.input_limits[side, place]
    told, limit = (f"{number:.3g} {flight.input_units[place]}" for number in numbers)
    names = [flight.input_names[k] for k in reached[:_MOST_NAMES]]
    more = f" and {len(reached) - len(names)} more" if len(reached) > len(names) else ""
    past = share[side, sample, place] > _ROUND_OFF and told != limit
    words = f"was asked for {told} of {limit}" if past else f"reached {limit}"
    return (
        f"{', '.join(names)}{more} ({flight.input_names[place]} {words} "
        f"at t = {flight.time[sample]:.3g} s)"
    )
