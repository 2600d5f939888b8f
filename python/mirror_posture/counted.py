"""Counts in words: one of a thing, or several."""

from __future__ import annotations


def counted(count: int, one: str, many: str = "") -> str:
    """`1 picture`, `4 pictures`; `many` where it is not `one` with an s (`1 mesh was`, `4 meshes were`)."""
    return f"{count} {one if count == 1 else many or f'{one}s'}"
