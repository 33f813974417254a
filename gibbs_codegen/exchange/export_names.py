"""Names in an exported file: those of the robot as far as the format can hold them, none twice."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from gibbs_codegen.errors import printable
from gibbs_codegen.exchange.source import Source
from gibbs_codegen.exchange.urdf_rotors import is_rotor_by_name

# What a robot file takes, 128 characters, less the room for a number.
_LONGEST = 120


class Names:
    """Names of one kind of thing in a file."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = set(taken)

    def free(self, name: str) -> str:
        """A name as near as can be that no other thing of the kind has, which takes it.

        Its characters are printable, and XML can hold them.
        """
        plain = "".join(c if c.isprintable() else "_" for c in name).strip() or "_"
        free, number = plain, 2
        while free in self._taken:
            free, number = f"{plain[:_LONGEST]}_{number}", number + 1
        self._taken.add(free)
        return free


def with_free_names(source: Source, is_urdf: bool) -> tuple[Source, list[str]]:
    """The same robot with names that a file can hold, and a line for each that is changed.

    `is_urdf` is whether frames are links and rotors are joints in the file, as in URDF.
    """
    # MuJoCo has a body of that name already.
    joints, links = Names(), Names(() if is_urdf else ("world",))
    rotors, frames = (joints, links) if is_urdf else (Names(), Names())
    lines: list[str] = []

    def free(names: Names, what: str, name: str, wanted: str | None = None) -> str:
        found = names.free(wanted or name)
        if found != name:
            lines.append(f"renamed: {what} {printable(name, 60)} is {found}")
        return found

    # The mounts of fixed joints, which a robot does not name, take what names are left.
    order = sorted(source.joints, key=lambda joint: joint.kind == "fixed")
    moved = {j.child: free(joints, "joint", j.name) for j in order if j.kind != "fixed"}
    placed = [replace(r, name=free(rotors, "rotor", r.name)) for r in source.rotors]
    moved |= {j.child: joints.free(j.name) for j in order if j.kind == "fixed"}
    # What a reader would take for a rotor of JSK is called otherwise.
    named = {
        link: free(links, "link", link, f"{link}_" if is_urdf and is_rotor else None)
        for link in source.links
        for is_rotor in [is_rotor_by_name(moved.get(link, ""), link)]
    }
    own = [f for f in source.frames if not (is_urdf and f.on == f.name and f.pose.is_identity)]
    return (
        replace(
            source,
            links={named[n]: replace(link, name=named[n]) for n, link in source.links.items()},
            joints=tuple(
                replace(j, name=moved[j.child], parent=named[j.parent], child=named[j.child])
                for j in source.joints
            ),
            rotors=tuple(replace(rotor, on=named[rotor.on]) for rotor in placed),
            frames=tuple(
                replace(f, name=free(frames, "frame", f.name), on=named[f.on]) for f in own
            ),
        ),
        lines,
    )
