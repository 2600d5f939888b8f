"""Mounts on a robot as a person states them: a link, a place on it, a viewing direction, an upward
direction."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .._core import MirrorPostureError
from ..arrays import Floats

Vector = tuple[float, float, float]
LEAST_ANGLE_RAD = math.radians(5.0)
"""Directions that are nearer to parallel than this do not define an upward direction."""


@dataclass(frozen=True)
class CameraMount:
    """The camera: its optical centre on a link (m), its viewing direction and the upward direction of its
    picture, in the link's frame.

    Without a place the link itself is the optical frame (z forward, x right, y down).
    """

    link: str
    at_m: Vector | None = None
    looks: Vector = (1.0, 0.0, 0.0)
    up: Vector = (0.0, 0.0, 1.0)
    tolerance_m: float | None = None
    tolerance_rad: float | None = None

    def link_from_mount(self) -> Floats:
        """The optical frame on its link, (4, 4): z where it looks, y down."""
        forward, up = _across(self.looks, self.up, "--camera-looks", "--camera-up")
        return _pose(self.at_m, np.stack([np.cross(-up, forward), -up, forward], axis=1))


@dataclass(frozen=True)
class FaceMount:
    """The board: its centre on a link (m), where its printed face looks and where its arrow y points, in the link's frame."""

    link: str
    at_m: Vector | None = None
    faces: Vector = (1.0, 0.0, 0.0)
    up: Vector = (0.0, 0.0, 1.0)
    tolerance_m: float | None = None
    tolerance_rad: float | None = None

    def link_from_mount(self) -> Floats:
        """The board's frame on its link, (4, 4): z out of the printed face, y up."""
        out, up = _across(self.faces, self.up, "--board-faces", "--board-up")
        return _pose(self.at_m, np.stack([np.cross(up, out), up, out], axis=1))


@dataclass(frozen=True)
class MarkerMount:
    """A marker: its name, its link and its centre on it, m."""

    name: str
    link: str
    at_m: Vector
    tolerance_m: float | None = None

    def link_from_mount(self) -> Floats:
        """The marker's frame on its link, (4, 4), with the link's axes."""
        return _pose(self.at_m, np.eye(3))


def parse_vector(text: str, option: str) -> Vector:
    """`X,Y,Z` as three finite numbers. Raises `MirrorPostureError` that names the option."""
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise MirrorPostureError(f"{option}: got {text!r}, needed X,Y,Z, as in 0.1,0,-0.02") from None
    if not all(math.isfinite(part) for part in (x, y, z)):
        raise MirrorPostureError(f"{option}: got {text!r}, needed finite numbers")
    return x, y, z


def parse_marker(text: str, tolerance_m: float | None) -> MarkerMount:
    """`NAME=LINK@X,Y,Z`. Raises `MirrorPostureError`."""
    name, equals, rest = text.partition("=")
    link, at, place = rest.rpartition("@")
    if not (equals and at and name.strip() and link.strip()):
        raise MirrorPostureError(
            f"--marker: got {text!r}, needed NAME=LINK@X,Y,Z (m, in the link's frame), as in hand=wrist_link@0.1,0,0"
        )
    return MarkerMount(name.strip(), link.strip(), parse_vector(place, "--marker"), tolerance_m)


def _across(along: Vector, up: Vector, along_option: str, up_option: str) -> tuple[Floats, Floats]:
    """Unit vectors: the first direction, and the second made square to it."""
    first, second = np.array(along, dtype=float), np.array(up, dtype=float)
    for vector, option in ((first, along_option), (second, up_option)):
        if np.linalg.norm(vector) < 1e-9:
            raise MirrorPostureError(f"{option}: got 0,0,0, needed a direction")
    first /= np.linalg.norm(first)
    second /= np.linalg.norm(second)
    if np.linalg.norm(np.cross(first, second)) < math.sin(LEAST_ANGLE_RAD):
        raise MirrorPostureError(
            f"{along_option} {along} is parallel to {up_option} {up} (0,0,1 unless told): say where up is with {up_option}, as 1,0,0, in the "
            "link's frame"
        )
    square = second - (first @ second) * first
    return first, square / np.linalg.norm(square)


def _pose(at_m: Vector | None, rotation: Floats) -> Floats:
    pose = np.eye(4)
    if at_m is not None:
        pose[:3, :3], pose[:3, 3] = rotation, at_m
    return pose
