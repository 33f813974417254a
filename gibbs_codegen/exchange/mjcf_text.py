"""MJCF for MuJoCo's compiler: files put together, with only what has to do with mass and motion.

MuJoCo looks for no file by itself: this module finds what a model names, beside the model's file or
the one that names it, and never in the working folder.
"""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from contextlib import suppress
from pathlib import Path, PurePosixPath

from gibbs_codegen.errors import printable
from gibbs_codegen.exchange import xml_file
from gibbs_codegen.exchange.sources import Finding, SourceFileError, refusal
from gibbs_codegen.exchange.unread import table, unread, without_part
from gibbs_codegen.exchange.xml_file import Element, child, children, within

_CHANGING = {"balanceinertia", "boundmass", "boundinertia", "settotalmass"}
_COUNTED = {
    "tendon": "tendons and their springs",
    "contact": "contacts",
    "sensor": "sensors",
    "keyframe": "keyframes",
    "deformable": "deformable bodies",
    "extension": "plugins, and what they do to the motion",
}
# What MuJoCo gets: attributes of elements.
_POSE = "pos quat axisangle euler xyaxes zaxis"
_ACTUATOR = "name class site joint gear ctrlrange ctrllimited forcerange forcelimited"
_EQUALITY = "name class active body1 body2 site1 site2 anchor"
_TAKEN = table(f"""
    compiler@ angle eulerseq autolimits inertiafromgeom inertiagrouprange exactmeshinertia alignfree
        fitaabb coordinate conflict strippath meshdir assetdir {" ".join(_CHANGING)}
    option@ gravity flag@ gravity default@ class asset@ worldbody@ actuator@ equality@ active
    mesh@ name class file content_type scale inertia refpos refquat vertex face builtin
    model@ name file content_type attach@ model body frame prefix
    body@ name childclass gravcomp {_POSE} frame@ name childclass {_POSE}
    replicate@ count sep offset {_POSE} composite@ inertial@ mass diaginertia fullinertia {_POSE}
    freejoint@ name align joint@ name class type pos axis range limited ref springref stiffness
        damping springdamper armature frictionloss actuatorfrclimited actuatorfrcrange
    geom@ name class type size fromto mass density mesh fitscale shellinertia group {_POSE}
    site@ name class type size fromto {_POSE} motor@ {_ACTUATOR}
    general@ {_ACTUATOR} gaintype gainprm biastype biasprm dyntype dynprm
    position@ {_ACTUATOR} kp kv dampratio timeconst inheritrange velocity@ {_ACTUATOR} kv
    connect@ {_EQUALITY} weld@ {_EQUALITY} relpose
    equality/joint@ name class active joint1 joint2 polycoef
    equality/tendon@ name class active tendon1 tendon2 polycoef
    tendon/fixed@ name class fixed/joint@ joint coef
    {" ".join(f"mujoco/{section}@" for section in _COUNTED)}
""")
# What is only counted, under these words, and what has no part in the motion.
_KNOWN = {f"{section}/": words for section, words in _COUNTED.items()}
_KNOWN |= {"plugin": _COUNTED["extension"]}
_KNOWN |= without_part("""
    / custom visual statistic size camera light texture material skin hfield lengthrange
    default/ pair tendon intvelocity orientation pid damper cylinder muscle
        adhesion dcmotor plugin
    @ user group material rgba
    compiler@ texturedir convexhull discardvisual usethread fusestatic saveinertial savecanonical
        savecompiled passthrough
    option@ timestep apirate impratio integrator cone jacobian solver iterations tolerance ls_
        noslip_ mpr_ ccd_ sdf_ o_ sleep_ collision magnetic density=0 viscosity=0 wind=0
    flag@ =enable contact warmstart filterparent refsafe sensor midphase nativeccd eulerdamp
        autoreset override energy fwdinv invdiscrete multiccd island sleep ipc speculative
        diagexact
    body@ mocap fuse simple sleep
    joint@ margin solreflimit solimplimit solreffriction solimpfriction actuatorgravcomp
    mesh@ params normal texcoord maxhullvert smoothnormal
    geom@ contype conaffinity condim friction solmix solref solimp margin gap priority hfield
        castshadow adhesion surfacevel fluidshape=none
    motor@ lengthrange delay=0 nsample=0 armature=0 damping=0
    general@ lengthrange delay=0 nsample=0 armature=0 damping=0 actdim actearly
    position@ lengthrange delay=0 nsample=0 armature=0 damping=0
    velocity@ lengthrange delay=0 nsample=0 armature=0 damping=0
""")
_MOST_COPIES = 1000
_ODD = re.compile(r"(?i)(^|[\s+-])(nan|inf)")
_TEXTS = ("name", "class", "childclass", "file", "mesh", "model", "joint", "prefix")


