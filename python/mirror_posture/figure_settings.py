"""Settings of matplotlib for one function that draws; those of the process stay as they are."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def drawn_with(settings: Any) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """A decorator: the function, with these `rcParams` while it runs."""

    def decorated(draw: Callable[P, R]) -> Callable[P, R]:
        @wraps(draw)
        def with_settings(*args: P.args, **kwargs: P.kwargs) -> R:
            from matplotlib import rc_context

            with rc_context(settings):
                return draw(*args, **kwargs)

        return with_settings

    return decorated


literal = drawn_with({"text.parse_math": False})
"""Texts of a figure as they stand: names of robots may hold dollars, which matplotlib takes for formulas."""
