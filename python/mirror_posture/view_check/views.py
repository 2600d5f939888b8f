"""Views of the board in the mirror, as the check of them takes them: what they show, and where the model has it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Floats, Mask
from ..board import Board
from ..camera import Camera
from ..mirror import FLOAT_GLASS_INDEX, IDEAL_MIRROR, Rig
from ..session.types import Session

MOST_VIEWS = 24
"""Number of views tested, spread over the session: a mistake of this kind is in all of them."""


@dataclass(frozen=True)
class Views:
    """Some of a session's views, as arrays: V views of N corners and M markers."""

    camera: Camera
    board: Board
    camera_from_board: Floats
    """(V, 4, 4), by the model."""
    board_px: Floats
    """(V, N, 2); NaN where a corner was not seen."""
    marker_px: Floats
    """(V, M, 2)."""
    marker_seen: Mask
    marker_in_camera_m: Floats
    """(V, M, 3), by the model."""
    glass_thickness_m: float
    refractive_index: float

    @classmethod
    def of(cls, session: Session) -> Views | None:
        """Views of a session; None where it has no camera, no board or no view of four corners."""
        camera, board, link = session.camera, session.board, session.camera_link
        if camera is None or board is None or link is None:
            return None
        seen = session.mirror_view
        rows = np.flatnonzero(seen.board_seen.sum(axis=1) >= 4)
        if len(rows) == 0:
            return None
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), MOST_VIEWS)).round().astype(int))]
        robot, positions = session.robot, session.positions[rows]
        poses = robot.forward_kinematics(positions)
        root_from_camera, root_from_board = (poses[:, robot.link_index(name)] for name in (link, board.link))
        turn, origin = root_from_camera[:, :3, :3], root_from_camera[:, :3, 3]
        markers = [
            np.einsum("nji,nj->ni", turn, poses[:, robot.link_index(marker.link), :3, 3] - origin)
            for marker in session.markers
        ]
        glass = (session.mirror or IDEAL_MIRROR).glass
        return cls(
            camera,
            board,
            np.linalg.solve(root_from_camera, root_from_board).astype(np.float64, copy=False),
            np.where(seen.board_seen[rows, :, None], seen.board_px[rows], np.nan),
            seen.marker_px[rows],
            seen.marker_seen[rows],
            np.stack(markers, axis=1) if markers else np.zeros((len(rows), 0, 3)),
            glass.get("glass_thickness_m", 0.0),
            glass.get("refractive_index", FLOAT_GLASS_INDEX),
        )

    @classmethod
    def of_boards(cls, rig: Rig, corners_px: Floats) -> Views:
        """Views of the board alone, (V, N, 2) px with NaN where a corner is hidden."""
        count = len(corners_px)
        return cls(
            rig.camera,
            rig.board,
            np.tile(np.asarray(rig.camera_from_board, dtype=np.float64), (count, 1, 1)),
            corners_px,
            np.zeros((count, 0, 2)),
            np.zeros((count, 0), dtype=bool),
            np.zeros((count, 0, 3)),
            rig.glass_thickness_m,
            rig.refractive_index,
        )
