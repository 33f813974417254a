"""MJCF for MuJoCo's compiler: files put together, and of them what has to do with mass and motion.

MuJoCo looks for no file by itself: what a model names is found here, beside the model's file or the
one that names it, and never in the working folder.
"""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath

from gibbs_codegen.errors import printable
from gibbs_codegen.exchange.sources import Finding, SourceFileError, refusal
from gibbs_codegen.exchange.unread import unread, without_part
from gibbs_codegen.exchange.xml_file import (
    Element,
    child,
    children,
    described,
    parse_xml,
    read_bytes,
    within,
)

_POSE = "pos quat axisangle euler xyaxes zaxis"
_MOTOR = "name class site joint gear ctrlrange ctrllimited forcerange forcelimited"
_EQUALITY = "name class active body1 body2 site1 site2 anchor"
_CHANGING = ("balanceinertia", "boundmass", "boundinertia", "settotalmass")
_COUNTED = {
    "tendon": "tendons and their springs",
    "contact": "contacts",
    "sensor": "sensors",
    "keyframe": "keyframes",
    "deformable": "deformable bodies",
    "extension": "plugins, and what they do to the motion",
}
# What MuJoCo is given: elements, and their attributes.
_TAKEN: Mapping[str, str | None] = {
    "compiler": "angle eulerseq autolimits inertiafromgeom inertiagrouprange exactmeshinertia "
    f"alignfree fitaabb coordinate conflict strippath meshdir assetdir {' '.join(_CHANGING)}",
    **{"option": "gravity", "flag": "gravity"},
    **{"default": "class", "asset": "", "worldbody": "", "actuator": "", "equality": ""},
    "mesh": "name class file content_type scale inertia refpos refquat vertex face builtin",
    "model": "name file content_type",
    "body": f"name childclass gravcomp {_POSE}",
    "frame": f"name childclass {_POSE}",
    "replicate": f"count sep offset {_POSE}",
    **{"attach": "model body frame prefix", "composite": ""},
    "inertial": f"mass diaginertia fullinertia {_POSE}",
    "freejoint": "name align",
    "joint": "name class type pos axis range limited ref springref stiffness damping springdamper "
    "armature frictionloss actuatorfrclimited actuatorfrcrange",
    "geom": f"name class type size fromto mass density mesh fitscale shellinertia group {_POSE}",
    "site": f"name class type size fromto {_POSE}",
    **{"motor": _MOTOR, "general": f"{_MOTOR} gaintype gainprm biastype biasprm dyntype dynprm"},
    **{"connect": _EQUALITY, "weld": f"{_EQUALITY} relpose", "equality/joint": None},
    "default/equality": "active",
    **dict.fromkeys([f"mujoco/{section}" for section in _COUNTED], ""),
}
# What is only counted, under these words, and what has no part in the motion.
_KNOWN = {f"{section}/": words for section, words in _COUNTED.items()}
_KNOWN |= {"plugin": _COUNTED["extension"]} | without_part(
    {
        "": "custom visual statistic size camera light texture material skin hfield lengthrange",
        "default/": "pair tendon position velocity intvelocity orientation pid damper cylinder "
        "muscle adhesion dcmotor plugin",
        "@": "user group material rgba",
        "compiler@": "texturedir convexhull discardvisual usethread fusestatic "
        "saveinertial savecanonical savecompiled passthrough",
        "option@": "timestep apirate impratio integrator cone jacobian solver iterations tolerance "
        "ls_iterations ls_tolerance noslip_iterations noslip_tolerance mpr_iterations "
        "mpr_tolerance ccd_iterations ccd_tolerance sdf_iterations sdf_initpoints sleep_tolerance "
        "collision magnetic o_margin o_solref o_solimp o_friction density=0 viscosity=0 wind=0",
        "flag@": "=enable contact warmstart filterparent refsafe sensor midphase nativeccd "
        "eulerdamp autoreset override energy fwdinv invdiscrete multiccd island sleep ipc "
        "speculative diagexact",
        "body@": "mocap fuse simple sleep",
        "joint@": "margin solreflimit solimplimit solreffriction solimpfriction actuatorgravcomp",
        "mesh@": "params normal texcoord maxhullvert smoothnormal",
        "geom@": "contype conaffinity condim friction solmix solref solimp margin gap priority "
        "hfield castshadow adhesion surfacevel fluidshape=none",
        "motor@": "lengthrange delay=0 nsample=0 armature=0 damping=0",
        "general@": "lengthrange delay=0 nsample=0 armature=0 damping=0 actdim actearly",
    }
)
_MOST_FILES = 50
_MOST_COPIES = 1000
_TEXTS = ("name", "class", "childclass", "file", "mesh", "model", "joint", "prefix")


