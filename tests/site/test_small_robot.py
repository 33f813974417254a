"""The small robot in print: what its page shows is the package's, and mechanics'."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from small_robot import c_functions, matrices
from support.tools import run

from gibbs_codegen import generate, load

PAGE = (ROOT / "docs" / "reference" / "equations.md").read_text(encoding="utf-8")
(TEXT,) = re.findall(r"```toml\n(.*?)```", PAGE, re.S)


def test_the_page_shows_what_the_package_writes() -> None:
    """`python docs/_ext/small_robot.py` prints it."""
    assert matrices(TEXT) in PAGE
    assert c_functions(TEXT) in PAGE


def test_equations_by_hand_are_those_of_the_module(tmp_path: Path) -> None:
    """Lagrange's, of a body and a particle with an inertia on a massless rod."""
    (tmp_path / "small.toml").write_text(TEXT, encoding="utf-8")
    module = load(generate(tmp_path / "small.toml", tmp_path))
    q, v, g = np.array([0.3, -0.2, 0.5, -1.1]), np.array([0.4, 0.7, -0.9, 1.6]), 9.81
    s, c, rate, (base, mass, r) = (
        np.sin(q[2] + q[3]),
        np.cos(q[2] + q[3]),
        v[2] + v[3],
        (0.5, 0.1, -0.2),
    )
    inertia, own = 0.001 + mass * r**2, 0.004
    # The pendulum's centre of mass is at (x + r s, z + r c), as pitch is about y.
    across = mass * r * np.array([c, -s])
    matrix = np.diag([base + mass, base + mass, own + inertia, inertia])
    matrix[2, 3] = matrix[3, 2] = inertia
    matrix[:2, 2:] = np.stack([across, across], axis=1)
    matrix[2:, :2] = matrix[:2, 2:].T
    residual = mass * r * np.array([s * rate**2, c * rate**2, g * s, g * s])
    residual[1] -= g * (base + mass)
    inputs = np.zeros((4, 3))
    inputs[0, :2], inputs[1, :2] = np.sin(q[2]), np.cos(q[2])
    inputs[2, :2], inputs[3, 2] = (-0.25, 0.25), 1.0
    np.testing.assert_allclose(module.mass_matrix(q), matrix, atol=1e-15)
    np.testing.assert_allclose(module.residual(q, v), residual, atol=1e-14)
    np.testing.assert_allclose(module.input_matrix(q), inputs, atol=1e-15)


@pytest.mark.slow
def test_published_tables_are_what_the_benchmark_prints() -> None:
    """Counts as they stand; digits to one, as other processors round in other ways."""
    printed = run([sys.executable, ROOT / "benchmarks" / "published_tables.py"])
    rows = [line.strip("| ").split(" | ") for line in printed.splitlines() if line.startswith("|")]
    shown = {line.strip("| ").split(" | ")[0]: line for line in PAGE.splitlines()}
    assert len(rows) == 2 * 2 + 14 + 5
    for what, *numbers in rows:
        found = shown[what].strip("| ").split(" | ")[1:]
        if len(numbers) == 1 and numbers[0][:1].isdigit():
            assert abs(float(numbers[0]) - float(found[0])) <= 1.0, what
        else:
            assert numbers == found, what
