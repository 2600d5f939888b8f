"""The result of a measurement: the mirror of each frame, the markers of each posture, each with its
covariance.

What is not measured has a mask (`measured`) and a `reason`; the arrays hold 0 there, never NaN.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa

from .._core import MirrorPostureError
from ..arrays import Floats, Integers, Mask
from ..short_repr import ShortRepr
from .options import Estimator
from .table import marker_table


class NothingMeasuredError(MirrorPostureError):
    """The session is valid and nothing can be measured from it; the message says why."""

    exit_code = 3


@dataclass(frozen=True, eq=False, repr=False)
class Mirrors(ShortRepr):
    """The mirror of each frame, in the camera frame: `normal · x = distance`, normal away from the camera."""

    measured: Mask
    """(F,); where it is False, `reason` says why and the arrays hold 0."""
    foot_m: Floats
    """(F, 3): the foot of the camera's perpendicular, distance times normal."""
    foot_covariance_m2: Floats
    """(F, 3, 3)."""
    corner_rms_px: Floats
    """(F,): root mean square length of the corners' residuals."""
    reason: tuple[str | None, ...]

    @property
    def distance_m(self) -> Floats:
        """(F,), from the camera."""
        result: Floats = np.linalg.norm(self.foot_m, axis=1)
        return result

    @property
    def normal(self) -> Floats:
        """(F, 3), of length 1."""
        return self.foot_m / np.where(self.measured, self.distance_m, 1.0)[:, None]


@dataclass(frozen=True, eq=False, repr=False)
class Markers(ShortRepr):
    """The markers of each posture that any view shows: one row a posture and marker."""

    posture: Integers
    """(K,): the posture's number."""
    marker: Integers
    """(K,): index into the session's markers."""
    views: Integers
    """(K,): in how many frames it is seen."""
    measured: Mask
    """(K,); where it is False, `reason` says why and `point_in_camera_m` holds 0."""
    point_in_camera_m: Floats
    """(K, 3)."""
    covariance_m2: Floats
    """(K, 3, 3), in the camera frame."""
    model_in_camera_m: Floats
    """(K, 3): the position by the nominal model (relative to the board, whose place counts as known)."""
    root_from_camera: Floats
    """(K, 4, 4), in the first frame of the posture: by the model, or as corrected by `joint`."""
    reason: tuple[str | None, ...]
    chi_squared: Floats
    """(K,): sum of squared normalised residuals of the views' pixels; 0 where there is no degree of freedom."""
    degrees_of_freedom: Integers
    """(K,): of that; 0 where it is not measured, and by `joint`, which has one sum for the whole session."""

    def __len__(self) -> int:
        return len(self.posture)

    @property
    def point_in_root_m(self) -> Floats:
        """(K, 3): the measured position in the frame of the session's root link."""
        return mapped(self.root_from_camera, self.point_in_camera_m)

    @property
    def model_in_root_m(self) -> Floats:
        """(K, 3): the model's position in the frame of the session's root link."""
        return mapped(self.root_from_camera, self.model_in_camera_m)

    @property
    def covariance_in_root_m2(self) -> Floats:
        """(K, 3, 3)."""
        turn = self.root_from_camera[:, :3, :3]
        result: Floats = turn @ self.covariance_m2 @ turn.swapaxes(1, 2)
        return result

    @property
    def std_m(self) -> Floats:
        """(K,): one standard deviation of the position's length of error, `sqrt(trace covariance)`."""
        result: Floats = np.sqrt(np.trace(self.covariance_m2, axis1=1, axis2=2))
        return result

    @property
    def distance_m(self) -> Floats:
        """(K,): from the model's position to the measured one; 0 where it is not measured."""
        result: Floats = (
            np.linalg.norm(self.point_in_camera_m - self.model_in_camera_m, axis=1) * self.measured
        )
        return result


@dataclass(frozen=True, eq=False, repr=False)
class Measurement(ShortRepr):
    """What one estimator makes of a session."""

    estimator: Estimator
    corner_noise_px: float
    marker_noise_px: float
    """Standard deviations of corners and ball centres, one axis, that the covariances rest on."""
    marker_names: tuple[str, ...]
    mirrors: Mirrors
    markers: Markers
    camera_from_nominal_camera: Floats = field(default_factory=lambda: np.eye(4))
    """(4, 4): the camera's displacement from the model, as calibrated or as estimated by `joint`; otherwise
    the identity."""
    camera_from_board_covariance: Floats | None = None
    """(6, 6): of the camera–board transform, rotation (rad) before translation (m); None where it is taken as exact."""
    chi_squared: float | None = None
    degrees_of_freedom: int | None = None
    warnings: tuple[str, ...] = ()
    """What was widened, and why: residuals above the stated noise."""

    def to_arrow(self) -> pa.Table:
        """The markers as a table, one row a marker of a posture, in the root link's frame (`marker_table`)."""
        return marker_table(self)

    def to_pandas(self) -> Any:
        """The same as a pandas data frame. Raises `ImportError` where pandas is not installed."""
        return self.to_arrow().to_pandas()


def mapped(a_from_b: Floats, point_in_b: Floats) -> Floats:
    """Points (K, 3) through transforms (K, 4, 4) or (1, 4, 4): `R p + t`."""
    result: Floats = np.einsum("kij,kj->ki", a_from_b[:, :3, :3], point_in_b) + a_from_b[:, :3, 3]
    return result
