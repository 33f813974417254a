"""What acts on the robot all through an interval of time, and begins or ends with a jump."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Acting:
    """What acts: whether the push does, and inputs u (nu) that are commanded all through, if any.

    Without inputs that are held, the law of control commands them at every instant.
    """

    push: bool = False
    held: tuple[float, ...] | None = None


NOTHING = Acting()
