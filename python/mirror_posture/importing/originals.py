"""What of a session an import replaces, and what it must not: all that no import made is somebody's original."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection
from pathlib import Path

from .._core import MirrorPostureError
from ..input_files import LARGEST_TABLE, read_regular
from ..session.tables import find_table

TABLES = ("frames.csv", "frames.parquet", "detections.csv", "detections.parquet")
MADE = "images/imported.sha256"
"""Hashes and names of the pictures that an import made, as `sha256sum` writes them: all others are somebody's originals."""
OF_OTHER_TIMES = {
    "states": "the log of another recording: joints that the import lacks would be read from it",
    "points": "measured at other frames: its positions would be taken for those of the new frames",
}
"""Tables that no import writes, and that say something else beside new frames."""


def refuse_other_tables(folder: Path) -> None:
    """Refuses a session with a log or with measured points: they are of other frames, and were recorded once."""
    for stem, why in OF_OTHER_TIMES.items():
        table = find_table(folder, stem)
        if table is not None:
            raise MirrorPostureError(
                f"{table}: is there already, {why}; move it out of the folder (back again if it is of this recording)"
            )


def refuse_links(folder: Path, names: Collection[str]) -> None:
    """Refuses a link on the way to a file that is written: it would be written elsewhere, into another's or the old folder."""
    for name in names:
        for above in Path(name).parents[:-1]:
            if (folder / above).is_symlink():
                raise MirrorPostureError(
                    f"{folder / above}: is a link (to {os.readlink(folder / above)}), needed a folder of the session itself, in which "
                    f"{Path(name).name} is written; remove the link, or put the folder in its place"
                )


def picture_name(number: int) -> str:
    return f"images/{number:04d}.png"


def made_by_import(folder: Path) -> list[str]:
    """The pictures of an earlier import, as it made them: one that was changed or replaced since is somebody's."""
    try:
        lines = set(read_regular(folder / MADE, LARGEST_TABLE).decode().splitlines())
    except (OSError, ValueError):
        return []
    return [
        name
        for name in map(picture_name, range(len(lines)))
        if (folder / name).is_file() and made_line(name, (folder / name).read_bytes()) in lines
    ]


def made_line(name: str, data: bytes) -> str:
    # Relative to images/, where `sha256sum --check imported.sha256` is run.
    return f"{hashlib.sha256(data).hexdigest()}  {Path(name).name}"


def refuse_replacing(folder: Path, count: int, earlier: Collection[str], overwrite: bool) -> None:
    """Refuses to replace pictures that were there before, other than those of an earlier import with --overwrite."""
    for name in map(picture_name, range(count)):
        if not os.path.lexists(folder / name) or (overwrite and name in earlier):
            continue
        if name in earlier:
            raise MirrorPostureError(
                f"{folder / name}: is there already, from an earlier import; add --overwrite to replace it"
            )
        raise MirrorPostureError(
            f"{folder / name}: is there already, and is not in {MADE}, the list of pictures that an import made; this import would "
            "replace it: move it out of images/ (or delete it)"
        )
