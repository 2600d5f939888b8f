"""Sizes of squares and balls for a distance and a camera, and distinguishable colours."""

from __future__ import annotations

import colorsys
import math
from dataclasses import dataclass

from .._core import MirrorPostureError

SQUARE_PX = 12.0
"""Side of a square's reflection face-on: at 45° the shorter side still has 8 px, twice a corner window's least half."""
BALL_PX = 16.0
"""Diameter of a ball's reflection: its outline is fitted from a radius of 3 px on, and half of it may be hidden."""
BALLS_MM = (6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80)
"""Diameters in which wooden and plastic balls are sold."""
HUE_TOLERANCE_DEG = 15.0
FIRST_HUE_DEG = 0.0
MOST_COLOURS = 8
"""More hues than this lie nearer than three tolerances: cameras of different white balance confuse them."""
NAMES = (
    "red",
    "orange",
    "yellow",
    "lime",
    "green",
    "mint",
    "cyan",
    "azure",
    "blue",
    "violet",
    "magenta",
    "rose",
)


@dataclass(frozen=True)
class BallColour:
    """A colour for a ball: hue in degrees, a name, and a tone for the screen (`#rrggbb`)."""

    hue_deg: float
    name: str
    tone: str


@dataclass(frozen=True)
class Recommendation:
    """Sizes for a distance: minima of `square_m` and `ball_diameter_m`, and one colour for each marker.

    `path_m` is the length of the light's path, camera – mirror – object: about twice the distance to the
    mirror.
    """

    path_m: float
    square_m: float
    ball_diameter_m: float
    colours: tuple[BallColour, ...]


def recommend(distance_m: float, focal_px: float, markers: int = 4) -> Recommendation:
    """Sizes and colours for a mirror at `distance_m` from the camera and the camera's focal length, px.

    An object of size s appears with `f s / L` px at the end of a path of length `L = 2 · distance`. Squares
    get at least 12 px and balls 16 px, rounded up to whole millimetres and to diameters that are sold. The
    hues are evenly spaced.

    Raises:
        MirrorPostureError: a distance or a focal length that is not positive, more markers than distinguishable hues.
    """
    for name, value in (("distance", distance_m), ("focal length", focal_px)):
        if not (math.isfinite(value) and value > 0.0):
            raise MirrorPostureError(f"{name}: got {value!r}, needed a number above 0")
    if not 1 <= markers <= MOST_COLOURS:
        raise MirrorPostureError(
            f"markers: got {markers}, needed 1 to {MOST_COLOURS}: more hues cannot be distinguished"
        )
    path = 2.0 * distance_m
    square = math.ceil(1000.0 * SQUARE_PX * path / focal_px - 1e-9) / 1000.0
    ball_mm = 1000.0 * BALL_PX * path / focal_px
    sold = next((size for size in BALLS_MM if size >= ball_mm), math.ceil(ball_mm))
    colours = []
    for index in range(markers):
        hue = (FIRST_HUE_DEG + 360.0 * index / markers) % 360.0
        red, green, blue = (round(255 * part) for part in colorsys.hsv_to_rgb(hue / 360.0, 0.85, 0.85))
        colours.append(
            BallColour(hue, NAMES[round(hue / 30.0) % len(NAMES)], f"#{red:02x}{green:02x}{blue:02x}")
        )
    return Recommendation(path, square, sold / 1000.0, tuple(colours))
