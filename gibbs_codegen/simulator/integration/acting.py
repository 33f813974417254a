"""What acts on the robot all through an interval of time, and begins or ends with a jump."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Acting:
    """What acts: whether the push does."""

    push: bool = False


NOTHING = Acting()
