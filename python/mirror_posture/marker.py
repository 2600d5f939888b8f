"""Markers: balls on the robot's links, and the colours by which they are found."""

from __future__ import annotations

import colorsys
from dataclasses import dataclass

from ._core import MirrorPostureError
from .formats.keys import finite


@dataclass(frozen=True)
class ColorRange:
    """A marker's colour as a box in HSV: hue in degrees (circular), saturation and value in 0..1.

    Raises `MirrorPostureError` for a number outside its range.
    """

    hue_deg: float
    hue_tolerance_deg: float
    min_saturation: float = 0.5
    min_value: float = 0.25

    def __post_init__(self) -> None:
        if not (finite(self.hue_deg) is not None and 0.0 <= self.hue_deg < 360.0):
            raise MirrorPostureError(f"color hue = {self.hue_deg}: needs degrees in [0, 360)")
        if not (finite(self.hue_tolerance_deg) is not None and 0.0 < self.hue_tolerance_deg <= 180.0):
            raise MirrorPostureError(
                f"color hue_tolerance = {self.hue_tolerance_deg}: needs degrees in (0, 180]"
            )
        for name, value in (("min_saturation", self.min_saturation), ("min_value", self.min_value)):
            if not (finite(value) is not None and 0.0 <= value <= 1.0):
                raise MirrorPostureError(f"color {name} = {value}: needs a number in [0, 1] (not 0 to 255)")


@dataclass(frozen=True)
class Marker:
    """A ball (or an ideal point, `diameter_m` 0) on a link."""

    name: str
    link: str = ""
    """The link whose origin is the ball's centre; empty where there is no robot."""
    diameter_m: float = 0.0
    mount_known: bool = True
    """Whether its place on the link is known: an unknown one is estimated along with the causes."""
    color: ColorRange | None = None
    """None for a marker that is not looked for in pictures."""
    tolerance_m: float | None = None
    """One standard deviation by which the real place may differ from the URDF's; 0: exact; None: not
    stated."""

    def rgb(self, saturation: float = 0.85, value: float = 0.85) -> tuple[float, float, float]:
        """Red, green and blue, 0 to 1, in which the marker is drawn: its hue; grey for a marker without colour."""
        if self.color is None:
            return value, value, value
        return colorsys.hsv_to_rgb(self.color.hue_deg / 360.0, saturation, value)
