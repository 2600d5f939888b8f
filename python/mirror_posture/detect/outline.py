"""A ball's outline to a fraction of a pixel, whatever the light on it.

Along rays from the ball's centre, every pixel is unmixed in linear light into the ball's own colour B there and what lies behind, G:
`I = s B + w G`. The share w does not depend on the light on the ball, s not on the light behind it; whichever is the more even of the
two on this ray counts more. The edge lies where the covered length ends: blur, sharpening and the pixels' area leave that in place, if the window over which it
is summed is wide enough, so the window follows the blur that the rays show. Rays that end early (another body part hides the outline) or at a highlight do not agree with a
ball's outline and are left out.

JPEG and most video keep colour at half of the brightness' resolution: an edge of both is then no mixture of two colours any more. Where the file says so, the
brightness is brought to the colour's resolution first (`_at_chroma_resolution`), so that all channels are blurred alike.

The outline of a sphere is a cone of rays: with unit rays r of the edge points, `r · w = 1` for w = axis / cos(half angle), three numbers
(Kanatani, "Geometric Computation for Machine Vision"): fitted in `cone`, it needs only part of the arc.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from ..short_repr import ShortRepr
from .types import FloatArray

STEP_PX = 0.25
# The search along a ray, on both sides of the expected edge, px, and at most this share of the radius inwards.
REACH_PX = 3.0
REACH_SHARE = 0.4
# Half width of the window over which the covered length is summed, for the least blur and for each px of it; at most this share of the radius.
LEAST_WINDOW_PX = 1.75
WINDOW_PER_BLUR = 2.0
WINDOW_SHARE = 0.45
# The blur that a lens and a pixel have, px.
USUAL_BLUR_PX = 0.7
# Width of the zones next to the window in which the two colours are read.
ZONE_PX = 1.5
# Unevenness of a zone that even light and a clean picture leave, as a share of its brightness.
SHARE_FLOOR = 0.02
# Depth inside of the edge over which the trend of the ball's light is read, and how much of it may be wrong at the rim.
TREND_PX = 3.0
TREND_DOUBT = 0.5
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
# Noise from which a picture is smoothed before edges are read, levels, and the most that it is smoothed.
NOISY_LEVELS = 6.0
MOST_SMOOTHING_PX = 1.4
# Levels are about this root of linear light.
ENCODING_POWER = 2.2
# The lens' blur where no ray shows it, and what bilinear sampling adds, px; least contrast of luma (0..1) that shows it.
USUAL_LENS_PX = 0.5
SAMPLING_BLUR_PX = 0.32
MIN_LUMA_CONTRAST = 0.12
# Errors of a coded picture's edges in colour and in luma, px, and how far apart both may be.
CODED_EDGE_FLOOR_PX = 0.07
LUMA_EDGE_FLOOR_PX = 0.2
LUMA_REACH_PX = 1.0


@dataclass(frozen=True, eq=False, repr=False)
class Circle(ShortRepr):
    """A circle in the picture, px."""

    center_px: FloatArray
    radius_px: float


@dataclass(frozen=True, eq=False, repr=False)
class Patch(ShortRepr):
    """A cut-out of a picture: `light` (H, W, 3) float32; `origin_px` is its top-left pixel.

    Light is linear, or, where the codec has blurred the colours, in the codec's levels (0..1, `encoded`): colours mix linearly where they are blurred.
    """

    light: np.ndarray
    origin_px: tuple[int, int]
    encoded: bool = False
    luma: np.ndarray = field(default_factory=lambda: np.zeros((1, 1), np.float32))
    """(H, W), 0..1, as sharp as the codec has it; only where `encoded`."""


@dataclass(frozen=True, eq=False, repr=False)
class Edges(ShortRepr):
    """Edge points `(N, 2)` px, one a ray, their standard deviations along the ray `(N,)` px, `found` `(N,)` where there is one.

    `blur_px` is the standard deviation of the blur that the rays show together.
    """

    points_px: FloatArray
    std_px: FloatArray
    found: np.ndarray
    blur_px: float


def cut_patch(
    bgr: np.ndarray, low: FloatArray, high: FloatArray, chroma_step_px: tuple[int, int] = (1, 1)
) -> Patch:
    """The part of a BGR picture (H, W, 3) uint8 between two corners, px, prepared for reading edges."""
    height, width = bgr.shape[:2]
    # Whole blocks of colour: the codec's grid starts at the picture's corner.
    left, top = (max(int(np.floor(v)) // 4 * 4, 0) for v in low)
    right, bottom = (
        min(int(np.ceil(high[0])) // 4 * 4 + 4, width),
        min(int(np.ceil(high[1])) // 4 * 4 + 4, height),
    )
    part = bgr[top:bottom, left:right]
    noise = _noise_levels(part)
    # The covered length does not mind a blur, and noise does.
    smoothing = min(MOST_SMOOTHING_PX, 0.5 * noise / NOISY_LEVELS) if noise > NOISY_LEVELS else 0.0
    if chroma_step_px != (1, 1):
        blurred = _at_chroma_resolution(part, chroma_step_px)
        luma = cv2.cvtColor(part, cv2.COLOR_BGR2GRAY).astype(np.float32) / np.float32(255.0)
        levels = blurred.astype(np.float32) / np.float32(255.0)
        return Patch(_smoothed(levels, smoothing), (left, top), True, _smoothed(luma, smoothing))
    return Patch(_smoothed(to_linear(part), smoothing), (left, top))


def _smoothed(values: np.ndarray, blur_px: float) -> np.ndarray:
    return values if blur_px <= 0.0 else cv2.GaussianBlur(values, (0, 0), blur_px)


def _noise_levels(bgr: np.ndarray) -> float:
    """Standard deviation of the noise of a channel, levels: the median of mixed differences, which shading and edges hardly touch."""
    if bgr.shape[0] < 3 or bgr.shape[1] < 3:
        return 0.0
    green = bgr[..., 1].astype(np.float32)
    mixed = green[1:, 1:] - green[1:, :-1] - green[:-1, 1:] + green[:-1, :-1]
    return float(np.median(np.abs(mixed))) / 0.6745 / 2.0


def _at_chroma_resolution(bgr: np.ndarray, step: tuple[int, int]) -> np.ndarray:
    """The picture with its luma averaged over the blocks that share a colour, and interpolated between them as decoders do with the colour."""
    height, width = bgr.shape[:2]
    across, down = step
    channels = cv2.cvtColor(bgr, cv2.COLOR_BGR2YCrCb)
    luma = np.ascontiguousarray(channels[..., 0])
    padded = cv2.copyMakeBorder(luma, 0, -height % down, 0, -width % across, cv2.BORDER_REPLICATE)
    small = cv2.resize(
        padded, (padded.shape[1] // across, padded.shape[0] // down), interpolation=cv2.INTER_AREA
    )
    wide = cv2.resize(small, (padded.shape[1], padded.shape[0]), interpolation=cv2.INTER_LINEAR)
    channels[..., 0] = wide[:height, :width]
    return cv2.cvtColor(channels, cv2.COLOR_YCrCb2BGR)


def to_linear(bgr: np.ndarray) -> np.ndarray:
    """Linear light from 8-bit sRGB (IEC 61966-2-1), float32 (H, W, 3). Cameras differ a little; what matters is the curve's bend."""
    result: np.ndarray = _SRGB_TABLE[bgr]
    return result


