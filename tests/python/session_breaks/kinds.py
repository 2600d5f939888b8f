"""What ways to break a session are made of: their kinds, and tables and settings to read, change and write."""

from __future__ import annotations

import csv
import io
import random
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Rows = list[list[str]]
Must = Literal["refused", "same", "any"]
Break = Callable[[Path, random.Random], str]
TEXT = ("target", "marker", "via", "image")
KEYS = (*TEXT, "frame", "posture", "index", "time_s")


class NotHere(Exception):
    """The session has nothing that could be broken so."""


@dataclass(frozen=True)
class Kind:
    """A way to break: `make` changes the folder and says what it did."""

    name: str
    must: Must
    make: Break


KINDS: list[Kind] = []


def kind(must: Must) -> Callable[[Break], Break]:
    def note(make: Break) -> Break:
        KINDS.append(Kind(make.__name__.replace("_", " "), must, make))
        return make

    return note


def read(file: Path) -> Rows:
    if not file.exists():
        raise NotHere
    with file.open(newline="", encoding="utf-8") as stream:
        return list(csv.reader(stream))


def write(file: Path, rows: Rows) -> None:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    file.write_text(text.getvalue(), encoding="utf-8")


def tables(folder: Path) -> list[Path]:
    return [
        folder / name for name in ("frames.csv", "detections.csv", "points.csv") if (folder / name).exists()
    ]


def observed(folder: Path) -> Path:
    return folder / ("detections.csv" if (folder / "detections.csv").exists() else "points.csv")


def scaled(rows: Rows, column: int, factor: float, shift: float = 0.0) -> None:
    for row in rows[1:]:
        row[column] = repr(float(row[column]) * factor + shift)


def edit(file: Path, pattern: str, by: str | Callable[[re.Match[str]], str], count: int = 0) -> None:
    """Replaces in a file, which must change."""
    if not file.exists():
        raise NotHere
    text = file.read_text(encoding="utf-8")
    new = re.sub(pattern, by, text, count=count)
    if new == text:
        raise NotHere
    file.write_text(new, encoding="utf-8")


def joints_of(rows: Rows) -> list[int]:
    return [i for i, name in enumerate(rows[0]) if name not in KEYS and ":" not in name]
