"""Options of a measurement: the estimator, the noise, the prior of the camera's mount."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from ..arrays import Floats
from ..short_repr import ShortRepr

Estimator = Literal["pose", "pose-snapped", "point-pair", "maximum-likelihood", "joint"]
ESTIMATORS: tuple[Estimator, ...] = get_args(Estimator)
"""From the paper's baseline (Eq. 1) to the best; `point-pair` is the paper's method (Eq. 2)."""

JOINT_MOUNT_STD_RAD = math.radians(1.0)
JOINT_MOUNT_STD_M = 0.002
"""Default prior of `joint` for the camera–board transform: a mount by hand."""

EXACT_STD = 1e-8
"""What is stated as exact, rad or m, where something else is not: a prior cannot hold a zero."""


@dataclass(frozen=True, eq=False, repr=False)
class Mount(ShortRepr):
    """A calibrated camera–board transform, at the posture of the session's first frame."""

    camera_from_board: Floats
    """(4, 4)."""
    covariance: Floats
    """(6, 6), in the tangent `camera_from_board ∘ (Exp ω, v)`: rotation (rad) before translation (m)."""


@dataclass(frozen=True)
class MeasureOptions:
    """How a session is measured."""

    estimator: Estimator = "maximum-likelihood"
    corner_noise_px: float | None = None
    marker_noise_px: float | None = None
    """Standard deviations of board corners and of ball centres, one axis. None: the session's, otherwise
    the detector's (median), otherwise estimated from the residuals."""
    mount_std_rad: float | None = None
    mount_std_m: float | None = None
    """How well the model's camera–board transform is known, one axis. None: exactly (`joint`: 1°, 2 mm)."""
    least_parallax_rad: float = math.radians(1.0)
    """Views of a marker whose rays differ by less give no position."""
    mount: Mount | None = None
    """A calibrated camera–board transform, which takes the place of the model's and of the two deviations above."""
    judge_markers: bool = True
    """Whether outlying views and markers are masked, and deviations that are too small throughout are
    increased; False leaves that to a caller who reads `chi_squared`."""
