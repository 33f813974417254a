"""What acts on the robot all through an interval of time, and begins or ends with a jump."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Acting:
    """What acts: pushes, payloads, and inputs u (nu) that are held, if any.

    `push` says whether the push does (…), `payloads` which of them do (…, p), or one flag for all.
    Without `held` inputs the law of control commands them at every instant.
    """

    push: bool | Flags = False
    payloads: bool | tuple[bool, ...] | Flags = False
    held: tuple[float, ...] | None = None


NOTHING = Acting()
