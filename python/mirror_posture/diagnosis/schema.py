"""diagnosis.json as JSON Schema, generated from the dataclasses that its reader fills."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from . import parts, result
from .parsing import NOT_OF_THE_FILE
from .result import FORMAT, VERDICTS, VERSIONS, Diagnosis

PANELS = ("signatures", "tracks", "fields")
"""Arrays of points for drawing, which are read column by column."""
KNOWN = {**vars(parts), **vars(result)}
"""Names in which the annotations of the dataclasses are read."""


def document_schema() -> dict[str, Any]:
    """The whole file as JSON Schema; keys that it does not name are allowed, because a newer core may write
    more."""
    schema = _of_dataclass(Diagnosis)
    properties = {key: value for key, value in schema["properties"].items() if key not in NOT_OF_THE_FILE}
    properties["verdict"] = {"enum": list(VERDICTS)}
    for panel in PANELS:
        item = {
            "type": "object",
            "properties": {"points": {"type": "array"}},
            "required": ["at", "unit", "points"],
        }
        properties[panel] = {"type": "array", "items": item}
    head = {"format": {"const": FORMAT}, "version": {"enum": list(VERSIONS)}}
    return {
        "type": "object",
        "properties": head | properties,
        "required": ["format", "version", "verdict", "causes", "where", "gap"],
    }


def described() -> Mapping[str, type]:
    """The dataclasses that make up the document, by their name in it."""
    return {
        "": Diagnosis,
        **{
            name: kind
            for name, kind in KNOWN.items()
            if is_dataclass(kind) and isinstance(kind, type) and kind is not Diagnosis
        },
    }


def _of_dataclass(kind: type) -> dict[str, Any]:
    hints = get_type_hints(kind, KNOWN)
    properties = {
        f.name: _of_type(hints[f.name]) for f in fields(kind) if f.name not in (*PANELS, *NOT_OF_THE_FILE)
    }
    needed = [f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING]
    result_schema: dict[str, Any] = {"type": "object", "properties": properties}
    return result_schema | ({"required": needed} if needed else {})


def _of_type(hint: Any) -> dict[str, Any]:
    """A type of a dataclass's field as JSON Schema."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin in (UnionType, Union):
        kinds = [_of_type(one) for one in inside if one is not NoneType]
        return {"anyOf": [*kinds, {"type": "null"}]} if NoneType in inside else {"anyOf": kinds}
    if origin is tuple:
        if inside[-1] is Ellipsis:
            return {"type": "array", "items": _of_type(inside[0])}
        return {
            "type": "array",
            "prefixItems": [_of_type(one) for one in inside],
            "minItems": len(inside),
            "maxItems": len(inside),
        }
    if origin is not None and issubclass(origin, Mapping):
        values = inside[1] if len(inside) == 2 else Any
        return {"type": "object", **({} if values is Any else {"additionalProperties": _of_type(values)})}
    if is_dataclass(hint) and isinstance(hint, type):
        return _of_dataclass(hint)
    plain = {str: "string", float: "number", int: "integer", bool: "boolean"}
    return {"type": plain[hint]} if hint in plain else {}