class MjcfTexts:
    """A model for MuJoCo: a text, and the texts of the models that it attaches.

    Every line of them has an element of its own, those of `elements`; `findings` says what is left
    out.
    """

    def __init__(self, path: Path, data: bytes) -> None:
        self.path, self.models = path, dict[str, bytes]()
        self.elements: list[Element] = []
        self.findings: list[Finding] = []
        self.text = self._text(path, data, 1)

    def refused(self, element: Element, message: str) -> SourceFileError:
        """The error, to be raised, for a fault of an element: what is wrong and what to do."""
        file, _, line = (element.elsewhere or f"{self.path}:{element.line or 1}").rpartition(":")
        return refusal(file, message, int(line), xml_file.described(element))

    def refused_by_mujoco(self, error: Exception) -> SourceFileError:
        """The error, to be raised, for one of MuJoCo's, at the element of which it complains."""
        text = printable(" ".join(str(error).split()), 300)
        line = re.search(r"line (\d+)", text)
        text = re.sub(r"(XML )?Error: |,? ?Element (name )?'[^']*',( id \d+,)? line \d+", "", text)
        message = f"MuJoCo refuses it: {text}; change the file until MuJoCo loads it"
        if line is None:
            return refusal(self.path, message)
        return self.refused(self.elements[min(int(line[1]), len(self.elements)) - 1], message)

    def _text(self, path: Path, data: bytes, copies: int, attached: bool = False) -> str:
        """The text of a model, which other models copy so many times.

        Raises `SourceFileError` for what would keep MuJoCo busy without end, or is missing.
        """
        root = xml_file.parse_xml(data, str(path))
        if attached:
            xml_file.place_elsewhere(root, path)
        self._include(root, path)
        root.get("model")
        _mark(root)
        self.findings += unread([root], _KNOWN)
        _purge(root)
        if count := _strip(root, attached):
            self.findings.append(Finding("left out", "shapes that give no mass", f"{count}"))
        self._settle(root, path)
        copies *= max(1, len(within(root, "model", "attach")))
        for element in within(root):
            times = element.attrib.get("count", "1")
            copies *= max(1, int(times)) if re.fullmatch(r"\d{1,5}", times) else _MOST_COPIES + 1
            if copies > _MOST_COPIES:
                words = f"more than {_MOST_COPIES} copies, or models that attach themselves"
                raise self.refused(element, words)
            if element.tag == "composite":
                raise self.refused(element, "composite bodies are not imported")
            for key, text in element.attrib.items():
                if key not in _TEXTS and _ODD.search(text):
                    raise self.refused(element, f"{key} must be finite")
        for model in within(root, "model"):
            file = self._file(model, path)
            text = self._text(file, xml_file.read_bytes(file), copies, True)
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
        while includes := [(p, e) for p in within(root) for e in children(p, "include")]:
            parent, element = includes[0]
            file = self._file(element, path)
            if file.resolve() in taken:
                words = f"{printable(file.name)} is included already; MuJoCo takes a file once"
                raise self.refused(element, words)
            taken.add(file.resolve())
            fresh = xml_file.parse_xml(xml_file.read_bytes(file), str(file))
            xml_file.place_elsewhere(fresh, file)
            place = [*parent].index(element)
            parent[place : place + 1] = children(fresh)

    def _settle(self, root: Element, path: Path) -> None:
        """Leave the compiler no choice: no welding, meshes that have mass, by their full paths.

        Settings with which MuJoCo changes masses or inertias are noted.
        """
        root.insert(0, Element("compiler"))
        folder, bare = "", False
        for compiler in children(root, "compiler"):
            for key in sorted(_CHANGING & {*compiler.attrib}):
                setting = f"{compiler.get(key)}changes masses or inertias in MuJoCo; remove it"
                self.findings.append(Finding("note", key, printable(setting)))
            folder = compiler.attrib.pop("meshdir", compiler.attrib.get("assetdir", folder))
            compiler.attrib.pop("assetdir", None)
            bare = compiler.attrib.pop("strippath", "false") == "true" or bare
            compiler.set("fusestatic", "false")
        used = {geom.get("mesh") for geom in root.iter("geom")}
        for assets in children(root, "asset"):
            for mesh in children(assets, "mesh"):
                file = mesh.attrib.get("file", "").replace("\\", "/")
                if mesh.get("name", PurePosixPath(file).stem) not in used:
                    assets.remove(mesh)
                elif "builtin" in mesh.attrib or not {"file", "vertex"} & {*mesh.attrib}:
                    words = "built-in meshes and meshes of plugins are not imported; give a file"
                    raise self.refused(mesh, words)
                elif file:
                    mesh.set("file", str(self._file(mesh, path, folder, bare)))


