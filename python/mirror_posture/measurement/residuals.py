"""Tests of a measurement's assumptions by its residuals: a claimed deviation may not be smaller than they
allow.

The camera–board transform and the noise of corners and balls are assumed; the views test them. With known
noise σ the squared residuals of a correct view sum to σ² times the degrees of freedom. If the sum is larger
throughout, the deviations of noise and mount are increased to match the residuals. A view that is far worse
than the others is left out. A marker whose own views disagree gets a larger deviation, or is left out if
they cannot be of one point.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from .._core import MeasureInput
from ..arrays import Floats, Integers, Mask
from ..session.types import Session
from ..short_repr import ShortRepr

WIDEN_ABOVE = 1.5
"""Ratio of the residuals' deviation to the assumed one above which the assumption is increased; the effect
of a wrong grey curve or a bent board stays below."""
OUTLYING_VIEW = 6.0
"""A view is left out whose residual is this many times the session's median, and the noise's,"""
OUTLYING_VIEW_PX = 1.0
"""and at least this, px RMS."""
WIDEN_MARKER_ABOVE = 2.0
"""Ratio above which one marker's own covariance is widened: 1 in 15,000 by chance for two views."""
DISAGREEING_MARKER = 10.0
"""Ratio above which a marker's views are not of one point."""
PLANE_FREEDOMS = 3
MOUNT_LEVER_M = 0.115
"""A mount that is turned by an angle is taken to be shifted by it times this (1° and 2 mm): the mirrors' planes absorb most of a shift, so the residuals hardly show it."""


@dataclass(frozen=True, eq=False, repr=False)
class Assumed(ShortRepr):
    """What a measurement assumes: noise of corners and ball centres (px, one axis), covariance (6, 6) of the camera–board transform (None: exact)."""

    corner_noise_px: float
    marker_noise_px: float
    mount_covariance: Floats | None


@dataclass(frozen=True)
class Tested:
    """Assumptions that the residuals allow, rows of frames to leave out with their reason, and what was
    increased, in words."""

    assumed: Assumed
    left_out: Mapping[int, str]
    warnings: tuple[str, ...]


def judge_views(
    session: Session, core: MeasureInput, assumed: Assumed, least_parallax_rad: float, mount_is_free: bool
) -> Tested:
    """Tests each view's residual in its most likely mirror, and the session's median.

    `mount_is_free`: the estimator fits the camera–board transform itself (`joint`), so that only single views are judged here.
    """
    done = core.ladder(
        "maximum_likelihood",
        corner_noise_px=assumed.corner_noise_px,
        marker_noise_px=assumed.marker_noise_px,
        least_parallax_rad=least_parallax_rad,
    )
    good = np.array([reason is None for reason in done.mirror_reason])
    if not good.any():
        return Tested(assumed, {}, ())
    seen = session.mirror_view.board_seen
    corners = seen.sum(axis=1)
    freedom = np.maximum(2 * corners - PLANE_FREEDOMS, 1)
    # Deviation of one axis that each view shows; the residual's RMS is of the length.
    shown = np.sqrt(done.corner_rms_px**2 * corners / freedom)
    usual = float(np.median(shown[good]))
    limit = max(OUTLYING_VIEW * max(usual, assumed.corner_noise_px), OUTLYING_VIEW_PX)
    left_out = {
        int(row): (
            f"its corners are {shown[row]:.2f} px (one axis) from any mirror's, the other views' {usual:.2f} px: a wrong grid, or a picture of another moment"
        )
        for row in np.flatnonzero(good & (shown > limit))
    }
    ratio = usual / assumed.corner_noise_px
    if mount_is_free or ratio <= WIDEN_ABOVE:
        return Tested(assumed, left_out, ())
    excess_px = math.sqrt(max(usual**2 - assumed.corner_noise_px**2, 0.0))
    mount = _mount_shown(session, seen & good[:, None], excess_px)
    both = (
        mount
        if assumed.mount_covariance is None
        else np.maximum(np.diag(assumed.mount_covariance), np.diag(mount))
    )
    if assumed.mount_covariance is not None:
        # The larger variance of each axis; the correlations of what was stated are kept where it is the larger.
        scale = np.sqrt(both / np.maximum(np.diag(assumed.mount_covariance), 1e-30))
        mount = assumed.mount_covariance * np.outer(scale, scale)
    rotation, translation = math.sqrt(mount[0, 0]), math.sqrt(mount[3, 3])
    warning = (
        f"the board's reflections leave {usual:.2f} px (one axis) where the noise is {assumed.corner_noise_px:.2f} px: camera, board and their places on the robot are not "
        f"exactly the model's; ± is widened to a mount known to {math.degrees(rotation):.1f}° and {1000.0 * translation:.1f} mm; use --estimator joint, or calibrate"
    )
    return Tested(replace(assumed, corner_noise_px=usual, mount_covariance=mount), left_out, (warning,))


def _mount_shown(session: Session, seen: Mask, excess_px: float) -> Floats:
    """Covariance of the camera–board transform that would leave such a residual: the turn that moves the board's corners so far, and the shift."""
    assert session.board is not None
    pixels = session.mirror_view.board_px
    radii, per_metre = [], []
    index = np.arange(session.board.columns * session.board.rows)
    plane_m = session.board.square_m * np.stack(
        [index % session.board.columns, index // session.board.columns], axis=1
    )
    for row in np.flatnonzero(seen.sum(axis=1) >= 4):
        mine = seen[row]
        radius_px, radius_m = (
            float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))
            for points in (pixels[row, mine], plane_m[mine])
        )
        radii.append(radius_px)
        per_metre.append(radius_px / radius_m)
    rotation_rad = excess_px / float(np.median(radii))
    translation_m = max(excess_px / float(np.median(per_metre)), MOUNT_LEVER_M * rotation_rad)
    return np.diag([rotation_rad**2] * 3 + [translation_m**2] * 3)


def widen_markers(
    covariance_m2: Floats, chi_squared: Floats, freedom: Integers
) -> tuple[Floats, list[str | None]]:
    """Covariances (K, 3, 3), increased where a marker's own views disagree, and the reason where they
    cannot be of one point."""
    ratio = np.sqrt(chi_squared / np.maximum(freedom, 1)) * (freedom > 0)
    factor = np.where(ratio > WIDEN_MARKER_ABOVE, ratio, 1.0)
    reasons = [
        f"its views disagree by {value:.0f} deviations: one of them is not of this marker, or the robot moved between them"
        if value > DISAGREEING_MARKER
        else None
        for value in ratio
    ]
    return covariance_m2 * (factor**2)[:, None, None], reasons


def excess_of_markers(chi_squared: Floats, freedom: Integers) -> float:
    """The factor between the actual and the assumed deviation of the markers' pixels, by the median; 1
    where no marker determines it."""
    known = freedom > 0
    if not known.any():
        return 1.0
    # Chi-squared of k degrees of freedom has its median at about k (1 - 2/(9k))³ (Wilson and Hilferty).
    usual = freedom[known] * (1.0 - 2.0 / (9.0 * freedom[known])) ** 3
    return math.sqrt(max(1.0, float(np.median(chi_squared[known] / usual))))
