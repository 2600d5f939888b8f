"""Detection in a session's pictures: from a session without image points to one with them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..arguments import checked_arguments
from ..session.load import as_session
from ..session.types import Session, Views
from ..view_check import check_views
from .pictures import DetectionOptions, PicturePrediction, detect_pictures
from .refused import refuse_all
from .types import BoardPrediction, DetectionError, DetectionSetup, PictureDetections

CHUNK = 16
"""Pictures handed to the detector at once: enough to keep all cores busy, few enough to stop soon."""


@checked_arguments
def setup_from_session(session: Session) -> DetectionSetup:
    """The board, the markers and the camera of a session. Raises `DetectionError` for a marker without a colour."""
    return DetectionSetup(session.board, session.markers, session.camera)


@checked_arguments
def predictions_from_session(session: Session) -> tuple[PicturePrediction | None, ...]:
    """The board's and the markers' nominal places before the camera in each frame, from the robot model at the commanded posture.

    The board's settles the labels of one that looks the same turned by 180°, the markers' are hints. None for each frame where the session has no board or camera.
    """
    if session.board is None or session.camera_link is None:
        return (None,) * len(session.frames)
    poses = session.robot.link_poses(session.positions, [session.camera_link, session.board.link])
    camera_from_board = np.linalg.solve(poses[:, 0], poses[:, 1])
    markers = {
        marker.name: session.robot.points(session.positions, session.camera_link, marker.link)
        for marker in session.markers
        if marker.mount_known
    }
    return tuple(
        PicturePrediction(
            BoardPrediction(camera_from_board=pose),
            marker_in_camera_m={name: points[row] for name, points in markers.items()},
        )
        for row, pose in enumerate(camera_from_board)
    )


@dataclass(frozen=True)
class DetectedSession:
    """A session with the image points from its pictures, and their details."""

    session: Session
    pictures: dict[int, PictureDetections]
    """By row of the frames table; a row without a picture has none."""


@checked_arguments
def detect_session(
    session: Session | str | os.PathLike[str],
    options: DetectionOptions | None = None,
    *,
    progress: Callable[[Iterable[list[int]]], Iterable[list[int]]] | None = None,
    done: dict[int, PictureDetections] | None = None,
    check: bool = True,
) -> DetectedSession:
    """Detects the board and the balls in every picture of a session (or a folder).

    A picture that cannot be used, and a view that is not reliable, is masked with its reason. `progress`
    wraps the chunks of rows as they are processed; `done` is filled as pictures are finished, so that a
    stop loses none of them.

    Raises `DetectionError` for a session without pictures, or with a marker that has no colour, where all pictures are
    refused for the same reason (their size, as a rule: one line says it with the fix), and, unless
    `check` is False, for pictures that are mirrored, rotated, of another board or of another camera
    (`mirror_posture.view_check`).
    """
    session = as_session(session)
    rows = [row for row, file in enumerate(session.image_files) if file is not None]
    if not rows:
        raise DetectionError(f"{session.folder}: has no pictures; add a column `image` to the frames table")
    setup = setup_from_session(session)
    predictions = predictions_from_session(session)
    pictures = {} if done is None else done
    chunks: Iterable[list[int]] = [rows[start : start + CHUNK] for start in range(0, len(rows), CHUNK)]
    for chunk in progress(chunks) if progress else chunks:
        files = [file for row in chunk if (file := session.image_files[row]) is not None]
        found = detect_pictures(files, setup, [predictions[row] for row in chunk], options)
        pictures.update(zip(chunk, found, strict=True))
    refuse_all(session, pictures)
    detected = with_detections(session, pictures)
    checked = check_views(detected) if check else None
    if checked is not None and checked.mistake:
        raise DetectionError(f"{session.folder}: {checked.mistake}")
    return DetectedSession(detected, pictures)


@checked_arguments
def with_detections(session: Session, pictures: dict[int, PictureDetections]) -> Session:
    """The session with the image points of these pictures (by row of the frames table) instead of its own."""
    corners = 0 if session.board is None else session.board.columns * session.board.rows
    names = session.marker_names
    count = len(session.frames)
    views = {
        via: replace(
            Views.empty(count, corners, len(names)),
            board_std_px=np.zeros((count, corners)),
            marker_std_px=np.zeros((count, len(names))),
        )
        for via in ("mirror", "direct")
    }
    for row, picture in pictures.items():
        for board in picture.boards:
            if not board.ok or board.corners_px is None or board.std_px is None:
                continue
            seen = np.ones(corners, dtype=bool) if board.visible is None else board.visible
            views[board.via].board_seen[row] = seen
            views[board.via].board_px[row] = np.where(seen[:, None], board.corners_px, 0.0)
            board_stds = views[board.via].board_std_px
            assert board_stds is not None  # made above
            board_stds[row] = np.where(seen, board.std_px, 0.0)
        for marker in picture.markers:
            if marker.ok and marker.pixel_px is not None:
                index = names.index(marker.name)
                views["mirror"].marker_seen[row, index] = True
                views["mirror"].marker_px[row, index] = marker.pixel_px
                marker_stds = views["mirror"].marker_std_px
                assert marker_stds is not None
                marker_stds[row, index] = marker.std_px or 0.0
    return replace(session, mirror_view=views["mirror"], direct_view=views["direct"], detected=True)
