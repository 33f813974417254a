"""Blocks of states and tests of numbers, in C that is compiled by itself."""

from __future__ import annotations

import ctypes
import functools
import itertools
import math

import mpmath
import numpy as np
import pytest
from support.alone import alone

WIDTH, COUNT = 3, 21


def lanes_of(real: type[np.floating]) -> int:
    """States in a block."""
    return 16 if real is np.float32 else 8


@pytest.fixture(
    scope="module",
    params=itertools.product(
        ("gcc", "clang"), ("-O0", "-O3", "-ffast-math"), (np.float64, np.float32)
    ),
    ids=lambda way: f"{way[0]}{way[1]}-{way[2].__name__}",
)
def library(request, tmp_path_factory) -> tuple[ctypes.CDLL, type[np.floating]]:
    compiler, option, real = request.param
    folder = tmp_path_factory.mktemp("blocks") / "alone"
    return ctypes.CDLL(str(alone(compiler, [option], real, folder))), real


def call(function, *arguments: np.ndarray | int) -> int:
    return function(
        *(
            ctypes.c_size_t(a) if isinstance(a, int) else ctypes.c_void_p(a.ctypes.data)
            for a in arguments
        )
    )


def states(real: type[np.floating]) -> np.ndarray:
    return np.arange(COUNT * WIDTH, dtype=real).reshape(COUNT, WIDTH)


def blocks_of(rows: np.ndarray) -> np.ndarray:
    """Block, entry, lane, the last state again in lanes that would be empty."""
    lanes = lanes_of(rows.dtype.type)
    whole = np.concatenate([rows, np.repeat(rows[-1:], -len(rows) % lanes, axis=0)])
    return whole.reshape(-1, lanes, WIDTH).swapaxes(1, 2)


def test_states_are_packed_into_blocks_and_back(library) -> None:
    c, real = library
    rows = states(real)
    expected = blocks_of(rows)
    blocks = np.full((len(expected) + 1, *expected.shape[1:]), -1, real)
    back = np.full((COUNT + 1, WIDTH), -1, real)
    call(c.packed, COUNT, WIDTH, rows, blocks)
    np.testing.assert_array_equal(blocks[:-1], expected)
    call(c.unpacked, COUNT, WIDTH, blocks, back)
    np.testing.assert_array_equal(back[:-1], rows)
    assert (blocks[-1] == -1).all()
    assert (back[-1] == -1).all()


@pytest.mark.parametrize("filled", [1, 5, 8])
def test_lanes_that_are_not_filled_hold_the_last_state(filled: int, library) -> None:
    c, real = library
    rows = states(real)[:filled]
    whole = np.full((WIDTH, lanes_of(real)), -1, real)
    block = np.full_like(whole, np.nan)
    block[:, :filled] = rows.T
    call(c.filled, WIDTH, filled, block, whole)
    np.testing.assert_array_equal(whole, blocks_of(rows)[0])


def test_numbers_are_told_from_what_is_not_finite(library) -> None:
    """Also where the compiler is told that every number is finite."""
    c, real = library
    for value in (0.0, -1.0, np.finfo(real).max, np.finfo(real).smallest_subnormal):
        assert call(c.finite_number, np.array([value], real)) == 1
    for value in (math.inf, -math.inf, math.nan, -math.nan):
        assert call(c.finite_number, np.array([value], real)) == 0


def test_entries_are_gathered_from_rows_and_columns(library) -> None:
    functions, real = library
    matrix = np.arange(12, dtype=real).reshape(4, 3)
    rows, columns = np.array([[0, 3, 1], [0, 0, 2]], dtype=np.intc)
    entries = np.full(4, -1, dtype=real)
    width, count = ctypes.c_int(3), ctypes.c_int(3)
    pointers = [ctypes.c_void_p(x.ctypes.data) for x in (rows, columns, matrix, entries)]
    functions.gathered(count, *pointers[:2], width, *pointers[2:])
    assert entries.tolist() == [0, 9, 5, -1]


@functools.cache
def tangents(real: type[np.floating]) -> tuple[np.ndarray, np.ndarray]:
    """Numbers up to 1, whole blocks of them, with arctangents by mpmath: hard and tiny ones."""
    rng = np.random.default_rng(4)
    edges = [math.sqrt(2) - 1, 1.0]
    near = [edge * (1 + k * float(np.finfo(real).eps)) for edge in edges for k in range(-8, 9)]
    exponents = rng.uniform(-35, 0, 200)
    parts = near, rng.uniform(0, 1, 1300), 10.0**exponents, [0.0] * 9
    x = np.concatenate(parts).astype(real)
    x = np.stack([x, -x], axis=1).reshape(-1)
    x = x[: len(x) // 16 * 16]
    with mpmath.workdps(40):
        return x, np.array([mpmath.atan(float(value)) for value in x])


def test_arctangents_are_true_in_blocks_as_alone(library) -> None:
    """To two units in the last place; the signs of zeros and the bits of both forms count."""
    functions, real = library
    x, true = tangents(real)
    alone, beside = np.empty_like(x), np.empty_like(x)
    for i in range(len(x)):
        call(functions.arctangent_of, x[i : i + 1], alone[i : i + 1])
    call(functions.arctangents, len(x), x, beside)
    for ours in (alone, beside):
        assert (np.signbit(ours) == np.signbit(x)).all()
        errors = [float(abs(float(y) - t)) for y, t in zip(ours, true, strict=True)]
        assert (errors <= 2 * np.spacing(np.abs(true.astype(real)))).all()
    assert alone.tobytes() == beside.tobytes()