def _srgb_table() -> np.ndarray:
    value = np.arange(256) / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32)


_SRGB_TABLE = _srgb_table()


def edges_on_rays(
    patch: Patch, center_px: FloatArray, radius_px: FloatArray, angle_rad: FloatArray, blur_px: float
) -> Edges:
    """Sub-pixel edges of the ball's colour along rays `angle_rad` (N,) from a centre, near the expected radii (N,)."""
    direction = np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1)
    mean_radius = float(radius_px.mean())
    window = min(max(LEAST_WINDOW_PX, 0.35 + WINDOW_PER_BLUR * blur_px), WINDOW_SHARE * mean_radius)
    reach = min(REACH_PX, REACH_SHARE * mean_radius)
    inner = min(mean_radius - 0.25, reach + window + TREND_PX)
    offsets = np.arange(-inner, reach + window + ZONE_PX + 0.5 * STEP_PX, STEP_PX)
    at = center_px + direction[:, None, :] * (radius_px[:, None] + offsets[None, :])[..., None]
    colours, inside = _sample(patch.light, at, patch.origin_px)
    # Two passes: the clear zones are set around the expected edge, then around the one found.
    edge = np.zeros(len(angle_rad))
    found = np.ones(len(angle_rad), dtype=bool)
    for _ in range(2):
        coverage, share_std, found = _coverage(colours, offsets, edge, window)
        edge = _edge_offset(coverage, offsets, window)
    floor = EDGE_FLOOR_PX
    if patch.encoded:
        luma, _ = _sample(patch.luma, at, patch.origin_px)
        lens_px = _lens_blur_px(luma, offsets, edge, window)
        edge = edge - _lens_before_codec(colours, offsets, edge, window, lens_px)
        floor = CODED_EDGE_FLOOR_PX
    found &= inside.all(axis=1) & (np.abs(edge) < reach)
    # An error e of the share moves the edge by about e × the width over which it is summed.
    std = np.hypot(floor, window * share_std)
    if patch.encoded:
        # The luma is as sharp as the picture: where ball and background differ in it, it says better where the edge is.
        sharp, sharp_std = _luma_edges(luma, colours, offsets, edge, lens_px)
        std = np.hypot(std, _scatter_px(edge, angle_rad, found))
        sharp_std = np.hypot(sharp_std, _scatter_px(sharp, angle_rad, found & np.isfinite(sharp_std)))
        agrees = np.abs(sharp - edge) < np.maximum(LUMA_REACH_PX, 2.0 * std)
        weight = np.where(agrees, (std / sharp_std) ** 2, 0.0)
        edge = (edge + weight * sharp) / (1.0 + weight)
        std = std / np.sqrt(1.0 + weight)
    blur = _blur_px(coverage, offsets, edge, found, window)
    return Edges(
        center_px + direction * (radius_px + edge)[:, None], std, found, blur_px if blur is None else blur
    )


