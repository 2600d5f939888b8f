"""A camera's sharpening, told by the board, and undone.

Cameras sharpen levels, not light: `L' = L − k ∇²L`, k in px². In levels an edge stays where it was, for what is added on one side is taken off on the other. In light,
where balls' edges are read, the two are not alike, and all balls of a picture are displaced alike: no residual shows it. The inverse of the sharpening, `1 / (1 + k |ω|²)`,
is a mild blur, so it is simply taken off. Pictures whose codec keeps colour coarsely are left as they are: there edges are read in levels.

How strong it is the board's pattern M shows, blurred by b in light: k and b by least squares of the levels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, lru_cache

import cv2
import numpy as np
import numpy.typing as npt

from .ball import Circle
from .drawn import DrawnBoard
from .ghost import board_ghost, with_ghost
from .ghost_light import Ghost, Pane, surroundings
from .types import FloatArray, Pixels

# Blurs of the pattern to begin with, px, the range of the blur, px, and of the strength, px²: cameras' own sharpening has up to 0.3.
START_BLURS_PX = (0.45, 0.8, 1.5)
BLUR_RANGE_PX = (0.25, 3.0)
MOST_STRENGTH_PX2 = 0.6
# Steps of the least squares, and how far the two are moved for its derivatives: px², and a share of the blur.
ROUNDS = 3
MOVED_PX2, MOVED_SHARE = 0.08, 0.15
# Levels (0..1) nearer to the ends may be cut off, and pixels nearer to the border mix with what is not drawn.
CLEAR_LEVELS = 0.01
CLEAR_PX = 4
LEAST_PIXELS = 100
# So many pixels share their errors: those of the drawing are as long as its edges.
SHARED_PIXELS = 10.0
# A sharpening is told from so many deviations on.
TOLD_DEVIATIONS = 2.0
# Pixels each way of the inverse, and of the grid of frequencies on which it is made.
REACH_PX, FREQUENCIES = 3, 32
_CROSS = np.array([[0.0, -1.0, 0.0], [-1.0, 4.0, -1.0], [0.0, -1.0, 0.0]], dtype=np.float32)


def ghost_and_sharpening(drawn: DrawnBoard, pane: Pane | None) -> tuple[Ghost | None, float]:
    """The ghost and the strength of the sharpening (px²) that a drawn board shows.

    A ghost is looked for where the sharpening is undone; it hides some of the sharpening, which is therefore told once more by the pattern with its ghost.
    """
    strength = board_sharpening_px2(drawn)
    ghost = board_ghost(replace(drawn, gray=undone(drawn.gray, strength)), pane)
    if strength > 0.0 and ghost is not None and ghost.strength > 0.0:
        strength = board_sharpening_px2(with_ghost(drawn, ghost))
    return ghost, strength


def board_sharpening_px2(drawn: DrawnBoard) -> float:
    """The strength k of the sharpening that a view of the board shows, px²; 0 where it shows none."""
    levels = drawn.gray.astype(np.float32) / np.float32(255.0)
    told = (levels > CLEAR_LEVELS) & (levels < 1.0 - CLEAR_LEVELS)
    told[:CLEAR_PX] = told[-CLEAR_PX:] = told[:, :CLEAR_PX] = told[:, -CLEAR_PX:] = False
    if int(told.sum()) < LEAST_PIXELS:
        return 0.0
    seen = levels[told]
    patterns: dict[float, tuple[Pixels, Pixels, Pixels]] = {}
    lights: dict[float, tuple[Pixels, Pixels]] = {}

    @cache
    def model(strength: float, blur: float) -> FloatArray:
        """Levels of the pattern with the contrast that the light has when the sharpening is undone."""
        if strength not in lights:
            light = _light_of(undone(levels, strength))
            lights[strength] = (light, drawn.mean(light))
        if blur not in patterns:
            pattern: Pixels = cv2.GaussianBlur(drawn.pattern, (0, 0), blur)
            even = drawn.mean(pattern)
            variance = np.maximum(drawn.mean(pattern * pattern) - even * even, np.float32(1e-4))
            patterns[blur] = (pattern, even, variance)
        pattern, even, variance = patterns[blur]
        light, middle = lights[strength]
        shown = middle + (drawn.mean(pattern * light) - even * middle) / variance * (pattern - even)
        without = _level_of(shown)
        sharpened = without
        if strength > 0.0:
            sharpened = without + np.float32(strength) * cv2.filter2D(
                without, -1, _CROSS, borderType=cv2.BORDER_REPLICATE
            )
        result: FloatArray = sharpened[told].astype(np.float64)
        return result

    strength = 0.0
    blur = min(START_BLURS_PX, key=lambda one: float(np.sum((seen - model(0.0, one)) ** 2)))
    std = np.inf
    for _ in range(ROUNDS):
        here = model(strength, blur)
        rows = np.stack(
            [
                (model(strength + MOVED_PX2, blur) - here) / MOVED_PX2,
                (model(strength, (1.0 + MOVED_SHARE) * blur) - here) / (MOVED_SHARE * blur),
            ]
        )
        left = seen - here
        normal = rows @ rows.T
        normal[np.diag_indices(2)] *= 1.0 + 1e-3
        inverse = np.linalg.inv(normal + 1e-12 * np.eye(2))
        step = inverse @ (rows @ left)
        strength = float(np.clip(strength + step[0], 0.0, MOST_STRENGTH_PX2))
        blur = float(np.clip(blur + np.clip(step[1], -0.3 * blur, 0.4 * blur), *BLUR_RANGE_PX))
        std = float(np.sqrt(SHARED_PIXELS * np.mean(left**2) * inverse[0, 0]))
        if strength == 0.0:
            break
    return strength if strength > TOLD_DEVIATIONS * std else 0.0


def _light_of(levels: Pixels) -> Pixels:
    """sRGB's light (0..1) of levels (0..1)."""
    curved: Pixels = cv2.pow((levels + np.float32(0.055)) / np.float32(1.055), 2.4)
    return np.where(levels <= 0.04045, levels / np.float32(12.92), curved)


