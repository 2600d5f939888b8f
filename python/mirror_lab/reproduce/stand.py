"""The stand of the measuring experiments: camera, board and six balls that do not move, before a mirror.

Its numbers are those of `stand/` (session.toml, robot.urdf, camera.yaml): 800×600, f = 693 px, a board of 14 mm squares 75 mm below the
camera, balls of 11.6 mm. What the paper does not state (the board's size, the six places) is chosen there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mirror_posture.mirror import Rig
from mirror_posture.render import MirrorPlane, View, view_planes
from mirror_posture.robots import Nominal

Floats = npt.NDArray[np.float64]

STAND_FOLDER = Path(__file__).parent / "stand"


@dataclass(frozen=True)
class PlaneInCamera:
    """A mirror's front face in the camera frame: a point of it (m) and its unit normal away from the camera."""

    point_m: Floats
    normal: Floats


@dataclass(frozen=True)
class Stand:
    """The fixed parts of the experiment."""

    nominal: Nominal

    @classmethod
    def load(cls) -> Stand:
        """The stand of the package's own folder."""
        return cls(Nominal.load(STAND_FOLDER))

    @property
    def markers(self) -> tuple[str, ...]:
        """P1 to P6, the names in the paper's Fig. 6."""
        return self.nominal.marker_names

    @cached_property
    def root_from_camera(self) -> Floats:
        """(4, 4)."""
        return self._root_from(str(self.nominal.metadata.camera_link))

    @cached_property
    def markers_in_camera_m(self) -> Floats:
        """(6, 3): where the balls are."""
        inverse = np.linalg.inv(self.root_from_camera)
        centers = [self._root_from(marker.link)[:3, 3] for marker in self.nominal.metadata.markers]
        result: Floats = np.array(centers) @ inverse[:3, :3].T + inverse[:3, 3]
        return result

    @cached_property
    def corners_in_camera_m(self) -> Floats:
        """(nx · ny, 3): the board's inner corners, x first."""
        board = self.nominal.metadata.board
        assert board is not None
        column, row = np.meshgrid(np.arange(board.columns), np.arange(board.rows))
        x = (column.ravel() - (board.columns - 1) / 2) * board.square_m
        y = (row.ravel() - (board.rows - 1) / 2) * board.square_m
        points = np.stack([x, y, np.zeros_like(x)], axis=1)
        result: Floats = points @ self.camera_from_board[:3, :3].T + self.camera_from_board[:3, 3]
        return result

    @cached_property
    def camera_from_board(self) -> Floats:
        """(4, 4)."""
        board = self.nominal.metadata.board
        assert board is not None
        return np.asarray(
            np.linalg.solve(self.root_from_camera, self._root_from(board.link)), dtype=np.float64
        )

    def plane(self, view: View) -> PlaneInCamera:
        """The mirror of a view, whose distance is that of its front face from the board's centre."""
        drawn = self.drawn_plane(view)
        inverse = np.linalg.inv(self.root_from_camera)
        return PlaneInCamera(
            inverse[:3, :3] @ np.array(drawn.center_in_root_m) + inverse[:3, 3],
            inverse[:3, :3] @ np.array(drawn.normal_in_root),
        )

    def drawn_plane(self, view: View) -> MirrorPlane:
        """The same in the root's frame, as the ray tracer wants it."""
        board = self.nominal.metadata.board
        assert board is not None
        return view_planes([view], self._root_from(board.link)[:3, 3])[0]

    def rig(self, glass_thickness_m: float) -> Rig:
        """The rig of the estimators: the true one. Only maximum likelihood uses the glass."""
        board, camera = self.nominal.metadata.board, self.nominal.camera
        assert board is not None and camera is not None
        return Rig(
            camera,
            board,
            self.camera_from_board,
            glass_thickness_m=glass_thickness_m,
        )

    def _root_from(self, link: str) -> Floats:
        robot = self.nominal.robot
        poses = robot.forward_kinematics(np.zeros((1, len(robot.position_names))))
        result: Floats = poses[0, robot.link_index(link)]
        return result
