"""Keys with several values: a list of texts, and an object with arbitrary names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .keys import Key


@dataclass(frozen=True, kw_only=True)
class Texts(Key):
    """A list of texts, which may be empty."""

    def _needed(self) -> str:
        return "a list of texts"

    def read(self, value: Any) -> list[str] | None:
        good = isinstance(value, list) and all(isinstance(item, str) for item in value)
        return value if good else None

    def schema(self) -> dict[str, Any]:
        return {"type": "array", "items": {"type": "string"}}


@dataclass(frozen=True, kw_only=True)
class Named(Key):
    """An object of values of one kind, by names that the format does not fix (joints, markers)."""

    each: Key

    def _needed(self) -> str:
        return f"an object, for each name {self.each.needed}"

    def read(self, value: Any) -> dict[str, Any] | None:
        good = isinstance(value, dict) and all(self.each.takes(item) for item in value.values())
        return value if good else None

    def schema(self) -> dict[str, Any]:
        return {"type": "object", "additionalProperties": self.each.schema_or_null()}
