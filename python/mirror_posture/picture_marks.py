"""Marks in pictures for people: rings and crosses with a dark rim, and text on a dark plate."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from .arrays import Floats

Pixels = npt.NDArray[Any]
"""A picture as OpenCV holds it: (H, W, 3) uint8, BGR."""
MEASURED_BGR = (80, 230, 80)
"""Green: what was measured."""
WANTED_BGR = (60, 60, 255)
"""Red: the model, or the target."""
SHIFT = 4
"""Fractional bits of OpenCV's drawing coordinates."""
WHITE = (255, 255, 255)


def draw_mark(
    canvas: Pixels,
    shape: str,
    at: Floats,
    color: tuple[int, int, int],
    scale: int,
) -> None:
    """A `ring` or a `cross` at a sub-pixel position, with a dark rim so that it shows on a ball of its own colour."""
    x, y = (int(v) for v in np.round(at * 2**SHIFT))
    for ink, weight in (((0, 0, 0), 3 * scale), (color, scale)):
        if shape == "ring":
            cv2.circle(canvas, (x, y), (9 * scale) << SHIFT, ink, weight, cv2.LINE_AA, SHIFT)
            continue
        arm = (5 * scale) << SHIFT
        for dx, dy in ((arm, arm), (arm, -arm)):
            cv2.line(canvas, (x - dx, y - dy), (x + dx, y + dy), ink, weight, cv2.LINE_AA, SHIFT)


def draw_label(canvas: Pixels, text: str, at: tuple[int, int], size: float) -> None:
    """Text on a dark plate; `at` is the left end of its baseline."""
    (width, height), base = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    x, y = at
    plate = canvas[max(y - height - 4, 0) : y + base + 2, max(x - 4, 0) : x + width + 4]
    plate[:] = (plate * 0.35).astype(np.uint8)
    cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, WHITE, 1, cv2.LINE_AA)
