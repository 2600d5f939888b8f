"""Renders a robot in front of a mirror by ray tracing, with the truth of each picture.

The core traces the rays, glass included. Nothing here or there projects a point, so measurements in the
pictures are tested by code that shares no formula with them.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ._core import MirrorPostureError, PictureMaker
from .arrays import Floats
from .input_files import LARGEST_MODEL, given_text
from .mirror import FLOAT_GLASS_INDEX
from .robots.nominal import EMBEDDED_FOLDER, Nominal
from .short_repr import ShortRepr
from .viewpoint import View

Positions = Mapping[str, float]
LinkPoses = Mapping[str, Floats]

BALL_SATURATION, BALL_VALUE = 0.94, 0.85
"""The balls' paint, as saturation and value of their marker's hue."""


@dataclass(frozen=True)
class MirrorPlane:
    """The front face of a mirror in the root's frame: centre (m) and unit normal from the robot to the mirror."""

    center_in_root_m: tuple[float, float, float]
    normal_in_root: tuple[float, float, float]


@dataclass(frozen=True)
class PictureOptions:
    """How the mirror is made, and how the camera takes its pictures."""

    glass_thickness_m: float = 0.003
    refractive_index: float = FLOAT_GLASS_INDEX
    curvature_per_m: float = 0.0
    """Positive is concave as the camera sees it."""
    mirror_width_m: float = 0.42
    mirror_height_m: float = 0.36
    ghosts: bool = True
    """Whether the front face's reflection and the second one off the silver are drawn."""
    samples: int = 2
    """Rays of a pixel are samples², and edge_samples² where there is an edge."""
    edge_samples: int = 4
    motion_px: tuple[float, float] = (0.0, 0.0)
    """How far the picture moves while the shutter is open."""
    blur_px: float = 0.55
    """Standard deviation of the Gaussian blur of lens and focus."""
    exposure: float = 1.0
    full_well_electrons: float | None = 9000.0
    """Electrons of a pixel at full white, whose square root is the noise; None for pictures without noise."""
    read_noise_electrons: float = 12.0
    gamma: float = 2.2
    jpeg_quality: int | None = None
    """1 to 100: pictures as after JPEG compression; None for none."""
    floor_m: float = -0.122
    """Height of the table in the root's frame."""


@dataclass(frozen=True, eq=False, repr=False)
class Drawn(ShortRepr):
    """A picture and its truth."""

    picture: npt.NDArray[np.uint8]
    """(H, W, 3), RGB."""
    truth: dict[str, Any]
    """Plain values: `mirror`, `camera_from_board`, `corners_px`, `corners_visible`, `markers`; see `TRUTH_CONVENTIONS`."""


def view_planes(views: Iterable[View], board_in_root_m: npt.ArrayLike) -> tuple[MirrorPlane, ...]:
    """The mirror of each view: its plane `n·x = n·board + distance`, centred before the board.

    `board_in_root_m` is the board's centre, (3,), m.
    """
    board = np.asarray(board_in_root_m, dtype=float)
    planes = []
    for view in views:
        if not (view.distance_m > 0.0 and math.isfinite(view.yaw_rad) and math.isfinite(view.pitch_rad)):
            raise MirrorPostureError(f"{view}: needed finite angles and a distance above 0 m")
        normal = view.normal_in_root
        center = board + view.distance_m * normal
        planes.append(MirrorPlane(tuple(center.tolist()), tuple(normal.tolist())))
    return tuple(planes)


@dataclass(frozen=True)
class Painter:
    """Draws one robot with one camera: made once, used for any posture and mirror."""

    nominal: Nominal
    maker: PictureMaker = field(repr=False)

    @classmethod
    def load(cls, folder: str | os.PathLike[str] = EMBEDDED_FOLDER) -> Painter:
        """Reads a template (or a session): the embedded robot by default.

        Raises `MirrorPostureError` for a template without a camera or with a board or marker that cannot be drawn.
        """
        nominal = Nominal.load(folder)
        file, metadata, camera = nominal.folder / "session.toml", nominal.metadata, nominal.camera
        if camera is None or metadata.camera_link is None:
            raise MirrorPostureError(f"{file}: has no camera; pictures need `camera` and [camera_mount]")
        board = metadata.board
        if board is not None and board.pattern != "chessboard":
            raise MirrorPostureError(
                f"{file}: [board] pattern {board.pattern!r} cannot be drawn, only 'chessboard'"
            )
        balls = []
        for marker in metadata.markers:
            if marker.diameter_m <= 0.0:
                raise MirrorPostureError(
                    f"{file}: marker {marker.name!r} has diameter 0; only balls can be drawn"
                )
            rgb = list(marker.rgb(BALL_SATURATION, BALL_VALUE))
            balls.append((marker.name, marker.link, marker.diameter_m, rgb))
        maker = PictureMaker(
            given_text(nominal.robot_file, "the robot's URDF", LARGEST_MODEL),
            size_px=camera.size_px,
            focal_px=camera.focal_px,
            center_px=camera.center_px,
            distortion=list(camera.distortion),
            camera_link=metadata.camera_link,
            board=None if board is None else (board.link, board.columns, board.rows, board.square_m),
            balls=balls,
        )
        return cls(nominal, maker)

    def link_poses(self, positions_rad: Positions) -> dict[str, Floats]:
        """`root_from_link` (4, 4) of each link at these ACTUAL joint positions; joints that are not named are at 0."""
        return self.maker.link_poses(dict(positions_rad))

    @property
    def board_in_root_m(self) -> Floats:
        """The board's centre, (3,), m, with all joints at 0; the camera's where there is no board."""
        metadata = self.nominal.metadata
        board = metadata.board
        link = metadata.camera_link if board is None else board.link
        return self.link_poses({})[str(link)][:3, 3]

    def draw(
        self, link_poses: LinkPoses, plane: MirrorPlane, options: PictureOptions | None = None, seed: int = 0
    ) -> Drawn:
        """Renders the robot with its links at these poses (`root_from_link`, (4, 4)) in front of a mirror.

        The poses may come from anywhere, for example a simulator: what bends or yields there is visible in
        the picture. The same input gives the same picture.
        """
        o = options or PictureOptions()
        picture, truth = self.maker.draw(
            dict(link_poses),
            mirror_center_m=list(plane.center_in_root_m),
            mirror_normal=list(plane.normal_in_root),
            glass_thickness_m=o.glass_thickness_m,
            refractive_index=o.refractive_index,
            curvature_per_m=o.curvature_per_m,
            mirror_size_m=(o.mirror_width_m, o.mirror_height_m),
            ghosts=o.ghosts,
            floor_m=o.floor_m,
            grid=o.samples,
            edge_grid=o.edge_samples,
            motion_px=list(o.motion_px),
            blur_px=o.blur_px,
            exposure=o.exposure,
            full_well_electrons=o.full_well_electrons,
            read_noise_electrons=o.read_noise_electrons,
            gamma=o.gamma,
            jpeg_quality=o.jpeg_quality,
            seed=seed,
        )
        return Drawn(picture, truth)
