"""The numbers of xacro files that can be changed, with their places in the text."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from .xml_text import Element, XmlText

BUILT_IN = {
    "arg",
    "attribute",
    "call",
    "element",
    "if",
    "include",
    "insert_block",
    "macro",
    "property",
    "unless",
}
DIGITS = 10
"""Digits after the point: smaller differences are rounding of other numbers."""
_TOKEN = re.compile(r"\$\{[^}]*\}|[^\s${}]+")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\Z")
_EXPRESSION = re.compile(r"\$\{([^}]*)\}\Z")
_DEFAULT = re.compile(r"(\w+):?=([-+.\deE]+)(?=\s|\Z)")


@dataclass(frozen=True)
class Place:
    """A number in a file's text, or an expression `${…}` to which a number can be added."""

    file: Path
    start: int
    """First byte, of the text as UTF-8."""
    end: int
    old: str
    line: int
    words: str
    """Its description for the reader."""

    @property
    def plain(self) -> bool:
        """A number, not an expression."""
        return _NUMBER.match(self.old) is not None

    def moved_by(self, change: float) -> str:
        """The text that is larger by a number."""
        if self.plain:
            return f"{round(float(self.old) + change, DIGITS) + 0.0:.12g}"
        found = _EXPRESSION.match(self.old)
        assert found is not None
        inner = found[1].strip()
        # A name or a number needs no brackets.
        inner = inner if re.fullmatch(r"[\w.]+", inner) else f"({inner})"
        return f"${{{inner} {'-' if change < 0 else '+'} {round(abs(change), DIGITS):.12g}}}"


def edited(sources: Mapping[Path, str], changes: Mapping[Place, str]) -> dict[Path, str]:
    """The texts of the files in which something changes."""
    found = {}
    for file in {place.file for place in changes}:
        data = sources[file].encode("utf-8")
        for place in sorted((p for p in changes if p.file == file), key=lambda p: p.start, reverse=True):
            data = data[: place.start] + changes[place].encode("utf-8") + data[place.end :]
        found[file] = data.decode("utf-8")
    return found


def shared_places(sources: Mapping[Path, str]) -> list[Place]:
    """Numbers of properties, arguments, macros' defaults and calls of macros, which a person would change
    first."""
    return [place for file, text in sources.items() for place in _shared(file, text)]


def _shared(file: Path, text: str) -> Iterator[Place]:
    document = _Document(file, text)
    for element in document.elements:
        prefix, _, name = element.tag.rpartition(":")
        given = element.attributes.get("name", "")
        if element.tag == "xacro:property":
            for key in ("value", "default"):
                yield from document.tokens(element, key, f"property {given}")
        elif element.tag == "xacro:arg":
            yield from document.tokens(element, "default", f"argument {given}")
        elif element.tag == "xacro:macro":
            yield from document.defaults(element, given)
        elif prefix == "xacro" and name not in BUILT_IN:
            for key in element.attributes:
                yield from document.tokens(element, key, f"{key} of {element.tag}")
            for block in element.children:
                for key in block.attributes if block.tag == "origin" else ():
                    yield from document.tokens(block, key, f"{key} of the origin in {element.tag}")


def own_places(sources: Mapping[Path, str], joint: str) -> list[tuple[Place, str, int]]:
    """Numbers and expressions in the origins and axes of the joints that may get a name, with attribute and column."""
    found = []
    for file, text in sources.items():
        document = _Document(file, text)
        for element in document.elements:
            if element.tag != "joint" or not _may_be(element.attributes.get("name", ""), joint):
                continue
            for child in element.children:
                keys = {"origin": ("xyz", "rpy"), "axis": ("xyz",)}.get(child.tag, ())
                for key in keys:
                    words = f"{key} of the {child.tag} of joint {element.attributes['name']}"
                    tokens = list(document.tokens(child, key, words))
                    if len(tokens) == 3:
                        found += [
                            (place, f"{child.tag} {key}", column) for column, place in enumerate(tokens)
                        ]
    return found


def joint_lines(sources: Mapping[Path, str], joint: str) -> list[str]:
    """`FILE, line N` of the joints that may get a name."""
    return [
        f"{file.name}, line {document.line(element.start)}"
        for file, text in sources.items()
        for document in (_Document(file, text),)
        for element in document.elements
        if element.tag == "joint" and element.children and _may_be(element.attributes.get("name", ""), joint)
    ]


def _may_be(template: str, name: str) -> bool:
    """Whether a name with `${…}` and `$(…)` in it may become another one."""
    if not template:
        return False
    parts = re.split(r"\$\{[^}]*\}|\$\([^)]*\)", template)
    return re.fullmatch(".*".join(map(re.escape, parts)), name) is not None


class _Document:
    """A file's elements, and the positions of the words of their attributes."""

    def __init__(self, file: Path, text: str) -> None:
        self._file = file
        self._bytes = text.encode("utf-8")
        self._shift = 3 if text.startswith("\ufeff") else 0
        self.elements: list[Element] = XmlText(text, str(file)).elements

    def line(self, start: int) -> int:
        return self._bytes.count(b"\n", 0, start + self._shift) + 1

    def _value(self, element: Element, key: str) -> tuple[int, str] | None:
        start = element.start + self._shift
        tag = self._bytes[start : element.open_end + self._shift]
        found = re.search(rb"""\s%s\s*=\s*("[^"]*"|'[^']*')""" % re.escape(key.encode()), tag)
        if found is None:
            return None
        return start + found.start(1) + 1, found[1][1:-1].decode("utf-8")

    def _places(self, at: int, text: str, spans: Iterable[tuple[int, int]], words: str) -> Iterator[Place]:
        for start, end in spans:
            first = at + len(text[:start].encode("utf-8"))
            old = text[start:end]
            yield Place(
                self._file,
                first,
                first + len(old.encode("utf-8")),
                old,
                self.line(first - self._shift),
                words,
            )

    def tokens(self, element: Element, key: str, words: str) -> Iterator[Place]:
        """The words of an attribute, if all are numbers or expressions."""
        value = self._value(element, key)
        if value is None:
            return
        at, text = value
        found = list(_TOKEN.finditer(text))
        left = _TOKEN.sub("", text)
        if left.strip() or not all(_NUMBER.match(m[0]) or _EXPRESSION.match(m[0]) for m in found):
            return
        yield from self._places(at, text, [m.span() for m in found], words)

    def defaults(self, macro: Element, name: str) -> Iterator[Place]:
        """The numbers that a macro takes where a call gives none."""
        value = self._value(macro, "params")
        if value is None:
            return
        at, text = value
        for found in _DEFAULT.finditer(text):
            if _NUMBER.match(found[2]):
                yield from self._places(at, text, [found.span(2)], f"default of {found[1]} of macro {name}")