def _lens_blur_px(levels: FloatArray, offsets: FloatArray, edge: FloatArray, window: float) -> float:
    """Standard deviation of the blur that the luma shows `(N, M)`, px: an edge of contrast c blurred by a Gaussian is c / (σ √2π) steep."""
    distance = offsets[None, :] - edge[:, None]
    ball = _mean_where(levels[..., None], (distance <= -window) & (distance >= -window - ZONE_PX))[:, 0]
    behind = _mean_where(levels[..., None], (distance >= window) & (distance <= window + ZONE_PX))[:, 0]
    steepest = np.abs(np.diff(levels, axis=1) / STEP_PX * (np.abs(distance[:, 1:]) < 1.5)).max(axis=1)
    contrast = np.abs(ball - behind)
    clear = contrast > MIN_LUMA_CONTRAST
    if clear.sum() < MIN_EDGE_POINTS:
        return USUAL_LENS_PX
    shown = float(np.median(contrast[clear] / np.maximum(steepest[clear], 1e-3))) / np.sqrt(2.0 * np.pi)
    # Bilinear sampling widens an edge by itself.
    return float(np.sqrt(np.clip(shown**2 - SAMPLING_BLUR_PX**2, 0.04, 4.0)))


def _scatter_px(edge: FloatArray, angle_rad: FloatArray, valid: np.ndarray) -> float:
    """Standard deviation of edges `(N,)` round a shifted and scaled outline, by the median: what a codec adds does not follow the outline."""
    if valid.sum() < MIN_EDGE_POINTS:
        return 1.0
    basis = np.stack([np.ones_like(angle_rad), np.cos(angle_rad), np.sin(angle_rad)], axis=1)[valid]
    value = edge[valid]
    weight = np.ones(len(value))
    residual = value
    for _ in range(4):
        solution, *_ = np.linalg.lstsq(basis * weight[:, None], value * weight, rcond=None)
        residual = value - basis @ solution
        weight = 1.0 / (1.0 + (residual / max(3.0 * float(np.median(np.abs(residual))), 0.02)) ** 2)
    return 1.4826 * float(np.median(np.abs(residual)))


