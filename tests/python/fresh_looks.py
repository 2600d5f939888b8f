"""What the pictures of `fresh_scene.py` ask for: geometry, light, lens, sensor, curve and codec of each variant."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from PIL import Image

Array = Any
COLUMNS, ROWS, SQUARE_M = 7, 4, 0.012


@dataclass
class Look:
    """What a variant asks for; ranges are (low, high)."""

    size_px: tuple[int, int] = (800, 600)
    radius_px: tuple[float, float] = (9.0, 20.0)
    hidden: tuple[float, float] = (0.0, 0.0)
    cast_shadow: bool = False
    sun: tuple[float, float] = (0.3, 0.9)
    gloss: float = 0.0
    clutter: tuple[float, float] | None = None
    texture: float = 0.25
    blur_px: tuple[float, float] = (0.4, 0.6)
    disc_px: float = 0.0
    shake_px: float = 0.0
    ghost: tuple[float, float] = (0.02, 0.05)
    """The front face's reflection, as a share of the silver's: a pane always has one."""
    vignette: float = 0.15
    rolling_px: float = 0.0
    light: float = 1.0
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)
    bayer: bool = False
    photons: float = 6000.0
    read_levels: float = 0.4
    sharpen: float = 0.0
    gamma: float = 0.0
    """0: sRGB's curve."""
    code: Callable[[Array], bytes | Array] | None = None


def jpeg(quality: int, subsampling: int) -> Callable[[Array], bytes]:
    def code(rgb: Array) -> bytes:
        place = io.BytesIO()
        Image.fromarray(rgb).save(place, "JPEG", quality=quality, subsampling=subsampling)
        return place.getvalue()

    return code


def webp(quality: int) -> Callable[[Array], bytes]:
    def code(rgb: Array) -> bytes:
        place = io.BytesIO()
        Image.fromarray(rgb).save(place, "WEBP", quality=quality)
        return place.getvalue()

    return code


def decoded(coder: Callable[[Array], bytes]) -> Callable[[Array], Array]:
    """A coded picture that a program has decoded and kept without loss: the file no longer says what was lost."""
    return lambda rgb: np.asarray(Image.open(io.BytesIO(coder(rgb))).convert("RGB"))[..., ::-1].copy()


def yuyv(rgb: Array) -> Array:
    """What a webcam's YUYV gives: two neighbours share a colour, repeated."""
    ycc = cv2.cvtColor(rgb, cv2.COLOR_RGB2YCrCb).astype(float)
    pairs = 0.5 * (ycc[:, 0::2, 1:] + ycc[:, 1::2, 1:])
    ycc[..., 1:] = np.repeat(pairs, 2, axis=1)
    return cv2.cvtColor(np.rint(ycc).clip(0, 255).astype(np.uint8), cv2.COLOR_YCrCb2BGR)


LOOKS: dict[str, Look] = {
    "plain": Look(),
    "no ghost (silver in front)": Look(ghost=(0.0, 0.0)),
    "soft sky, no sun": Look(sun=(0.0, 0.0)),
    "hard sun": Look(sun=(0.9, 0.97)),
    "hard sun, cast shadows": Look(sun=(0.9, 0.97), cast_shadow=True),
    "gloss": Look(gloss=0.6),
    "busy background": Look(texture=0.8),
    "Bayer": Look(bayer=True, photons=3000.0),
    "Bayer, sharpened": Look(bayer=True, photons=3000.0, sharpen=1.0),
    "Bayer, low light": Look(bayer=True, photons=150.0, read_levels=1.5),
    **{
        f"radius {a} to {b} px": Look(radius_px=(a, b)) for a, b in ((3.2, 4.5), (4.5, 7), (20, 34), (34, 60))
    },
    "radius 34 to 60 px, hard sun": Look(radius_px=(34, 60), sun=(0.9, 0.97)),
    "radius 34 to 60 px, soft, hidden": Look(radius_px=(34, 60), blur_px=(1.5, 2.5), hidden=(0.1, 0.3)),
    **{
        f"hidden {int(100 * a)} to {int(100 * b)} %": Look(hidden=(a, b))
        for a, b in ((0.1, 0.2), (0.2, 0.35), (0.35, 0.5))
    },
    "hidden, hard sun": Look(hidden=(0.1, 0.45), sun=(0.9, 0.97), cast_shadow=True),
    "hidden, JPEG 4:2:0 q80 to 95": Look(hidden=(0.1, 0.4), code=jpeg(90, 2)),
    "same hue near": Look(clutter=(2.3, 4.0)),
    "same hue touching": Look(clutter=(1.1, 1.9)),
    "same hue far": Look(clutter=(5.0, 9.0)),
    "same hue near, JPEG 4:2:0 q85": Look(clutter=(2.2, 3.5), code=jpeg(85, 2)),
    **{f"defocus of a disc of {d} px": Look(disc_px=d) for d in (1.5, 3.0)},
    **{f"Gauss {b} px": Look(blur_px=(b, b)) for b in (0.2, 1.0, 1.8, 2.6)},
    **{f"shake {s} px": Look(shake_px=s) for s in (2.0, 5.0, 8.0)},
    "ghost 8 to 12 %": Look(ghost=(0.08, 0.12)),
    "vignette 60 %": Look(vignette=0.6),
    "rolling shutter 8 px": Look(rolling_px=8.0),
    **{f"light × {g}": Look(light=g, photons=6000.0 * g, read_levels=1.0) for g in (1.6, 0.4, 0.15, 0.06)},
    "warm": Look(tint=(1.25, 1.0, 0.72)),
    "cold": Look(tint=(0.78, 1.0, 1.25)),
    "gamma 1.8": Look(gamma=1.8),
    "gamma 2.6": Look(gamma=2.6),
    "noise": Look(photons=400.0, read_levels=3.0),
    "much noise": Look(photons=80.0, read_levels=6.0),
    "sharpened": Look(sharpen=0.8),
    "sharpened strongly": Look(sharpen=2.0),
    **{f"JPEG 4:4:4 q{q}": Look(code=jpeg(q, 0)) for q in (95, 85, 70, 45, 25)},
    **{f"JPEG 4:2:2 q{q}": Look(code=jpeg(q, 1)) for q in (90, 70)},
    **{f"JPEG 4:2:0 q{q}": Look(code=jpeg(q, 2)) for q in (98, 95, 92, 88, 80, 70, 55, 35, 20)},
    "JPEG 4:2:0 q92, sharpened": Look(code=jpeg(92, 2), sharpen=1.0),
    "JPEG 4:2:0 q92, hard sun": Look(code=jpeg(92, 2), sun=(0.9, 0.97)),
    "JPEG 4:2:0 q92, kept as PNG": Look(code=decoded(jpeg(92, 2))),
    "WebP q90": Look(code=webp(90)),
    "YUYV, kept as PNG": Look(code=yuyv),
    "phone": Look(bayer=True, photons=2500.0, sharpen=1.2, code=jpeg(93, 2), sun=(0.6, 0.9), gloss=0.2),
    "webcam": Look(
        size_px=(640, 480),
        bayer=True,
        photons=500.0,
        read_levels=1.5,
        sharpen=0.6,
        blur_px=(0.7, 1.0),
        code=jpeg(75, 1),
    ),
}
