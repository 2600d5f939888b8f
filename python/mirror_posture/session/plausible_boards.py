"""Plausibility of the board's pictures: corners that are no plane's image, a board that is too near, one
that looks away."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..medians import median
from .errors import SessionError

if TYPE_CHECKING:
    from ..arrays import Floats, Mask
    from .types import Session

BOARDS_TRIED = 200
LEAST_CORNERS = 8
"""A homography goes through four points; fewer than this show little of whether it is the right one."""
BENT, MOSTLY = 0.1, 0.8
"""Misfit of a board's corners to a plane's image, as a share of the board's size in the picture: lenses and mirrors bend it by a
few hundredths. Where this share of the boards is beyond it, the corners' numbers are others."""
NEARER = 0.5
"""Light from the board to the camera goes at least straight. A picture of the board that is larger than it would be at this share of the
straight distance is of a board whose square, or of a camera whose focal length, is in another unit."""
LEAST_FACING = 0.1
"""Cosine between the board's face and what the camera sees of it in the mirror: both must look at the
mirror."""


def flat_boards(session: Session) -> None:
    """The board is a plane: its corners' image is that of a plane, also in a mirror."""
    board = session.board
    if board is None:
        return
    for view in (session.mirror_view, session.direct_view):
        rows = np.flatnonzero(view.board_seen.sum(axis=1) >= LEAST_CORNERS)
        rows = rows[:: max(1, len(rows) // BOARDS_TRIED)]
        if not len(rows):
            continue
        flat = board.corner_in_board_m[:, :2] / np.abs(board.corner_in_board_m).max()
        misfits = _misfits(flat, view.board_px[rows], view.board_seen[rows])
        bent = misfits > BENT
        if bent.mean() > MOSTLY:
            raise SessionError(
                "detections.csv",
                f"the board's corners are no image of a plane in {bent.mean():.0%} of the frames (typically "
                f"{min(median(misfits), 1.0):.0%} of the board's size off): is corners = [{board.columns}, {board.rows}] right, "
                "and is `index` the corner's number, row by row?",
                column="index",
            )


def _misfits(flat: Floats, px: Floats, seen: Mask) -> Floats:
    """(frames,): RMS distance of image points from the best homography of a plane's points, as a share of their spread.

    `flat` (corners, 2); `px` (frames, corners, 2), of which those `seen` (frames, corners) count: at least one a frame.
    """
    count = seen.sum(axis=1)
    px = np.where(seen[:, :, None], px, 0.0)
    centred = np.where(seen[:, :, None], px - px.sum(axis=1)[:, None] / count[:, None, None], 0.0)
    size = np.sqrt((centred**2).sum(axis=(1, 2)) / count)
    spread = size > 1e-9
    image = centred / np.where(spread, size, 1.0)[:, None, None]
    homogeneous = np.concatenate([flat, np.ones((len(flat), 1))], axis=1)
    none = np.zeros((*seen.shape, 3))
    plane = np.where(seen[:, :, None], homogeneous, 0.0)
    rows = np.concatenate(
        [
            np.concatenate([plane, none, -image[:, :, :1] * plane], axis=2),
            np.concatenate([none, plane, -image[:, :, 1:] * plane], axis=2),
        ],
        axis=1,
    )
    h = np.linalg.eigh(rows.transpose(0, 2, 1) @ rows)[1][:, :, 0].reshape(-1, 3, 3)
    fitted = homogeneous @ h.transpose(0, 2, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.where(seen[:, :, None], fitted[:, :, :2] / fitted[:, :, 2:] - image, 0.0)
        rms = np.sqrt((off**2).sum(axis=(1, 2)) / count)
    return np.where(spread & np.isfinite(rms), rms, np.inf)


def board_distance(session: Session) -> None:
    """No mirror shows the board nearer than it is: the way over the mirror is longer than the straight one.

    A board of size s shows at most f s / d pixels at a distance of d, less where it is turned away.
    """
    camera, board, link = session.camera, session.board, session.camera_link
    seen = session.mirror_view.board_seen
    rows = np.flatnonzero(seen.sum(axis=1) >= LEAST_CORNERS)
    if camera is None or board is None or link is None or not len(rows):
        return
    poses = session.robot.link_poses(session.positions[rows], [link, board.link])
    camera_in_world = poses[:, 0, :3, 3]
    straight_m = np.linalg.norm(poses[:, 1, :3, 3] - camera_in_world, axis=1)
    spread_px = _spread(session.mirror_view.board_px[rows], seen[rows])
    spread_m = _spread(board.corner_in_board_m[None], seen[rows])
    shown_m = max(camera.fx_px, camera.fy_px) * spread_m / np.maximum(spread_px, 1e-9)
    if median(shown_m / np.maximum(straight_m, 1e-9)) < NEARER:
        raise SessionError(
            "session.toml",
            f"in the mirror the board looks {median(shown_m):.3g} m away, nearer than the {median(straight_m):.3g} m straight from the "
            f"camera; needed: at least as far. Is its square of {board.square_m:g} m in m, and the camera file that of this camera?",
        )


def _spread(points: Floats, seen: Mask) -> Floats:
    """(frames,): standard deviation of the points (1 or frames, corners, d) that were seen (frames, corners), all axes together."""
    counts, count = seen[:, :, None], seen.sum(axis=1)
    mean = np.where(counts, points, 0.0).sum(axis=1) / count[:, None]
    off = np.where(counts, points - mean[:, None], 0.0)
    spread: Floats = np.sqrt((off**2).sum(axis=(1, 2)) / count)
    return spread


def facing(session: Session) -> list[str]:
    """Camera and board both look at the mirror: what the camera sees of the board is where the board's face
    looks."""
    camera, board, link = session.camera, session.board, session.camera_link
    if camera is None or board is None or link is None or not session.mirror_view.board_seen.any():
        return []
    robot = session.robot
    poses = robot.link_poses(session.positions, [link, board.link])
    face = np.einsum("fji,fj->fi", poses[:, 0, :3, :3], poses[:, 1, :3, 2])
    seen = session.mirror_view.board_seen
    rows = np.flatnonzero(seen.any(axis=1))
    count = seen[rows].sum(axis=1, keepdims=True)
    pixel = (session.mirror_view.board_px[rows] * seen[rows, :, None]).sum(axis=1) / count
    ray = np.stack(
        [
            (pixel[:, 0] - camera.cx_px) / camera.fx_px,
            (pixel[:, 1] - camera.cy_px) / camera.fy_px,
            np.ones(len(rows)),
        ],
        axis=1,
    )
    cosine = median((face[rows] * ray).sum(axis=1) / np.linalg.norm(ray, axis=1))
    if cosine >= LEAST_FACING:
        return []
    return [
        f"session.toml: the board's face and the camera's sight differ by {np.degrees(np.arccos(np.clip(cosine, -1, 1))):.0f}°, "
        f"and both must look at the mirror: does the z axis of {link!r} look forward (x right, y down), and that of "
        f"{board.link!r} out of the printed face?"
    ]
