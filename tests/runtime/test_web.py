"""Emitted functions as WebAssembly in node: the bits of the same C, and what the module refuses."""

from __future__ import annotations

import ctypes
import hashlib
import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from support.tools import compiled, missing, run, tool

from gibbs_codegen.errors import MissingFunctionError, UsageError
from gibbs_codegen.interface import Signature, module_signatures
from gibbs_codegen.runtime import web

ROBOT = "quadrotor_arm_2link"
# A quaternion is normalised, and both have the library's arctangent, of which the last bit differs.
OF_ARCTANGENTS = {"difference"}
STATES = 40
ZIG = (sys.executable, "-m", "ziglang", "cc", "-target", "wasm32-freestanding")
CALLS = """
import { readFileSync, writeFileSync } from "node:fs";
import { load } from "./robot.mjs";
const [calls, refused] = JSON.parse(readFileSync("calls.json", "utf8"));
const robot = await load(readFileSync("robot.wasm"));
const found = [];
for (const [name, given] of calls) {
  const results = robot[name](...given);
  found.push(...(Array.isArray(results) ? results.flatMap((x) => [...x]) : results));
}
writeFileSync("found", new Float64Array(found));
const said = ([name, given]) => {
  try { return robot[name](...given); } catch (error) { return String(error); }
};
console.log(JSON.stringify(refused.map(said)));
"""


@pytest.fixture(scope="module")
def module(shipped: Callable[[str], ModuleType]) -> ModuleType:
    tool("node")
    try:
        web.compiler()
    except UsageError as error:
        missing(str(error))
    return shipped(ROBOT)


def in_node(module: ModuleType, folder: Path, calls: list[Any], refused: list[Any]) -> Any:
    """All results of calls, and what others say."""
    assembly, script = web.web_files(module)
    (folder / "robot.wasm").write_bytes(assembly)
    (folder / "robot.mjs").write_text(script, encoding="utf-8")
    (folder / "calls.mjs").write_text(CALLS, encoding="utf-8")
    (folder / "calls.json").write_text(json.dumps([calls, refused]), encoding="utf-8")
    said = run(["env", "-C", folder, tool("node"), "calls.mjs"])
    return np.fromfile(folder / "found"), json.loads(said)


def in_c(library: ctypes.CDLL, signature: Signature, given: list[list[float]]) -> np.ndarray:
    """Results of a function for one state, one after the other."""
    outputs = [np.zeros(shape) for shape in signature.shapes]
    arrays = [*map(np.array, given), *outputs]
    constants = ctypes.c_char.in_dll(library, f"{ROBOT}_default_constants")
    pointers = [x.ctypes.data_as(ctypes.c_void_p) for x in arrays]
    library[f"{ROBOT}_{signature.name}"](ctypes.byref(constants), *pointers)
    return np.concatenate([np.ravel(x) for x in outputs])


@pytest.mark.parametrize("extra", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_bits_are_those_of_c_without_fused_operations(
    extra: bool, module: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a clang of the machine, and by that of the extra `web`."""
    if extra:
        pytest.importorskip("ziglang")
        monkeypatch.setattr(web, "compiler", lambda: ZIG)
    rng = np.random.default_rng(0)
    neutral = np.eye(9)[module.COORDINATES.index("qw")]
    calls: list[Any] = []
    for signature in module_signatures(module):
        for _ in range(STATES):
            given = [rng.uniform(-2.0, 2.0, width) for width in signature.widths]
            for name, x in zip(signature.arguments, given, strict=True):
                if name in ("q", "q0", "q1"):
                    x[:] = module.integrate(neutral, rng.uniform(-2.0, 2.0, 8))
            calls.append([signature, [x.tolist() for x in given]])
    found, _ = in_node(module, tmp_path, [[s.name, given] for s, given in calls], [])
    source = Path(module.__path__[0]) / f"{ROBOT}.c"
    flags = ["-O2", "-ffp-contract=off", "-shared", "-fPIC"]
    command = [tool("gcc"), *flags, source, "-lm"]
    library = ctypes.CDLL(str(compiled(command, tmp_path / "robot.so")))
    place = 0
    for signature, given in calls:
        expected = in_c(library, signature, given)
        here = found[place : place + len(expected)]
        place += len(expected)
        if signature.name in OF_ARCTANGENTS:
            assert np.allclose(here, expected, rtol=1e-15, atol=1e-15)
        else:
            digests = [hashlib.sha256(x.tobytes()).digest() for x in (here, expected)]
            assert digests[0] == digests[1], signature.name
    assert place == len(found)


def test_what_is_of_no_use_is_refused(module: ModuleType, tmp_path: Path) -> None:
    refused = [["positions", [[1.0]]], ["prepare", [[0.0] * len(module.PARAMETERS)]]]
    refused.append(["prepare", [[*module.PARAMETERS.values()], [0.0]]])
    _, said = in_node(module, tmp_path, [], refused)
    assert said[2].endswith("give constants an array that robot.array made")
    assert said[0] == "RangeError: positions: q has 9 entries; 1 are given"
    assert said[1].startswith("RangeError: prepare: the robot has no mass")
    with pytest.raises(MissingFunctionError, match="jvp"):
        web.web_files(module, ["forward_dynamics_jvp"])
    with pytest.raises(UsageError, match="--laws"):
        web.web_files(module, ["positions"], ["geometric"])


def test_without_clang_the_extra_compiles_and_else_both_are_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(web.shutil, "which", lambda _: None)
    found = {"ziglang": True}
    monkeypatch.setattr(web, "find_spec", found.get)
    assert web.compiler.__wrapped__() == ZIG
    found.clear()
    with pytest.raises(UsageError, match=r"clang and lld.*gibbs_codegen\[web\]"):
        web.compiler.__wrapped__()
