"""The light of a pane's ghost: its front face also reflects a few hundredths of the light, and shows everything once more, displaced by some pixels.

The edges of a ball and those of its ghost overlap, which pulls the ball's outline towards the ghost, in all of a picture's balls alike: no residual shows it. Where
the board tells the ghost, it is taken off the balls' surroundings, in linear light: S = P − r P(x − d) + r² P(x − 2d), r its strength against the rest. What the
board leaves unknown of it is added to the claims.

Front face and silver are parallel, so the ghost is the picture of everything moved along the mirror's normal n by δ: seen at X it lies at X − δ n, and its
displacement differs across the picture. A ghost that lies elsewhere (a filter before the lens) is the same all over.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from .._core import MirrorPostureError, levels_without_ghost
from ..camera import Camera
from .ball import Circle, OutlineFit
from .types import FloatArray, Pixels

# A ghost d px away pulls an outline whose edges show a blur b by this share of its strength times d exp(−(d / w)²), w so many times b: near ones shift an edge, far ones
# stand beside it. More where a codec has blurred the levels, in which a faint light beside a dark background is much. Measured on drawn balls.
PULL_SHARE, CODED_PULL_SHARE, PULL_WIDTH_OF_BLUR = 0.5, 1.0, 3.7
# So much of the pull may be left when the ghost has been taken off.
LEFT_SHARE = 0.35
# What the front face of a pane returns, as a share of all light, and how far from it that lies, px; so many mirrors have one.
USUAL_STRENGTH, USUAL_SHIFT_PX, UNTOLD_SHARE = 0.035, 3.0, 0.7
# A ghost is a pane's if the board shows it within this angle of where the normal lies (its cosine) and no farther along it than panes are thick, m.
ALONG_NORMAL = 0.94
MOST_MOVED_M = 0.03
# A ball's surroundings that its measurement reads: a share of its radius and some px more.
MARGIN_SHARE, MARGIN_PX = 1.7, 18.0
# A short way along the normal, as a share of the distance.
SHORT = 1e-4
# Steps of the table from light to levels.
STEPS = 1 << 14

_LEVELS = np.arange(256) / 255.0
_LIGHT = np.where(_LEVELS <= 0.04045, _LEVELS / 12.92, ((_LEVELS + 0.055) / 1.055) ** 2.4).astype(np.float32)
_SHARES = np.arange(STEPS + 1) / STEPS
_LEVEL_OF_LIGHT = np.rint(
    255.0 * np.where(_SHARES <= 0.0031308, 12.92 * _SHARES, 1.055 * _SHARES ** (1.0 / 2.4) - 0.055)
).astype(np.uint8)


def linear_light(levels: Pixels) -> Pixels:
    """The light (0..1) of 8-bit levels (sRGB)."""
    result: Pixels = cv2.LUT(levels, _LIGHT)
    return result


@dataclass(frozen=True, eq=False)
class Pane:
    """A mirror whose front face may make a ghost: its unit normal (3,) away from the camera, and how far away from the camera the board's reflection is, m."""

    normal: FloatArray
    distance_m: float
    camera: Camera

    def way_px(self, pixels_px: FloatArray) -> FloatArray | None:
        """How far points seen at pixels `(N, 2)` at that distance go against the normal, `(N, 2)` px for each m; None where the camera does not see them."""
        try:
            rays = self.camera.unproject(pixels_px)
            points = rays / np.linalg.norm(rays, axis=1)[:, None] * self.distance_m
            step = SHORT * self.distance_m
            result: FloatArray = (
                self.camera.project(points - step * self.normal) - self.camera.project(points)
            ) / step
        except MirrorPostureError:
            return None
        return result if np.isfinite(result).all() else None

    def moved_m(self, pixel_px: FloatArray, shift_px: FloatArray) -> float | None:
        """How far apart the faces' pictures are along the normal if a ghost lies `shift_px` (2,) from a pixel (2,); None where no pane's does."""
        ways = self.way_px(pixel_px[None])
        if ways is None:
            return None
        along, square = float(shift_px @ ways[0]), float(ways[0] @ ways[0])
        if not along > ALONG_NORMAL * np.sqrt(square) * float(np.linalg.norm(shift_px)):
            return None
        return along / square if along <= MOST_MOVED_M * square else None