def _level_of(light: Pixels) -> Pixels:
    curved: Pixels = np.float32(1.055) * cv2.pow(np.maximum(light, 0.0), 1.0 / 2.4) - np.float32(0.055)
    return np.where(light <= 0.0031308, np.float32(12.92) * light, curved)


@lru_cache(maxsize=64)
def _inverse(strength_px2: float) -> Pixels:
    """The kernel of `1 / (1 + k |ω|²)`, ω² of the five-point Laplacian."""
    cosine = np.cos(2.0 * np.pi * np.fft.fftfreq(FREQUENCIES))
    gain = 1.0 + strength_px2 * (4.0 - 2.0 * cosine[:, None] - 2.0 * cosine[None, :])
    side = slice(FREQUENCIES // 2 - REACH_PX, FREQUENCIES // 2 + REACH_PX + 1)
    kernel = np.fft.fftshift(np.real(np.fft.ifft2(1.0 / gain)))[side, side]
    result: Pixels = (kernel / kernel.sum()).astype(np.float32)
    return result


def undone(levels: Pixels, strength_px2: float) -> Pixels:
    """Levels (H, W) or (H, W, 3) before a sharpening; in their own type."""
    if strength_px2 == 0.0:
        return levels
    result: Pixels = cv2.filter2D(levels, -1, _inverse(strength_px2), borderType=cv2.BORDER_REPLICATE)
    return result


def falling(levels: Pixels, strength_px2: float) -> Pixels:
    """How much levels (H, W), of which a sharpening was undone, fall for each px² of more that is undone: `|ω|² / (1 + k |ω|²)` of them, 0..1."""
    shares = levels.astype(np.float32) / np.float32(255.0)
    result: Pixels = cv2.filter2D(undone(shares, strength_px2), -1, _CROSS, borderType=cv2.BORDER_REPLICATE)
    return result


def without_sharpening(
    bgr: npt.NDArray[np.uint8], strength_px2: float, circles: Sequence[Circle]
) -> npt.NDArray[np.uint8]:
    """Pixels `(H, W, 3)` BGR before the sharpening around circles; elsewhere as they were."""
    if strength_px2 == 0.0 or not circles:
        return bgr
    result: npt.NDArray[np.uint8] = bgr.copy()
    for circle in circles:
        (left, top), (right, bottom) = surroundings(circle, bgr)
        if right > left and bottom > top:
            result[top:bottom, left:right] = undone(bgr[top:bottom, left:right], strength_px2)
    return result
