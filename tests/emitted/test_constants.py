"""Copies of constants, of which gcc 12 makes wrong ones for processors with AVX-512."""

from __future__ import annotations

import ctypes
import itertools
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from support.tools import compiled, tool

COUNT = 16


@pytest.mark.parametrize("tuning", ["native", "skylake-avx512", "x86-64-v4"])
def test_equal_numbers_before_zeros_are_copied(tuning: str, tmp_path: Path) -> None:
    flags = Path("/proc/cpuinfo")
    if tuning != "native" and not (flags.is_file() and "avx512dq" in flags.read_text()):
        pytest.skip("needs a processor with AVX-512")
    rows = [
        [2.0] * equal + [0.0] * zeros + [3.0] * (COUNT - equal - zeros)
        for equal, zeros in itertools.product(range(1, 8), range(1, 9))
    ]
    text = 'typedef double real;\n#define LANES 8\n#include "platform.c"\n'
    for k, row in enumerate(rows):
        numbers = ", ".join(map(str, row))
        text += f"void row_{k}(real *to)\n{{\n    static const real row[] = {{{numbers}}};\n"
        text += f"    for (int i = 0; i < {COUNT}; ++i) to[i] = row[i];\n}}\n"
    (tmp_path / "rows.c").write_text(text)
    options = ["-O3", f"-march={tuning}", "-shared", "-fPIC", f"-I{ROOT}/gibbs_codegen/emitted"]
    command = [tool("gcc"), *options, str(tmp_path / "rows.c")]
    library = ctypes.CDLL(str(compiled(command, tmp_path / "rows.so")))
    for k, row in enumerate(rows):
        copy = np.full(COUNT, np.nan)
        library[f"row_{k}"](ctypes.c_void_p(copy.ctypes.data))
        assert copy.tolist() == row
