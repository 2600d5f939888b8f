"""Options of a measurement: the estimator, the noise, the prior of the camera's mount."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from .._core import MirrorPostureError
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

    def __post_init__(self) -> None:
        """Raises `MirrorPostureError` for an unknown estimator, and for a number that nothing can be measured with."""
        if self.estimator not in ESTIMATORS:
            raise MirrorPostureError(
                f"estimator: got {self.estimator!r}, needed one of {', '.join(ESTIMATORS)}"
            )
        for name in ("corner_noise_px", "marker_noise_px"):
            _refuse(name, getattr(self, name), lambda value: value > 0.0, "above 0 px, or None (as detected)")
        for name, unit in (("mount_std_rad", "rad"), ("mount_std_m", "m")):
            _refuse(
                name,
                getattr(self, name),
                lambda value: value >= 0.0,
                f"of at least 0 {unit}, or None (exact)",
            )
        if self.least_parallax_rad is None:
            raise MirrorPostureError("least_parallax_rad: got None, needed an angle, rad")
        _refuse(
            "least_parallax_rad",
            self.least_parallax_rad,
            lambda value: 0.0 < value < math.pi / 2,
            "above 0 and below a right angle, rad (not degrees)",
        )


def _refuse(name: str, value: object, fits: Callable[[float], bool], needed: str) -> None:
    """Refuses an option that is neither None nor a finite number that fits."""
    if value is None:
        return
    is_number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value) or not fits(float(value)):  # type: ignore[arg-type]
        raise MirrorPostureError(f"{name}: got {value!r}, needed a finite number {needed}")
