"""SDF models that are put together of others, made one model.

What is nested or included gets the name by which the whole refers to it, such as `camera::link`.
Where it is placed, attached or seen from by default is written out, so that no reader needs to know
which model or version of SDF it came from.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from gibbs_codegen.errors import printable
from gibbs_codegen.exchange.urdf import Values
from gibbs_codegen.exchange.xml_file import (
    Element,
    child,
    child_text,
    children,
    parse_xml,
    place_elsewhere,
    read_bytes,
    within,
)

MODEL, WORLD = "__model__", "world"
# How libsdformat calls the frame of a model that is merged.
MERGED = "_merged__"
PLACED = ("link", "joint", "frame")
# Before this version axes are in the axes of the model.
_OWN_AXES = (1, 5)
# Published robots are put together of fewer than twenty.
_MOST_INCLUDED = 100
_PATHS = ("GZ_SIM_RESOURCE_PATH", "SDF_PATH", "GAZEBO_MODEL_PATH")


@dataclass(frozen=True, eq=False)
class _Part:
    """A model, the version of SDF of its file, and the files by which it is reached."""

    model: Element
    version: tuple[int, int]
    files: tuple[Path, ...]


def whole_model(root: Element, file: Path, values: Values) -> tuple[Element, list[Element]]:
    """The model that moves in a file, with all that it brings in, and includes that are left out.

    Models that a world includes count where it has none of its own, and static ones with joints
    where none moves. It has a `canonical_link`, on which its frames are.
    """
    file_part = _Part(root, _version(root, values), (Path(os.path.abspath(file)),))
    holders = [root, *children(root, "world")]
    models = [
        replace(file_part, model=model) for top in holders for model in children(top, "model")
    ]
    left = [include for top in holders for include in children(top, "include")]
    assembly, lost = _Assembly(values), list[str]()
    moving = [part for part in models if not _rests(part.model)]
    for include in [] if moving else left[:]:
        brought = assembly.included(include, file_part)
        if isinstance(brought, str):
            lost.append(brought)
        elif not _rests(brought.model):
            left.remove(include)
            moving.append(brought)
    moving = moving or [part for part in models if _has_joints(part.model)]
    if len(moving) != 1:
        names = ", ".join(printable(part.model.get("name", "?"), 60) for part in moving[:5])
        words = f"holds {len(moving)} models that move ({names or 'none'}); keep one"
        static = [f"{printable(part.model.get('name'), 60)} is <static>" for part in models]
        values.fault(root, "; ".join([words, *([] if moving else static[:5]), *lost[:5]]))
        return root, left
    parts, canonical = assembly.flat(moving[0])
    whole = Element("model", {**moving[0].model.attrib, "canonical_link": canonical})
    whole.line, whole.elsewhere = moving[0].model.line, moving[0].model.elsewhere
    whole.extend(parts)
    return whole, left


def is_true(text: str | None) -> bool:
    """True if SDF takes a text for true."""
    return (text or "").strip().lower() in ("true", "1")


def _has_joints(model: Element) -> bool:
    return any(joint.get("type") != "fixed" for joint in within(model, "joint"))


def _rests(model: Element) -> bool:
    return is_true(child_text(model, "static"))


def _version(root: Element, values: Values) -> tuple[int, int]:
    """The version of SDF, such as 1.10, which is later than 1.9."""
    text = root.get("version", "1.0")
    if not (numbers := re.fullmatch(r"(\d{1,4})\.(\d{1,4})", text)):
        values.fault(root, f"version must be like 1.9, not {printable(text, 40)}")
        return _OWN_AXES
    return int(numbers[1]), int(numbers[2])


class _Assembly:
    """Puts models together; `values` collects what is wrong with them."""

    def __init__(self, values: Values) -> None:
        self._values, self._count = values, 0

    def flat(self, part: _Part, scope: str = "", frame: str = MODEL) -> tuple[list[Element], str]:
        """All that is in a model, by names that begin with a scope, and its canonical link.

        `frame` is what the model's own frame is called.
        """
        parts, links, nested = list[Element](), list[str](), list[str]()

        def named(name: str) -> str:
            """The name outside of something of the model."""
            name = name.strip().removesuffix(f"::{MODEL}")
            return name if name == WORLD else frame if name == MODEL else scope + name

        for entry in children(part.model):
            if entry.tag not in ("include", "model"):
                _rename(entry, named, part.version)
                parts.append(entry)
                links += [entry.get("name", "")] if entry.tag == "link" else []
                continue
            brought = (
                self.included(entry, part) if entry.tag == "include" else replace(part, model=entry)
            )
            if isinstance(brought, str):
                self._values.fault(entry, brought)
                continue
            model, merged = brought.model, is_true(entry.get("merge"))
            name = self._values.name(model)
            seat_name = scope + (f"{MERGED}{name}{MODEL}" if merged else name)
            inner = scope if merged else f"{seat_name}::"
            below, canonical = self.flat(brought, inner, seat_name)
            (links if merged else nested).append(canonical)
            seat = Element("frame", {"name": seat_name, "attached_to": canonical})
            seat.line, seat.elsewhere = entry.line, entry.elsewhere
            if placed := model.get("placement_frame"):
                seat.set("placement_frame", seat_name if placed == MODEL else inner + placed)
            pose = child(model, "pose")
            pose = Element("pose") if pose is None else pose
            pose.set("relative_to", named(pose.get("relative_to") or MODEL))
            seat.append(pose)
            parts += [seat, *(other for other in below if other is not pose)]
        chosen = part.model.get("canonical_link")
        return parts, named(chosen) if chosen else next(iter([*links, *nested]), "")

    def included(self, include: Element, by: _Part) -> _Part | str:
        """The model that an include brings in, as it says, or why there is none."""
        uri = child_text(include, "uri")
        file = _model_file(uri, by.files[-1].parent)
        if isinstance(file, str):
            return file
        self._count += 1
        if file in by.files or self._count > _MOST_INCLUDED:
            return f"includes itself, or is one of more than {_MOST_INCLUDED}"
        if any(entry.tag.startswith("experimental:") for entry in children(include)):
            return "has <experimental:params>, which import does not apply; write the model out"
        root = parse_xml(read_bytes(file), str(file))
        if root.tag != "sdf" or (model := child(root, "model")) is None:
            return f"{printable(file)} holds no model of SDF"
        place_elsewhere(root, file)
        for key in ("name", "placement_frame"):
            if text := child_text(include, key):
                model.set(key, text)
        # What comes first counts.
        model[:0] = children(include, "pose", "static", "plugin")
        return _Part(model, _version(root, self._values), (*by.files, file))


def _rename(element: Element, named: Callable[[str], str], version: tuple[int, int]) -> None:
    """Give an element of a model, and what it refers to, names that hold outside of the model."""
    if element.tag in PLACED:
        if name := element.get("name"):
            element.set("name", named(name))
        pose = child(element, "pose")
        outer = "" if pose is None else pose.get("relative_to") or pose.get("frame") or ""
        if outer or element.tag == "link":
            if pose is None:
                element.append(pose := Element("pose"))
            pose.set("relative_to", named(outer or MODEL))
        if element.tag == "frame":
            element.set("attached_to", named(element.get("attached_to") or MODEL))
    for owner in within(element, "joint", "plugin"):
        for entry in children(owner):
            if entry.tag in ("parent", "child", "linkName", "jointName") and entry.text:
                entry.text = named(entry.text)
            in_model = version < _OWN_AXES or is_true(child_text(entry, "use_parent_model_frame"))
            axis = child(entry, "xyz") if entry.tag == "axis" else None
            seen_from = "" if axis is None else axis.get("expressed_in") or MODEL * in_model
            if axis is not None and seen_from:
                axis.set("expressed_in", named(seen_from))


def _model_file(uri: str, folder: Path) -> Path | str:
    """The file of a model that is included by a file in a folder, or why there is none.

    It is looked for in that folder and above, and where the environment says that models are.
    """
    scheme, _, rest = uri.rpartition("://")
    if not rest or scheme in ("http", "https", "fuel"):
        words = (
            "is not on this machine; download it with gz fuel download -u, and write model://NAME"
        )
        return f"{printable(uri, 200)} {words}" if rest else "has no <uri>"
    above = [folder, *folder.parents]
    named = [Path(path) for key in _PATHS for path in os.environ.get(key, "").split(os.pathsep)]
    words = ""
    for place in [
        *above,
        *(parent / "models" for parent in above),
        *filter(Path.is_absolute, named),
    ]:
        file = place / rest
        if os.path.isdir(file):
            config = file / "model.config"
            file /= _configured(config) if os.path.isfile(config) else "model.sdf"
            only = ", only a template of it" if os.path.isfile(f"{file}.jinja") else ""
            words = words or f" ({printable(file)} is not there{only})"
        if os.path.isfile(file):
            return Path(os.path.abspath(file))
    return (
        f"{printable(uri, 100)} was not found{words}: it may be beside this file, in folders above "
        f"it or their models/, or in a folder that {' or '.join(_PATHS)} names"
    )


def _configured(config: Path) -> str:
    """The file of the latest version that a model.config names."""
    root, texts = parse_xml(read_bytes(config), str(config)), dict[tuple[int, ...], str]()
    for entry in root.iter("sdf"):
        version = tuple(map(int, re.findall(r"\d{1,4}", entry.get("version", ""))))
        texts[version] = (entry.text or "").strip()
    return texts[max(texts)] if texts else "model.sdf"