class MjcfTexts:
    """A model as MuJoCo is given it: a text, and the texts of the models that it attaches.

    Every line of them has an element of its own, those of `elements`; `findings` says what is left
    out.
    """

    def __init__(self, path: Path, data: bytes) -> None:
        self.path, self.models = path, dict[str, bytes]()
        self.elements: list[Element] = []
        self.findings: list[Finding] = []
        self.text = self._text(path, data, (), 1)

    def refused(self, element: Element, message: str) -> SourceFileError:
        """The error, to be raised, for a fault of an element: what is wrong and what to do."""
        file, _, line = element.elsewhere.rpartition(":")
        place = int(line) if file else element.line
        return refusal(file or self.path, message, place, described(element))

    def refused_by_mujoco(self, error: Exception) -> SourceFileError:
        """The error, to be raised, for one of MuJoCo's, with the line of the file that it is of."""
        text = printable(" ".join(str(error).split()), 300)
        line = re.search(r"line (\d+)", text)
        text = re.sub(r"(XML )?Error: |,? ?Element (name )?'[^']*',( id \d+,)? line \d+", "", text)
        message = f"MuJoCo refuses it: {text}; change the file until MuJoCo loads it"
        if line is None or not 0 < int(line[1]) <= len(self.elements):
            return refusal(self.path, message)
        return self.refused(self.elements[int(line[1]) - 1], message)

    def _text(self, path: Path, data: bytes, above: tuple[Path, ...], copies: int) -> str:
        """The text of a model that those of `above` attach, in so many copies.

        Raises `SourceFileError` for what would keep MuJoCo busy without end, or is missing.
        """
        root, above = parse_xml(data, str(path)), (*above, path.resolve())
        if len(above) > 1:
            _place(root, path)
        self._include(root, path)
        root.get("model")
        _mark(root)
        self.findings += unread([root], _KNOWN)
        _purge(root)
        shapes = _Shapes(root)
        for world in [found for found in children(root) if found.tag == "worldbody"]:
            shapes.strip(world, "", len(above) == 1)
        if shapes.count:
            words = "shapes that give no mass"
            self.findings.append(Finding("left out", words, f"{shapes.count}"))
        self._settle(root, path)
        copies *= max(1, len([*root.iter("attach")]))
        for element in within(root):
            copies *= self._copies(element)
            if copies > _MOST_COPIES:
                raise self.refused(element, f"more than {_MOST_COPIES} copies")
        for model in [found for found in within(root) if found.tag == "model"]:
            file = self._file(model, path)
            if file.resolve() in above or len(self.models) >= _MOST_FILES:
                many = f"more than {_MOST_FILES} models are attached"
                raise self.refused(model, "attaches itself" if file.resolve() in above else many)
            text = self._text(file, read_bytes(file), above, copies)
            model.set("file", name := f"model_{len(self.models)}.xml")
            self.models[name] = text.encode()
        before = "\n" * len(self.elements)
        for element in within(root):
            element.text, element.tail = "\n" if len(element) else None, "\n"
            self.elements.append(element)
        return before + re.sub(r"\n(?=</|\Z)", "", ET.tostring(root, encoding="unicode"))

    def _file(self, element: Element, path: Path, folder: str = "", bare: bool = False) -> Path:
        """The file that an element of the model in `path` names, in a folder beside one of them."""
        name = element.attrib.get("file", "").replace("\\", "/")
        name = PurePosixPath(name).name if bare else name
        here = Path(element.elsewhere.rpartition(":")[0] or path)
        for place in (path.parent / folder / name, here.parent / folder / name, here.parent / name):
            if os.path.isfile(place):
                return place.absolute()
        raise self.refused(element, f"{printable(name, 100)}: no such file beside {here.name}")

    def _include(self, root: Element, path: Path) -> None:
        """Put the contents of included files in place of `<include>`."""
        taken = {path.resolve()}
        while found := [(p, e) for p in within(root) for e in children(p) if e.tag == "include"]:
            parent, element = found[0]
            file = self._file(element, path)
            if file.resolve() in taken or len(taken) > _MOST_FILES:
                again = f"{printable(file.name)} is included already; MuJoCo takes a file once"
                many = f"more than {_MOST_FILES} files are included"
                raise self.refused(element, again if file.resolve() in taken else many)
            taken.add(file.resolve())
            fresh = parse_xml(read_bytes(file), str(file))
            _place(fresh, file)
            place = [*parent].index(element)
            parent[place : place + 1] = children(fresh)

    def _settle(self, root: Element, path: Path) -> None:
        """Leave the compiler no choice: no welding, meshes that have mass, by their full paths.

        Tells of settings with which MuJoCo changes masses or inertias.
        """
        if child(root, "compiler") is None:
            root.insert(0, Element("compiler"))
        folder, bare = "", False
        for compiler in [found for found in children(root) if found.tag == "compiler"]:
            for key in sorted({*_CHANGING} & {*compiler.attrib}):
                setting = f"{compiler.get(key)}: with it MuJoCo changes masses or inertias"
                self.findings.append(Finding("note", key, printable(setting)))
            folder = compiler.attrib.pop("meshdir", compiler.attrib.get("assetdir", folder))
            compiler.attrib.pop("assetdir", None)
            bare = compiler.attrib.pop("strippath", "false") == "true" or bare
            compiler.set("fusestatic", "false")
        used = {geom.get("mesh") for geom in root.iter("geom")}
        for assets in [found for found in children(root) if found.tag == "asset"]:
            for mesh in [found for found in children(assets) if found.tag == "mesh"]:
                file = mesh.attrib.get("file", "").replace("\\", "/")
                if mesh.get("name", PurePosixPath(file).stem) not in used:
                    assets.remove(mesh)
                elif "builtin" in mesh.attrib or not {"file", "vertex"} & {*mesh.attrib}:
                    words = "builtin meshes are not imported, nor those of plugins; give a file"
                    raise self.refused(mesh, words)
                elif file:
                    mesh.set("file", str(self._file(mesh, path, folder, bare)))

    def _copies(self, element: Element) -> int:
        """How often there is what is within an element, which is checked."""
        if element.tag == "composite":
            raise self.refused(element, "composite bodies are not imported")
        for key, text in element.attrib.items():
            words = {*text.lower().replace("+", "").replace("-", "").split()}
            if key not in _TEXTS and words & {"nan", "inf", "infinity"}:
                raise self.refused(element, f"{key} must be finite, not {printable(text)}")
        count = element.attrib.get("count", "1") if element.tag == "replicate" else "1"
        return int(count) if count.isdigit() and len(count) < 6 else _MOST_COPIES + 1


