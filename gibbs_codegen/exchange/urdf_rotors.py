"""Rotors in URDF, which has no element for them: Gazebo's motor plugins, and JSK's convention.

Both push along z of a link. A drag is negative for a rotor that spins counter-clockwise, seen from
the tip of its thrust.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from gibbs_codegen.exchange.source import SourceRotor
from gibbs_codegen.exchange.urdf_values import Values, child, children
from gibbs_codegen.exchange.xml_file import Element

_THRUST = "thrust"


def urdf_rotors(root: Element, values: Values) -> list[SourceRotor]:
    """The rotors under `<robot>`, in the order of their numbers or of the file."""
    motors = [found for found in root.iter("plugin") if isinstance(found, Element)]
    numbered = [_gazebo(found, values) for found in motors if is_motor(found)]
    gazebo = _by_number(numbered)
    taken = {rotor.joint for rotor in gazebo} | {rotor.on for rotor in gazebo}
    jsk = _jsk(root, values)
    return gazebo + [r for r in jsk if r.joint not in taken and r.on not in taken]


def is_rotor_by_name(joint: str, link: str, prefix: str = _THRUST) -> bool:
    """Whether a joint is a rotor by the convention of JSK, in a file without a common rate.

    `link` is what it carries, and `prefix` how the links of rotors begin.
    """
    return bool(re.fullmatch(r"rotor\d+", joint) and re.fullmatch(rf"{re.escape(prefix)}\d+", link))


def _by_number(numbered: Sequence[tuple[float, SourceRotor]]) -> list[SourceRotor]:
    return [rotor for _, rotor in sorted(numbered, key=lambda pair: pair[0])]


def is_motor(plugin: Element) -> bool:
    """Whether a plugin is a motor with a propeller, and not a servo, which is a motor too."""
    kind = child(plugin, "motorType")
    if kind is not None and (kind.text or "").strip() != "velocity":
        return False
    return child(plugin, "linkName") is not None and child(plugin, "motorConstant") is not None


def _gazebo(plugin: Element, values: Values) -> tuple[float, SourceRotor]:
    """The rotor of a motor plugin, with its number."""
    texts = {found.tag: (found.text or "").strip() for found in children(plugin)}

    def number(tag: str) -> float:
        return values.of_text(plugin, f"<{tag}>", texts[tag]) if texts.get(tag) else 0.0

    turning = texts.get("turningDirection", "")
    if turning not in ("cw", "ccw"):
        values.fault(plugin, f"<turningDirection> must be cw or ccw, not {turning or 'left out'}")
    moment = number("momentConstant")
    most = number("motorConstant") * number("maxRotVelocity") ** 2
    joint, link = texts.get("jointName"), texts["linkName"]
    rotor = SourceRotor(
        name=link,
        on=link,
        drag=-moment if turning == "ccw" else moment,
        limits=(0.0, most) if most > 0.0 else None,
        time_constant=number("timeConstantUp") or None,
        joint=joint,
        found_by="Gazebo",
    )
    return number("motorNumber"), rotor


def _jsk(root: Element, values: Values) -> list[SourceRotor]:
    """Rotors by the convention of JSK: joints rotor1, rotor2 …, whose limits are of the thrust.

    A joint may have an `<m_f_rate>` of its own, as `export` writes it: then it is a rotor by any
    name, and there need not be one rate for all.
    """
    common = child(root, "m_f_rate")
    thrust = child(root, "thrust_link")
    prefix = _THRUST if thrust is None else thrust.get("name", _THRUST)
    numbered = []
    for joint in children(root):
        if joint.tag != "joint":
            continue
        own, link = child(joint, "m_f_rate"), child(joint, "child")
        name, on = joint.get("name", ""), "" if link is None else link.get("link", "")
        by_name = is_rotor_by_name(name, on if common is None else f"{prefix}0", prefix)
        if own is None and not by_name:
            continue
        rate = values.number(own if own is not None else common, "value", 0.0)
        z = values.vector(child(joint, "axis"), "xyz", (0.0, 0.0, 1.0))[2]
        limit = child(joint, "limit")
        low, high = values.bound(limit, "lower"), values.bound(limit, "upper")
        rotor = SourceRotor(name, on, joint=name, found_by="JSK")
        drag = (z > 0.0) * rate - (z < 0.0) * rate
        limits = None if low is None or high is None or low >= high else (low, high)
        number = int(name.removeprefix("rotor")) if own is None else 0
        numbered.append((number, replace(rotor, drag=drag, limits=limits)))
    return _by_number(numbered)
