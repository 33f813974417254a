"""Which random trees are compared with Pinocchio: by default, in CI, and in all."""

from __future__ import annotations

from itertools import product
from typing import Any

import pytest

# By default one with Tait–Bryan angles and one with a quaternion, which together have held and
# welded links, rotors on links, springs, poses and Denavit–Hartenberg parameters.
QUICK_TREES = ((9, "tait_bryan"), (6, "quaternion"))
CI_TREES = range(10, 13)
TREES = 100


def tree_cases() -> list[Any]:
    """Random trees with both attitudes: a few, a few more that are slow, and all."""
    cases = []
    for case in product(range(TREES), ("tait_bryan", "quaternion")):
        slow = [] if case in QUICK_TREES else [pytest.mark.slow]
        if slow and case[0] not in CI_TREES:
            slow.append(pytest.mark.exhaustive)
        cases.append(pytest.param(*case, marks=slow))
    return cases
