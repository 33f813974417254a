"""Install the wheels with the oldest and newest Python and dependencies, and compare.

    python3 .ci/matrix.py FOLDER

FOLDER is what distributions.py wrote; pip takes the wheel that fits best. Of the Pythons that
pyproject.toml allows and that are on the path or among pyenv's, the oldest has an environment with
the oldest dependencies, and the newest one with the newest and the packages for numbers that SymPy
computes with where it finds them; what works with both works in between. In both, modules in
generated/ must be up to date, a user's commands and some tests must pass, and what is emitted must
be the same bytes. The newest must find the dependencies of all extras; the others' are those that
.ci/run installs.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OLDEST_MINOR = int(PROJECT["requires-python"].removeprefix(">=3."))
EXTRAS = f"{PROJECT['name']}[{','.join(PROJECT['optional-dependencies'])}]"
OLDEST = [re.sub(" *>= *", "==", requirement) for requirement in PROJECT["dependencies"]]

# SymPy computes with these where it finds them.
NUMBER_PACKAGES = ["gmpy2", "python-flint", "symengine"]
NEWEST = [*NUMBER_PACKAGES, "pip"]
# Packages whose versions are told.
TOLD = {*NUMBER_PACKAGES, *(requirement.partition("==")[0] for requirement in OLDEST)}
# What stands most on versions of others, quick, and without a need for further packages.
TESTS = [
    f"tests/{name}.py"
    for name in (
        *("equations/test_normal_form", "equations/test_typeset", "targets/test_numpy"),
        *("robot/test_file", "flight/scenario/test_path_tables"),
    )
]

LIST_PACKAGES = """
from importlib.metadata import distributions
print("\\n".join(sorted(f"{d.name}=={d.version}" for d in distributions())))
"""
LIST_COMMANDS = """
import sys
from pathlib import Path
from support.digests import commands
from support.random_robots import write_random_robots
print("\\n".join(commands(write_random_robots(Path(sys.argv[1]), 3))))
"""
WALK = """
info quadrotor_2link
show quadrotor_2link --chain 1
new mine.toml
generate mine.toml --no-verify
verify mine --states 2
simulate mine --set duration=0.5 --set integration.method=rk4
"""
BOTH_BACK_ENDS = """
import gibbs_codegen, numpy
robots = [gibbs_codegen.load("mine", backend=backend) for backend in ("numpy", "c")]
assert robots[1].__file__.endswith(".so"), "nothing was compiled"
state = numpy.linspace(-1, 1, 9), numpy.linspace(0, 2, 9)
for arguments, keywords in [(state, {}), (state[:1], {"v": state[1]})]:
    one, other = (robot.residual(*arguments, **keywords) for robot in robots)
    assert numpy.allclose(one, other, rtol=1e-12, atol=1e-12)
"""
NUMPY_ALONE = """
import importlib.util, mine
assert not any(map(importlib.util.find_spec, ("gibbs_codegen", "sympy", "scipy", "jinja2")))
mass_matrix = mine.mass_matrix([0.1] * 9)
assert mass_matrix.shape == (9, 9) and (mass_matrix == mass_matrix.T).all()
"""


class FailedError(Exception):
    """A command failed in an environment; what it said."""


@dataclass(frozen=True)
class Environment:
    """A virtual environment, in a folder of its own, where its commands run too."""

    label: str
    interpreter: Path
    folder: Path
    packages: Sequence[str] = ()

    @property
    def variables(self) -> dict[str, str]:
        """A cache of its own; C is compiled soon, since how fast it runs is not looked at."""
        return {"GIBBS_CODEGEN_CACHE": str(self.folder / "cache"), "CC": "cc -O0"}

    def run(self, *command: str | Path, cwd: Path | None = None, **variables: str) -> str:
        """What a program of the environment prints. Raises `FailedError`."""
        done = subprocess.run(
            [self.folder / "bin" / command[0], *command[1:]],
            cwd=cwd or self.folder,
            env=os.environ | self.variables | variables,
            capture_output=True,
            text=True,
        )
        if done.returncode != 0:
            said = f"{done.stdout[-6000:]}\n{done.stderr[-6000:]}"
            raise FailedError(f"{self.label}: {' '.join(map(str, command))}\n{said}")
        return done.stdout

    def pip(self, *arguments: str | Path) -> None:
        """Have this program's pip install packages."""
        python = self.folder / "bin" / "python"
        pip = (sys.executable, "-m", "pip", "--python", python, "install", "--quiet")
        self.run(*pip, "--only-binary=:all:", *arguments)

    def find(self, *packages: str) -> None:
        """Look for packages and what they need, by its own pip: a new one need not load them."""
        pip = ("python", "-m", "pip", "install", "--quiet", "--only-binary=:all:", "--dry-run")
        self.run(*pip, *packages)

    def install(self, *others: str, wheels: Path | None = None) -> str:
        """Make the environment with its packages, wheels and others; which versions came."""
        subprocess.run([self.interpreter, "-m", "venv", "--without-pip", self.folder], check=True)
        if wheels:
            self.pip("--no-deps", "--no-index", "--find-links", wheels, PROJECT["name"])
        self.pip("--no-compile", *self.packages, *others)
        listed = self.run("python", "-c", LIST_PACKAGES).lower().split()
        return ", ".join(line for line in listed if line.partition("==")[0] in TOLD)

    def walk(self) -> None:
        """Run each command and load what they made, with no checkout in sight."""
        for line in WALK.strip().splitlines():
            self.run("gibbs-codegen", *line.split())
        self.run("python", "-c", BOTH_BACK_ENDS)
        if not (self.folder / "flight" / "snapshots.png").stat().st_size:
            raise FailedError(f"{self.label}: simulate leaves an empty figure")

    def check(self) -> None:
        """Compare generated/ with what would be written, walk, test."""
        for module in sorted(path.name for path in (ROOT / "generated").iterdir()):
            self.run("gibbs-codegen", "generate", module, "--check", cwd=ROOT)
        self.walk()
        # Old packages warn of each other. What needs an extra is skipped, since none is installed.
        pytest = ("pytest", "-q", "-W", "default", "-p", "no:cacheprovider")
        self.run(*pytest, *TESTS, cwd=ROOT, GIBBS_CODEGEN_REQUIRE_TOOLS="")

    def digests(self, commands: Sequence[str]) -> dict[str, str]:
        """What the commands emit, as digests by command."""
        printed = self.run(
            "python", ROOT / "tests" / "support" / "digests.py", *commands
        ).splitlines()
        return {command: digest for digest, command in (line.split(" ", 1) for line in printed)}


