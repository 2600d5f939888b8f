"""From the JSON of the public format to the parts of a diagnosis, checked: each value by the type of the field that it fills."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np

from ..arrays import Floats
from .parts import Field, Signature, Track
from .vocabulary import along_joint

NOT_OF_THE_FILE = ("document", "slides")
"""Fields that are no key of the file."""
PLAIN: dict[Any, tuple[tuple[type, ...], str]] = {
    bool: ((bool,), "true or false"),
    int: ((int,), "a whole number"),
    float: ((int, float), "a number"),
    str: ((str,), "a text"),
}


def read_fields(
    kind: type, entry: Any, where: str = "", at: str = "", sliding: Collection[str] = ()
) -> dict[str, Any]:
    """The fields of a dataclass from its known keys; a newer core may write more.

    `where` names the entry, `at` is its place, `sliding` are the places of prismatic joints.

    Raises:
        TypeError: a value of another type; the message names it.
    """
    if not isinstance(entry, Mapping):
        raise _wrong(where, entry, "an object")
    hints, at = _hints(kind), entry.get("at", at)
    if not along_joint(entry.get("effect", "")):
        at = ""
    found = {
        name: _read(hint, entry[name], f"{where}.{name}".lstrip("."), at, sliding)
        for name, hint in hints.items()
        if name in entry and name not in NOT_OF_THE_FILE
    }
    return found | ({"slides": at in sliding} if "slides" in hints else {})


def _read(kind: Any, value: Any, where: str, at: str, sliding: Collection[str]) -> Any:
    origin, inside = get_origin(kind), get_args(kind)
    if origin in (UnionType, Union):
        if value is None and NoneType in inside:
            return None
        (kind,) = (one for one in inside if one is not NoneType)
        return _read(kind, value, where, at, sliding)
    if origin is tuple:
        kinds = inside[:1] * len(value) if inside[-1] is Ellipsis and isinstance(value, list) else inside
        # A text would be read letter by letter, an object key by key.
        if not isinstance(value, list) or len(value) != len(kinds):
            raise _wrong(where, value, "a list" if inside[-1] is Ellipsis else f"a list of {len(inside)}")
        each = zip(kinds, value, strict=True)
        return tuple(_read(one, v, f"{where}[{i}]", at, sliding) for i, (one, v) in enumerate(each))
    if origin is not None:
        if not isinstance(value, Mapping):
            raise _wrong(where, value, "an object")
        return {name: _read(inside[1], v, f"{where}.{name}", at, sliding) for name, v in value.items()}
    if kind in PANELS:
        return PANELS[kind](value)
    if isinstance(kind, type) and is_dataclass(kind):
        return kind(**read_fields(kind, value, where, at, sliding))
    kinds, words = PLAIN[kind]
    if not isinstance(value, kinds) or (isinstance(value, bool) and kind is not bool):
        raise _wrong(where, value, words)
    if isinstance(value, (int, float)) and not math.isfinite(value):
        raise _wrong(where, value, "a finite number")
    return value


def _wrong(where: str, value: Any, needed: str) -> TypeError:
    return TypeError(f"{where}: got {value!r:.80}, needed {needed}")


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def read_signature(entry: Mapping[str, Any]) -> Signature:
    points = entry["points"]

    def column(name: str) -> Floats:
        return np.array([point[name] for point in points], dtype=float)

    names = ("position", "torque_nm", "direction", "time_s", "error", "std", "fitted")
    return Signature(
        at=entry["at"],
        unit=entry["unit"],
        cause=entry.get("cause"),
        other=entry.get("other"),
        other_position=column("other_position") if entry.get("other") else None,
        frame=np.array([point["frame"] for point in points], dtype=np.int64),
        **{name: column(name) for name in names},
    )


def _table(points: Sequence[Mapping[str, Any]], name: str, columns: int) -> Floats:
    """(points, columns): one of the points' values."""
    return np.array([point[name] for point in points], dtype=float).reshape(len(points), columns)


def read_track(entry: Mapping[str, Any]) -> Track:
    points, components, against = entry["points"], entry["components"], entry["against"]

    return Track(
        at=entry["at"],
        what=entry["what"],
        unit=entry["unit"],
        cause=entry.get("cause"),
        components=tuple(components),
        against=tuple(axis["name"] for axis in against),
        against_units=tuple(axis["unit"] for axis in against),
        frame=np.array([point["frame"] for point in points], dtype=np.int64),
        values=_table(points, "against", len(against)),
        **{name: _table(points, name, len(components)) for name in ("error", "std", "fitted")},
    )


def read_field(entry: Mapping[str, Any]) -> Field:
    points = entry["points"]
    axes = 2 if entry["over"] == "image" else 3

    return Field(
        at=entry["at"],
        over=entry["over"],
        unit=entry["unit"],
        cause=entry.get("cause"),
        size=np.array(entry["size"], dtype=float),
        at_points=_table(points, "at", 2),
        of=tuple(point["of"] for point in points),
        count=np.array([point["count"] for point in points], dtype=np.int64),
        without=_table(points, "without", axes),
        std=_table(points, "std", axes),
        with_cause=_table(points, "with", axes) if points and "with" in points[0] else None,
    )


PANELS = {Signature: read_signature, Track: read_track, Field: read_field}
"""Arrays of points for drawing, read column by column."""
