"""Pictures of a simulated session: board and balls through mirror and lens, ray by ray, in plain NumPy.

A pixel's ray is undistorted, goes to the mirror, which may be a pane (refracted in, off the silver,
refracted out) or curved (the law of reflection at the cap's own normal), and from there to the first hit.
Nothing projects a point: `optics` shoots from points to the camera, this goes the other way. No ghosts of
the front face, no body except board and balls, and the mirror fills the picture.
"""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .optics import Lens, Mirror, _across
from .robots import Robot

Array = NDArray[np.float64]

SAMPLES = 3
"""SAMPLES² rays are cast for each pixel near board and balls."""
MARGIN_SQUARES = 1.0
"""White paper around the squares of the board."""
PADDING_PX = 4
BLUR_PX = 0.6
NOISE = 0.006
"""Standard deviation of a pixel's brightness, of white."""
GAMMA = 2.2
WALL, PAPER, INK = 0.18, 0.80, 0.03
"""Reflectance of background, paper and ink."""
BALL_SATURATION, BALL_VALUE = 0.94, 0.85
AMBIENT = 0.55
LIGHT = np.array([0.35, -0.75, -0.55]) / np.linalg.norm([0.35, -0.75, -0.55])
"""Towards the lamp, in the camera's frame: above, a little to the right, behind the camera."""
LENS_STEPS = 12
CAP_STEPS = 8


@dataclass
class View:
    """The board and the balls before the camera in each frame, in its optical frame."""

    board_m: Array
    """(F, 3) the board's centre."""
    board_rotation: Array
    """(F, 3, 3)"""
    balls_m: Array
    """(F, M, 3)"""
    mirror: Mirror
    focal_factor: Array
    """(F,)"""
    square_m: float
    warp_per_m: float


def marker_hue_deg(k: int, count: int) -> float:
    """Hue of marker `k` of `count`, evenly spaced."""
    return 360.0 * k / count


def hue_tolerance_deg(count: int) -> float:
    return min(15.0, 180.0 / count - 1.0)


def draw(robot: Robot, lens: Lens, view: View, frame: int, near_px: tuple[Array, Array]) -> Array:
    """A frame's picture (H, W, 3), linear RGB, without blur and noise."""
    width, height = lens.size_px
    picture = np.full((height, width, 3), WALL)
    traced = np.zeros((height, width), dtype=bool)
    for left, top, right, bottom in _boxes(robot, lens, view, frame, near_px):
        traced[top:bottom, left:right] = True
    rows, columns = np.nonzero(traced)
    offset = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    total = np.zeros((len(rows), 3))
    for dy in offset:
        for dx in offset:
            px = np.column_stack([columns + dx, rows + dy])
            total += _colours(robot, view, frame, rays(lens, px, float(view.focal_factor[frame])))
    picture[rows, columns] = total / SAMPLES**2
    return picture


def rays(lens: Lens, px: Array, focal_factor: float) -> Array:
    """Unit directions (N, 3) in which pixels (N, 2) look: the lens undone by substitution."""
    u = px[:, 0] - lens.shear * (px[:, 1] - lens.center_px[1])
    target = (np.column_stack([u, px[:, 1]]) - lens.center_px) / (lens.focal_px * focal_factor)
    k1, k2, p1, p2, k3 = lens.distortion
    x, y = target.T
    for _ in range(LENS_STEPS):
        s = x * x + y * y
        radial = 1 + s * (k1 + s * (k2 + s * k3))
        dx, dy = 2 * p1 * x * y + p2 * (s + 2 * x * x), p1 * (s + 2 * y * y) + 2 * p2 * x * y
        x, y = (target[:, 0] - dx) / radial, (target[:, 1] - dy) / radial
    direction = np.column_stack([x, y, np.ones_like(x)])
    result: Array = direction / np.linalg.norm(direction, axis=1)[:, None]
    return result


def reflected(mirror: Mirror, frame: int, direction: Array) -> tuple[Array, Array]:
    """Where rays from the camera leave the mirror (N, 3), and their directions then; NaN where they miss it."""
    n, d = mirror.normal[frame], float(mirror.distance_m[frame])
    cosine = direction @ n
    cosine = np.where(cosine > 1e-6, cosine, np.nan)
    hit = direction * (d / cosine)[:, None]
    if np.any(mirror.curvature_per_m):
        return _off_cap(n, d, mirror.curvature_per_m, direction, cosine)
    out = direction - 2 * cosine[:, None] * n
    if mirror.glass_m > 0:
        across = (direction - cosine[:, None] * n) / mirror.refractive_index
        inside = np.sqrt(1 - np.einsum("ni,ni->n", across, across))
        hit = hit + across * (2 * mirror.glass_m / inside)[:, None]
    return hit, out


