"""Records with arrays: short repr, compared by identity, filled from the core's results."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

import numpy as np

Record = TypeVar("Record")
LONGEST = 60
"""Characters of one field; longer ones are shown by their kind and size."""


class ShortRepr:
    """A mix-in of dataclasses whose fields are arrays, or long: `dataclass(eq=False, repr=False)`.

    Arrays are shown by type and shape: a session's own would fill pages. Two records are equal only where they are the
    same one: of arrays `==` gives arrays.
    """

    def __repr__(self) -> str:
        shown = (
            f"{field.name}={_short(getattr(self, field.name))}"
            for field in dataclasses.fields(self)  # type: ignore[arg-type]
            if field.repr
        )
        return f"{type(self).__name__}({', '.join(shown)})"


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray) and value.size > 1:
        return f"<{value.dtype} {' × '.join(map(str, value.shape))}>"
    text = repr(value)
    if len(text) <= LONGEST:
        return text
    kind = type(value).__name__
    try:
        return f"<{kind} of {len(value)}>"
    except TypeError:
        return f"<{kind}>"


def from_core(kind: type[Record], core: Any, **others: Any) -> Record:
    """A dataclass filled from the core's results: fields of the same names, and the others as given."""
    names = (field.name for field in dataclasses.fields(kind))  # type: ignore[arg-type]
    return kind(**{name: others[name] if name in others else getattr(core, name) for name in names})
