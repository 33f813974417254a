"""Octave, as the tests run it: one process, arrays in and out, and not a word of warning."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.io import loadmat, savemat

from support.tools import HANGING, tool

Array = NDArray[np.float64]


def octave(folder: Path, lines: Sequence[str]) -> str:
    """What a script prints that runs in a folder; a warning or an error fails the test."""
    options = ["--quiet", "--norc", "--no-history"]
    command = [tool("octave-cli"), *options, "--eval", "\n".join(lines)]
    done = subprocess.run(
        command,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=HANGING,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    if done.returncode != 0 or done.stderr:
        pytest.fail(f"octave exits {done.returncode}: {done.stderr[:4000]}", pytrace=False)
    return done.stdout


def octave_arrays(
    folder: Path, given: Mapping[str, Array], lines: Sequence[str], wanted: Sequence[str]
) -> list[Array]:
    """Variables after a script that has others, whose states go along the last axis."""
    savemat(folder / "given.mat", dict(given))
    saved = ", ".join(f"'{name}'" for name in wanted)
    octave(folder, ["load('given.mat');", *lines, f"save('-v7', 'wanted.mat', {saved});"])
    found = loadmat(folder / "wanted.mat")
    return [found[name] for name in wanted]
