"""A document of JSON compared with the definitions of its keys."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from .keys import Section

MOST_SHOWN = 80
"""Characters of a value that are shown."""


def problems(section: Section, tree: Any, path: str = "") -> Iterator[str]:
    """The errors of a document, key by key: what was given and what is required. Unknown keys of a closed
    section are errors too."""
    if not isinstance(tree, dict):
        yield f"{path or 'the document'}: got {_shown(tree)}, needed an object"
        return
    head = f"{path}." if path else ""
    for key in section.keys:
        if key.name not in tree:
            if key.required:
                yield f"{head}{key.name} is missing; needed {key.needed}"
        elif not key.takes(tree[key.name]):
            yield f"{head}{key.name}: got {_shown(tree[key.name])}, needed {key.needed}"
    for inner in section.sections:
        where = f"{head}{inner.name}"
        if inner.name not in tree:
            if inner.name in section.given:
                yield f"{where} is missing; needed {'a list of objects' if inner.repeated else 'an object'}"
        elif not inner.repeated:
            yield from problems(inner, tree[inner.name], where)
        elif not isinstance(tree[inner.name], list):
            yield f"{where}: got {_shown(tree[inner.name])}, needed a list of objects"
        else:
            for index, one in enumerate(tree[inner.name]):
                yield from problems(inner, one, f"{where}[{index}]")
    names = sorted({key.name for key in section.keys} | {one.name for one in section.sections})
    if section.closed:
        for name in tree:
            if name not in names:
                yield f"{head}{name} is no key of the format; needed one of {', '.join(names)}"


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}…"
