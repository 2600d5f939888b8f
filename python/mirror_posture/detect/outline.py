"""A ball's outline to a fraction of a pixel, whatever the light on it.

Along rays from the ball's centre, every pixel is unmixed in linear light into the ball's own colour B there and what lies behind, G:
`I = s B + w G`. The share w does not depend on the light on the ball, s not on the light behind it; whichever is the more even of the
two on this ray counts more. The edge lies where the covered length ends. Rays that end early (another body part hides the outline) or at a highlight do not agree with a
ball's outline and are left out.

The outline of a sphere is a cone of rays: with unit rays r of the edge points, `r · w = 1` for w = axis / cos(half angle), three numbers
(Kanatani, "Geometric Computation for Machine Vision"): fitted in `cone`, it needs only part of the arc.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from ..short_repr import ShortRepr
from .types import FloatArray

# The search along a ray, on both sides of the expected edge, px, in steps of STEP_PX.
REACH_PX = 4.0
STEP_PX = 0.25
# The colours inside and outside are read beyond the blurred edge, this far from it.
CLEAR_PX = 1.75
# Width of the zones in which those colours are read.
ZONE_PX = 1.5
# Unevenness of a zone that even light and a clean picture leave, as a share of its brightness.
SHARE_FLOOR = 0.02
# Error of an edge from pixel structure alone.
EDGE_FLOOR_PX = 0.05
# Edge points farther from the fitted outline than this belong to something else.
INLIER_PX = 0.45
# Rounds of centring the rays and fitting again.
ROUNDS = 3
RANDOM_TRIALS = 160
# A ray's unmixing must tell the two colours apart: sine of the angle between them in RGB.
MIN_COLOUR_SINE = 0.12
MIN_EDGE_POINTS = 8


@dataclass(frozen=True, eq=False, repr=False)
class Circle(ShortRepr):
    """A circle in the picture, px."""

    center_px: FloatArray
    radius_px: float


@dataclass(frozen=True, eq=False, repr=False)
class Edges(ShortRepr):
    """Edge points `(N, 2)` px, one a ray, their standard deviations along the ray `(N,)` px, and `found` `(N,)` where there is one."""

    points_px: FloatArray
    std_px: FloatArray
    found: np.ndarray


def to_linear(bgr: np.ndarray) -> np.ndarray:
    """Linear light from 8-bit sRGB (IEC 61966-2-1), float32 (H, W, 3). Cameras differ a little; what matters is the curve's bend."""
    result: np.ndarray = _SRGB_TABLE[bgr]
    return result


def _srgb_table() -> np.ndarray:
    value = np.arange(256) / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32)


_SRGB_TABLE = _srgb_table()


def edges_on_rays(linear: np.ndarray, circle: Circle) -> Edges:
    """Sub-pixel edge of the ball's colour along rays from the circle's centre, about one ray for each pixel of the outline."""
    count = int(np.clip(round(2.0 * np.pi * circle.radius_px), 16, 720))
    angle = np.arange(count) * (2.0 * np.pi / count)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    reach = min(REACH_PX, 0.6 * circle.radius_px)
    radii = circle.radius_px + np.arange(-reach, REACH_PX + 0.5 * STEP_PX, STEP_PX)
    at = circle.center_px + direction[:, None, :] * radii[None, :, None]
    colours, inside = _sample_colours(linear, at)
    # Two passes: the clear zones are set around the expected edge, then around the one found.
    edge = np.full(count, circle.radius_px)
    found = np.ones(count, dtype=bool)
    for _ in range(2):
        coverage, share_std, found = _coverage(colours, radii, edge, min(CLEAR_PX, 0.5 * reach))
        edge = _edge_radius(coverage, radii)
    found &= inside.all(axis=1) & (edge > radii[0] + 2 * STEP_PX) & (edge < radii[-1] - 2 * STEP_PX)
    # An error e of the share moves the edge by about e × the width over which it is summed.
    std = np.hypot(EDGE_FLOOR_PX, CLEAR_PX * share_std)
    return Edges(circle.center_px + direction * edge[:, None], std, found)


