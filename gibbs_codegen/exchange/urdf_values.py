"""Numbers and names in attributes of URDF elements, with every fault of the file at once."""

from __future__ import annotations

import math

from gibbs_codegen.errors import Fault, printable
from gibbs_codegen.exchange.placement import Placement, degrees, vector
from gibbs_codegen.exchange.xml_file import Element
from gibbs_codegen.robot.magnitude import LEAST, MOST
from gibbs_codegen.robot.model import Vector3

# What some exporters write for no limit.
_ENDLESS = 1e15


class Values:
    """Reads values of elements and collects `faults`; a faulty value counts as its default."""

    def __init__(self) -> None:
        self.faults: list[Fault] = []

    def fault(self, element: Element, message: str) -> None:
        """Note a fault of an element: what is wrong, and what would be right."""
        self.faults.append(Fault(described(element), message, element.line))

    def name(self, element: Element, attribute: str = "name") -> str:
        """A name, or an empty text if there is none, which is a fault."""
        text = element.get(attribute, "").strip()
        if not text:
            self.fault(element, f"has no {attribute}")
        elif not text.isprintable() or len(text) > 200:
            self.fault(element, f"{attribute} must be at most 200 printable characters")
        return text

    def number(
        self, element: Element | None, attribute: str, default: float | None = None
    ) -> float:
        """A finite number, which must be there unless it has a default."""
        if element is None:
            return default or 0.0
        if (text := element.get(attribute)) is None:
            if default is None:
                self.fault(element, f"has no {attribute}")
            return default or 0.0
        return self.of_text(element, attribute, text)

    def of_text(self, element: Element, what: str, text: str) -> float:
        """The number that a text holds, 0 if it is faulty; `what` is what it is called."""
        try:
            value = float(text) if "_" not in text else math.nan
        except ValueError:
            value = math.nan
        if not abs(value) <= MOST:
            self.fault(
                element,
                f"{what} must be a finite number up to {MOST:g} in size, not {printable(text, 40)}",
            )
            return 0.0
        return value if abs(value) >= LEAST else 0.0

    def positive(self, element: Element | None, attribute: str) -> float:
        """A number that is at least 0, and 0 by default."""
        value = self.number(element, attribute, 0.0)
        if value < 0.0 and element is not None:
            self.fault(element, f"{attribute} must be at least 0, not {value:g}")
        return max(value, 0.0)

    def bound(self, element: Element | None, attribute: str) -> float | None:
        """A limit; what is left out or endless is None."""
        text = None if element is None else element.get(attribute)
        if element is None or text is None:
            return None
        if text.strip().lower().lstrip("+-") in ("inf", "infinity"):
            return None
        value = self.of_text(element, attribute, text)
        return value if abs(value) < _ENDLESS else None

    def vector(self, element: Element | None, attribute: str, default: Vector3) -> Vector3:
        """Three numbers."""
        text = None if element is None else element.get(attribute)
        if element is None or text is None:
            return default
        words = text.split()
        if len(words) != 3:
            self.fault(element, f"{attribute} must have 3 numbers, not {len(words)}")
            return default
        return vector([self.of_text(element, attribute, word) for word in words])

    def placement(self, element: Element | None) -> Placement:
        """The pose that an `<origin>` gives, or that of one left out."""
        xyz = self.vector(element, "xyz", (0.0, 0.0, 0.0))
        roll, pitch, yaw = map(degrees, self.vector(element, "rpy", (0.0, 0.0, 0.0)))
        return Placement(xyz, (roll, pitch, yaw))


def child(element: Element, tag: str) -> Element | None:
    """The first child of a tag, or None."""
    return next((found for found in children(element) if found.tag == tag), None)


def children(element: Element) -> list[Element]:
    """The children of an element, in order."""
    return [found for found in element if isinstance(found, Element)]


def described(element: Element) -> str:
    """An element in words for messages, such as `<joint "rotor1">`."""
    name = element.get("name")
    tag = printable(element.tag, 40)
    return f"<{tag}>" if name is None else f'<{tag} "{printable(name, 60)}">'
