"""Loads a session for a command that needs image points; runs detection first if it has only pictures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from .output import Output

if TYPE_CHECKING:
    from ..session import Session


def load_detected(output: Output, folder: Path, *, points_suffice: bool = False) -> Session:
    """The session of a folder with its image points; its warnings and those of the pictures are printed.

    `points_suffice`: measured points (`points.csv`) are sufficient; pictures beside them are not processed.
    """
    from ..detect.refused import not_detected, told_refusals
    from ..session import load_session

    loaded = load_session(folder)
    for warning in loaded.warnings:
        output.warn(warning)
    enough = loaded.detected or (points_suffice and loaded.points is not None)
    if enough or not any(loaded.image_files):
        if loaded.points is None and (line := not_detected(loaded)):
            output.warn(line)
        return loaded
    from ..detect import detect_session

    output.say("no detections yet: looking for the board and the balls in the pictures first")
    found = detect_session(loaded, progress=lambda chunks: output.chunks(chunks, "detecting"))
    for line in told_refusals(loaded, found.pictures):
        output.warn(line)
    return found.session