def _sample_colours(linear: np.ndarray, at: FloatArray) -> tuple[FloatArray, np.ndarray]:
    height, width = linear.shape[:2]
    u, v = at[..., 0].astype(np.float32), at[..., 1].astype(np.float32)
    inside = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
    colours = cv2.remap(linear, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return colours.astype(np.float64), inside


def _coverage(
    colours: FloatArray, radii: FloatArray, edge: FloatArray, clear: float
) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """Share of the ball in each sample `(rays, samples)`, its standard deviation by ray, and which rays can tell ball from background."""
    distance = radii[None, :] - edge[:, None]
    ball_zone = (distance <= -clear) & (distance >= -clear - ZONE_PX)
    behind_zone = (distance >= clear) & (distance <= clear + ZONE_PX)
    ball = _mean_where(colours, ball_zone)
    behind = _mean_where(colours, behind_zone)
    bb = np.einsum("nc,nc->n", ball, ball)
    gg = np.einsum("nc,nc->n", behind, behind)
    bg = np.einsum("nc,nc->n", ball, behind)
    determinant = bb * gg - bg * bg
    telling = determinant > (MIN_COLOUR_SINE**2) * bb * gg + 1e-12
    safe = np.where(telling, determinant, 1.0)
    ib = np.einsum("nsc,nc->ns", colours, ball)
    ig = np.einsum("nsc,nc->ns", colours, behind)
    share_of_ball = (gg[:, None] * ib - bg[:, None] * ig) / safe[:, None]
    share_behind = (bb[:, None] * ig - bg[:, None] * ib) / safe[:, None]
    # The ball's share s assumes even light on the ball, 1 − w an even background: each counts by how even its zone is.
    variance_ball = _variance_where(share_of_ball, ball_zone) + SHARE_FLOOR**2
    variance_behind = _variance_where(share_behind, behind_zone) + SHARE_FLOOR**2
    weight = (variance_behind / (variance_ball + variance_behind))[:, None]
    coverage = weight * share_of_ball + (1.0 - weight) * (1.0 - share_behind)
    std = np.sqrt(variance_ball * variance_behind / (variance_ball + variance_behind))
    return np.clip(coverage, -0.25, 1.25), std, telling


def _mean_where(values: FloatArray, where: np.ndarray) -> FloatArray:
    weight = where.astype(np.float64)
    total = np.maximum(weight.sum(axis=1), 1e-9)
    result: FloatArray = np.einsum("nsc,ns->nc", values, weight) / total[:, None]
    return result


def _variance_where(values: FloatArray, where: np.ndarray) -> FloatArray:
    weight = where.astype(np.float64)
    total = np.maximum(weight.sum(axis=1), 1e-9)
    mean = (values * weight).sum(axis=1) / total
    result: FloatArray = ((values - mean[:, None]) ** 2 * weight).sum(axis=1) / total
    return result


def _edge_radius(coverage: FloatArray, radii: FloatArray) -> FloatArray:
    """Radius at which the covered length ends: the outermost half crossing, then the covered area in a window around it."""
    covered = coverage > 0.5
    last = coverage.shape[1] - 1 - np.argmax(covered[:, ::-1], axis=1)
    last = np.where(covered.any(axis=1), last, 0)
    window = round(CLEAR_PX / STEP_PX)
    offsets = np.arange(-window, window + 1)
    index = np.clip(last[:, None] + offsets, 0, coverage.shape[1] - 1)
    local = np.take_along_axis(coverage, index, axis=1)
    start = radii[np.clip(last - window, 0, len(radii) - 1)]
    result: FloatArray = start + (local.sum(axis=1) - 0.5) * STEP_PX
    return result


def fit_circle_robustly(
    points: FloatArray, min_radius_px: float, max_radius_px: float, tolerance_px: float
) -> Circle | None:
    """The circle with the most points within the tolerance, by random triples (seeded: the same answer each time)."""
    if len(points) < 3:
        return None
    random = np.random.default_rng(len(points))
    triples = random.integers(0, len(points), size=(RANDOM_TRIALS, 3))
    a, b, c = points[triples[:, 0]], points[triples[:, 1]], points[triples[:, 2]]
    ab, ac = b - a, c - a
    cross = 2.0 * (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
    usable = np.abs(cross) > 1e-6
    cross = np.where(usable, cross, 1.0)
    ab2, ac2 = (ab**2).sum(axis=1), (ac**2).sum(axis=1)
    offset = (
        np.stack([ac[:, 1] * ab2 - ab[:, 1] * ac2, ab[:, 0] * ac2 - ac[:, 0] * ab2], axis=1) / cross[:, None]
    )
    radius = np.linalg.norm(offset, axis=1)
    usable &= (radius >= min_radius_px) & (radius <= max_radius_px)
    if not usable.any():
        return None
    center = (a + offset)[usable]
    radius = radius[usable]
    away = np.abs(np.linalg.norm(points[None] - center[:, None], axis=2) - radius[:, None])
    votes = np.maximum(0.0, 1.0 - (away / tolerance_px) ** 2).sum(axis=1)
    best = int(np.argmax(votes))
    near = points[away[best] <= tolerance_px]
    refined = _algebraic_circle(near) if len(near) >= 3 else None
    if refined is not None and min_radius_px <= refined.radius_px <= max_radius_px:
        return refined
    return Circle(center[best], float(radius[best]))


def _algebraic_circle(points: FloatArray) -> Circle | None:
    """Least-squares circle `|p|² = 2 p·c + k` (Kåsa)."""
    middle = points.mean(axis=0)
    local = points - middle
    design = np.column_stack([2.0 * local, np.ones(len(local))])
    solution, _, rank, _ = np.linalg.lstsq(design, (local**2).sum(axis=1), rcond=None)
    square = solution[2] + solution[0] ** 2 + solution[1] ** 2
    if rank < 3 or square <= 0.0:
        return None
    return Circle(middle + solution[:2], float(np.sqrt(square)))
