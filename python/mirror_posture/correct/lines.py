"""Append-only files that survive a kill: each line is on disk before the next one is started."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..output_files import sync_folder

FRAMES, DETECTIONS, POINTS = "frames.csv", "detections.csv", "points.csv"


def line(cells: Sequence[Any]) -> str:
    # repr keeps all digits of a float; names with a comma are quoted as CSV has it.
    texts = [repr(cell) if isinstance(cell, float) else str(cell) for cell in cells]
    quoted = [
        '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\n') else text for text in texts
    ]
    return ",".join(quoted) + "\n"


def append(file: Path, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    header = "" if file.exists() and file.stat().st_size else line(columns)
    append_bytes(file, (header + "".join(line(row) for row in rows)).encode())


def append_bytes(file: Path, data: bytes) -> None:
    """One write, then a sync: a kill can cut the last line at most."""
    with open(file, "ab", buffering=0) as stream:
        stream.write(data)
        os.fsync(stream.fileno())


def write_whole(file: Path, data: bytes) -> None:
    """Under its name only once it is whole and on the disk."""
    beside = file.with_name(f".{file.name}.part")
    with open(beside, "wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())
    os.replace(beside, file)
    sync_folder(file.parent)


def cut_last_line(file: Path) -> None:
    """Removes everything after the last end of a line."""
    if not file.is_file():
        return
    data = file.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    if len(whole) != len(data):
        write_whole(file, whole)


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
            write_whole(file, b"".join(kept))
