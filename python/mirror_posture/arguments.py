"""Checks of the public functions' arguments: a wrong type is a `MirrorPostureError` that says what was
required."""

from __future__ import annotations

import collections.abc
import functools
import inspect
import os
import re
import typing
from collections.abc import Callable
from types import NoneType, UnionType
from typing import Any, ParamSpec, TypeVar

import numpy as np

from ._core import MirrorPostureError

P = ParamSpec("P")
R = TypeVar("R")

LONGEST_SHOWN = 60


def checked_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """Checks the arguments of a public function or method against its annotations, before it does anything.

    The function itself checks values (ranges, shapes, names). What the compiled core refuses to convert is
    reported as a `MirrorPostureError` as well.
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        hints = _hints(function)
        for name, value in signature.bind(*args, **kwargs).arguments.items():
            parameter = signature.parameters[name]
            if parameter.kind in (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD):
                continue
            if name in hints and not _fits(value, hints[name]):
                valid = _literals(hints[name])
                needed = f"one of {', '.join(map(str, valid))}" if valid else parameter.annotation
                raise MirrorPostureError(f"{function.__name__}: {name}: got {_shown(value)}, needed {needed}")
        try:
            return function(*args, **kwargs)
        except (TypeError, ValueError, OverflowError) as error:
            place = _refused_by_the_core(error)
            if place is None:
                raise
            raise MirrorPostureError(
                f"{function.__name__}: {place}: {' '.join(str(error).split())}"
            ) from error

    return checked


def _refused_by_the_core(error: Exception) -> str | None:
    """The argument that the compiled core could not convert, from pyo3's note or message; None for any other error."""
    notes = " ".join(getattr(error, "__notes__", ()))
    found = re.search(r"while processing '(\w+)'", notes) or re.match(r"argument '(\w+)'", str(error))
    return found.group(1) if found else None


class _ArrayLike:
    """The hint of arguments that NumPy makes an array of numbers of."""


@functools.cache
def _hints(function: Callable[..., Any]) -> dict[str, Any]:
    """Each parameter's annotation that can be evaluated; those of types that are imported for checkers only cannot."""
    found: dict[str, Any] = {}
    for name, text in function.__annotations__.items():
        if isinstance(text, str):
            text = re.sub(r"npt\.(ArrayLike|NDArray\[[^\]]*\])", "_ArrayLike", text)
            try:
                text = eval(text, {**function.__globals__, "_ArrayLike": _ArrayLike})
            except (NameError, TypeError, AttributeError):
                continue
        found[name] = text
    return found


def _literals(hint: Any) -> tuple[object, ...]:
    """The values that an annotation lists (`Literal`, also beside None), None included; nothing for any other."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Literal:
        return parts
    if origin not in (typing.Union, UnionType):
        return ()
    each = [(None,) if part is NoneType else _literals(part) for part in parts]
    return tuple(value for values in each for value in values) if all(each) else ()


def _fits(value: object, hint: Any) -> bool:
    """Whether a value has an annotation's type, or is one of its literals; True where the annotation is not specific enough."""
    origin, parts = typing.get_origin(hint), typing.get_args(hint)
    if hint is None or hint is NoneType:
        return value is None
    if hint is _ArrayLike or origin is np.ndarray:
        return _is_numbers(value)
    if origin in (typing.Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is typing.Literal:
        return any(isinstance(value, type(part)) and value == part for part in parts)
    if origin is tuple:
        return isinstance(value, (tuple, list, np.ndarray))
    if origin is collections.abc.Mapping or origin is dict:
        return isinstance(value, collections.abc.Mapping)
    if origin in (collections.abc.Sequence, list, collections.abc.Iterable):
        several = isinstance(value, collections.abc.Iterable) and not isinstance(value, (str, bytes))
        if several and parts and isinstance(value, (list, tuple)):
            return all(_fits(item, parts[0]) for item in value)
        return several
    if origin is collections.abc.Callable:
        return callable(value)
    if origin is os.PathLike:
        return isinstance(value, os.PathLike)
    if hint is float:
        return isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    if hint is int:
        return isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if hint is bool:
        return isinstance(value, (bool, np.bool_))
    if isinstance(hint, type):
        try:
            return isinstance(value, hint)
        except TypeError:
            return True
    return True


def _is_numbers(value: object) -> bool:
    if value is None or isinstance(value, (str, bytes)):
        return False
    try:
        return np.asarray(value).dtype.kind in "biuf"
    except (TypeError, ValueError):
        return False


def _shown(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of {value.dtype} with shape {value.shape}"
    text = repr(value)
    kind = type(value).__name__
    return f"a {kind}: {text}" if len(text) <= LONGEST_SHOWN else f"a {kind}"
