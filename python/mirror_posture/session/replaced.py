"""What a session that is written replaces in its folder, and what stays: others' files are not the format's."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from ..input_files import path_inside
from ..output_files import keep_files
from .errors import SessionError
from .metadata import FILE
from .tables import SUFFIXES, UNFINISHED
from .types import Session

TABLES = tuple(stem + suffix for stem in ("frames", "detections", "points", "states") for suffix in SUFFIXES)
OWN_FILES = (FILE, "robot.urdf", "camera.yaml", UNFINISHED, *TABLES)
MESHES = "meshes"
"""The folder of a model's shapes, beside the model."""
OF_ANOTHER = ("images", "images/*", MESHES, f"{MESHES}/*")
"""Patterns of what else goes where another session lay: its pictures and shapes."""


def keep_others(session: Session, folder: Path, target: Path) -> None:
    """Links what stays of a folder into the one that takes its place: notes, plans, diagnoses, and in the session's own
    folder its pictures and shapes."""
    if folder.is_dir():
        own = folder.resolve() == session.folder.resolve()
        keep_files(folder, target, OWN_FILES if own else (*OWN_FILES, *OF_ANOTHER))


def copy_meshes(session: Session, target: Path) -> None:
    """Copies the shapes of a session's model, unless they are there; links that lead out of their folder are left out."""
    meshes = session.robot_file.parent / MESHES
    if not meshes.is_dir() or (target / MESHES).exists():
        return
    for file in sorted(meshes.rglob("*")):
        name = file.relative_to(meshes)
        if file.is_file() and path_inside(meshes, name.as_posix()) is not None:
            (target / MESHES / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, target / MESHES / name)


def copy_pictures(session: Session, target: Path) -> None:
    """Copies a session's pictures; those that lie in the folder already stay as they are.

    Raises `SessionError`, before anything is copied, for a path that leaves the folder.
    """
    names = session.frames.image or ()
    for row, name in enumerate(names):
        if name is not None and path_inside(target, name) is None:
            raise SessionError(
                "frames.csv",
                f"got {name!r}, needed a path inside the session's folder, with /; rename it in `frames.image`",
                row=row + 1,
                column="image",
            )
    for name, picture in zip(names, session.image_files, strict=False):
        place = None if name is None else target / name
        if place is None or picture is None or picture == place or not picture.is_file():
            continue
        if os.path.lexists(place):
            if place.exists() and place.samefile(picture):
                continue
            # A link to another's picture, which must not be written into.
            place.unlink()
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(picture, place)