def _luma_edges(
    luma: FloatArray, colours: FloatArray, offsets: FloatArray, edge: FloatArray, lens_px: float
) -> tuple[FloatArray, FloatArray]:
    """Edges of the luma `(N, M)` near those of the colour, offsets and standard deviations `(N,)` px."""
    window = max(LEAST_WINDOW_PX, 0.35 + WINDOW_PER_BLUR * lens_px)
    found = edge.copy()
    std = np.full(len(edge), np.inf)
    for _ in range(2):
        distance = offsets[None, :] - found[:, None]
        ball_zone = (distance <= -window) & (distance >= -window - ZONE_PX)
        behind_zone = (distance >= window) & (distance <= window + ZONE_PX)
        slope = _slope_where(luma, distance, (distance <= -window) & (distance >= -window - TREND_PX))
        middle = -window - 0.5 * ZONE_PX
        ball = _mean_where(luma[..., None], ball_zone)[:, 0]
        behind = _mean_where(luma[..., None], behind_zone)[:, 0]
        at_rim = ball - slope * middle
        contrast = at_rim - behind
        clear = np.abs(contrast) > MIN_LUMA_CONTRAST
        safe = np.where(clear, contrast, 1.0)
        # The ball's own level along the ray, its trend carried on to the rim.
        own = ball[:, None] + slope[:, None] * (np.minimum(distance, 0.0) - middle)
        difference = own - behind[:, None]
        difference = np.where(np.abs(difference) > 0.4 * np.abs(safe)[:, None], difference, safe[:, None])
        share = np.clip((luma - behind[:, None]) / difference, -0.5, 1.5)
        relative = np.abs(distance)
        weight = np.clip((window + 0.5 * STEP_PX - relative) / STEP_PX, 0.0, 1.0)
        covered = (share * weight).sum(axis=1) * STEP_PX + (2.0 * window - weight.sum(axis=1) * STEP_PX) * 0.5
        step = covered - window
        found = np.where(clear, found + np.clip(step, -1.5, 1.5), edge)
        uneven = np.sqrt(_variance_where(luma, ball_zone) + _variance_where(luma, behind_zone)) / np.abs(safe)
        doubt = TREND_DOUBT * np.abs(slope / safe) * (window + ZONE_PX)
        std = np.where(
            clear, np.sqrt(LUMA_EDGE_FLOOR_PX**2 + (0.5 * window) ** 2 * (uneven**2 + doubt**2)), np.inf
        )
    # What the lens does before the codec, as in the colours.
    weights = np.array([0.114, 0.587, 0.299])
    distance = offsets[None, :] - found[:, None]
    inner = np.clip(_mean_where(colours, (distance <= -window) & (distance >= -window - ZONE_PX)), 0.0, 1.0)
    outer = np.clip(_mean_where(colours, (distance >= window) & (distance <= window + ZONE_PX)), 0.0, 1.0)
    half = (0.5 * (inner**ENCODING_POWER + outer**ENCODING_POWER)) ** (1.0 / ENCODING_POWER)
    contrast = (inner - outer) @ weights
    telling = np.abs(contrast) > 0.5 * MIN_LUMA_CONTRAST
    share_at_half = ((half - outer) @ weights) / np.where(telling, contrast, 1.0)
    bend = np.where(telling, np.clip(share_at_half - 0.5, -0.4, 0.4), 0.0)
    return found - 4.0 * bend * lens_px / np.sqrt(np.pi), std


def _lens_before_codec(
    colours: FloatArray, offsets: FloatArray, edge: FloatArray, window: float, lens_px: float
) -> FloatArray:
    """How far the lens' own blur, which mixes linear light, moves the covered length that is summed in encoded levels, px a ray.

    With g(w) the share that levels show at the share w, close to a parabola with g(1/2) = 1/2 + b/4: `∫ g(Φ(-t/σ)) - Φ(-t/σ) dt = b σ / √π`.
    """
    distance = offsets[None, :] - edge[:, None]
    ball = np.clip(_mean_where(colours, (distance <= -window) & (distance >= -window - ZONE_PX)), 0.0, 1.0)
    behind = np.clip(_mean_where(colours, (distance >= window) & (distance <= window + ZONE_PX)), 0.0, 1.0)
    half = (0.5 * (ball**ENCODING_POWER + behind**ENCODING_POWER)) ** (1.0 / ENCODING_POWER)
    contrast = ball - behind
    share = np.einsum("nc,nc->n", half - behind, contrast) / np.maximum(
        np.einsum("nc,nc->n", contrast, contrast), 1e-6
    )
    result: FloatArray = 4.0 * (share - 0.5) * lens_px / np.sqrt(np.pi)
    return result


