"""Captures pictures of the board for the calibration of a camera, automatically, from a live camera or a
film."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from .._core import MirrorPostureError
from ..arrays import Floats
from ..board import Board
from ..camera_calibration import GOOD_VIEWS, LEAST_VIEWS, calibrate_camera
from ..detect import BoardOptions, DetectionOptions, DetectionSetup, detect_picture
from ..picture_files import write_picture
from .sources import Shot, Source
from .stillness import Stillness

STILL_S = 0.6
"""For how long all must have stood still: a board in a hand trembles less than it seems."""
LOOK_EVERY_S = 0.5
APART = 0.02
"""Of the picture's width, RMS over the corners: nearer to an existing picture, another one adds little
information."""


def take_board_pictures(
    source: Source, board: Board, folder: Path, most: int, say: Callable[[str], object]
) -> int:
    """Takes pictures of the board into a folder until a calibration finds nothing weak in them; returns how
    many.

    A picture is taken when everything is still, the board is found in it, and its place differs from those
    in all pictures taken. After each picture the weak points are printed. It ends with `GOOD_VIEWS`
    pictures or more if nothing is weak, with `most`, or with the source.

    Raises:
        MirrorPostureError: a folder that is not empty, a source of single pictures, a source that ends unexpectedly.
    """
    if source.stills:
        raise MirrorPostureError(
            "--source: pictures of a folder are calibrated as they are; leave --source away"
        )
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise MirrorPostureError(
            f"{folder}: is there already; needed a new folder for the pictures of --source"
        )
    folder.mkdir(parents=True, exist_ok=True)
    setup, options = DetectionSetup(board, (), None), DetectionOptions(board=BoardOptions(views=("direct",)))
    still, taken, looked_s, told = Stillness(), list[Floats](), -np.inf, ""
    while len(taken) < most and (shot := source.read()) is not None:
        still_s = still.see(shot.picture, shot.time_s)
        if still_s < STILL_S or not still.moved or shot.time_s - looked_s < LOOK_EVERY_S:
            continue
        looked_s = shot.time_s
        corners, why = _corners(shot, setup, options, taken)
        if corners is None:
            if why != told:
                say(why)
            told = why
            continue
        write_picture(folder / f"{len(taken):02d}.png", shot.picture)
        taken.append(corners)
        still.take(shot.picture)
        height, width = shot.picture.shape[:2]
        weak = _weak(board, taken, (width, height))
        told = f"picture {len(taken)}: {'; '.join(weak) or 'nothing is weak any more'}"
        say(told)
        if len(taken) >= GOOD_VIEWS and not weak:
            break
    return len(taken)


def _corners(
    shot: Shot, setup: DetectionSetup, options: DetectionOptions, taken: list[Floats]
) -> tuple[Floats | None, str]:
    """The board's corners (N, 2) in a picture that is useful, NaN where one is not seen; otherwise None,
    and why not."""
    view = detect_picture(shot.picture, setup, options=options).boards[0]
    if not view.ok or view.corners_px is None:
        return None, f"still, but not taken: {view.reason}"
    corners = np.array(view.corners_px, dtype=np.float64)
    if view.visible is not None:
        corners[~np.asarray(view.visible, dtype=bool)] = np.nan
    for before in taken:
        away = np.linalg.norm(corners - before, axis=1)
        if np.isfinite(away).any() and np.sqrt(np.nanmean(away**2)) < APART * shot.picture.shape[1]:
            return None, "still, but not taken: the board was there before; move it elsewhere, or tilt it"
    return corners, ""


def _weak(board: Board, taken: list[Floats], size_px: tuple[int, int]) -> list[str]:
    """What a calibration of these pictures would leave weak, in words."""
    if len(taken) < LEAST_VIEWS:
        return [f"{GOOD_VIEWS - len(taken)} more at least, tilted by 30° to 45°, in all parts of the picture"]
    try:
        return list(calibrate_camera(board, taken, size_px).weak)
    except MirrorPostureError as error:
        return [str(error)]
