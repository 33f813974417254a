"""Every guarantee has tests, which exist."""

from __future__ import annotations

import functools
import re
import tomllib

import pytest
from conftest import ROOT

PAGE = (ROOT / "GUARANTEES.md").read_text(encoding="utf-8")
TESTS = tomllib.loads((ROOT / "tests" / "guarantees.toml").read_text(encoding="utf-8"))


def test_every_guarantee_of_the_page_has_tests() -> None:
    promised = re.findall(r"^- \*\*(.+?)\*\*", PAGE, flags=re.MULTILINE)
    assert promised == list(TESTS)
    assert all(TESTS.values())


@functools.cache
def _tests(file: str) -> set[str]:
    text = (ROOT / "tests" / file).read_text(encoding="utf-8")
    return set(re.findall(r"^def (test_\w+)\(", text, re.MULTILINE))


@pytest.mark.parametrize("guarantee", TESTS)
def test_tests_of_guarantees_exist(guarantee: str) -> None:
    for test in TESTS[guarantee]:
        file, name = test.split("::")
        assert name in _tests(file)