def _place(root: Element, path: Path) -> None:
    """Note in all elements of a file that they are of it, where it is not the one imported."""
    for element in within(root):
        element.elsewhere, element.line = f"{path}:{element.line}", None


def _mark(element: Element) -> None:
    """Mark what MuJoCo is given of what is within an element."""
    for inner in children(element):
        taken = _TAKEN.get(f"{element.tag}/{inner.tag}", _TAKEN.get(inner.tag))
        drives = element.tag != "actuator" or bool({"site", "joint"} & {*inner.attrib})
        if taken is not None and drives and "refsite" not in inner.attrib:
            inner.read.update(("", *taken.split()))
            _mark(inner)


def _purge(element: Element) -> None:
    """Remove what is not marked."""
    element.attrib = {key: text for key, text in element.attrib.items() if key in element.read}
    for inner in children(element):
        if inner.read:
            _purge(inner)
        else:
            element.remove(inner)


class _Shapes:
    """Removes shapes that give no mass, and counts them."""

    def __init__(self, root: Element) -> None:
        self.count = 0
        self._computed = any(c.get("inertiafromgeom") == "true" for c in root.iter("compiler"))
        self._masses: dict[str, str | None] = {}
        for default in children(root):
            if default.tag == "default":
                self._read(default, None)

    def _read(self, default: Element, mass: str | None) -> None:
        """Learn the mass of shapes of each class, which a class within a class inherits."""
        geom = child(default, "geom")
        mass = mass if geom is None else geom.get("mass", mass)
        self._masses[default.get("class", "main")] = mass
        for inner in children(default):
            if inner.tag == "default":
                self._read(inner, mass)

    def strip(self, element: Element, kind: str, weighed: bool) -> None:
        """Remove the shapes of an element, a body or what holds some, and of the bodies in it.

        `kind` is the class of shapes that name no other; `weighed` whether the mass is given, so
        that no shape counts.
        """
        for found in children(element):
            inner = found.get("childclass", kind)
            if found.tag == "body":
                has_inertial = child(found, "inertial") is not None
                self.strip(found, inner, has_inertial and not self._computed)
            elif found.tag in ("frame", "replicate"):
                self.strip(found, inner, weighed)
            elif found.tag == "geom":
                given_class = found.get("class", kind) or "main"
                mass = found.get("mass", self._masses.get(given_class))
                with suppress(ValueError):  # MuJoCo refuses what is no number.
                    no_solid = found.get("type") in ("plane", "hfield")
                    if weighed or no_solid or (mass is not None and float(mass) == 0.0):
                        element.remove(found)
                        self.count += 1
