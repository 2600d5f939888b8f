"""Image points without a picture: exact pixels of board corners and balls in a mirror, with chosen noise.

The light's path is the blind check's (Snell's law by shooting, the ball's traced outline), so that no formula is shared with the
measurement. Occlusion by limbs is not modelled: only the picture's border
and the board's face count.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mirror_posture._core import MirrorPostureError
from mirror_posture.robots.nominal import Nominal
from mirror_posture.robots.protocol import ImagePoints

from ..blind.optics import Lens, Mirror, apparent, ball_images

Floats = npt.NDArray[np.float64]

MARGIN_PX = 6.0
"""A corner or a ball's centre nearer to the border is not seen: a detector needs its surroundings."""
LEAST_COSINE = 0.15
"""Of the angle between the board's face and the direction to the mirror; flatter boards are not found."""


@dataclass(frozen=True)
class MirrorInRoot:
    """The front face `normal · x = distance` in the root's frame, normal from the robot to the mirror, and its make."""

    normal: Floats
    distance_m: float
    glass_thickness_m: float = 0.0
    refractive_index: float = 1.52
    curvature_per_m: float = 0.0


def lens_of(nominal: Nominal) -> Lens:
    """The nominal camera as the blind check's lens. Raises `MirrorPostureError` for one that it does not know."""
    camera = nominal.camera
    if camera is None:
        raise MirrorPostureError(
            f"{nominal.folder}: has no camera; image points need `camera` and [camera_mount]"
        )
    if camera.distortion_model not in ("plumb_bob", "none"):
        raise MirrorPostureError(
            f"{nominal.folder}: exact pixels know the distortion 'plumb_bob', got {camera.distortion_model!r}; use pictures"
        )
    distortion = np.zeros(5)
    distortion[: len(camera.distortion)] = camera.distortion
    return Lens(
        np.array([camera.fx_px, camera.fy_px]),
        np.array([camera.cx_px, camera.cy_px]),
        distortion,
        (camera.width_px, camera.height_px),
    )


def exact_points(
    nominal: Nominal,
    lens: Lens,
    root_from_link: Mapping[str, Floats],
    mirror: MirrorInRoot,
    noise_px: float,
    rng: np.random.Generator,
) -> ImagePoints:
    """What a detector with Gaussian noise of `noise_px` an axis would find with the links at these ACTUAL poses."""
    metadata = nominal.metadata
    root_from_camera = root_from_link[str(metadata.camera_link)]
    camera_from_root = np.linalg.inv(root_from_camera)
    normal = camera_from_root[:3, :3] @ mirror.normal
    distance = mirror.distance_m - float(mirror.normal @ root_from_camera[:3, 3])

    def in_mirror(count: int) -> Mirror:
        return Mirror(
            np.tile(normal, (count, 1)),
            np.full(count, distance),
            mirror.glass_thickness_m,
            mirror.refractive_index,
            np.full(2, mirror.curvature_per_m),
        )

    def visible(pixels: Floats, points: Floats) -> npt.NDArray[np.bool_]:
        size = np.array(lens.size_px)
        with np.errstate(invalid="ignore"):
            inside = np.all((pixels > MARGIN_PX) & (pixels < size - 1 - MARGIN_PX), axis=1)
        result: npt.NDArray[np.bool_] = inside & (distance > 0.0) & (points @ normal < distance)
        return result

    reasons = []
    board_px, board_seen = np.zeros((nominal.corner_count, 2)), np.zeros(nominal.corner_count, dtype=bool)
    if metadata.board is not None and distance > 0.0:
        camera_from_board = camera_from_root @ root_from_link[metadata.board.link]
        corners = metadata.board.corner_in_board_m @ camera_from_board[:3, :3].T + camera_from_board[:3, 3]
        found = lens.image(apparent(in_mirror(len(corners)), corners))
        faces = float(camera_from_board[:3, 2] @ normal) > LEAST_COSINE
        # A chessboard is detected completely or not at all.
        whole = faces and bool(visible(found, corners).all())
        board_seen[:] = whole
        if whole:
            board_px = found + rng.normal(0.0, noise_px, found.shape)
        else:
            reasons.append("board: outside the picture" if faces else "board: turned away from the mirror")
    centers = np.array([root_from_link[marker.link][:3, 3] for marker in metadata.markers]).reshape(-1, 3)
    centers = centers @ camera_from_root[:3, :3].T + camera_from_root[:3, 3]
    marker_px, marker_seen = np.zeros((len(centers), 2)), np.zeros(len(centers), dtype=bool)
    for radius in sorted({0.5 * marker.diameter_m for marker in metadata.markers}) if distance > 0.0 else ():
        mine = np.array([0.5 * marker.diameter_m == radius for marker in metadata.markers])
        ahead = mine & (centers @ normal < distance)
        if ahead.any():
            marker_px[ahead] = ball_images(lens, in_mirror(int(ahead.sum())), centers[ahead], radius)
    with np.errstate(invalid="ignore"):
        marker_seen = visible(marker_px, centers)
    noisy = marker_px + rng.normal(0.0, noise_px, marker_px.shape)
    marker_px = np.where(marker_seen[:, None], noisy, 0.0)
    reasons += [
        f"{marker.name}: outside the picture"
        for marker, seen in zip(metadata.markers, marker_seen, strict=True)
        if not seen
    ]
    return ImagePoints(
        board_px,
        board_seen,
        marker_px,
        marker_seen,
        np.where(board_seen, noise_px, 0.0),
        np.where(marker_seen, noise_px, 0.0),
        tuple(reasons),
    )
