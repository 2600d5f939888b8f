"""Repeated looks of the camera at the stand in a view: exact pixels with noise, or drawn and detected pictures.

Both share no formula with the estimators. Noise: the place on the mirror where the light bounces follows from the law of equal
angles, and the picture is a pinhole's. Pictures: the core's ray tracer draws glass, silver and sensor noise, and the detector looks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt

from mirror_posture.detect import detect_picture, predictions_from_session, setup_from_session
from mirror_posture.render import Painter, PictureOptions, View
from mirror_posture.robots import Look

from .stand import STAND_FOLDER, PlaneInCamera, Stand

Floats = npt.NDArray[np.float64]

STAND_RAD, STAND_M = np.radians(0.3), 0.0005
"""How exactly a stand is set by hand for a drawn look: angle (yaw and pitch) and distance, standard deviations."""

Told = Callable[[], None]
"""Called after each look."""


@dataclass(frozen=True)
class Sighting:
    """N looks at the stand in one view, px; NaN for what was not seen."""

    corners_px: Floats
    """(N, nx · ny, 2)."""
    markers_px: Floats
    """(N, 6, 2): images of the balls' centres."""


class Eye(Protocol):
    """A method to look at the stand."""

    @property
    def stand(self) -> Stand: ...

    @property
    def glass_thickness_m(self) -> float:
        """Thickness of the mirror's glass, m."""
        ...

    @property
    def noise_px(self) -> float | None:
        """Standard deviation of a pixel along one axis, where it was chosen."""
        ...

    @property
    def widest_deg(self) -> float:
        """The widest angle of the paper's range at which the board is found."""
        ...

    def see(self, view: View, count: int, stream: int, told: Told | None = None) -> Sighting:
        """`count` looks in a view; looks of another `stream` are independent."""
        ...


@dataclass(frozen=True)
class NoisyEye:
    """Exact pixels with normal noise; an ideal mirror. Looks differ by their noise alone."""

    stand: Stand
    noise_px: float
    seed: int
    glass_thickness_m: float = 0.0
    widest_deg: float = 25.0

    def see(self, view: View, count: int, stream: int, told: Told | None = None) -> Sighting:
        """All looks at once; what lies beyond the picture's edge is not seen."""
        camera = self.stand.nominal.camera
        assert camera is not None
        plane = self.stand.plane(view)
        points = np.concatenate([self.stand.corners_in_camera_m, self.stand.markers_in_camera_m])
        sight = bounce(plane, points)
        focal, center = camera.focal_px, camera.center_px
        exact = sight[:, :2] / sight[:, 2:] * focal + center
        random = np.random.default_rng([self.seed, stream])
        pixels = exact + self.noise_px * random.standard_normal((count, *exact.shape))
        edge = np.array([camera.width_px, camera.height_px]) - 0.5
        inside = np.all((pixels > -0.5) & (pixels < edge), axis=-1, keepdims=True)
        pixels = np.where(inside, pixels, np.nan)
        if told is not None:
            for _ in range(count):
                told()
        corners = len(self.stand.corners_in_camera_m)
        return Sighting(pixels[:, :corners], pixels[:, corners:])


def bounce(plane: PlaneInCamera, points_in_camera_m: Floats) -> Floats:
    """Where on the mirror the light from points (K, 3) turns towards the camera's centre: (K, 3), m.

    Equal angles: the bounce divides the way between the feet of both perpendiculars as their heights.
    """
    camera_height = plane.point_m @ plane.normal
    heights = (plane.point_m - points_in_camera_m) @ plane.normal
    camera_foot = camera_height * plane.normal
    feet = points_in_camera_m + heights[:, None] * plane.normal
    share = (camera_height / (camera_height + heights))[:, None]
    return camera_foot + share * (feet - camera_foot)


@dataclass(frozen=True)
class DrawingEye:
    """Pictures by the ray tracer, 3 mm of glass as the paper's mirror, and detection.

    Looks differ by the sensor's noise and by how exactly the stand is set (`STAND_RAD`, `STAND_M`): what a detector does wrong in one
    picture it does wrong again in the same picture, and only another one tells. A view's pictures are drawn once: another stream sees
    the same ones.
    """

    stand: Stand
    seed: int
    options: PictureOptions = field(default_factory=PictureOptions)
    noise_px: None = None
    widest_deg: float = 20.0
    """At 25° a part of the board leaves the picture, and it is not detected."""
    _painter: Painter = field(default_factory=lambda: Painter.load(STAND_FOLDER))
    _seen: dict[tuple[View, int], Sighting] = field(default_factory=dict)

    @property
    def glass_thickness_m(self) -> float:
        """Of the drawn mirror."""
        return self.options.glass_thickness_m

    def see(self, view: View, count: int, stream: int, told: Told | None = None) -> Sighting:
        """Picture after picture."""
        looks = []
        for number in range(count):
            key = (view, number)
            if key not in self._seen:
                self._seen[key] = self._draw_and_detect(view, number)
            looks.append(self._seen[key])
            if told is not None:
                told()
        return Sighting(
            np.concatenate([look.corners_px for look in looks]),
            np.concatenate([look.markers_px for look in looks]),
        )

    def _draw_and_detect(self, view: View, number: int) -> Sighting:
        # A seed for each picture, and never the same for two views.
        random = np.random.default_rng([self.seed, number, *_bits(view)])
        yaw, pitch = STAND_RAD * random.standard_normal(2)
        placed = View(
            view.yaw_rad + yaw, view.pitch_rad + pitch, view.distance_m + STAND_M * random.standard_normal()
        )
        poses, seed = self._painter.link_poses({}), int(random.integers(2**31))
        drawn = self._painter.draw(poses, self.stand.drawn_plane(placed), self.options, seed)
        session = self.stand.nominal.session([Look({}, 0.0)], [0])
        found = detect_picture(
            drawn.picture[..., ::-1], setup_from_session(session), predictions_from_session(session)[0]
        )
        corners = np.full((1, self.stand.nominal.corner_count, 2), np.nan)
        markers = np.full((1, len(self.stand.markers), 2), np.nan)
        for board in found.boards:
            if board.ok and board.via == "mirror" and board.corners_px is not None:
                seen = np.ones(corners.shape[1], dtype=bool) if board.visible is None else board.visible
                corners[0, seen] = board.corners_px[seen]
        for marker in found.markers:
            if marker.ok and marker.sphere_center_px is not None:
                markers[0, self.stand.markers.index(marker.name)] = marker.sphere_center_px
        return Sighting(corners, markers)


def _bits(view: View) -> list[int]:
    """A view as integers, for seeding."""
    numbers = np.array([view.yaw_rad, view.pitch_rad, view.distance_m], dtype=np.float64)
    return [int(x) for x in numbers.view(np.uint64)]
