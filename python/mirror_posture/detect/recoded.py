"""What a coarse codec's errors do to a ball's centre, sampled: the picture is coded once more and measured again.

A JPEG rounds the coefficients of its blocks. A block of colour is as large as a ball, so one rounding moves the edges of a whole side of the ball alike: their
scatter around the outline does not show that. The decoded picture, moved by some pixels against the grid of blocks and coded again with the file's own
tables, has errors of the same kind and size, but others; how far they move the measured centre is known. The same shifts average out such errors in
pictures (Nosratinia, "Enhancement of JPEG-compressed images by re-application of JPEG", 2001).
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from PIL import Image

from ..short_repr import ShortRepr
from .ball import Circle, OutlineFit, Start
from .types import FloatArray, MarkerView

# From this mean step of the finest coefficients on (levels; JPEG quality 88), what a codec adds is sampled: below, scatter shows it.
LEAST_STEP = 3.0
# Side of a block, samples, and the shifts against the grid, samples of colour: each way none twice. Three more give the same claims.
BLOCK = 8
SHIFTS = ((1, 3), (3, 1), (5, 7), (7, 5))
# A ball's surroundings that its measurement reads: a share of its radius and some px more.
MARGIN_SHARE, MARGIN_PX = 1.4, 16.0
# The radius may differ from the one found by this factor.
SIZE_FACTOR = 1.15
# The part of the sampled variance that the edges' scatter does not hold already. Measured on balls of 7 to 13 px at JPEG qualities 20 to 85.
UNSEEN_SHARE = 0.45
# So much of a covariance of a few samples is taken for round.
ROUND_SHARE = 0.5
# A sample in which the ball is lost counts as so many of the others' mean squares.
LOST_SQUARES = 3.0


@dataclass(frozen=True, eq=False, repr=False)
class Codec(ShortRepr):
    """How a JPEG was coded: its tables of steps by number, its kind of sampling (as Pillow counts them), and the pixels that share a colour."""

    tables: dict[int, list[int]]
    sampling: int
    chroma_step_px: tuple[int, int]

    def again(self, bgr: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        """Pixels `(H, W, 3)` BGR, coded and decoded."""
        import simplejpeg

        coded = io.BytesIO()
        Image.fromarray(bgr[..., ::-1]).save(coded, "JPEG", qtables=self.tables, subsampling=self.sampling)
        decoded: npt.NDArray[np.uint8] = simplejpeg.decode_jpeg(coded.getvalue(), "BGR")
        return decoded


Measured = Callable[[npt.NDArray[np.uint8], list[Start]], list[OutlineFit | None]]


def with_recoded(
    bgr: npt.NDArray[np.uint8], views: Sequence[MarkerView], codec: Codec, measured: Measured
) -> list[MarkerView]:
    """Views whose covariance holds the codec's errors: `C + UNSEEN_SHARE · Σ (c_i − c)(c_i − c)ᵀ / n` (px²), c the centre in the picture, c_i in each recoded one."""
    indices = [i for i, view in enumerate(views) if view.ok and view.outline is not None]
    if not indices:
        return list(views)
    starts = [_start(views[i]) for i in indices]
    centres = []
    for picture in (bgr, *(_moved_against_blocks(bgr, starts, codec, shift) for shift in SHIFTS)):
        centres.append(
            [np.full(2, np.nan) if fit is None else fit.centroid_px for fit in measured(picture, starts)]
        )
    away = np.array(centres[1:]) - np.array(centres[0])
    result = list(views)
    for place, index in enumerate(indices):
        more = _variance(away[:, place])
        covariance = views[index].covariance_px2
        if more is not None and covariance is not None:
            result[index] = replace(views[index], covariance_px2=covariance + UNSEEN_SHARE * more)
    return result


def _start(view: MarkerView) -> Start:
    assert view.outline is not None and view.pixel_px is not None
    radius = float(np.sqrt(view.outline.semi_major_px * view.outline.semi_minor_px))
    return Start(Circle(np.array(view.pixel_px), radius), radius / SIZE_FACTOR, radius * SIZE_FACTOR)


def _moved_against_blocks(
    bgr: npt.NDArray[np.uint8], starts: Sequence[Start], codec: Codec, shift: tuple[int, int]
) -> npt.NDArray[np.uint8]:
    """The picture with the surroundings of each ball coded again on a grid of blocks that is moved by a shift (samples of colour, across and down)."""
    step = np.array(codec.chroma_step_px)
    side, moved = BLOCK * step, np.array(shift) * step
    size = np.array([bgr.shape[1], bgr.shape[0]])
    result: npt.NDArray[np.uint8] = bgr.copy()
    for start in starts:
        reach = MARGIN_SHARE * start.circle.radius_px + MARGIN_PX
        # Whole blocks of the moved grid: where the surroundings of two balls overlap, both give the same.
        low = np.floor((start.circle.center_px - reach - moved) / side).astype(int) * side + moved
        high = np.ceil((start.circle.center_px + reach - moved) / side).astype(int) * side + moved
        left, top = np.where(low < 0, moved, low)
        right, bottom = np.minimum(high, size)
        if right > left and bottom > top:
            part = np.ascontiguousarray(bgr[top:bottom, left:right])
            result[top:bottom, left:right] = codec.again(part)
    return result


def _variance(away: FloatArray) -> FloatArray | None:
    """Mean square of centres `(N, 2)` around zero, px²; None where hardly any are known."""
    known = away[np.isfinite(away).all(axis=1)]
    if len(known) < 2:
        return None
    lost = 1.0 - len(known) / len(away)
    square = known.T @ known / len(known) * (1.0 + (LOST_SQUARES - 1.0) * lost)
    result: FloatArray = (1.0 - ROUND_SHARE) * square + ROUND_SHARE * 0.5 * np.trace(square) * np.eye(2)
    return result
