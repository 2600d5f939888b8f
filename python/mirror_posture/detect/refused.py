"""Pictures that cannot be used, told once for each reason: all pictures of a session mostly have the same one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from PIL import Image, UnidentifiedImageError

from ..camera import Camera
from ..session.types import Session
from .types import DetectionError, PictureDetections

MOST_FRAMES = 5
"""Frames that are listed with a reason; of more the others are only counted."""


def size_mistake(width: int, height: int, camera: Camera | None, exif_turn: str = "") -> str:
    """What is wrong with a picture of this size, what the size suggests and the fix; empty where it is the camera's."""
    if camera is None or (camera.width_px, camera.height_px) == (width, height):
        return ""
    across, down = width / camera.width_px, height / camera.height_px
    if (height, width) == (camera.width_px, camera.height_px):
        tagged = f" (its EXIF tag says: shown {exif_turn})" if exif_turn else ""
        guess = (
            f"turned by 90°{tagged}; turn the pictures back, or give the camera file of the turned picture"
        )
    elif abs(across - down) < 0.01 * across:
        guess = f"{across:.3g} times as large: resized, or taken at another resolution; give the camera file of this resolution"
    elif across <= 1.0 and down <= 1.0:
        guess = "cropped, or another camera's; give whole pictures, or the camera file of the cropped ones"
    else:
        guess = (
            "another camera's or another resolution's; give the camera file of this camera at this resolution"
        )
    return f"is {width} × {height} px, but the camera file is for {camera.width_px} × {camera.height_px} px; it is {guess}"


def told_refusals(session: Session, pictures: Mapping[int, PictureDetections]) -> list[str]:
    """The pictures (by row of the frames table) that cannot be used: one line for each reason, with the count and the frames."""
    return [_line(session, rows, len(pictures), why) for why, rows in refused_by_reason(pictures).items()]


def refuse_all(session: Session, pictures: Mapping[int, PictureDetections]) -> None:
    """Raises `DetectionError` where no picture can be used, all for the same reason: then there is nothing to detect in, and no
    other picture of the same kind would help."""
    reasons = refused_by_reason(pictures)
    if len(reasons) == 1 and sum(map(len, reasons.values())) == len(pictures):
        why = next(iter(reasons))
        if len(pictures) == 1:
            raise DetectionError(next(iter(pictures.values())).error)
        raise DetectionError(
            f"{session.folder}: none of the {len(pictures)} pictures can be used: {_each(why)}"
        )


def refused_by_reason(pictures: Mapping[int, PictureDetections]) -> dict[str, list[int]]:
    """Rows by why their picture cannot be used, without the picture's own name."""
    reasons: dict[str, list[int]] = {}
    for row, picture in sorted(pictures.items()):
        if picture.error:
            reasons.setdefault(reason_of(picture), []).append(row)
    return reasons


def reason_of(picture: PictureDetections) -> str:
    """Why a picture cannot be used, without its name."""
    return picture.error.removeprefix(f"{picture.source}: ")


def not_detected(session: Session) -> str:
    """One line on the pictures of another size than the camera file's whose frames have no image points, though the session's
    detections were made: empty where there are none. Only the sizes are read.
    """
    if not session.detected or session.camera is None:
        return ""
    rows = [row for row, file in enumerate(session.image_files) if file is not None and file.is_file()]
    views = (session.mirror_view, session.direct_view)
    blank = [
        row for row in rows if not any(v.board_seen[row].any() or v.marker_seen[row].any() for v in views)
    ]
    reasons: dict[str, list[int]] = {}
    for row in blank:
        file = session.image_files[row]
        size = None if file is None else _size(file)
        why = "" if size is None else size_mistake(*size, session.camera)
        if why:
            reasons.setdefault(why, []).append(row)
    if not reasons:
        return ""
    why, most = max(reasons.items(), key=lambda item: len(item[1]))
    return f"{_line(session, most, len(rows), why)}; then detect again with --overwrite"


def _size(file: Path) -> tuple[int, int] | None:
    """Width and height of a picture; None where it is none."""
    try:
        with Image.open(file) as picture:
            width, height = picture.size
            return width, height
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, ValueError, SyntaxError):
        return None


def _line(session: Session, rows: Sequence[int], of: int, why: str) -> str:
    frames = [str(session.frames.frame[row]) for row in rows]
    listed = ", ".join(frames[:MOST_FRAMES]) + (" …" if len(frames) > MOST_FRAMES else "")
    named = f"frame {listed}" if len(frames) == 1 else f"frames {listed}"
    return f"{len(rows)} of {of} pictures cannot be used ({named}): {_each(why)}"


def _each(why: str) -> str:
    return f"each {why}" if why.startswith("is ") else why
