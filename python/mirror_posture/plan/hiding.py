"""Occlusion of the board and the balls by the robot itself, from the mirror and from the camera."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Floats, Mask
from ..rotations import reflected
from .options import MirrorPlace
from .setting import Setting
from .sight import Scene, Sight

if TYPE_CHECKING:
    from ..shapes.body import Body


RIM_SHARE, RIM_LEAST = 0.8, 3
"""A ball counts as visible if its centre and this many of four points at this share of its radius are: the
outline of a half-hidden one is not found reliably."""


def _face(setting: Setting, scene: Scene, row: int) -> Floats:
    """Points all over the board's print in the camera's frame, none farther than a square's half diagonal from the next: the squares' corners,
    the print's rim, and the squares' middles. The scene has the outer corners only; a thumb hides others."""
    board, (first, right, down) = setting.board, scene.corners[row][:3]
    x, y = (right - first) / (board.columns - 1), (down - first) / (board.rows - 1)
    grids = [
        np.stack(np.meshgrid(np.arange(start, board.columns + end), np.arange(start, board.rows + end)), axis=-1).reshape(-1, 2)
        for start, end in ((-1.0, 1.0), (-0.5, 0.0))
    ]  # fmt: skip
    grid = np.concatenate(grids)
    points: Floats = first + grid[:, :1] * x + grid[:, 1:] * y
    return points


def _rim(centre: Floats, way: Floats, radius_m: float) -> Floats:
    """Points (4, 3) near the rim of a ball as seen along a path of light."""
    first = np.cross(way, [1.0, 0.0, 0.0] if abs(way[0]) < abs(way[1]) else [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    second = np.cross(way, first) / np.linalg.norm(way)
    points: Floats = centre + RIM_SHARE * radius_m * np.array([first, -first, second, -second])
    return points


def unhidden(
    setting: Setting, body: Body | None, scene: Scene, sight: Sight, mirror: MirrorPlace, row: int
) -> Mask | None:
    """The balls (M,) that are seen and that no part of the robot hides, on the way to the mirror or back; None: the board is hidden."""
    if body is None:
        alone: Mask = sight.markers[row]
        return alone
    base_from_camera = np.linalg.inv(scene.camera_from_base[row])
    eye = base_from_camera[:3, 3]
    normal, at = mirror.normal_in_root, float(mirror.normal_in_root @ mirror.center_in_root_m)
    balls = np.flatnonzero(sight.markers[row])
    turn = base_from_camera[:3, :3].T
    face, centres = _face(setting, scene, row) @ turn + eye, scene.markers[row][balls] @ turn + eye

    # The camera's image: the way from the mirror to a point lies on the line from there.
    behind = reflected(eye, normal, at)

    def clear(points: Floats, keep_off_m: float) -> Iterator[bool]:
        """Of each point (N, 3) whether the way to the mirror and on to the camera is free, the last `keep_off_m` before it aside."""
        back = points - behind
        length = np.linalg.norm(back, axis=1)
        back /= length[:, None]
        image = reflected(points, normal, at) - eye
        out = image / length[:, None]
        share = (at - eye @ normal) / (image @ normal)
        for k, whole in enumerate(length):
            yield not (
                body.hides(behind, back[k], whole - keep_off_m)
                or body.hides(eye, out[k], share[k] * whole, past_camera=True)
            )

    if not all(clear(face, 1e-3)):
        return None
    seen = np.zeros(sight.markers.shape[1], dtype=bool)
    for ball, centre in zip(balls, centres, strict=True):
        radius, towards = float(setting.radii_m[ball]), reflected(centre, normal, at) - eye
        middle, *rim = clear(np.vstack([centre, _rim(centre, towards, radius)]), radius + 1e-3)
        seen[ball] = middle and sum(rim) >= RIM_LEAST
    return seen
