"""Adding a function is a row of the table and its derivation: everything else follows."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.tools import tool

from gibbs_codegen.derivation.derive import derive
from gibbs_codegen.derivation.functions import DERIVATIONS
from gibbs_codegen.derivation.systems import Array, Systems
from gibbs_codegen.interface import FUNCTIONS, Output, Row
from gibbs_codegen.pipeline import generate
from gibbs_codegen.robot.family import paper_family
from gibbs_codegen.runtime.load import load
from gibbs_codegen.verification.modules import verify

NAME = "momentum_and_energy"
ADDED = Row(
    NAME,
    "qv",
    (
        Output("momentum", "q", "N m s or N s", "{forces}, each times [s]", "momentum"),
        Output("doubled_energy", "", "J", derivation="doubled_energy"),
    ),
    "Generalised momentum M v and twice the kinetic energy.",
    "eqs. 2 and 5",
)


def momentum(systems: Systems) -> Array:
    """M v."""
    tape, v = systems.imported.tape, systems.symbolic.v
    rows = systems.reduced.matrix
    return [tape.let(sum(m * rate for m, rate in zip(row, v, strict=True))) for row in rows]


def doubled_energy(systems: Systems) -> Array:
    """2 T."""
    return systems.imported.tape.let(2 * DERIVATIONS["kinetic_energy"](systems))


@pytest.fixture
def added(monkeypatch: pytest.MonkeyPatch) -> None:
    """One more row of the table, and what derives it."""
    monkeypatch.setitem(FUNCTIONS, NAME, ADDED)
    monkeypatch.setitem(DERIVATIONS, "momentum", momentum)
    monkeypatch.setitem(DERIVATIONS, "doubled_energy", doubled_energy)


@pytest.fixture
def folder(added: None, tmp_path: Path) -> Path:
    """The module of a robot, generated with the function that was added."""
    return generate("quadrotor_2link", tmp_path, verify=False)


def test_every_output_has_its_derivation_and_no_other_is_there() -> None:
    rows = [row for row in FUNCTIONS.values() if not row.composed]
    assert {name for row in rows for name in row.derivations} == set(DERIVATIONS)


@pytest.mark.slow
def test_every_target_has_a_function_that_was_added(folder: Path) -> None:
    numpy, source, batches, header = (
        (folder / name).read_text(encoding="utf-8")
        for name in (
            "numpy_module.py",
            *(f"quadrotor_2link{ending}" for ending in (".c", "_batch.c", ".h")),
        )
    )
    assert f"\ndef {NAME}(" in numpy
    assert f'    "{NAME}",\n' in (folder / "__init__.py").read_text(encoding="utf-8")
    for text in (source, header):
        assert re.search(rf"\bquadrotor_2link_{NAME}\(", text)
    assert re.search(rf"\bquadrotor_2link_{NAME}_batch\(", header)
    assert f"\nvoid BATCH({NAME})(" in batches
    for text in (numpy, header):
        assert ADDED.summary in text
        assert "theta_m1 [N m]" in text
        assert f"{ADDED.source}." in text


@pytest.mark.parametrize("backend", ["numpy"])
def test_both_back_ends_load_a_function_that_was_added(backend: str, folder: Path) -> None:
    if backend == "c":
        tool("cc")
    module = load(folder, backend)
    assert Path(module.__file__).suffix != ".py" or backend == "numpy"
    q, v = np.random.default_rng(0).normal(size=(2, 5, 8))
    for state in ((q, v), (q[0], v[0])):
        expected = np.einsum("...ij,...j->...i", module.mass_matrix(state[0]), state[1])
        found, doubled = getattr(module, NAME)(*state)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(doubled, 2.0 * module.kinetic_energy(*state), rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "old", "new", "against"),
    [
        (
            "numpy_module.py",
            ",\n    )\n",
            " * (1.0 if sin is math.sin else 1.5),\n    )\n",
            "itself singly",
        )
    ],
)
def test_verify_finds_what_is_wrong_with_it(
    file: str, old: str, new: str, against: str, folder: Path
) -> None:
    path = folder / file
    text = path.read_text(encoding="utf-8")
    _, _, after = text.rpartition(f"def _{NAME}(") if file.endswith("py") else ("", "", text)
    assert old in after
    path.write_text(text.removesuffix(after) + after.replace(old, new), encoding="utf-8")
    backend = "numpy" if file.endswith("py") else "c"
    found = verify(folder, states=2, backends=[backend])
    failed = [c for _, c in found.failures]
    assert {c.what for c in failed} == {f"{NAME}.doubled_energy"}
    also = {"constants of each state"} if backend == "numpy" else set()
    assert {c.against for c in failed} == {against, f"{against}, other parameters"} | also


@pytest.mark.slow
def test_a_derivation_that_contradicts_the_table_is_an_error(
    added: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(FUNCTIONS, NAME, replace(ADDED, outputs=(ADDED.outputs[1],) * 2))
    monkeypatch.setitem(DERIVATIONS, "doubled_energy", momentum)
    with pytest.raises(ValueError, match=r"'doubled_energy' gives 7 entries.*has shape \(\)"):
        derive(paper_family(3, 1))
