"""The effects by name: the public vocabulary, as commands take it."""

from __future__ import annotations

from collections.abc import Sequence

from .._core import MirrorPostureError

EFFECTS = (
    "joint_offset",
    "gear_ratio",
    "gear_eccentricity",
    "backlash",
    "stiction",
    "joint_compliance",
    "link_bending",
    "link_length",
    "axis_tilt",
    "joint_coupling",
    "drift",
    "marker_mount",
    "camera_mount",
    "camera_focal",
    "camera_center",
    "lens_distortion",
    "board_scale",
    "mirror_glass",
    "mirror_curvature",
    "geometry",
    "pairing",
)


def checked_effects(names: Sequence[str]) -> list[str]:
    """The names, where all are of the vocabulary.

    Raises:
        MirrorPostureError: an effect that is none; the message lists those that are.
    """
    for name in names:
        if name not in EFFECTS:
            raise MirrorPostureError(f"without: got {name!r}, needed one of {', '.join(EFFECTS)}")
    return list(names)
