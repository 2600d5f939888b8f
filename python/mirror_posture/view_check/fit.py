"""How well an interpretation of a session explains its views: the board's residual in the best mirrors, and
the markers' distances in those."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Floats, Mask
from ..board import Board
from ..camera import Camera
from ..mirror import FLOAT_GLASS_INDEX, IDEAL_MIRROR, Rig, estimate_mirrors
from ..optics import see_in_mirror
from ..session.types import Session
from .readings import PIXELS, Reading

MOST_VIEWS = 24
"""Number of views tested, spread over the session: a mistake of this kind is in all of them."""
LEAST_MARKER_PX = 2.0
"""Residuals below these are as good as none when two readings are compared, px."""
NO_MIRROR_PX = 1000.0
"""Stands for the residual where no mirror explains a view at all."""
LEAST_SCALE = 0.04
"""Factors of board or camera nearer to 1 than this are a matter of calibration, not of a mistake."""
LARGEST_FACTOR = 4.0


@dataclass(frozen=True)
class Fit:
    """How well a reading explains the views: medians over them, px; infinite where it explains fewer than half."""

    reading: Reading
    board_rms_px: float
    marker_px: float | None

    def gain_over(self, other: Fit, noise_px: float) -> float:
        """How many times smaller this fit's residuals are, board times markers."""
        gain = min(max(other.board_rms_px, noise_px), NO_MIRROR_PX) / max(self.board_rms_px, noise_px)
        if self.marker_px is not None and other.marker_px is not None:
            gain *= max(other.marker_px, LEAST_MARKER_PX) / max(self.marker_px, LEAST_MARKER_PX)
        return gain


@dataclass(frozen=True)
class Views:
    """Some of a session's views, as arrays."""

    camera: Camera
    board: Board
    camera_from_board: Floats
    board_px: Floats
    """(V, N, 2); NaN where a corner was not seen."""
    marker_px: Floats
    marker_seen: Mask
    marker_in_camera_m: Floats
    glass_thickness_m: float
    refractive_index: float

    @classmethod
    def of(cls, session: Session) -> Views | None:
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

    @property
    def square_picture(self) -> bool:
        width, height = self.camera.size_px
        return width == height

    def fit(self, reading: Reading) -> Fit:
        """Medians over the views of the board's residual in the best mirror and of the markers' distances from the model's in that mirror."""
        nx, ny = self.board.corners
        width, height = self.camera.size_px
        board_px = PIXELS[reading.pixels](self.board_px, width, height)
        if reading.labels != "as they are":
            grid = board_px.reshape(-1, ny, nx, 2)
            grid = grid[:, :, ::-1] if reading.labels.endswith("x") else grid[:, ::-1]
            board_px = np.ascontiguousarray(grid).reshape(board_px.shape)
        camera = self._scaled(reading.camera_factor, reading.focal_factor)
        poses = reading.camera_from_meant @ self.camera_from_board @ reading.board_from_meant
        rms = np.full(len(board_px), np.inf)
        foot = np.full((len(board_px), 3), np.nan)
        _, first, group = np.unique(
            poses.round(9).reshape(len(poses), -1), axis=0, return_index=True, return_inverse=True
        )
        for number, row in enumerate(first):
            mine = np.flatnonzero(group.reshape(-1) == number)
            rig = Rig(
                camera,
                Board(*self.board.corners, self.board.square_m * reading.square_factor),
                poses[row],
                None,
                self.glass_thickness_m,
                self.refractive_index,
            )
            found = estimate_mirrors(rig, board_px[mine])
            rms[mine] = np.where(found.valid, found.rms_px, np.inf)
            foot[mine] = found.foot_points_m
        return Fit(reading, float(np.median(rms)), self._markers_px(reading, camera, foot))

    def _markers_px(self, reading: Reading, camera: Camera, foot: Floats) -> float | None:
        view, marker = np.nonzero(self.marker_seen & np.isfinite(foot).all(axis=1, keepdims=True))
        if len(view) == 0:
            return None
        width, height = self.camera.size_px
        seen = PIXELS[reading.pixels](self.marker_px, width, height)[view, marker]
        points = self.marker_in_camera_m[view, marker] @ reading.camera_from_meant[:3, :3].T
        expected = see_in_mirror(
            camera,
            foot[view],
            points,
            glass_thickness_m=self.glass_thickness_m,
            refractive_index=self.refractive_index,
        )
        away = np.linalg.norm(expected.pixels_px - seen, axis=1)
        return float(np.median(np.where(expected.valid, away, float(width))))

    def _scaled(self, factor: float, focal_factor: float) -> Camera:
        """The camera of the same picture at another resolution (pixel centres are whole numbers, hence the halves), or with another lens."""
        if factor == 1.0 and focal_factor == 1.0:
            return self.camera
        (fx, fy), (cx, cy), size = self.camera.focal_px, self.camera.center_px, self.camera.size_px
        return replace(
            self.camera,
            size_px=(max(1, round(size[0] * factor)), max(1, round(size[1] * factor))),
            focal_px=(fx * factor * focal_factor, fy * factor * focal_factor),
            center_px=((cx + 0.5) * factor - 0.5, (cy + 0.5) * factor - 0.5),
        )

    def best_factors(self) -> list[Fit]:
        """The best factor of the squares' side, of the camera's resolution and of its focal length, each alone, where it is far from 1."""

        def of_board(factor: float) -> Reading:
            return Reading(
                "another board",
                f"the board is another one: its squares measure {1000.0 * factor * self.board.square_m:.2f} mm, not {1000.0 * self.board.square_m:.2f} mm",
                "measure the printed squares and correct [board] square",
                1,
                "board_scale",
                square_factor=factor,
            )

        def of_camera(factor: float) -> Reading:
            return Reading(
                "camera of another resolution",
                f"the camera file is another camera's or another resolution's: {factor:.2f} times its focal length and centre fit",
                "give the camera file of this camera at the resolution of these pictures",
                1,
                "camera_resolution",
                camera_factor=factor,
            )

        def of_lens(factor: float) -> Reading:
            return Reading(
                "camera of another focal length",
                f"the camera file is another camera's, or the pictures are cropped or zoomed: {factor:.2f} times its focal length fits",
                "give the camera file of this camera as it took these pictures",
                1,
                "camera_focal",
                focal_factor=factor,
            )

        found = []
        for reading in (of_board, of_camera, of_lens):
            factor = _least(lambda log, reading=reading: self.fit(reading(math.exp(log))).board_rms_px)  # type: ignore[misc]
            if factor is not None and abs(math.log(factor)) > LEAST_SCALE:
                found.append(self.fit(reading(factor)))
        return found


def _least(cost: Callable[[float], float]) -> float | None:
    """The factor with the least cost: a coarse search over its logarithm, then golden sections. None where nothing has a finite cost."""
    grid = np.linspace(-math.log(LARGEST_FACTOR), math.log(LARGEST_FACTOR), 25)
    costs = [cost(float(log)) for log in grid]
    best = int(np.argmin(costs))
    if not math.isfinite(costs[best]):
        return None
    low, high = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, len(grid) - 1)])
    golden = (math.sqrt(5.0) - 1.0) / 2.0
    for _ in range(16):
        a, b = high - golden * (high - low), low + golden * (high - low)
        if cost(a) <= cost(b):
            high = b
        else:
            low = a
    return math.exp(0.5 * (low + high))
