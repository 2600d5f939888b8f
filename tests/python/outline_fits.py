"""Outlines of balls as the core would have measured them, for tests of what is made of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mirror_posture.detect.ball import OutlineFit
from mirror_posture.detect.types import Ellipse


def outline_fit(center_px: tuple[float, float], radius_px: float, **other: Any) -> OutlineFit:
    """A whole clear circle; `other` are fields that are otherwise."""
    turns = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    fit = OutlineFit(
        centroid_px=np.array(center_px),
        centroid_covariance_px2=np.eye(2) * 0.01,
        sphere_center_px=np.array(center_px),
        ellipse=Ellipse(center_px, radius_px, radius_px, 0.0),
        boundary_px=np.array(center_px) + radius_px * np.stack([np.cos(turns), np.sin(turns)], axis=1),
        mean_radius_px=radius_px,
        arc_fraction=1.0,
        residual_rms_px=0.1,
        blur_px=0.7,
        narrow_blur_px=0.7,
        lens_blur_px=0.7,
    )
    return replace(fit, **other)
