"""What a coarse JPEG's rounding does to balls' centres: added to their covariances. The core samples it (`mirror_core::outline::codec_covariance`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .. import _core
from ..camera import Camera
from ..short_repr import ShortRepr
from .types import MarkerView

# From this mean step of the finest coefficients on (levels; JPEG quality 88), what a codec adds is sampled: below, scatter shows it.
LEAST_STEP = 3.0
# The radius may differ from the one found by this factor.
SIZE_FACTOR = 1.15


@dataclass(frozen=True, eq=False, repr=False)
class Codec(ShortRepr):
    """How a JPEG was coded: the steps of its coefficients of brightness and of colour (64 each, row by row), and the pixels across and down that share a colour."""

    luma_steps: tuple[int, ...]
    chroma_steps: tuple[int, ...]
    sampling_px: tuple[int, int]


def with_codec_errors(
    bgr: npt.NDArray[np.uint8],
    views: Sequence[MarkerView],
    codec: Codec,
    camera: Camera,
    chroma_step_px: tuple[int, int],
    blurs_px: Mapping[tuple[float, float], float] | None = None,
) -> list[MarkerView]:
    """Views whose covariance holds the codec's errors too (px²); `chroma_step_px`: pixels that share a colour, as the balls were measured; `blurs_px`: their blur
    by their centre, standard deviation, where it is alike in all directions: where it is not known it is looked for."""
    indices = [i for i, view in enumerate(views) if view.ok and view.outline is not None]
    result = list(views)
    if not indices:
        return result
    circles = np.array([_circle(views[i]) for i in indices])
    radii = np.outer(circles[:, 2], [1.0 / SIZE_FACTOR, SIZE_FACTOR])
    added = _core.codec_covariances(
        np.ascontiguousarray(bgr),
        circles,
        radii,
        camera.core,
        chroma_step_px,
        [list(codec.luma_steps), list(codec.chroma_steps)],
        codec.sampling_px,
        [(blurs_px or {}).get(views[i].pixel_px or (0.0, 0.0)) for i in indices],
    )
    for index, more in zip(indices, added, strict=True):
        covariance = views[index].covariance_px2
        if more is not None and covariance is not None:
            uu, uv, vv = more
            result[index] = replace(views[index], covariance_px2=covariance + np.array([[uu, uv], [uv, vv]]))
    return result


def _circle(view: MarkerView) -> tuple[float, float, float]:
    assert view.outline is not None and view.pixel_px is not None
    return (*view.pixel_px, float(np.sqrt(view.outline.semi_major_px * view.outline.semi_minor_px)))
