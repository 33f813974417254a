"""XML as the readers of robots take it, and refused in words of people."""

from __future__ import annotations

import codecs

import pytest

from gibbs_codegen.exchange.sources import SourceFileError
from gibbs_codegen.exchange.xml_file import children, parse_xml

TEXT = '<?xml version="1.0" encoding="{}"?>\n<!-- {} -->\n<robot name="bär">\n <link/></robot>'
UTF8 = TEXT.format("utf-8", "ä")
READ = {
    "plain": UTF8.encode(),
    "no declaration": UTF8[UTF8.index("<!--") :].encode(),
    "byte order mark": codecs.BOM_UTF8 + UTF8.encode(),
    "empty lines before": b"\r\n \n" + UTF8.encode(),
    "mark and empty lines": codecs.BOM_UTF8 + b"\n\n" + UTF8.encode(),
    "comment before": b"<!-- (c) -- me -->\n" + UTF8.encode(),
    "drawing": TEXT.format("utf-8", "-->\n<!----- a -- b --->\n<!-- - ---").encode(),
    "latin-1 in a comment": TEXT.format("utf-8", "X").encode().replace(b"X", b"\xe4\xb0\xff"),
    "latin-1 undeclared": TEXT.format("utf-8", "").encode("latin-1"),
    "latin-1": TEXT.format("ISO-8859-1", "ä").encode("latin-1"),
    "windows-1252": TEXT.format("windows-1252", "€ \x81").replace("\x81", "").encode("cp1252"),
    "utf-16": TEXT.format("utf-16", "a -- b").encode("utf-16"),
    "utf-16 without a mark": ("\n" + TEXT.format("utf-16", "ä")).lstrip().encode("utf-16-be"),
    "said to be utf-16": TEXT.format("utf-16", "").encode(),
    "cdata": b'<robot name="b\xc3\xa4r"><![CDATA[<!-- a -- b]]><link/></robot>',
}


@pytest.mark.parametrize("kind", READ)
def test_what_other_readers_take_is_read(kind: str) -> None:
    root = parse_xml(READ[kind], "robot.urdf")
    (link,) = children(root)
    assert (root.tag, root.get("name"), link.tag) == ("robot", "bär", "link")
    lines = READ[kind].decode("utf-16-be" if "without" in kind else "latin-1").count("\n")
    if "utf-16" not in kind:
        assert link.line == lines + 1


REFUSED = {
    "<a><b></a>": "the end tag here is not that of the open element, <b>",
    "<a>": "it ends before its root element does",
    "<a b='": "it ends within a tag or comment",
    "<a><!-- b": "it ends within a tag or comment",
    "<a b='1' b='2'/>": "an attribute is there twice",
    "<a/><b/>": "something follows the end of the root element",
    "<a>&deg;</a>": "an entity",
    "<a>1 < 2</a>": "< and & are written &lt; and &amp;",
    "{% if x %}<a/>": "a Jinja template",
    '<?xml version="1.0" encoding="punycode"?><a/>': "the encoding punycode",
    '<?xml version="1.0" encoding="zip"?><a/>': "save it as UTF-8",
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_is_no_xml_is_refused_in_words(text: str) -> None:
    with pytest.raises(SourceFileError) as caught:
        parse_xml(b"\n" + text.encode(), "robot.urdf")
    assert REFUSED[text] in str(caught.value)
    assert str(caught.value).startswith("robot.urdf:")
