"""Numbers of a robot file that are free: which these are, and how they follow from unknowns.

An unknown z is 0 in the robot file. A number is that of the file times exp(z), and a coordinate of
a centre of mass is it plus z times the radius of gyration. So what is positive stays so. The
moments of inertia of a body are free together: z are logarithms of the Cholesky factor of its
second moments about the centre of mass, so that every z is a body that can be. A body without
extent along an axis stays so: of a thin rod one moment is free, of a plate two, and the others
follow. Static friction keeps its ratio to that at speed where it is not free itself. What a body
carries is a point: a part of its mass times exp(z) to begin with, anywhere around its origin.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from itertools import chain
from pathlib import Path
from types import ModuleType

import numpy as np

from gibbs_codegen.errors import UsageError, near, printable
from gibbs_codegen.exchange.welding import composite
from gibbs_codegen.flight.vectors import Array
from gibbs_codegen.identification.robot_file import names_by_keys
from gibbs_codegen.robot.names import default_prefix, frame_prefix
from gibbs_codegen.robot.parts.base import FIXED
from gibbs_codegen.robot.parts.body import RigidBody, entries_of, inertia_matrix
from gibbs_codegen.robot.parts.numbers import AXIS_PAIRS, XYZ
from gibbs_codegen.robot.parts.pose import HERE, vector

# The deviation of the prior, a share, where none is given.
PRIOR = 0.3
Prior = float | Mapping[str, float]
# Free by default: what a drawing does not tell.
_FREE = re.compile(
    r"^(?!payload\.).*(mass|com_[xyz]|inertia_(xx|yy|zz|xy|xz|yz)|mass_per_length|drag(_\d+)?"
    r"|thrust_\d|time_(constant|up|down)|damping|friction_[cv]\w+|servo_(stiffness|delay))$"
)
# What numbers of all rotors together are called, and those of what a body carries.
_ROTORS, _PAYLOAD = "rotors.", "payload"
# Of a load the mass to begin with, as a share of its body's, and deviations of the prior: of the
# logarithm of its mass, and of its place, m.
_LIGHT, _ANY_MASS, _ANYWHERE = 0.1, 1.5, 0.1
# Second moments along an axis, as a share of all, up to which a body has no extent along it.
_THIN = 1e-9
_LOWER = np.tril_indices(3, -1)
# How far, m, frames such as those of IMUs are off, by shares of the prior.
_PLACE = 0.1
_DIFFERENCE = 1e-6


class Unknowns:
    """Unknowns (f) of a module by their `names`, of those that patterns choose, or by default.

    `names` are those of parameters, or as `rotors.thrust_1` of all rotors alike, which keep their
    ratios. `prior` (f) are standard deviations: shares of a number, for a centre of mass of the
    radius of gyration, for the place of a frame of 0.1 m.

    Raises `UsageError` for a pattern that chooses nothing, or what cannot be free.
    """

    def __init__(self, module: ModuleType, free: Sequence[str], prior: Prior) -> None:
        self.module = module
        # A robot that is not derived yet has no file beside it.
        path = Path(*getattr(module, "__path__", ()), "robot.toml")
        self.text = path.read_text("utf-8") if hasattr(module, "__path__") else ""
        self.file = {name: float(value) for name, value in module.PARAMETERS.items()}
        self.members = self._ties() | {name: (name,) for name in self.file} | self._loads()
        for name in filter(re.compile(r"\w+_friction_coulomb$").match, self.file):
            self.members[name] = name, f"{name.removesuffix('coulomb')}static"
        self._inertias = self._entries()
        self.names = self.chosen(free)
        if not self.names:
            raise UsageError(f"{module.NAME}: no number is free by default; give some (--free)")
        self._scales = dict[str, float]()
        places = {f"{frame_prefix(frame)}_{axis}" for frame in module.FRAMES for axis in XYZ}
        for name in self.names:
            if name.startswith(f"{_PAYLOAD}."):
                self._begin_load(name)
            elif name in places:
                self._scales[name] = _PLACE
            elif "_com_" in name:
                self._scales[name] = self._gyration(name.partition("_com_")[0])
            elif any(self.file[member] == 0.0 for member in self.members[name]):
                raise UsageError(
                    f"--free {name}: is 0 in the robot file, and the fit scales numbers; give it "
                    "an initial value there, or leave it out"
                )
        self.prior = np.full(len(self.names), PRIOR)
        for pattern, share in (prior if isinstance(prior, Mapping) else {"*": prior}).items():
            self.prior[self._expected(pattern, share)] = share

    def _expected(self, pattern: str, share: float) -> list[int]:
        """Places of numbers that a pattern of the prior chooses: one moment for all of its body."""
        if not 0.0 < share < np.inf:
            raise UsageError(f"--prior {pattern}: must be above 0 and finite, but is {share:g}")
        chosen = {name for name in self.names if _chooses(pattern, name)}
        if not chosen and pattern != "*":
            words = f"chooses none of the numbers that are free: {', '.join(self.names)}"
            raise UsageError(f"--prior {printable(pattern)}: {words}")
        chosen = chosen.union(*(row for row in self._inertias.values() if chosen & {*row}))
        return [self.names.index(name) for name in chosen.intersection(self.names)]

    def _ties(self) -> dict[str, tuple[str, ...]]:
        """Numbers that all rotors have, by what they are called together."""
        names = [n.removeprefix("F_") for n in self.module.INPUTS if n.startswith("F_")]
        prefixes = [default_prefix("rotor", int(n)) if n.isdigit() else n for n in names]
        if not prefixes:
            return {}
        first = f"{prefixes[0]}_"
        ends = [name.removeprefix(first) for name in self.file if name.startswith(first)]
        rows = {end: tuple(f"{prefix}_{end}" for prefix in prefixes) for end in ends}
        return {f"{_ROTORS}{end}": row for end, row in rows.items() if {*row} <= self.file.keys()}

    def _loads(self) -> dict[str, tuple[str, ...]]:
        """By numbers of loads those of their bodies in which they are."""
        bodies = [name.removesuffix("_mass") for name in self.file if name.endswith("_mass")]
        ends = {"mass": "mass", **{axis: f"com_{axis}" for axis in XYZ}}
        return {
            f"{_PAYLOAD}.{body}_{end}": (f"{body}_{of_body}",)
            for body in bodies
            for end, of_body in ends.items()
        }

    def _begin_load(self, name: str) -> None:
        """Give a number of a load a value to begin with, and what its unknown is times."""
        body, _, end = name.removeprefix(f"{_PAYLOAD}.").rpartition("_")
        if lacking := [number for number in _numbers_of(body) if number not in self.file]:
            raise UsageError(
                f"--free {name}: {self.module.NAME} has no {lacking[0]}, which a load changes; "
                "generate the module with --all-parameters"
            )
        self.file[name] = _LIGHT * self.file[f"{body}_mass"] if end == "mass" else 0.0
        self._scales[name] = (_ANY_MASS if end == "mass" else _ANYWHERE) / PRIOR

    def chosen(self, free: Sequence[str]) -> list[str]:
        """Names that patterns choose, in the order of the file; without patterns, by default."""
        tied = {m for name, row in self.members.items() if name.startswith(_ROTORS) for m in row}
        said = [*chain(*names_by_keys(self.text).values())] if self.text else self.file
        placed = [name for name, row in self.members.items() if {*row} <= {*said}]
        by_default = [
            name
            for name in placed
            if _FREE.search(name)
            and name in self._together(name)
            and all(self.file[n] != 0.0 or "_com_" in n for n in self.members[name])
            # A base that stays where it is weighs on the ground alone.
            and not (name.startswith("base_") and self.module.ATTITUDE == FIXED)
        ]
        one_by_one = [name for name in by_default if name not in tied]
        if not free:
            return one_by_one
        chosen = dict[str, None]()
        for pattern in free:
            names = [name for name in placed if _chooses(pattern, name)]
            if len(names) > 1:  # A pattern chooses no lengths, and rotors' numbers one by one.
                names = [name for name in names if name in by_default] or names
            if not names:
                carried = pattern.startswith(f"{_PAYLOAD}.")
                known = {n.rpartition("_")[0] for n in self._loads()} if carried else self.members
                hint = near(pattern, known) or "."
                raise UsageError(
                    f"--free {printable(pattern)}: {self.module.NAME} has no such number other "
                    f"than 0 with a key in its file{hint} Free by default: "
                    f"{', '.join(one_by_one)}; `PARAMETERS` of the module has all numbers"
                )
            chosen |= dict.fromkeys(names)
        chosen = dict.fromkeys(name for first in chosen for name in self._together(first))
        both = [
            name
            for name in chosen
            if name.startswith(_ROTORS) and {*self.members[name]} & {*chosen}
        ]
        if both:
            member = next(name for name in self.members[both[0]] if name in chosen)
            raise UsageError(f"--free {both[0]}: {member} is free by itself too; give one of them")
        return [name for name in self.members if name in chosen]

    def _together(self, name: str) -> tuple[str, ...]:
        """Names that are free where one is chosen: others with it, or in its stead."""
        if name.startswith(f"{_PAYLOAD}."):  # Without a mass its place changes nothing.
            return f"{name.rpartition('_')[0]}_mass", name
        row = self._inertias.get(name.rpartition("_inertia_")[0], {name: 3})
        # Of one moment alone some values are those of no body.
        return tuple(n for n, place in row.items() if place < 3 or row.get(name, 0) >= 3)

    def _entries(self) -> dict[str, dict[str, int]]:
        """By bodies the entries of inertia that can be free, and what each scales.

        That is its extent along an axis, 0 to 2, or an entry of a Cholesky factor, 3 to 5, or a
        correlation where other products are 0.
        """
        bodies, rows = [name.rpartition("_inertia_") for name in self.file], {}
        for body in dict.fromkeys(body for body, _, axes in bodies if axes in AXIS_PAIRS[:3]):
            names = _numbers_of(body)[4:]
            moments = self._second_moments(body)
            least = _THIN * float(np.trace(moments))
            along = [k for k in range(3) if abs(moments[k, k]) > least]
            about = [[], [(k + 1) % 3 for k in along], along[::-1], along][len(along)]
            if np.linalg.eigvalsh(moments)[0] > least:
                about = along = [k for k in range(6) if k < 3 or self.file.get(names[k])]
            rows[body] = {names[i]: k for i, k in zip(about, along, strict=True)}
        return rows

    def _second_moments(self, body: str) -> Array:
        """Second moments (3, 3) of a body in the robot file about its centre of mass, kg m²."""
        inertia = inertia_matrix([self.file.get(name, 0.0) for name in _numbers_of(body)[4:]])
        return np.asarray(0.5 * np.trace(inertia) * np.eye(3) - inertia, np.float64)

    def _gyration(self, body: str) -> float:
        """The radius of gyration, m, of a body; 1 cm of a point."""
        mass, moments = self.file.get(f"{body}_mass", 0.0), self._second_moments(body)
        return max(float(np.sqrt(np.trace(moments) / mass)), 0.01) if mass > 0.0 else 0.01

    def parameters(self, z: Array) -> dict[str, float]:
        """Parameters of the module, those that differ from the robot file, by unknowns (f)."""
        changed, loads = self._without_loads(z), self._carried(z)
        for body in dict.fromkeys(name.rpartition("_")[0] for name in loads):
            mass, *place = (loads.get(f"{body}_{end}", 0.0) for end in ("mass", *XYZ))
            changed |= self._with_load(body, self.file | changed, mass, np.array(place))
        return changed

    def _carried(self, z: Array) -> dict[str, float]:
        """Numbers of loads by the bodies' names and ends."""
        return {
            name.removeprefix(f"{_PAYLOAD}."): self.file[name]
            * float(np.exp(self._scales[name] * x))
            if name.endswith("_mass")
            else self._scales[name] * x
            for name, x in zip(self.names, z.tolist(), strict=True)
            if name.startswith(f"{_PAYLOAD}.")
        }

    def _with_load(
        self, body: str, unloaded: dict[str, float], load: float, place: Array
    ) -> dict[str, float]:
        """Numbers of a body with a point that has a mass."""
        names = _numbers_of(body)
        mass, *rest = (unloaded[name] for name in names)
        of_file = RigidBody(0.0, mass, vector(rest[:3]), entries_of(inertia_matrix(rest[3:])))
        added = RigidBody(0.0, load, vector(place))
        whole = composite([(of_file, HERE), (added, HERE)], snap=False)
        return dict(zip(names, [whole.mass, *whole.com, *whole.inertia], strict=True))

    def _without_loads(self, z: Array) -> dict[str, float]:
        """Parameters without loads."""
        changed = dict[str, float]()
        for name, value in zip(self.names, z.tolist(), strict=True):
            if name.startswith(f"{_PAYLOAD}."):
                continue
            scale = self._scales.get(name)
            for member in self.members[name]:
                p = self.file[member]
                changed[member] = p * float(np.exp(value)) if scale is None else p + scale * value
        for body, row in self._inertias.items():
            changes, listed = np.zeros(6), [name for name in row if name in self.names]
            changes[[row[n] for n in listed]] = [z[self.names.index(n)] for n in listed]
            entries = self._scaled(self._second_moments(body), changes, len(listed) == 6)
            pairs = zip(_numbers_of(body)[4:], entries, strict=True)
            changed |= {name: entry for name, entry in pairs if listed and name in self.file}
        return changed

    def _scaled(self, moments: Array, changes: Array, products: bool) -> tuple[float, ...]:
        """Entries of the inertia of a body whose second moments' Cholesky factor changes."""
        size = np.exp(0.5 * changes[:3])
        if products:
            factor = np.diag(size)
            factor[_LOWER] = changes[3:]
            whole = np.linalg.cholesky(moments) @ factor
            moments = whole @ whole.T
        else:  # So that entries that are 0 stay so.
            along = np.sqrt(np.maximum(np.diag(moments), np.finfo(float).tiny))
            shares = np.clip(moments / np.outer(along, along), -1.0, 1.0)
            with np.errstate(divide="ignore"):  # Thin bodies have shares of 1.
                shares[_LOWER] = np.tanh(np.arctanh(shares[_LOWER]) + changes[3:])
            shares = np.eye(3) + np.tril(shares, -1) + np.tril(shares, -1).T
            moments = np.outer(size * along, size * along) * shares
        return entries_of(np.trace(moments) * np.eye(3) - moments)

    def values(self, z: Array) -> Array:
        """Values (f) of the numbers, of rotors those of the first."""
        values = self._without_loads(z)
        values |= {f"{_PAYLOAD}.{name}": value for name, value in self._carried(z).items()}
        return np.array(
            [values.get(name, values.get(self.members[name][0])) for name in self.names]
        )

    def before(self) -> Array:
        """Values (f) of the robot file, which has no loads."""
        loads = [name.startswith(f"{_PAYLOAD}.") for name in self.names]
        return np.where(loads, 0.0, self.values(np.zeros(len(self.names))))

    def slopes(self, z: Array) -> Array:
        """Derivatives (f, f) of values by unknowns."""
        steps = _DIFFERENCE * np.eye(len(z))
        return np.array([(self.values(z + s) - self.values(z - s)) for s in steps]).T / (
            2 * _DIFFERENCE
        )


def _chooses(pattern: str, name: str) -> bool:
    """Whether a pattern chooses a number: of loads only by their name, which stands for all."""
    if not pattern.startswith(f"{_PAYLOAD}."):
        return fnmatchcase(name, pattern) and not name.startswith(f"{_PAYLOAD}.")
    return fnmatchcase(name, pattern) or fnmatchcase(name, f"{pattern}_*")


def _numbers_of(body: str) -> tuple[str, ...]:
    """Names of mass, centre of mass and inertia of a body."""
    centre, inertia = (f"{body}_com_{a}" for a in XYZ), (f"{body}_inertia_{a}" for a in AXIS_PAIRS)
    return (f"{body}_mass", *centre, *inertia)
