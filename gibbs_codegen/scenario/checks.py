"""The check of values that a scenario made in Python may hold."""

from __future__ import annotations

from gibbs_codegen.errors import UsageError


def require(right: bool, otherwise: str) -> None:
    """Raise an error for values that mean nothing.

    Args:
        right: Whether the values are right.
        otherwise: What is wrong else.

    Raises:
        UsageError: If they are not.
    """
    if not right:
        raise UsageError(otherwise)
