"""The rest of a file that no reader took, like with like, so that nothing is lost in silence.

Readers mark what they read in `Element.read`. A format names what has no part in the motion, and
what is only counted; all else that has no mark is reported with its lines.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress

from gibbs_codegen.errors import printable
from gibbs_codegen.exchange.sources import Finding
from gibbs_codegen.exchange.xml_file import Element, children, within

_MOST, _SHOWN = 20, 3
# In place of words: what is within an element is looked at.
WITHIN = "/"
# Attributes that XML itself defines, in every format.
_OF_XML = ("xmlns", "xml:", "xsi:")


def unread(roots: Iterable[Element], words_of: Mapping[str, str]) -> list[Finding]:
    """Lines on all in some elements that is neither read nor has words.

    `known` has names as `tag`, `parent/tag`, `parent/`, `prefix:`, `tag@attribute`, `@attribute`,
    `tag@` and `tag@prefix_`, also with a value at the end, as in `link/gravity=1`; its texts are
    the words under which something is counted, or empty.
    """
    counts: dict[str, set[Element]] = {}
    groups: dict[str, dict[Element, str]] = {}  # An element may be within several of the roots.

    def sort(element: Element, text: str, subject: str, *names: str) -> None:
        value = plain(text)
        names = (*(f"{name}={value}" for name in names), *names)
        words = next((words_of[name] for name in names if name in words_of), None)
        if words is None:
            groups.setdefault(subject, {})[element] = text
        elif words:
            counts.setdefault(words, set()).add(element)

    def walk(element: Element) -> None:
        tag = element.tag
        for key, text in element.attrib.items():
            if key not in element.read and not key.startswith(_OF_XML):
                subject = f"{printable(key, 40)} of <{printable(tag, 40)}>"
                begin = f"{tag}@{key.partition('_')[0]}_"
                sort(element, text, subject, f"{tag}@{key}", f"@{key}", f"{tag}@", begin)
        for inner in children(element):
            if inner.read or words_of.get(f"{tag}/{inner.tag}") == WITHIN:
                walk(inner)
            else:
                space, colon, _ = inner.tag.partition(":")
                names = (f"{tag}/{inner.tag}", inner.tag, space + colon, f"{tag}/")
                subject = f"<{printable(inner.tag, 40)}> in <{printable(tag, 40)}>"
                sort(inner, inner.text or "", subject, *names)

    for root in roots:
        walk(root)
    lines = [Finding("left out", words, f"{len(same)}") for words, same in counts.items()]
    shown = [*groups.items()][:_MOST]
    lines += [Finding("left out", subject, _detail([*same.items()])) for subject, same in shown]
    if more := len(groups) - len(shown):
        lines.append(Finding("left out", "elements and attributes", f"{more} other kinds"))
    return lines


def table(text: str) -> dict[str, list[str]]:
    """Words by that before them which ends with `/` or `@`."""
    columns: dict[str, list[str]] = {}
    for word in text.split():
        if word[-1] in "/@":
            columns[word] = words = []
        else:
            words.append(word)
    return columns


def without_part(text: str) -> dict[str, str]:
    """Names of what has no part in the motion, of a table, with no words for them."""
    lines = table(text).items()
    return {begin.removeprefix("/") + name: "" for begin, names in lines for name in names}


def pass_over(element: Element | None) -> None:
    """Count an element and all within as read, which say nothing where they are."""
    for inner in [] if element is None else within(element):
        inner.read.update(("", *inner.attrib))


def plain(text: str) -> str:
    """A value in one form: numbers that are all zero as 0, true and false as 1 and 0."""
    words = text.lower().split()
    with suppress(ValueError):
        numbers = [float(word) for word in words]
        return "0" if numbers and not any(numbers) else " ".join(f"{x:g}" for x in numbers)
    return {"true": "1", "false": "0"}.get(" ".join(words), " ".join(words))


def _detail(same: list[tuple[Element, str]]) -> str:
    """The number of elements, their value or names, and the lines of the first."""
    values = {text.strip() for _, text in same}
    names = [name for element, _ in same if (name := element.attrib.get("name"))]
    words = [f"{len(same)} of them"] if len(same) > 1 else []
    words += [printable(text, 40) for text in values if text and len(values) == 1]
    words += [printable(name, 40) for name in names[:_SHOWN]]
    lines = [f"{element.line}" for element, _ in same[:_SHOWN] if not element.elsewhere]
    words += [f"line{'s' * (len(lines) > 1)} {', '.join(lines)}"] if lines else []
    words += dict.fromkeys(printable(element.elsewhere) for element, _ in same[:_SHOWN])
    return ", ".join(filter(None, words)) + " …" * (len(same) > _SHOWN)
