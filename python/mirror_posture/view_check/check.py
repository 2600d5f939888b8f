"""Tests whether the pictures are what they claim to be: the board's reflections against the model, and
against the usual mistakes.

A board at a known place in front of the camera has three degrees of freedom in a mirror (the plane) and
shows six (its pose): the other three are a test. The reflections of a correct session fit a mirror to the
noise. If they do not, each usual mistake is tried exactly: pictures mirrored or rotated by a driver, a
board mounted or counted the other way round, a camera file of another resolution, another board. A mistake
is named only if it explains the views, markers included, far better than the session as given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from .._core import MirrorPostureError
from ..session.types import Session
from .fit import LEAST_MARKER_PX, Fit, Views
from .readings import Reading, usual_mistakes

LEAST_NOISE_PX = 0.05
USUAL_NOISE_PX = 0.2
SUSPICIOUS_DEVIATIONS = 2.0
"""RMS of the board's residual, in deviations of the noise, above which the usual mistakes are tried. Hand-made mounts leave up to 10."""
EXPLAINED_DEVIATIONS = 20.0
"""A reading that leaves more than this, in deviations of the noise, explains nothing."""
SUSPICIOUS_MARKERS = 0.05
"""Median distance of the markers from the model's, as a share of the picture's width, above which it may be doubted."""
LEAST_GAIN = 8.0
"""How many times smaller the residuals (board times markers) must be for a mistake to be named; squared for two mistakes at once."""
WORSE = 1.5
"""No residual of a named reading may be larger than this many times the session's own."""


@dataclass(frozen=True)
class ViewCheck:
    """The result of the check. `mistake` is empty where none is named; `as_it_stands` is the session's own
    fit."""

    as_it_stands: Fit
    noise_px: float
    mistake: str = ""
    readings: tuple[Reading, ...] = ()


def check_views(session: Session) -> ViewCheck | None:
    """Tests a session's views of the board in the mirror; None where there is nothing to test (no board, camera or view).

    Raises `MirrorPostureError` for numbers that make no camera or board.
    """
    views = Views.of(session)
    if views is None:
        return None
    return check(views, _noise_px(session))


def check(views: Views, noise_px: float, *, gross: bool = False) -> ViewCheck:
    """Tests views of the board in the mirror; `noise_px` is the standard deviation of a corner along one axis.

    `gross`: mistakes are tried only where the board's residuals are far from what mounts by hand leave.
    """
    own = views.fit(Reading("as it stands"))
    noise = max(LEAST_NOISE_PX, noise_px * math.sqrt(2.0))
    width = views.camera.size_px[0]
    doubted = own.board_rms_px > (EXPLAINED_DEVIATIONS if gross else SUSPICIOUS_DEVIATIONS) * noise or (
        not gross and own.marker_px is not None and own.marker_px > SUSPICIOUS_MARKERS * width
    )
    if not doubted:
        return ViewCheck(own, noise)
    fits = [views.fit(reading) for reading in usual_mistakes(views.board.corners, views.square_picture)]
    fits += views.best_factors()
    better = [fit for fit in fits if _explains(fit, own, noise)]
    if not better:
        return ViewCheck(own, noise)
    least = min(fit.reading.mistakes for fit in better)
    simple = [fit for fit in better if fit.reading.mistakes == least]
    best = max(simple, key=lambda fit: fit.gain_over(own, noise))
    # An interpretation that explains the views as well as the best one cannot be separated from it.
    equal = [fit for fit in simple if best.gain_over(fit, noise) < WORSE and fit is not best]
    return ViewCheck(own, noise, _said(own, best, equal), (best.reading, *(fit.reading for fit in equal)))


def refuse_mistakes(session: Session) -> ViewCheck | None:
    """The check of a session's views. Raises `MirrorPostureError` that names the mistake and the fix, where there is one."""
    checked = check_views(session)
    if checked is not None and checked.mistake:
        raise MirrorPostureError(f"{session.folder}: {checked.mistake}")
    return checked


def refuse_unnamed_mistakes(session: Session) -> None:
    """Refuses what a diagnosis has no word for: of a camera's body taken for its optical frame no search can tell anything.

    Tested where the boards' reflections are far from what mounts by hand leave. Raises `MirrorPostureError` that names the mistake and the
    fix (a diagnosis's errors get the session's name where they are told), unless a mistake of the vocabulary explains the views as well.
    """
    views = Views.of(session)
    if views is None:
        return
    checked = check(views, _noise_px(session), gross=True)
    if checked.mistake and not any(reading.effect for reading in checked.readings):
        raise MirrorPostureError(checked.mistake)


def _explains(fit: Fit, own: Fit, noise: float) -> bool:
    if not fit.board_rms_px <= min(WORSE * max(own.board_rms_px, noise), EXPLAINED_DEVIATIONS * noise):
        return False
    if own.marker_px is not None and fit.marker_px is not None and math.isfinite(own.marker_px):
        if fit.marker_px > WORSE * max(own.marker_px, LEAST_MARKER_PX):
            return False
    return fit.gain_over(own, noise) >= LEAST_GAIN**fit.reading.mistakes


def _said(own: Fit, best: Fit, equal: list[Fit]) -> str:
    stands = (
        f"{own.board_rms_px:.2f} px RMS"
        if math.isfinite(own.board_rms_px)
        else "no mirror at all explains them"
    )
    text = (
        f"{best.reading.said}: read so, the board's reflections fit a mirror to {best.board_rms_px:.2f} px RMS, as they stand: {stands}; "
        f"{best.reading.fix}"
    )
    for other in equal:
        text += f"; or {other.reading.said} (cannot be separated here): {other.reading.fix}"
    return text


def _noise_px(session: Session) -> float:
    """Standard deviation of a corner, one axis: as stated, else the detector's median, else a usual one."""
    return session.noise.pixel_std_px or session.mirror_view.claimed_board_px or USUAL_NOISE_PX