@dataclass(frozen=True)
class Ghost:
    """A second, weaker picture: its share of the light (0: none is told), and where it lies, px, if it lies alike everywhere; the weakest that would be told; how
    probable it is that it is a pane's, whose faces' pictures are so far apart, m."""

    strength: float
    shift_px: tuple[float, float]
    weakest: float = 0.0
    pane: Pane | None = None
    moved_m: float = 0.0
    probability: float = 0.0

    def shifts_at(self, pixel_px: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where it lies at a pixel `(2,)`, px: the more probable of the two, and the other."""
        alike = np.array(self.shift_px)
        ways = None if self.pane is None else self.pane.way_px(pixel_px[None])
        by_pane = alike if ways is None else ways[0] * self.moved_m
        return (by_pane, alike) if self.probability > 0.5 else (alike, by_pane)


def pull_px(strength: float, shift_px: FloatArray, blur_px: float, coded: bool = False) -> FloatArray:
    """How far a ghost draws the outline of a ball whose edges show that blur, `(2,)` px; `coded`: the codec keeps colour coarser than brightness."""
    near = np.exp(-float(shift_px @ shift_px) / (PULL_WIDTH_OF_BLUR * blur_px) ** 2)
    result: FloatArray = (CODED_PULL_SHARE if coded else PULL_SHARE) * strength * near * shift_px
    return result


def surroundings(
    circle: Circle, bgr: npt.NDArray[np.uint8]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """What the measurement of the ball at a circle reads of a picture (H, W, 3): the first pixel (u, v), and the one after the last."""
    size = np.array([bgr.shape[1], bgr.shape[0]])
    reach = MARGIN_SHARE * circle.radius_px + MARGIN_PX
    low = np.clip(np.floor(circle.center_px - reach), 0, size).astype(np.intp)
    high = np.clip(np.ceil(circle.center_px + reach) + 1.0, 0, size).astype(np.intp)
    return low, high


def without_ghost(
    bgr: npt.NDArray[np.uint8], ghost: Ghost | None, circles: Sequence[Circle]
) -> npt.NDArray[np.uint8]:
    """Pixels `(H, W, 3)` BGR without the ghost around circles; elsewhere as they were."""
    if ghost is None or ghost.strength == 0.0 or not circles:
        return bgr
    ratio = ghost.strength / (1.0 - ghost.strength)
    size = np.array([bgr.shape[1], bgr.shape[0]])
    result: npt.NDArray[np.uint8] = bgr.copy()
    for circle in circles:
        shift, _ = ghost.shifts_at(circle.center_px)
        low, high = surroundings(circle, bgr)
        # Twice the shift is read beside it.
        more = np.ceil(2.0 * np.abs(shift)).astype(int) + 1
        first, last = np.maximum(low - more, 0), np.minimum(high + more, size)
        if np.any(high <= low):
            continue
        light = linear_light(bgr[first[1] : last[1], first[0] : last[0]])
        once = moved_by(light, shift)
        part = [*(low - first).tolist(), *(high - first).tolist()]
        result[low[1] : high[1], low[0] : high[0]] = levels_without_ghost(
            [light, once, moved_by(light, 2.0 * shift)], part, ratio, _LEVEL_OF_LIGHT
        )
    return result


def moved_by(light: Pixels, shift_px: FloatArray) -> Pixels:
    """Light (H, W) or (H, W, 3) that lies so far away (2,), px."""
    way = np.array([[1.0, 0.0, shift_px[0]], [0.0, 1.0, shift_px[1]]])
    result: Pixels = cv2.warpAffine(
        light, way, (light.shape[1], light.shape[0]), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return result


def with_ghost_left(fit: OutlineFit | None, ghost: Ghost | None, coded: bool) -> OutlineFit | None:
    """An outline whose covariance holds the pull of what may be left of a ghost."""
    if fit is None or ghost is None:
        return fit
    if ghost.strength == 0.0:
        # One that is too weak for the board to show may be there, on any side.
        pull = pull_px(
            min(ghost.weakest, USUAL_STRENGTH), np.array([USUAL_SHIFT_PX, 0.0]), fit.blur_px, coded
        )
        left = UNTOLD_SHARE * float(pull @ pull) * 0.5 * np.eye(2)
    else:
        told, other = (
            pull_px(ghost.strength, shift, fit.blur_px, coded) for shift in ghost.shifts_at(fit.centroid_px)
        )
        doubt = min(ghost.probability, 1.0 - ghost.probability)
        left = LEFT_SHARE**2 * np.outer(told, told) + doubt * np.outer(other - told, other - told)
    return replace(fit, centroid_covariance_px2=fit.centroid_covariance_px2 + left)
