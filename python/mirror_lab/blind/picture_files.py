"""The drawn pictures of a session as files: blurred, with the sensor's noise."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from .drawing import BLUR_PX, GAMMA, NOISE, View, draw
from .optics import Lens
from .robots import Robot

Array = NDArray[np.float64]


def write_pictures(
    robot: Robot,
    lens: Lens,
    view: View,
    clean_px: tuple[Array, Array],
    folder: Path,
    rng: np.random.Generator,
    renderer: str = "own",
) -> list[str]:
    """One PNG a frame in `folder`; `clean_px` are corners (F, C, 2) and balls (F, M, 2), to know where to look.
    `renderer` is `own` or `mitsuba`. Returns the files' names."""
    folder.mkdir(parents=True, exist_ok=True)
    names = []
    for f in range(len(view.board_m)):
        if renderer == "mitsuba":
            from .mitsuba_pictures import draw as draw_by_mitsuba

            linear = draw_by_mitsuba(robot, lens, view, f)
        else:
            linear = draw(robot, lens, view, f, (clean_px[0][f], clean_px[1][f]))
        blurred = cv2.GaussianBlur(linear, (0, 0), BLUR_PX)
        shown = np.clip(blurred, 0, 1) ** (1 / GAMMA) + rng.normal(0, NOISE, linear.shape)
        name = f"{f:04d}.png"
        cv2.imwrite(str(folder / name), np.clip(np.round(255 * shown[..., ::-1]), 0, 255).astype(np.uint8))
        names.append(name)
    return names
