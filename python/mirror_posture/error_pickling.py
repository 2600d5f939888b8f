"""Pickling of errors, with which a worker process returns its errors."""

from __future__ import annotations

from typing import Any


class PickledWhole:
    """An error that is restored from pickling unchanged, whatever its `__init__` takes.

    Python would call the class with the message alone. Here the message and the fields are restored without
    `__init__`. The fields come after the error itself, so that one of them may contain the error again (all
    problems of a session).
    """

    args: tuple[Any, ...]

    def __reduce__(self) -> tuple[Any, ...]:
        return _with_message, (type(self), self.args), dict(self.__dict__)


def _with_message(kind: type[BaseException], args: tuple[Any, ...]) -> BaseException:
    return kind.__new__(kind, *args)
