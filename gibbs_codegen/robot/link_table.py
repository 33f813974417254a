"""The table of a link in a robot file, with the joint that carries it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field

from gibbs_codegen.files.faults import fault
from gibbs_codegen.files.table import Table
from gibbs_codegen.robot.body_tables import NOT_BOTH_BODIES, RIGID_NEEDS_MASS, BodyTable
from gibbs_codegen.robot.model import AXES, JointLimits, Link, LinkKind, Passive
from gibbs_codegen.robot.placed_tables import PoseTable
from gibbs_codegen.robot.quantities import (
    Angle,
    Direction,
    Label,
    NotNegative,
    OpenRange,
    Size,
    exact,
)

DH_KEYS = ("alpha_deg", "a", "d", "theta_deg")
POSE_KEYS = ("xyz", "rpy_deg")
PASSIVE_KEYS = ("damping", "armature", "stiffness", "rest")
LIMIT_KEYS = ("limits", "limits_deg", "effort", "velocity")


class PlaceTable(PoseTable):
    """Where a link's joint is, by modified Denavit–Hartenberg parameters or a pose."""

    name: Label | None = Field(
        default=None, description="name of the link, any text; without it link 2 is called link2"
    )
    parent: Label | None = Field(
        default=None,
        description='what carries the link: "base" or the name of a link given earlier; default: '
        "the link before, the base for the first",
    )
    alpha_deg: Angle = Field(
        default=0.0, description="twist about x of the parent's frame, degrees"
    )
    a: Size | None = Field(
        default=None,
        description="distance along x of the parent's frame, m; default: the length of the "
        "parent, 0 where it is the base",
    )
    d: Size = Field(default=0.0, description="offset along the joint's axis z, m")
    theta_deg: Angle = Field(default=0.0, description="offset of the joint angle, degrees")
    axis: Direction = Field(
        default=AXES["z"],
        description="axis of a joint that xyz or rpy_deg places, in the link's frame: an axis such "
        'as "x" or "-y", or a direction [x, y, z]',
        json_schema_extra={"default": "z"},
    )


def _not_continuous(kind: object) -> object:
    if kind == "continuous":
        raise fault('must be "revolute", without limits, for what URDF calls "continuous"')
    return kind


class JointTable(Table):
    """What a link's joint does."""

    joint: Annotated[LinkKind, BeforeValidator(_not_continuous)] = Field(
        default="revolute",
        description="what the joint does: it turns about its axis, slides along it, or is fixed",
    )
    constrained: bool = Field(
        default=False,
        description="whether a fixed link is held by a constraint torque about its axis, which the "
        "hybrid system has, instead of welded",
    )
    coordinate: Label | None = Field(
        default=None,
        description="name of the joint's coordinate, any text; default: the link's name, or "
        "theta_… or d_… with the joint's number",
    )
    damping: NotNegative = Field(
        default=0.0, description="torque or force against the joint's rate, N m s/rad or N s/m"
    )
    armature: NotNegative = Field(
        default=0.0,
        description="inertia of what turns with the joint alone, such as a geared motor, kg m² or "
        "kg",
    )
    stiffness: NotNegative = Field(default=0.0, description="of a spring, N m/rad or N/m")
    rest: Size = Field(default=0.0, description="coordinate at which the spring rests, rad or m")
    limits: OpenRange | None = Field(
        default=None,
        description="least and greatest coordinate, rad or m; inf where there is none. Limits are "
        "for simulators and controllers",
    )
    limits_deg: OpenRange | None = Field(
        default=None, description="limits of a joint that turns, degrees"
    )
    effort: NotNegative | None = Field(
        default=None, description="greatest torque or force of the joint, N m or N; default: none"
    )
    velocity: NotNegative | None = Field(
        default=None, description="greatest rate of the joint, rad/s or m/s; default: none"
    )

    def passive(self) -> Passive:
        """What acts on the joint by itself."""
        return Passive(self.damping, self.armature, self.stiffness, self.rest)

    def bounds(self) -> JointLimits:
        """The limits of the joint, in rad or m."""
        low, high = self.limits or (-math.inf, math.inf)
        if self.limits_deg:
            low, high = map(math.radians, self.limits_deg)
        return JointLimits(
            low if math.isfinite(low) else None,
            high if math.isfinite(high) else None,
            self.effort,
            self.velocity,
        )


class LinkTable(BodyTable, JointTable, PlaceTable):
    """A link, with the joint that carries it."""

    model_config = ConfigDict(
        json_schema_extra={
            "dependentRequired": RIGID_NEEDS_MASS,
            "dependentSchemas": {
                **NOT_BOTH_BODIES,
                **{key: {"properties": dict.fromkeys(DH_KEYS, False)} for key in POSE_KEYS},
                "axis": {"anyOf": [{"required": [key]} for key in POSE_KEYS]},
                "limits": {"properties": {"limits_deg": False}},
                "limits_deg": {"properties": {"joint": {"const": "revolute"}}},
            },
        }
    )

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Faults of keys that do not go with each other."""
        yield from super().key_faults(values)
        pose = [key for key in POSE_KEYS if key in values]
        dh = [key for key in DH_KEYS if key in values]
        if pose and dh:
            yield (
                dh[0],
                f"belongs to Denavit–Hartenberg parameters, but {pose[0]} gives a pose: give "
                "alpha_deg, a, d and theta_deg, or xyz, rpy_deg and axis",
            )
        if "axis" in values and not pose:
            yield (
                "axis",
                "needs a pose, since by Denavit–Hartenberg parameters the axis is z: give xyz or "
                "rpy_deg",
            )
        yield from cls._joint_faults(values)

    @classmethod
    def _joint_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        kind, constrained = values.get("joint", "revolute"), values.get("constrained") is True
        if kind == "fixed":
            for key in (*PASSIVE_KEYS, *LIMIT_KEYS):
                if key in values:
                    yield key, "must be left out, since a fixed joint does not move"
            if "coordinate" in values and not constrained:
                yield "coordinate", "must be left out, since a welded joint has no coordinate"
        elif constrained:
            yield "constrained", 'needs a joint that does not move: give joint = "fixed"'
        if kind != "fixed" and "limits_deg" in values:
            if "limits" in values:
                yield "limits_deg", "must be left out, or limits: give one of the two"
            elif kind == "prismatic":
                yield "limits_deg", "belongs to a joint that turns: give limits, in m"

    def link(self, parent: int | None) -> Link:
        """The link that the table describes; `parent` numbers its carrier, None the link before."""
        return Link(
            self.body(),
            exact(self.alpha_deg),
            self.a,
            self.d,
            exact(self.theta_deg),
            self.joint,
            parent,
            self.pose() if self.xyz or self.rpy_deg else None,
            self.axis,
            self.constrained,
            self.name,
            self.coordinate,
            self.passive(),
            self.bounds(),
        )