def _off_cap(n: Array, d: float, curvature: Array, direction: Array, cosine: Array) -> tuple[Array, Array]:
    first, second = (v[0] for v in _across(n[None]))
    c1, c2 = curvature
    sag = np.zeros(len(direction))
    for _ in range(CAP_STEPS):
        hit = direction * ((d - sag) / cosine)[:, None]
        s, t = hit @ first, hit @ second
        root = np.sqrt(1 - (c1 * s) ** 2 - (c2 * t) ** 2)
        sag = (c1 * s * s + c2 * t * t) / (1 + root)
    slope_s = (2 * c1 * s + sag * c1 * c1 * s / root) / (1 + root)
    slope_t = (2 * c2 * t + sag * c2 * c2 * t / root) / (1 + root)
    normal = n + slope_s[:, None] * first + slope_t[:, None] * second
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return hit, direction - 2 * np.einsum("ni,ni->n", direction, normal)[:, None] * normal


def _colours(robot: Robot, view: View, frame: int, direction: Array) -> Array:
    origin, out = reflected(view.mirror, frame, direction)
    colour = np.full((len(out), 3), WALL)
    nearest = np.full(len(out), np.inf)
    reach, shade = _board(robot, view, frame, origin, out)
    seen = reach < nearest
    colour[seen], nearest[seen] = shade[seen, None], reach[seen]
    count = len(robot.markers)
    for k in range(count):
        hue = marker_hue_deg(k, count) / 360
        paint = np.array(colorsys.hsv_to_rgb(hue, BALL_SATURATION, BALL_VALUE)) ** GAMMA
        reach, lit = _ball(view.balls_m[frame, k], robot.marker_diameter_m / 2, origin, out)
        seen = reach < nearest
        colour[seen], nearest[seen] = lit[seen, None] * paint, reach[seen]
    return colour


def _board(robot: Robot, view: View, frame: int, origin: Array, out: Array) -> tuple[Array, Array]:
    """Distance along the rays to the printed face (∞ where they miss it), and its reflectance there."""
    turn = view.board_rotation[frame]
    o, v = (origin - view.board_m[frame]) @ turn, out @ turn
    facing = v[:, 2] < -1e-9
    z = np.zeros(len(o))
    fall = np.where(facing, v[:, 2], -1.0)
    for _ in range(CAP_STEPS if view.warp_per_m else 1):
        reach = (z - o[:, 2]) / fall
        x = o[:, 0] + reach * v[:, 0]
        bend = np.clip(view.warp_per_m * x, -0.99, 0.99)
        z = view.warp_per_m * x * x / (1 + np.sqrt(1 - bend**2))
    along = np.arcsin(bend) / view.warp_per_m if view.warp_per_m else x
    nx, ny = robot.board_corners
    i = along / view.square_m + (nx + 1) / 2
    j = (o[:, 1] + reach * v[:, 1]) / view.square_m + (ny + 1) / 2
    wide, high = nx + 1 + MARGIN_SQUARES, ny + 1 + MARGIN_SQUARES
    inside = (i > -MARGIN_SQUARES) & (i < wide) & (j > -MARGIN_SQUARES) & (j < high)
    squares = (i >= 0) & (i < nx + 1) & (j >= 0) & (j < ny + 1)
    dark = squares & ((np.floor(i) + np.floor(j)) % 2 == 0)
    hit = facing & inside & (reach > 0)
    return np.where(hit, reach, np.inf), np.where(dark, INK, PAPER)


def _ball(center: Array, radius_m: float, origin: Array, out: Array) -> tuple[Array, Array]:
    """Distance along the rays to a ball (∞ where they miss it), and how brightly it is lit there."""
    to = center - origin
    along = np.einsum("ni,ni->n", to, out)
    inside = radius_m**2 - (np.einsum("ni,ni->n", to, to) - along**2)
    hit = (inside > 0) & (along > 0)
    reach = along - np.sqrt(np.where(hit, inside, 0.0))
    normal = (origin + reach[:, None] * out - center) / radius_m
    lit = AMBIENT + (1 - AMBIENT) * np.clip(normal @ LIGHT, 0, 1)
    return np.where(hit, reach, np.inf), lit


def _boxes(
    robot: Robot, lens: Lens, view: View, frame: int, near_px: tuple[Array, Array]
) -> list[tuple[int, int, int, int]]:
    """Rectangles (left, top, right, bottom) that hold the board and the balls, with room around them."""
    width, height = lens.size_px
    corners, balls = near_px
    nx, ny = robot.board_corners
    square_px = np.linalg.norm(np.ptp(corners, axis=0) / np.array([nx - 1, ny - 1])) + PADDING_PX
    boxes = [np.concatenate([corners.min(0) - 2.2 * square_px, corners.max(0) + 2.2 * square_px])]
    depth = view.mirror.distance_m[frame]
    size = PADDING_PX + 1.5 * lens.focal_px.max() * robot.marker_diameter_m / depth
    boxes += [np.concatenate([b - size, b + size]) for b in balls if np.isfinite(b).all()]
    whole = np.array([width, height, width, height])
    out = []
    for box in boxes:
        left, top, right, bottom = np.clip(np.round(box), 0, whole).astype(int)
        out.append((int(left), int(top), int(right), int(bottom)))
    return out
