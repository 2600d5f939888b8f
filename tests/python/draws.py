"""How many draws of one kind of case are usual: those that differ by a seed alone are for a run of all."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TypeVar

T = TypeVar("T")


def draws(usual: int, of: Sequence[T]) -> Sequence[T]:
    """The first `usual` of them; all where `MIRROR_TEST_ALL` is set, as for the tests in Rust."""
    return of if "MIRROR_TEST_ALL" in os.environ else of[:usual]
