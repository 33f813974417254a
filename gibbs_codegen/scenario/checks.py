"""The check of values that a scenario made in Python may hold."""

from __future__ import annotations

from gibbs_codegen.errors import UsageError


def require(right: bool, otherwise: str) -> None:
    """Raise `UsageError` for values that mean nothing."""
    if not right:
        raise UsageError(otherwise)
