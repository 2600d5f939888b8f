"""Append-only files that survive a kill: each line is on disk before the next one is started."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..output_files import write_file

FRAMES, DETECTIONS, POINTS = "frames.csv", "detections.csv", "points.csv"


def line(cells: Sequence[Any]) -> str:
    """A row as CSV has it, with all digits of its floats and an end of one byte, which `append` and `cut_last_line` count on."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()


def append(file: Path, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    header = "" if file.exists() and file.stat().st_size else line(columns)
    append_bytes(file, (header + "".join(line(row) for row in rows)).encode())


def append_bytes(file: Path, data: bytes) -> None:
    """One write, then a sync: a kill can cut the last line at most."""
    with open(file, "ab", buffering=0) as stream:
        stream.write(data)
        os.fsync(stream.fileno())


def cut_last_line(file: Path) -> None:
    """Removes everything after the last end of a line."""
    if not file.is_file():
        return
    data = file.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    if len(whole) != len(data):
        write_file(file, whole)


def drop_orphans(folder: Path) -> None:
    """Takes off image points and positions of a frame whose own row was not written any more."""
    frames = {line.partition(b",")[0] for line in (folder / FRAMES).read_bytes().splitlines()[1:]}
    for name in (DETECTIONS, POINTS):
        file = folder / name
        if not file.is_file():
            continue
        lines = file.read_bytes().splitlines(keepends=True)
        kept = lines[:1] + [line for line in lines[1:] if line.partition(b",")[0] in frames]
        if len(kept) != len(lines):
            write_file(file, b"".join(kept))
