"""From the JSON of the public format to the parts of a diagnosis, checked."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields as fields_of
from typing import Any, TypeGuard, TypeVar

import numpy as np

from .parts import (
    Alternative,
    Cause,
    Checked,
    Data,
    Estimate,
    Field,
    Floats,
    Gap,
    LeftOut,
    Limit,
    Member,
    Signature,
    Step,
    Track,
)

PLAIN = {"float", "int", "str", "bool", "None"}
Kind = TypeVar("Kind")
LISTS = (
    "causes",
    "where",
    "next_postures",
    "warnings",
    "trace",
    "ranking",
    "signatures",
    "tracks",
    "fields",
    "witness",
    "limits",
    "markers",
)
OF_CAUSES: dict[str, type] = {"alternatives": list, "members": list, "frames": list, "parameters": Mapping}


def check_containers(tree: Mapping[str, Any]) -> None:
    """Refuses texts and objects where lists are needed: they would be read letter by letter, key by key."""
    if not isinstance(tree.get("sentence", ""), str):
        raise TypeError(f"sentence: got {tree['sentence']!r:.80}, needed a text")
    lists: list[tuple[str, Any, type]] = [(name, tree[name], list) for name in LISTS if name in tree]
    for cause in filter(_is_mapping, tree["causes"]):
        lists += [(name, cause[name], kind) for name, kind in OF_CAUSES.items() if name in cause]
    gap, data = tree.get("gap"), tree.get("data")
    if _is_mapping(gap):
        lists += [
            (f"gap.{name}", gap[name], list)
            for name in ("checked", "steps", "closed_ci95")
            if gap.get(name) is not None
        ]
    if _is_mapping(data) and "left_out" in data:
        lists.append(("data.left_out", data["left_out"], list))
    for name, value, kind in lists:
        if not isinstance(value, kind):
            raise TypeError(f"{name}: got {value!r:.80}, needed {'a list' if kind is list else 'an object'}")
    for name in ("trace", "warnings"):
        if not all(isinstance(line, str) for line in tree.get(name, ())):
            raise TypeError(f"{name}: got {tree[name]!r:.80}, needed texts")
    for numbers in (tree.get("noise", {}), *tree.get("next_postures", ())):
        if not _is_mapping(numbers) or not all(_is_of(value, ["float"]) for value in numbers.values()):
            raise TypeError(f"noise and next_postures: got {numbers!r:.80}, needed objects of numbers")
    interval = gap.get("closed_ci95") if _is_mapping(gap) else None
    if interval is not None and (len(interval) != 2 or not all(_is_of(end, ["float"]) for end in interval)):
        raise TypeError(f"gap.closed_ci95: got {interval!r:.80}, needed two numbers")


def _is_mapping(value: Any) -> TypeGuard[Mapping[str, Any]]:
    return isinstance(value, Mapping)


def read_plain(kind: type[Kind], entry: Mapping[str, Any]) -> Kind:
    """A dataclass from the keys that it knows, numbers and texts checked; a newer core may say more."""
    fields = {f.name: str(f.type) for f in fields_of(kind)}  # type: ignore[arg-type]
    for name, needed in fields.items():
        if name in entry and not _is_of(entry[name], needed.split(" | ")):
            raise TypeError(f"{kind.__name__.lower()}.{name}: got {entry[name]!r:.80}, needed {needed}")
    return kind(**{key: value for key, value in entry.items() if key in fields})


def _is_of(value: Any, kinds: Sequence[str]) -> bool:
    """Whether a value is of one of the kinds, as far as they are plain ones."""
    if value is None:
        return "None" in kinds or not PLAIN.issuperset(kinds)
    if not PLAIN.issuperset(kinds):
        return True
    if isinstance(value, bool):
        return "bool" in kinds
    if isinstance(value, (int, float)):
        return ("float" in kinds or ("int" in kinds and isinstance(value, int))) and math.isfinite(value)
    return isinstance(value, str) and "str" in kinds


def read_cause(entry: Mapping[str, Any], sliding: Collection[str] = ()) -> Cause:
    """A cause; `sliding` are the places of prismatic joints."""

    def of(at: str, value: Mapping[str, Any]) -> dict[str, Any]:
        return {**value, "slides": at in sliding}

    at = entry.get("at", "")
    parameters = {name: read_plain(Estimate, of(at, value)) for name, value in entry["parameters"].items()}
    alternatives = tuple(read_plain(Alternative, value) for value in entry.get("alternatives", ()))
    members = tuple(read_plain(Member, of(value.get("at", ""), value)) for value in entry.get("members", ()))
    return read_plain(
        Cause,
        {
            **entry,
            "parameters": parameters,
            "alternatives": alternatives,
            "members": members,
            "frames": tuple(entry.get("frames", ())),
        },
    )


def read_data(entry: Mapping[str, Any]) -> Data:
    left_out = tuple(read_plain(LeftOut, value) for value in entry.get("left_out", ()))
    return read_plain(Data, {**entry, "left_out": left_out})


def read_gap(entry: Mapping[str, Any]) -> Gap:
    interval = entry.get("closed_ci95")
    return read_plain(
        Gap,
        {
            **entry,
            "closed_ci95": None if interval is None else tuple(interval),
            "checked": tuple(read_plain(Checked, value) for value in entry.get("checked", ())),
            "steps": tuple(read_plain(Step, value) for value in entry.get("steps", ())),
        },
    )


def read_limit(entry: Mapping[str, Any], sliding: Collection[str] = ()) -> Limit:
    """A limit; `sliding` are the places of prismatic joints."""
    for name, size in entry["parameters"].items():
        if not _is_of(size, ("float", "None")):
            raise TypeError(f"limit.{name}: got {size!r:.80}, needed a number or null")
    return read_plain(
        Limit, {**entry, "parameters": dict(entry["parameters"]), "slides": entry.get("at") in sliding}
    )


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
