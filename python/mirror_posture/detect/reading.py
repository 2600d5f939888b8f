"""Reads pictures, and says in one line what is wrong with one that cannot be read.

The picture libraries behind OpenCV write to the process's standard error by themselves, for broken files that they return as if
nothing were wrong too. What they say is caught, and makes the picture an error.
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from .types import DetectionError

Picture = npt.NDArray[np.uint8]

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")
# How the decoders' own messages begin.
_DECODER_MESSAGES = (
    "Corrupt JPEG",
    "Premature end of JPEG",
    "Invalid JPEG",
    "Unsupported JPEG",
    "Bogus",
    "libpng",
    "TIFF",
)
MIN_SIDE_PX = 16
MAX_PIXELS = 200_000_000

_stderr_lock = threading.Lock()


def read_picture(path: Path | str) -> Picture:
    """A picture as BGR `(H, W, 3)` uint8.

    Raises `DetectionError` naming the file for one that is missing, empty, broken (also half broken) or no picture.
    """
    file = Path(path)
    try:
        content = file.read_bytes()
    except FileNotFoundError:
        raise DetectionError(f"{file}: the picture is missing; put it there or correct its path") from None
    except OSError as error:
        raise DetectionError(f"{file}: the picture cannot be read: {error.strerror or error}") from None
    if not content:
        raise DetectionError(f"{file}: the picture is empty (0 bytes); take or copy it again")
    picture, message = _decode(content)
    if picture is None:
        kind = (
            "broken"
            if file.suffix.lower() in PICTURE_SUFFIXES
            else "no picture (known: PNG, JPEG, BMP, TIFF, WebP)"
        )
        detail = f" ({message})" if message else ""
        raise DetectionError(f"{file}: the picture is {kind}{detail}; take or copy it again")
    if message:
        raise DetectionError(f"{file}: the picture is broken in part ({message}); take or copy it again")
    return as_picture(picture, str(file))


def as_picture(values: npt.ArrayLike, name: str = "picture") -> Picture:
    """Checks an array and returns it as BGR uint8: accepts grey or BGR(A), 8 or 16 bits, or floats in 0..1."""
    array = np.asarray(values)
    if array.ndim == 3 and array.shape[2] == 1:
        array = array[..., 0]
    if array.ndim not in (2, 3) or (array.ndim == 3 and array.shape[2] not in (3, 4)):
        raise DetectionError(f"{name}: has shape {array.shape}; needed (H, W) grey or (H, W, 3) BGR")
    height, width = array.shape[:2]
    if height < MIN_SIDE_PX or width < MIN_SIDE_PX or height * width > MAX_PIXELS:
        raise DetectionError(
            f"{name}: is {width} × {height} px; needed at least {MIN_SIDE_PX} px a side and at most {MAX_PIXELS // 10**6} million pixels"
        )
    if array.dtype == np.uint16:
        array = (array >> 8).astype(np.uint8)
    elif array.dtype == np.bool_:
        array = array.astype(np.uint8) * np.uint8(255)
    elif np.issubdtype(array.dtype, np.floating):
        if not np.isfinite(array).all():
            raise DetectionError(f"{name}: holds a number that is not finite")
        if array.min() < 0.0 or array.max() > 1.0:
            raise DetectionError(
                f"{name}: floating-point pictures need values in 0..1, got {array.min():.3g} to {array.max():.3g}"
            )
        array = np.rint(array * 255.0).astype(np.uint8)
    elif array.dtype != np.uint8:
        raise DetectionError(f"{name}: has type {array.dtype}; needed uint8, uint16, or floats in 0..1")
    array = np.ascontiguousarray(array)
    if array.ndim == 2:
        return np.repeat(array[..., None], 3, axis=2)
    return np.ascontiguousarray(array[..., :3])


def list_pictures(folder: Path | str) -> tuple[Path, ...]:
    """The pictures of a folder, sorted by name. Raises `DetectionError` for a folder that is missing or has none."""
    place = Path(folder)
    if not place.is_dir():
        raise DetectionError(f"{place}: is no folder; give the folder that holds the pictures")
    found = tuple(
        sorted(file for file in place.iterdir() if file.suffix.lower() in PICTURE_SUFFIXES and file.is_file())
    )
    if not found:
        raise DetectionError(f"{place}: holds no pictures (known: {', '.join(PICTURE_SUFFIXES)})")
    return found


def _decode(content: bytes) -> tuple[npt.NDArray | None, str]:
    """The decoded picture or None, and what the decoder had to say."""
    with _caught_decoder_messages() as messages:
        try:
            picture = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
        except cv2.error as error:
            picture = None
            messages.append(str(error.err) if hasattr(error, "err") else "the decoder refused it")
    return picture, "; ".join(dict.fromkeys(messages))


@contextmanager
def _caught_decoder_messages() -> Iterator[list[str]]:
    """Collects what native decoders write to standard error; lines of anybody else are passed on."""
    messages: list[str] = []
    with _stderr_lock:
        level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        try:
            saved = os.dup(2)
        except OSError:
            # No standard error at all: nothing to keep quiet.
            try:
                yield messages
            finally:
                cv2.utils.logging.setLogLevel(level)
            return
        caught = tempfile.TemporaryFile()
        try:
            sys.stderr.flush()
            os.dup2(caught.fileno(), 2)
            yield messages
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            cv2.utils.logging.setLogLevel(level)
            caught.seek(0)
            for line in caught.read().decode("utf-8", "replace").splitlines():
                if line.startswith(_DECODER_MESSAGES):
                    messages.append(line.strip())
                elif line.strip():
                    os.write(2, (line + "\n").encode())
            caught.close()
