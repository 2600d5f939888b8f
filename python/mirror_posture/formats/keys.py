"""A key of a file: its type, its range, its default and its meaning; a section: a group of keys."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

REQUIRED = object()
"""The default of a key that must be given."""
LARGEST = 1.7976931348623157e308
"""The largest finite double."""


@dataclass(frozen=True, kw_only=True)
class Key:
    """The common part of every key. `default` is the value if the key is left out; `REQUIRED`: it must be
    there."""

    name: str
    what: str
    """What it means, one sentence in Markdown."""
    default: Any = REQUIRED
    unit: str = ""
    needs: str = ""
    """Its requirement, if it differs from that of its type."""
    null: bool = False
    """Whether null is allowed (TOML has none)."""

    @property
    def required(self) -> bool:
        """Whether the key must be given."""
        return self.default is REQUIRED

    @property
    def needed(self) -> str:
        """The requirement of the key, for error messages."""
        return (self.needs or self._needed()) + (", or null" if self.null else "")

    def _needed(self) -> str:
        raise NotImplementedError

    def read(self, value: Any) -> Any:
        """The value as readers use it; None if it is invalid."""
        raise NotImplementedError

    def takes(self, value: Any) -> bool:
        """Whether a value is allowed."""
        return (self.null and value is None) or self.read(value) is not None

    def schema(self) -> dict[str, Any]:
        """The values that `read` takes, as JSON Schema."""
        raise NotImplementedError

    def schema_or_null(self) -> dict[str, Any]:
        """The values that `takes` takes, as JSON Schema."""
        return {"anyOf": [self.schema(), {"type": "null"}]} if self.null else self.schema()


@dataclass(frozen=True, kw_only=True)
class Text(Key):
    """A text that is not blank, or one of some."""

    one_of: tuple[str, ...] = ()

    def _needed(self) -> str:
        return f"one of {', '.join(self.one_of)}" if self.one_of else "a name (text)"

    def read(self, value: Any) -> str | None:
        good = isinstance(value, str) and (value in self.one_of if self.one_of else bool(value.strip()))
        return value if good else None

    def schema(self) -> dict[str, Any]:
        return {"enum": list(self.one_of)} if self.one_of else {"type": "string", "pattern": r"\S"}


@dataclass(frozen=True, kw_only=True)
class Flag(Key):
    """True or false."""

    def _needed(self) -> str:
        return "true or false"

    def read(self, value: Any) -> bool | None:
        return value if isinstance(value, bool) else None

    def schema(self) -> dict[str, Any]:
        return {"type": "boolean"}


@dataclass(frozen=True, kw_only=True)
class Whole(Key):
    """A whole number, or one of some."""

    at_least: int | None = None
    at_most: int | None = None
    one_of: tuple[int, ...] = ()

    def _needed(self) -> str:
        if self.one_of:
            return " or ".join(map(str, self.one_of))
        text = "a whole number"
        if self.at_least is not None and self.at_most is not None:
            return f"{text} from {self.at_least} to {self.at_most}"
        return text if self.at_least is None else f"{text}, at least {self.at_least}"

    def read(self, value: Any) -> int | None:
        if (
            isinstance(value, bool)
            or not isinstance(value, int)
            or (self.one_of and value not in self.one_of)
        ):
            return None
        small = self.at_least is not None and value < self.at_least
        return None if small or (self.at_most is not None and value > self.at_most) else value

    def schema(self) -> dict[str, Any]:
        if self.one_of:
            return {"enum": list(self.one_of)}
        bounds = {"minimum": self.at_least, "maximum": self.at_most}
        return {"type": "integer"} | {key: bound for key, bound in bounds.items() if bound is not None}


@dataclass(frozen=True, kw_only=True)
class Number(Key):
    """A finite number within bounds."""

    at_least: float = -math.inf
    above: float = -math.inf
    below: float = math.inf
    at_most: float = math.inf

    def _needed(self) -> str:
        bounds = [
            text
            for text, given in (
                (f"at least {self.at_least:g}", self.at_least > -math.inf),
                (f"above {self.above:g}", self.above > -math.inf),
                (f"below {self.below:g}", self.below < math.inf),
                (f"at most {self.at_most:g}", self.at_most < math.inf),
            )
            if given
        ]
        return " ".join(["a finite number", " and ".join(bounds)]).strip()

    def read(self, value: Any) -> float | None:
        number = finite(value)
        if number is None or number < self.at_least or number > self.at_most:
            return None
        return None if number <= self.above or number >= self.below else number

    def schema(self) -> dict[str, Any]:
        low = {"exclusiveMinimum": self.above} if self.above > self.at_least else {"minimum": self.at_least}
        high = {"exclusiveMaximum": self.below} if self.below < self.at_most else {"maximum": self.at_most}
        bounds = {key: max(-LARGEST, min(LARGEST, bound)) for key, bound in (low | high).items()}
        return {"type": "number", **bounds}


@dataclass(frozen=True, kw_only=True)
class Numbers(Key):
    """A list of a fixed number of finite numbers."""

    count: int

    def _needed(self) -> str:
        return f"a list of {self.count} finite numbers"

    def read(self, value: Any) -> list[float] | None:
        found = [finite(item) for item in value] if isinstance(value, list) else []
        numbers = [item for item in found if item is not None]
        return numbers if len(numbers) == len(found) == self.count else None

    def schema(self) -> dict[str, Any]:
        number = {"type": "number", "minimum": -LARGEST, "maximum": LARGEST}
        return {"type": "array", "items": number, "minItems": self.count, "maxItems": self.count}


@dataclass(frozen=True, kw_only=True)
class Wholes(Key):
    """A list of a fixed number of whole numbers within bounds."""

    count: int
    at_least: int
    at_most: int

    def _needed(self) -> str:
        return f"a list of {self.count} whole numbers from {self.at_least} to {self.at_most}"

    def read(self, value: Any) -> list[int] | None:
        if not isinstance(value, list) or len(value) != self.count:
            return None
        one = Whole(name=self.name, what=self.what, at_least=self.at_least, at_most=self.at_most)
        return value if all(one.read(item) is not None for item in value) else None

    def schema(self) -> dict[str, Any]:
        number = {"type": "integer", "minimum": self.at_least, "maximum": self.at_most}
        return {"type": "array", "items": number, "minItems": self.count, "maxItems": self.count}


@dataclass(frozen=True, kw_only=True)
class Section:
    """A table of a file: `[name]`, or `[[name]]` where there may be several."""

    name: str
    what: str
    keys: tuple[Key, ...]
    sections: tuple[Section, ...] = ()
    repeated: bool = False
    most: int | None = None
    """How many there may be, of a repeated one."""
    rules: Mapping[str, Any] = field(default_factory=dict)
    """What else holds between its keys, as JSON Schema."""
    closed: bool = False
    """Whether a key that is not listed is refused; else it is a warning."""
    given: Sequence[str] = ()
    """Sections within it that must be there."""

    def key(self, name: str) -> Key:
        """The key of this name."""
        return next(key for key in self.keys if key.name == name)

    def schema(self) -> dict[str, Any]:
        """What the section takes, as JSON Schema."""
        properties: dict[str, Any] = {}
        for key in self.keys:
            text = f"{key.what} ({key.unit})" if key.unit else key.what
            properties[key.name] = {"description": text, **key.schema_or_null()}
            if not key.required and key.default is not None:
                properties[key.name]["default"] = key.default
        for section in self.sections:
            one = section.schema()
            properties[section.name] = {"type": "array", "items": one} if section.repeated else one
            if section.most is not None:
                properties[section.name]["maxItems"] = section.most
        required = [key.name for key in self.keys if key.required] + list(self.given)
        result: dict[str, Any] = {"type": "object", "description": self.what, "properties": properties}
        if required:
            result["required"] = required
        if self.closed:
            result["additionalProperties"] = False
        return result | dict(self.rules)


def finite(value: Any) -> float | None:
    """A number of TOML or JSON as a finite double, or None."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
