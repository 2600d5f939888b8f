"""Mirrors from pictures alone: a board that one picture shows twice, directly and in the mirror; no robot needed.

camera = load_camera_info("camera.yaml")
mirror = mirror_from_picture(camera, Board(7, 6, 0.025), "picture.jpg")
mirror.normals, mirror.offsets_m, mirror.covariances_m2
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ._core import MirrorPostureError
from .board import CHESSBOARD, Board
from .camera import Camera
from .detect import BoardOptions, BoardView, DetectionOptions, DetectionSetup, detect_picture
from .mirror import MirrorEstimates, Rig, estimate_mirrors, planar_poses

Picture = str | os.PathLike[str] | npt.NDArray[np.uint8]


def mirror_from_picture(
    camera: Camera,
    board: Board,
    picture: Picture,
    *,
    camera_from_board: npt.ArrayLike | None = None,
    glass_thickness_m: float = 0.0,
) -> MirrorEstimates:
    """The mirror in one picture, a path or a BGR array: the plane `n·x = d` in the camera frame, m, with the covariance of its foot point.

    The picture shows the board and its reflection: the first tells where the board is, both together where the mirror is (maximum likelihood). With a
    known `camera_from_board` (4, 4) the reflection is enough. The result has one row.

    Raises `MirrorPostureError` for a picture that cannot be read or is of another size than the camera's, and where a view is not found or cannot
    be trusted: the message says which and why.
    """
    if board.pattern != CHESSBOARD:
        raise MirrorPostureError(
            f"board pattern = {board.pattern!r}: mirrors from pictures need a chessboard"
        )
    known = camera_from_board is not None
    options = DetectionOptions(board=BoardOptions(views=("mirror",) if known else ("direct", "mirror")))
    shown = picture if isinstance(picture, np.ndarray) else Path(picture)
    found = detect_picture(shown, DetectionSetup(board, (), camera), options=options)
    views = {view.via: view for view in found.boards}
    mirrored = _trusted(views.get("mirror"), found.source)
    pose, covariance = camera_from_board, None
    if pose is None:
        direct = _trusted(views.get("direct"), found.source)
        poses = planar_poses(camera, board, direct[0][None], noise_px=direct[1])
        if not poses.valid[0]:
            raise MirrorPostureError(
                f"{found.source}: no pose of the board explains its direct view ({poses.reasons[0]})"
            )
        pose, covariance = poses.camera_from_pattern[0], poses.covariances[0]
    rig = Rig(camera, board, np.asarray(pose, dtype=np.float64), covariance, glass_thickness_m)
    return estimate_mirrors(rig, mirrored[0][None], noise_px=mirrored[1])


def mirrors_from_pictures(
    camera: Camera,
    board: Board,
    pictures: Sequence[Picture],
    *,
    camera_from_board: npt.ArrayLike | None = None,
    glass_thickness_m: float = 0.0,
) -> tuple[MirrorEstimates | MirrorPostureError, ...]:
    """`mirror_from_picture` of each picture, in the order given; the error that says why in place of a mirror that was not measured."""
    found: list[MirrorEstimates | MirrorPostureError] = []
    for picture in pictures:
        try:
            found.append(
                mirror_from_picture(
                    camera,
                    board,
                    picture,
                    camera_from_board=camera_from_board,
                    glass_thickness_m=glass_thickness_m,
                )
            )
        except MirrorPostureError as error:
            found.append(error)
    return tuple(found)


def _trusted(view: BoardView | None, source: str) -> tuple[npt.NDArray[np.float64], float]:
    """Corners (N, 2) px and the standard deviation of one axis, px, of a view that passed its checks."""
    if view is None or not view.ok or view.corners_px is None or view.std_px is None:
        via = "mirror" if view is None else view.via
        reason = "not found" if view is None else view.reason
        seen = "seen directly" if via == "direct" else "in the mirror"
        raise MirrorPostureError(f"{source}: board {seen}: {reason}")
    return view.corners_px, float(np.sqrt(np.mean(view.std_px**2)))
