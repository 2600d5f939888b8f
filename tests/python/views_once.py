"""Views that the model proposes for a target, worked out once in a process: many corrections of one target ask for the same."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirror_posture.correct import propose_views
from mirror_posture.correct.target import Target
from mirror_posture.viewpoint import View

_KNOWN: dict[Any, list[View]] = {}


def _all_of(value: object) -> Any:
    """What can be compared and hashed, and is equal for equal values only."""
    if is_dataclass(value):
        return type(value), *(_all_of(getattr(value, field.name)) for field in fields(value))
    if isinstance(value, np.ndarray):
        return value.shape, str(value.dtype), value.tobytes()
    if isinstance(value, Mapping):
        return tuple((_all_of(key), _all_of(value[key])) for key in sorted(value))
    if isinstance(value, Sequence) and not isinstance(value, str):
        return tuple(map(_all_of, value))
    assert value is None or isinstance(value, (str, int, float, Path)), type(value)
    return value


def _once(target: Target, *arguments: object, **named: object) -> list[View]:
    nominal = target.nominal
    model = (nominal.robot_file.read_text(), nominal.metadata, nominal.camera)
    key = _all_of((*model, target.posture, target.markers, target.held, arguments, named))
    if key not in _KNOWN:
        _KNOWN[key] = propose_views(target, *arguments, **named)  # type: ignore[arg-type]
    return list(_KNOWN[key])


@contextmanager
def views_once() -> Iterator[None]:
    """In here the loop of a correction is given the proposals that are known; `propose_views` itself stays as it is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mirror_posture.correct.viewpoints.propose_views", _once)
        yield
