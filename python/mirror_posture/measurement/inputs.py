"""From a session to the input of the core's estimators: nominal transforms, pixels with masks, noise."""

from __future__ import annotations

import numpy as np

from .._core import MeasureInput, MirrorPostureError
from ..arrays import Floats
from ..mirror import IDEAL_MIRROR
from ..session import Session
from .options import MeasureOptions
from .residuals import excess_of_markers
from .types import NothingMeasuredError


def require_detected(session: Session) -> None:
    """Raises `MirrorPostureError`, with the command that detects, for a session without image points."""
    if not session.detected:
        raise MirrorPostureError(
            f"{session.folder}: nothing is detected yet, neither board nor markers; run `mirror-posture detect {session.folder}` first"
        )


def nominal_camera_from_board(session: Session) -> Floats:
    """(F, 4, 4), by the model at the commanded joint positions.

    Raises `MirrorPostureError` for a session without camera or board.
    """
    if session.camera_link is None or session.camera is None:
        raise MirrorPostureError(
            f"{session.folder}: has no camera; only what a camera sees in a mirror is measured"
        )
    if session.board is None:
        raise MirrorPostureError(f"{session.folder}: has no [board], whose reflection determines the mirror")
    return a_from_b(session, session.camera_link, session.board.link)


def a_from_b(session: Session, link_a: str, link_b: str) -> Floats:
    """(F, 4, 4): from link b's frame to link a's, by the model at the commanded joint positions."""
    robot = session.robot
    poses = robot.forward_kinematics(session.positions)
    root_from_a, root_from_b = (poses[:, robot.link_index(link)] for link in (link_a, link_b))
    return np.linalg.solve(root_from_a, root_from_b).astype(np.float64, copy=False)


def core_input(session: Session, camera_from_board: Floats) -> MeasureInput:
    """The session's pixels and masks with these transforms (F, 4, 4). It must have a camera and a board."""
    camera, board = session.camera, session.board
    assert camera is not None and board is not None
    seen, direct = session.mirror_view, session.direct_view
    return MeasureInput(
        camera=camera.core,
        board_corners=board.corners,
        square_m=board.square_m,
        diameters_m=[marker.diameter_m for marker in session.markers],
        **(session.mirror or IDEAL_MIRROR).glass,
        posture=session.frames.posture.tolist(),
        camera_from_board=camera_from_board,
        board_px=seen.board_px,
        board_seen=seen.board_seen,
        marker_px=seen.marker_px,
        marker_seen=seen.marker_seen,
        direct_px=direct.marker_px,
        direct_seen=direct.marker_seen,
    )


def noise_px(session: Session, core: MeasureInput, options: MeasureOptions) -> tuple[float, float]:
    """Standard deviations of corners and of ball centres, one axis: as stated, else as detected, else by the residuals.

    Medians, since a few views may be bad. Ball centres are never taken to be better than corners, whose noise was measured
    on many more points.
    """
    stated, seen = session.noise.pixel_std_px, session.mirror_view
    corner = options.corner_noise_px or stated or seen.claimed_board_px
    marker = options.marker_noise_px or stated or seen.claimed_marker_px
    if corner is not None and marker is not None:
        return corner, marker
    corner = corner or _corner_noise_px(session, core, options)
    if marker is None:
        done = core.ladder(
            "maximum_likelihood",
            corner_noise_px=corner,
            marker_noise_px=corner,
            least_parallax_rad=options.least_parallax_rad,
        )
        marker = corner * excess_of_markers(done.point_chi_squared, done.point_degrees_of_freedom)
    return corner, marker


def _corner_noise_px(session: Session, core: MeasureInput, options: MeasureOptions) -> float:
    done = core.ladder(
        "maximum_likelihood", marker_noise_px=1.0, least_parallax_rad=options.least_parallax_rad
    )
    good = np.array([reason is None for reason in done.mirror_reason])
    if not good.any():
        reason = next(reason for reason in done.mirror_reason if reason is not None)
        raise NothingMeasuredError(f"{session.folder}: no mirror can be estimated ({reason})")
    corners = session.mirror_view.board_seen.sum(axis=1)[good]
    # Two numbers a corner, three of them spent on the plane.
    per_axis = done.corner_rms_px[good] ** 2 * corners / np.maximum(2 * corners - 3, 1)
    return float(np.sqrt(np.median(per_axis)))
