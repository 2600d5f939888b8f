"""XML edited as text: attributes of single elements change, every other character of the file stays as it is."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from ..._core import MirrorPostureError
from ...input_files import LARGEST_MODEL, read_regular, reason

BOM = "\ufeff"
_ATTRIBUTE = r"""(\s{name}\s*=\s*)("[^"]*"|'[^']*')"""


def read_xml(file: Path) -> str:
    """A file's text with its own line ends; a byte order mark is kept."""
    try:
        return read_regular(file, LARGEST_MODEL).decode("utf-8")
    except UnicodeDecodeError as error:
        raise MirrorPostureError(f"{file}: is not UTF-8 ({error}); save it as UTF-8") from None
    except (OSError, ValueError) as error:
        raise MirrorPostureError(f"{file}: cannot be read ({reason(error)}); needed an XML file") from None


@dataclass(eq=False)
class Element:
    """An element of the text: its tag, its attributes as they were read, and where its tags lie in the bytes."""

    tag: str
    attributes: dict[str, str]
    parent: Element | None
    start: int
    """First byte of `<tag …>`."""
    open_end: int = 0
    """First byte after the start tag."""
    end: int = 0
    """First byte after the whole element."""
    children: list[Element] = field(default_factory=list)

    def find(self, tag: str) -> Element | None:
        """The first child with a tag."""
        return next((child for child in self.children if child.tag == tag), None)


class XmlText:
    """A document whose attributes can be edited without touching anything else.

    `root` is the outermost element, `elements` are all of them in the file's order. Edits are collected and made by
    `text()`; they do not show in `attributes`.

    Raises:
        MirrorPostureError: text that is no XML.
    """

    def __init__(self, text: str, name: str = "the file") -> None:
        self._bom = BOM if text.startswith(BOM) else ""
        self._bytes = text.removeprefix(BOM).encode("utf-8")
        self.elements: list[Element] = []
        self._attributes: dict[int, dict[str, str]] = {}
        self._inserted: dict[int, list[str]] = {}
        self._replaced: list[tuple[int, int, str]] = []
        self._by_start: dict[int, Element] = {}
        stack: list[Element] = []
        # The encoding that the declaration names was undone when the file was read.
        parser = expat.ParserCreate("utf-8")

        def opened(tag: str, attributes: dict[str, str]) -> None:
            element = Element(tag, attributes, stack[-1] if stack else None, parser.CurrentByteIndex)
            element.open_end = self._tag_end(element.start)
            if stack:
                stack[-1].children.append(element)
            self.elements.append(element)
            self._by_start[element.start] = element
            stack.append(element)

        def closed(_: str) -> None:
            element = stack.pop()
            at = parser.CurrentByteIndex
            closes_itself = self._bytes[element.open_end - 2 : element.open_end] == b"/>"
            element.end = element.open_end if closes_itself else self._tag_end(at)

        parser.StartElementHandler, parser.EndElementHandler = opened, closed
        try:
            parser.Parse(self._bytes, True)
        except expat.ExpatError as error:
            raise MirrorPostureError(f"{name}: is no XML: {error}") from None
        self.root = self.elements[0]

    def set(self, element: Element, attribute: str, value: str) -> None:
        """Gives an attribute a value."""
        self._attributes.setdefault(element.start, {})[attribute] = value

    def inner(self, element: Element) -> str:
        """The text between an element's tags, as it was read."""
        if element.open_end == element.end:
            return ""
        return self._bytes[element.open_end : self._bytes.rfind(b"</", 0, element.end)].decode("utf-8")

    def set_inner(self, element: Element, text: str) -> None:
        """Replaces the text between an element's tags; blanks at its ends stay. The element has no children."""
        if element.open_end == element.end:
            self.replace(element, f"{self._source(element)[:-2].rstrip()}>{escape(text)}</{element.tag}>")
            return
        was = self.inner(element)
        start = element.open_end + len(was) - len(was.lstrip())
        core = was.strip()
        self._replaced.append((start, start + len(core.encode("utf-8")), escape(text)))

    def replace(self, element: Element, text: str) -> None:
        """Writes other text in the place of an element."""
        self._replaced.append((element.start, element.end, text))

    def insert_text_in(self, element: Element, text: str) -> None:
        """Adds XML text as the first thing inside an element, on a line of its own where its first child has one."""
        self._inserted.setdefault(element.open_end, []).append(self._breaks(element, inside=True) + text)

    def _source(self, element: Element) -> str:
        return self._bytes[element.start : element.open_end].decode("utf-8")

    def insert_in(self, element: Element, tag: str, attributes: Mapping[str, str]) -> None:
        """Adds an element as the first child."""
        self._insert(element.open_end, element, tag, attributes, inside=True)

    def insert_after(self, element: Element, tag: str, attributes: Mapping[str, str]) -> None:
        """Adds an element after another one."""
        self._insert(element.end, element, tag, attributes, inside=False)

    def _insert(
        self, at: int, element: Element, tag: str, attributes: Mapping[str, str], *, inside: bool
    ) -> None:
        if inside and self._bytes[element.open_end - 2 : element.open_end - 1] == b"/":
            raise MirrorPostureError(
                f"<{element.tag}/> has nothing inside; write it as <{element.tag}></{element.tag}>"
            )
        told = "".join(f" {key}={quoteattr(value)}" for key, value in attributes.items())
        self._inserted.setdefault(at, []).append(f"{self._breaks(element, inside=inside)}<{tag}{told}/>")

    def _breaks(self, element: Element, *, inside: bool) -> str:
        """The line end and indentation of the neighbour; nothing where it has none of its own."""
        near = element.children[0] if inside and element.children else element
        line = self._bytes.rfind(b"\n", 0, near.start) + 1
        indent = self._bytes[line : near.start].decode()
        if line == 0 or indent.strip():
            return ""
        return ("\r\n" if self._bytes[line - 2 : line] == b"\r\n" else "\n") + indent

    def text(self) -> str:
        """The edited document."""
        changes = [
            (self._by_start[start].start, self._by_start[start].open_end, self._edited(start, wanted))
            for start, wanted in self._attributes.items()
        ]
        changes += [(at, at, "".join(parts)) for at, parts in self._inserted.items()]
        changes += self._replaced
        data = self._bytes
        for start, end, new in sorted(changes, key=lambda change: change[:2], reverse=True):
            data = data[:start] + new.encode("utf-8") + data[end:]
        return self._bom + data.decode("utf-8")

    def _edited(self, start: int, wanted: Mapping[str, str]) -> str:
        element = self._by_start[start]
        tag = self._bytes[start : element.open_end].decode("utf-8")
        for name, value in wanted.items():
            pattern = re.compile(_ATTRIBUTE.format(name=re.escape(name)))
            if pattern.search(tag):
                quoted = quoteattr(value)
                tag = pattern.sub(lambda found, quoted=quoted: found.group(1) + quoted, tag, count=1)  # type: ignore[misc]
            else:
                # Before the end, with the blank that stands there kept.
                body = re.match(r"(.*?)(\s*/?>)$", tag, re.DOTALL)
                assert body is not None
                tag = f"{body.group(1)} {name}={quoteattr(value)}{body.group(2)}"
        return tag

    def _tag_end(self, start: int) -> int:
        """First byte after the tag that starts at a place; a `>` inside quotes ends nothing."""
        quote = 0
        for at in range(start, len(self._bytes)):
            byte = self._bytes[at]
            if quote:
                quote = 0 if byte == quote else quote
            elif byte in b"\"'":
                quote = byte
            elif byte == 0x3E:
                return at + 1
        return len(self._bytes)
