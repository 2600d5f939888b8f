"""Picture files: how one is written, and how large one may be."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import cv2
import numpy.typing as npt

from ._core import MirrorPostureError
from .output_files import write_file

MOST_PIXELS = 150_000_000
"""Of a picture at most. Pillow warns of smaller ones already; its limit and the filters of warnings are the process's, and stay as they are."""


def encoded_picture(picture: npt.NDArray[Any], name: str | os.PathLike[str]) -> bytes:
    """A picture, grey or BGR, in the format that the ending of a file's name says; PNG without one.

    Raises:
        MirrorPostureError: the format is not known, or cannot hold the picture.
    """
    suffix = Path(name).suffix or ".png"
    try:
        done, data = cv2.imencode(suffix, picture)
    except cv2.error:
        done = False
    if not done:
        raise MirrorPostureError(
            f"{os.fspath(name)}: a picture of shape {picture.shape} cannot be encoded as {suffix!r}; "
            "needed grey or BGR, as .png or .jpg"
        )
    return data.tobytes()


def write_picture(file: str | os.PathLike[str], picture: npt.NDArray[Any]) -> Path:
    """Writes a picture in one step, as `encoded_picture` and `write_file`. Returns its path."""
    return write_file(file, encoded_picture(picture, file))
