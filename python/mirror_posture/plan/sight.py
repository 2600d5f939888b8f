"""Visibility in a mirror of finite size, for many postures at once, with reasons."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arrays import Floats, Integers, Mask
from ..mirror import IDEAL_MIRROR
from ..optics import see_in_mirror
from ..rotations import reflected
from .options import MirrorPlace
from .setting import Setting

EDGE_SHARE = 0.02
"""Of the picture's width: nearer to its edge nothing is planned."""
FRAME_SHARE = 0.06
"""Margin of the mirror's edges: nothing is planned nearer to them, because it will not be exactly where it
was meant."""
STEEPEST_COS = math.cos(math.radians(60.0))
LEAST_SQUARE_PX = 6.0
"""Of a square of the board: with fewer pixels its corners are not found."""
LEAST_BALL_PX = 6.0


@dataclass(frozen=True, eq=False)
class Scene:
    """N postures: where things are, in the camera's frame, m."""

    camera_from_base: Floats
    """(N, 4, 4)."""
    corners: Floats
    """(N, C, 3), the board's outer corners or all of them."""
    board_normal: Floats
    """(N, 3)."""
    markers: Floats
    """(N, M, 3)."""


@dataclass(frozen=True, eq=False)
class Sight:
    """What one mirror shows of N postures."""

    board: Mask
    """(N,): the whole board."""
    markers: Mask
    """(N, M): each ball."""
    real: Mask
    """(N,): a real ball is in the picture."""


def outer_corners(setting: Setting) -> Integers:
    """Indices of the board's four outer corners."""
    nx, ny = setting.board.columns, setting.board.rows
    return np.array([0, nx - 1, nx * (ny - 1), nx * ny - 1])


def scene_of(setting: Setting, positions: Floats, all_corners: bool = False) -> Scene:
    """The scene of postures (N, nq)."""
    robot = setting.nominal.robot
    markers = setting.nominal.metadata.markers
    links = [robot.link_names[0], setting.camera_link, setting.board.link, *(m.link for m in markers)]
    poses = robot.link_poses(positions, links)
    camera_from = np.linalg.inv(poses[:, 1])[:, None] @ poses
    corner = setting.board.corner_in_board_m
    if not all_corners:
        corner = corner[outer_corners(setting)]
    board = camera_from[:, 2]
    corners = np.einsum("nij,cj->nci", board[:, :3, :3], corner) + board[:, None, :3, 3]
    return Scene(camera_from[:, 0], corners, board[:, :3, 2], camera_from[:, 3:, :3, 3])


def look(setting: Setting, scene: Scene, mirror: MirrorPlace) -> Sight:
    """What a mirror (in the base's frame) shows the camera of each posture."""
    camera = setting.camera
    rotation = scene.camera_from_base[:, :3, :3]
    normal = rotation @ mirror.normal_in_root
    up, right = rotation @ mirror.up_in_root, rotation @ mirror.right_in_root
    center = rotation @ mirror.center_in_root_m + scene.camera_from_base[:, :3, 3]
    distance = np.einsum("ni,ni->n", normal, center)
    foot = distance[:, None] * normal
    points = np.concatenate([scene.corners, scene.markers], axis=1)
    count, each = points.shape[:2]
    corners = scene.corners.shape[1]
    size = np.array(camera.size_px, dtype=float)
    margin = EDGE_SHARE * size[0]
    seen = see_in_mirror(
        camera,
        np.repeat(foot, each, axis=0),
        points.reshape(-1, 3),
        **(setting.nominal.metadata.mirror or IDEAL_MIRROR).glass,
    )
    pixels = np.where(seen.valid[:, None], seen.pixels_px, -1e6).reshape(count, each, 2)
    behind = np.einsum("nki,ni->nk", points, normal)
    # The light crosses the plane where the way to the reflection does.
    image = reflected(points, normal[:, None], distance[:, None])
    along = np.einsum("nki,ni->nk", image, normal)
    crossing = image * (distance[:, None] / np.where(np.abs(along) > 1e-9, along, 1e-9))[..., None]
    offset = crossing - center[:, None]
    across = np.abs(np.einsum("nki,ni->nk", offset, right))
    upward = np.abs(np.einsum("nki,ni->nk", offset, up))
    keep = 0.5 - FRAME_SHARE
    radius = np.concatenate([np.zeros(corners), setting.radii_m])
    path = np.linalg.norm(image, axis=2)
    ball_px = camera.fx_px * radius / np.maximum(path, 1e-9)
    good = seen.valid.reshape(count, each) & (distance > 0.0)[:, None]
    room = margin + ball_px[..., None]
    good &= ((pixels > room) & (pixels < size - 1.0 - room)).all(axis=2)
    good &= (across + radius < keep * mirror.width_m) & (upward + radius < keep * mirror.height_m)
    good &= behind + radius < distance[:, None]
    good[:, corners:] &= (setting.radii_m == 0.0) | (2.0 * ball_px[:, corners:] > LEAST_BALL_PX)
    facing = np.einsum("ni,ni->n", scene.board_normal, normal) > STEEPEST_COS
    square = camera.fx_px * setting.board.square_m / np.maximum(path[:, :corners].max(axis=1), 1e-9)
    board = good[:, :corners].all(axis=1) & facing & (square > LEAST_SQUARE_PX)
    return Sight(board, good[:, corners:], _real(setting, scene))


def _real(setting: Setting, scene: Scene) -> Mask:
    """Whether a real ball is in the camera's picture, (N,)."""
    camera = setting.camera
    count, balls = scene.markers.shape[:2]
    flat = scene.markers.reshape(-1, 3)
    ahead = flat[:, 2] > 0.0
    # The lens model is not monotonic far outside of the picture: only what a pinhole of twice the picture
    # sees is projected.
    depth = np.where(ahead, flat[:, 2], 1.0)
    span = np.array(camera.size_px) / np.array([camera.fx_px, camera.fy_px])
    near = ahead & (np.abs(flat[:, :2] / depth[:, None]) < span).all(axis=1)
    pixels = np.full((len(flat), 2), -1e6)
    if near.any():
        pixels[near] = camera.project(flat[near])
    size = np.array(camera.size_px, dtype=float)
    radius_px = camera.fx_px * np.tile(setting.radii_m, count) / np.maximum(depth, 1e-3)
    inside = near & ((pixels > -radius_px[:, None]) & (pixels < size - 1.0 + radius_px[:, None])).all(axis=1)
    found: Mask = inside.reshape(count, balls).any(axis=1)
    return found