def _mark(element: Element) -> None:
    """Mark what MuJoCo gets of the contents of an element."""
    for inner in children(element):
        taken = _TAKEN.get(f"{element.tag}/{inner.tag}@", _TAKEN.get(f"{inner.tag}@"))
        drives = element.tag != "actuator" or bool({"site", "joint"} & {*inner.attrib})
        if taken is not None and drives and "refsite" not in inner.attrib:
            inner.read.update(("", *taken))
            _mark(inner)


def _purge(element: Element) -> None:
    """Remove what is not marked."""
    element.attrib = {key: text for key, text in element.attrib.items() if key in element.read}
    for inner in children(element):
        if inner.read:
            _purge(inner)
        else:
            element.remove(inner)


def _strip(root: Element, attached: bool) -> int:
    """Remove shapes that give no mass, and count them; those of the world do if it is attached."""
    above = {inner: outer for outer in within(root) for inner in children(outer)}
    computed = any(element.get("inertiafromgeom") == "true" for element in within(root, "compiler"))
    masses: dict[str, str | None] = {}
    for default in within(root, "default"):
        geom, outer = child(default, "geom"), above[default].attrib.get("class", "main")
        weight = None if geom is None else geom.attrib.get("mass")
        masses[default.attrib.get("class", "main")] = weight or masses.get(outer)
    count = 0
    for geom in within(root, "geom"):
        holders = [above[geom]]
        while holders[-1] in above:
            holders.append(above[holders[-1]])
        bodies = [holder for holder in holders if holder.tag in ("body", "worldbody")]
        if not bodies:  # It is a default, or MuJoCo refuses it.
            continue
        body = bodies[0]
        heavy = child(body, "inertial") is not None and not computed
        weighed = heavy if body.tag == "body" else not attached
        classes = [text for holder in holders if (text := holder.attrib.get("childclass"))]
        kind = geom.attrib.get("class", [*classes, "main"][0])
        mass = geom.attrib.get("mass", masses.get(kind)) or "1"
        with suppress(ValueError):  # MuJoCo refuses what is no number.
            if weighed or geom.get("type") in ("plane", "hfield") or float(mass) == 0.0:
                above[geom].remove(geom)
                count += 1
    return count
