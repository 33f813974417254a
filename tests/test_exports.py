"""What `gibbs_codegen` exports is what its name says, whichever submodule was imported before."""

from __future__ import annotations

import inspect
import pkgutil
import subprocess
import sys
from types import ModuleType

import pytest
from conftest import ROOT

import gibbs_codegen
from gibbs_codegen import flight
from gibbs_codegen.errors import UsageError

SUBMODULES = [
    found.name for found in pkgutil.iter_modules(gibbs_codegen.__path__) if found.name != "__main__"
]


@pytest.mark.parametrize("package", [gibbs_codegen, flight])
def test_exports_are_functions_and_classes_of_their_names(package: ModuleType) -> None:
    for name in package.__all__:
        exported = getattr(package, name)
        assert not isinstance(exported, ModuleType)
        assert name == "__version__" or exported.__name__ == name


@pytest.mark.slow
def test_no_submodule_hides_an_export_by_its_import() -> None:
    """Python sets a submodule as an attribute of its package when it imports it."""
    code = (
        "import importlib, types, gibbs_codegen as g\n"
        f"for name in {SUBMODULES!r}:\n"
        "    importlib.import_module('gibbs_codegen.' + name)\n"
        "hidden = [n for n in g.__all__ if isinstance(getattr(g, n), types.ModuleType)]\n"
        "assert not hidden, hidden"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


@pytest.mark.parametrize(
    "name",
    ["chains_figure", "coupling_figure", "hybrid_pattern_figure"],
)
def test_figures_are_functions_at_the_package_itself(name: str) -> None:
    draw = getattr(gibbs_codegen, name)
    assert draw(gibbs_codegen.paper_family(3, 1)).axes


def test_scenario_names_its_arguments() -> None:
    """Before and after its checks are built."""
    for _ in range(2):
        arguments = inspect.signature(gibbs_codegen.Scenario).parameters
        assert [*arguments][:4] == ["name", "duration", "base", "attitude"]
        assert arguments["duration"].default is inspect.Parameter.empty
        with pytest.raises(UsageError, match=r"Scenario\.duration: missing$"):
            gibbs_codegen.Scenario(name="a")  # type: ignore[call-arg]