def _sample(values: np.ndarray, at: FloatArray, origin: tuple[int, int]) -> tuple[FloatArray, np.ndarray]:
    height, width = values.shape[:2]
    u, v = (at[..., 0] - origin[0]).astype(np.float32), (at[..., 1] - origin[1]).astype(np.float32)
    inside = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
    colours = cv2.remap(values, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return colours.astype(np.float64), inside


def _coverage(
    colours: FloatArray, offsets: FloatArray, edge: FloatArray, window: float
) -> tuple[FloatArray, FloatArray, np.ndarray]:
    """Share of the ball in each sample `(rays, samples)`, its standard deviation by ray, and which rays can tell ball from background."""
    distance = offsets[None, :] - edge[:, None]
    ball_zone = (distance <= -window) & (distance >= -window - ZONE_PX)
    behind_zone = (distance >= window) & (distance <= window + ZONE_PX)
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
    # The ball's share s assumes that its light goes on to the rim as inside of it: the trend there is carried on, and counts as doubt as well.
    trend_zone = (distance <= -window) & (distance >= -window - TREND_PX)
    slope = _slope_where(share_of_ball, distance, trend_zone)
    middle = -window - 0.5 * ZONE_PX
    carried = 1.0 + slope[:, None] * (np.minimum(distance, 0.0) - middle)
    share_of_ball = np.where(distance > -window, share_of_ball / np.clip(carried, 0.4, 2.5), share_of_ball)
    # The share 1 − w assumes an even background. Each counts by how even its zone is.
    variance_ball = (
        _variance_where(share_of_ball, ball_zone)
        + SHARE_FLOOR**2
        + (TREND_DOUBT * slope * (window + ZONE_PX)) ** 2
    )
    variance_behind = _variance_where(share_behind, behind_zone) + SHARE_FLOOR**2
    weight = (variance_behind / (variance_ball + variance_behind))[:, None]
    coverage = weight * share_of_ball + (1.0 - weight) * (1.0 - share_behind)
    std = np.sqrt(variance_ball * variance_behind / (variance_ball + variance_behind))
    return np.clip(coverage, -0.5, 1.5), std, telling


def _slope_where(values: FloatArray, at: FloatArray, where: np.ndarray) -> FloatArray:
    """Least-squares slope of values `(N, M)` over positions `(N, M)`, 1/px."""
    weight = where.astype(np.float64)
    total = np.maximum(weight.sum(axis=1), 1e-9)[:, None]
    local = at - (at * weight).sum(axis=1, keepdims=True) / total
    spread = (local**2 * weight).sum(axis=1)
    result: FloatArray = (local * values * weight).sum(axis=1) / np.maximum(spread, 1e-9)
    return result


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


def _edge_offset(coverage: FloatArray, offsets: FloatArray, window: float) -> FloatArray:
    """Offset at which the covered length ends: the outermost half crossing, then the covered area in a window around it."""
    covered = coverage > 0.5
    last = coverage.shape[1] - 1 - np.argmax(covered[:, ::-1], axis=1)
    last = np.where(covered.any(axis=1), last, 0)
    half = round(window / STEP_PX)
    index = np.clip(last[:, None] + np.arange(-half, half + 1), 0, coverage.shape[1] - 1)
    local = np.take_along_axis(coverage, index, axis=1)
    start = offsets[np.clip(last - half, 0, len(offsets) - 1)]
    result: FloatArray = start + (local.sum(axis=1) - 0.5) * STEP_PX
    return result


def _blur_px(
    coverage: FloatArray, offsets: FloatArray, edge: FloatArray, found: np.ndarray, window: float
) -> float | None:
    """Standard deviation of the blur: for an edge blurred by a Gaussian, `σ² = 2 ∫ |t| (w or 1 − w) dt`, by the median ray."""
    if found.sum() < MIN_EDGE_POINTS:
        return None
    relative = offsets[None, :] - edge[:, None]
    uncovered = np.where(relative > 0.0, coverage, 1.0 - coverage) * np.abs(relative)
    second = 2.0 * (uncovered * (np.abs(relative) <= window + ZONE_PX))[found].sum(axis=1) * STEP_PX
    return float(np.sqrt(np.clip(np.median(second), 0.1, 16.0)))


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