def interpreters() -> Iterator[tuple[str, Path]]:
    """Every version of Python that can make environments, oldest first."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    folders = [*map(Path, os.environ["PATH"].split(os.pathsep)), *sorted(pyenv.glob("*/bin"))]
    for version in (f"3.{minor}" for minor in range(OLDEST_MINOR, OLDEST_MINOR + 20)):
        for folder in folders:
            # pyenv's shims are there for versions that do not run.
            ask = [folder / f"python{version}", "-c", "import ensurepip, venv"]
            if ask[0].is_file() and subprocess.run(ask, capture_output=True).returncode == 0:
                yield version, ask[0]
                break


def environments(work: Path) -> list[Environment]:
    """Environments to make: the oldest first."""
    found = list(interpreters())
    if not found:
        sys.exit(f"no Python from 3.{OLDEST_MINOR} on with venv (Debian: python3-venv)")
    (first, oldest), (last, newest) = found[0], found[-1]
    return [
        Environment(f"Python {first}, oldest packages", oldest, work / "oldest", OLDEST),
        Environment(f"Python {last}, newest packages", newest, work / "newest", NEWEST),
    ]


def installed(environment: Environment, wheels: Path) -> None:
    """Make an environment, and say what is in it."""
    packages = environment.install(PROJECT["name"], "pytest", "hypothesis", wheels=wheels)
    print(f"{environment.label}: {packages}", flush=True)


def numpy_alone(interpreter: Path, generated: Path, folder: Path) -> None:
    """Import a generated module where there is NumPy, of the oldest version, and nothing else."""
    numpy = [requirement for requirement in OLDEST if requirement.startswith("numpy=")]
    environment = Environment("NumPy alone", interpreter, folder, numpy)
    environment.install()
    environment.run("python", "-c", NUMPY_ALONE, cwd=generated)


def main(wheels: Path) -> None:
    """Make the environments, check each, and compare what they emit."""
    with tempfile.TemporaryDirectory() as name, ThreadPoolExecutor(3) as pool:
        work = Path(name)
        made = environments(work)
        for _ in pool.map(lambda environment: installed(environment, wheels), made):
            pass
        first = made[0]
        tests = str(ROOT / "tests")
        commands = first.run("python", "-c", LIST_COMMANDS, work, PYTHONPATH=tests).splitlines()
        extras = pool.submit(made[-1].find, EXTRAS)
        for _ in pool.map(Environment.check, made):
            pass
        extras.result()
        numpy_alone(first.interpreter, first.folder / "generated", work / "alone")
        digests = list(pool.map(lambda environment: environment.digests(commands), made))
    differing = [
        f"{command}: other bytes with {environment.label} than with {first.label}"
        for environment, found in zip(made, digests, strict=True)
        for command in commands
        if found[command] != digests[0][command]
    ]
    if differing:
        sys.exit("\n".join(differing))
    print(f"matrix: {len(commands)} commands emit the same bytes in {len(made)} environments")


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]).absolute())
    except FailedError as error:
        sys.exit(str(error))
