"""What acts on the robot all through an interval of time, and begins or ends with a jump."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Acting:
    """What acts: whether the push does (…), and which payloads do (…, p), or one for all."""

    push: bool | Flags = False
    payloads: bool | Flags = False


NOTHING = Acting()
