"""Tests of the residuals of pictures that were measured without a robot, as `measure` tests a session's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ._core import MirrorPostureError
from .arrays import Floats
from .camera import Camera
from .detect import MarkerView
from .detect.marker_judge import MarkerOptions, size_share
from .detect.shown_ball import shown_ball
from .marker import Marker
from .measurement.residuals import (
    MOUNT_LEVER_M,
    OUTLYING_VIEW,
    OUTLYING_VIEW_PX,
    WIDEN_ABOVE,
    widen_markers,
)
from .mirror import MirrorEstimates, Rig, estimate_mirrors
from .rotations import reflected
from .triangulate import MarkerPositions
from .view_check.check import check
from .view_check.views import Views

TAKEN_UP = 2.5
"""How many times what corners show of an error that they share a plane may have taken up: measured on pictures of shutters that roll."""


def tested_mirrors(
    rig: Rig, corners_px: Floats, noise_px: float, sources: Sequence[str]
) -> tuple[MirrorEstimates, tuple[str, ...]]:
    """Mirrors of views (V, N, 2) px, NaN where a corner is hidden. If corners fit no mirror within their
    noise, the deviations of noise and the board's pose are increased to match the residuals, with a warning.

    An error that all corners share (a rolling shutter, a bent board, another lens) turns a plane as a
    whole; averaging over many corners does not reduce it. Raises `MirrorPostureError` where no mirror
    explains a view, with the usual mistake that would.
    """
    mirrors = estimate_mirrors(rig, corners_px, noise_px=noise_px)
    # A hidden corner tells nothing of its view. (A view of none has no mirror: any count will do there.)
    corners = np.maximum(np.isfinite(corners_px).all(axis=2).sum(axis=1), 2)
    shown = np.where(mirrors.valid, mirrors.rms_px * np.sqrt(corners / (2 * corners - 3)), np.inf)
    wrong = np.flatnonzero(shown > max(OUTLYING_VIEW_PX, OUTLYING_VIEW * noise_px))
    if len(wrong):
        first = int(wrong[0])
        said = check(Views.of_boards(rig, corners_px[wrong]), noise_px).mistake
        stands = (
            f"its corners lie {shown[first]:.1f} px from any mirror's"
            if np.isfinite(shown[first])
            else f"no mirror gives it ({mirrors.reasons.get(first, 'not found')})"
        )
        raise MirrorPostureError(
            f"{sources[first]}: {said or f'the reflected board does not fit: {stands}; is it this board, this camera file, this camera_from_board, and did the board stay?'}"
        )
    if not (shown > WIDEN_ABOVE * noise_px).any():
        return mirrors, ()
    worst = int(np.argmax(shown))
    seen = corners_px[worst][np.isfinite(corners_px[worst]).all(axis=1)]
    spread = seen - seen.mean(axis=0)
    rotation = TAKEN_UP * float(
        np.sqrt(shown[worst] ** 2 - noise_px**2) / np.sqrt(np.mean(np.sum(spread**2, axis=1)))
    )
    doubt = np.diag([rotation**2] * 3 + [(MOUNT_LEVER_M * rotation) ** 2] * 3)
    known = np.zeros((6, 6)) if rig.camera_from_board_covariance is None else rig.camera_from_board_covariance
    wider = replace(rig, camera_from_board_covariance=known + doubt)
    return estimate_mirrors(wider, corners_px, noise_px=float(shown[worst])), (
        f"the board's corners lie {shown[worst]:.2f} px from any mirror's (their noise: {noise_px:.2f} px): a shutter that rolls, a bent board, another camera's file, or a board that "
        f"moved; ± is widened to a board known to {np.degrees(rotation):.2f}°",
    )


def agreeing_views(part: MarkerPositions, freedom: int) -> MarkerPositions:
    """The deviation of a marker whose views disagree is increased; it is masked if they cannot be of one
    point."""
    if freedom <= 0 or not part.valid[0] or not np.isfinite(part.chi_squared[0]):
        return part
    covariances, (reason,) = widen_markers(part.covariances_m2, part.chi_squared, np.array([freedom]))
    if reason is not None:
        return _masked(part, reason)
    return replace(part, covariances_m2=covariances)


def of_its_size(
    part: MarkerPositions,
    marker: Marker,
    camera: Camera,
    mirrors: MirrorEstimates,
    views: Mapping[int, MarkerView],
) -> MarkerPositions:
    """A marker is masked where an outline is not as large as a ball of its diameter is at the place at which its
    views (by mirror) meet: two views may agree on another thing of its colour, or on two.

    The camera sees the ball where the mirror shows it. An ideal point has no size.
    """
    if not part.valid[0] or marker.diameter_m <= 0.0:
        return part
    place = part.points_in_camera_m[0]
    for row, view in views.items():
        image = reflected(place, mirrors.normals[row], mirrors.offsets_m[row])
        shown = shown_ball(image, 0.5 * marker.diameter_m, camera)
        if view.outline is None or shown is None:
            continue
        _, expected_px = shown
        seen_px = float(np.sqrt(view.outline.semi_major_px * view.outline.semi_minor_px))
        if abs(seen_px / expected_px - 1.0) > size_share(expected_px, MarkerOptions()):
            return _masked(
                part,
                f"its views meet where a ball of {1e3 * marker.diameter_m:.1f} mm has a radius of {expected_px:.1f} px, and one of them shows {seen_px:.1f} px: "
                "another thing of its colour, or another diameter",
            )
    return part


def _masked(part: MarkerPositions, reason: str) -> MarkerPositions:
    numbers: dict[str, Any] = {
        name: np.full_like(value, np.nan)
        for name, value in vars(part).items()
        if isinstance(value, np.ndarray) and value.dtype.kind == "f"
    }
    return replace(part, **numbers, valid=np.array([False]), reasons={0: reason})
