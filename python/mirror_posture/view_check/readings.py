"""The usual mistakes: other interpretations of a session, and how to correct each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from ..arrays import Floats
from ..short_repr import ShortRepr

PixelMap = Callable[[Floats, float, float], Floats]


@dataclass(frozen=True, eq=False, repr=False)
class Reading(ShortRepr):
    """One interpretation of a session: what was done to pictures, labels, board and camera, and how to
    correct it."""

    name: str
    said: str = ""
    fix: str = ""
    mistakes: int = 0
    effect: str = ""
    """The cause by which a diagnosis names it; empty where its vocabulary has no word."""
    pixels: str = "as they are"
    labels: str = "as they are"
    board_from_meant: Floats = field(default_factory=lambda: np.eye(4))
    camera_from_meant: Floats = field(default_factory=lambda: np.eye(4))
    camera_factor: float = 1.0
    focal_factor: float = 1.0
    square_factor: float = 1.0


# What a driver does to a picture of width w and height h, and that done back: from the pixels given to those meant.
PIXELS: dict[str, PixelMap] = {
    "as they are": lambda p, w, h: p,
    "mirrored left-right": lambda p, w, h: np.stack([w - 1 - p[..., 0], p[..., 1]], axis=-1),
    "mirrored up-down": lambda p, w, h: np.stack([p[..., 0], h - 1 - p[..., 1]], axis=-1),
    "turned by 180°": lambda p, w, h: np.stack([w - 1 - p[..., 0], h - 1 - p[..., 1]], axis=-1),
    "turned by 90° to the right": lambda p, w, h: np.stack([p[..., 1], h - 1 - p[..., 0]], axis=-1),
    "turned by 90° to the left": lambda p, w, h: np.stack([w - 1 - p[..., 1], p[..., 0]], axis=-1),
}
_FLIPS = ("mirrored left-right", "mirrored up-down")
_QUARTERS = ("turned by 90° to the right", "turned by 90° to the left")
_FLIP_FIX = {
    "mirrored left-right": "switch the driver's mirroring off, or mirror the pictures back (u becomes W - 1 - u), and detect again",
    "mirrored up-down": "switch the driver's flip off, or mirror the pictures back (v becomes H - 1 - v), and detect again",
    "turned by 180°": "switch the driver's rotation off, or turn the pictures back by 180°, and detect again",
    "turned by 90° to the right": "turn the pictures back by 90° to the left, and detect again",
    "turned by 90° to the left": "turn the pictures back by 90° to the right, and detect again",
}


def _turned_board(quarters: int) -> Floats:
    c, s = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][quarters % 4]
    turn = np.eye(4)
    turn[:2, :2] = [[c, -s], [s, c]]
    return turn


# A camera body's frame (x forward, z up) in its optical frame (z forward, x right): REP 103.
_OPTICAL_FROM_BODY = np.array([[0.0, -1.0, 0, 0], [0.0, 0, -1.0, 0], [1.0, 0, 0, 0], [0, 0, 0, 1.0]])


def usual_mistakes(corners: tuple[int, int], square_picture: bool) -> Iterator[Reading]:
    """All readings that one usual mistake makes, and those that two make which come together."""
    nx, ny = corners
    pixels = [*_FLIPS, "turned by 180°", *(_QUARTERS if square_picture else ())]
    for name in pixels:
        word = "" if name in _QUARTERS else "picture_flipped"
        one = Reading(name, f"the pictures are {name}", _FLIP_FIX[name], 1, word, pixels=name)
        # If a flipped view is flipped back, its labels change handedness, because the detector took the board
        # for a mirrored one. The dark square diagonally outside corner 0 shows which axis it reversed, if the
        # counts differ in parity.
        swaps = ("as they are",) if name not in _FLIPS else _natural_swaps(nx, ny)
        for labels in dict.fromkeys(("as they are", *swaps)):
            yield replace(one, labels=labels)
        # The same, and the board counted from the other end.
        if name in _FLIPS:
            for labels in ("reversed in x", "reversed in y"):
                if labels not in swaps:
                    yield replace(
                        one,
                        labels=labels,
                        mistakes=2,
                        said=f"{one.said}, and the board is mounted turned by 180°",
                    )
    for quarters in (2, 1, 3) if nx != ny else (1, 2, 3):
        # A board of other counts along x and y cannot be counted turned by 90°.
        counted = ", or its corners are counted," if quarters == 2 or nx == ny else ""
        yield Reading(
            f"board turned by {90 * quarters}°",
            f"the board is mounted{counted} turned by {90 * quarters}° against the URDF",
            f"turn the board, or its link [board] link, by {90 * quarters}° about its z axis",
            1,
            "board_turned",
            board_from_meant=_turned_board(quarters),
        )
    for axis in ("x", "y"):
        yield Reading(
            f"labels reversed in {axis}",
            f"the corners are counted against the board's {axis} axis (as OpenCV counts a board seen directly)",
            f"count them along it: index = iy * {nx} + ix from the corner at -x, -y, z out of the printed face",
            1,
            labels=f"reversed in {axis}",
        )
    yield Reading(
        "camera body",
        "[camera_mount] link is the camera's body (x forward), not its optical frame (z forward, x right, y down)",
        "name the optical frame's link, or add one to the URDF, turned by rpy = -pi/2, 0, -pi/2 against the body",
        1,
        camera_from_meant=_OPTICAL_FROM_BODY,
    )


def _natural_swaps(nx: int, ny: int) -> tuple[str, ...]:
    if nx % 2 == ny % 2:
        return ("reversed in x", "reversed in y")
    return ("reversed in y",) if nx % 2 == 1 else ("reversed in x",)
