"""Tests whether the pictures are what they claim to be: the board's reflections against the model, and
against the usual mistakes.

A board at a known place in front of the camera has three degrees of freedom in a mirror (the plane) and
shows six (its pose): the other three are a test. The reflections of a correct session fit a mirror to the
noise. If they do not, each usual mistake is tried exactly: pictures mirrored or rotated by a driver, a
board mounted or counted the other way round, a camera file of another resolution, another board. A mistake
is named only if it explains the views, markers included, far better than the session as given. The core
does that (`mirror_core::view_check`).
"""

from __future__ import annotations

from dataclasses import dataclass

from .. import _core
from .._core import MirrorPostureError
from ..session.types import Session
from .views import Views

USUAL_NOISE_PX = 0.2


@dataclass(frozen=True)
class Fit:
    """How well a reading explains the views: medians over them, px.

    `board_rms_px` is infinite where it explains fewer than half of them, `marker_px` None where no view with
    a mirror shows a marker.
    """

    board_rms_px: float
    marker_px: float | None


@dataclass(frozen=True)
class Reading:
    """One interpretation of a session: what is wrong, and how to correct it."""

    name: str
    said: str
    fix: str
    effect: str
    """The cause by which a diagnosis names it; empty where its vocabulary has no word."""
    factor: float
    """By how much board or camera are larger than stated; 1 where the mistake is no factor."""


@dataclass(frozen=True)
class ViewCheck:
    """The result of the check. `mistake` is empty where none is named; `as_it_stands` is the session's own
    fit, `noise_px` the deviation of a corner's distance with which it was compared, `readings` what
    `mistake` tells: the best, then those that cannot be separated from it."""

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
    found = _core.check_views(
        views.camera.core,
        views.board.corners,
        views.board.square_m,
        views.camera_from_board,
        views.board_px,
        views.marker_px,
        views.marker_seen,
        views.marker_in_camera_m,
        views.glass_thickness_m,
        views.refractive_index,
        noise_px,
        gross,
    )
    own = Fit(found.board_rms_px, found.marker_px)
    return ViewCheck(own, found.noise_px, found.mistake, tuple(Reading(*each) for each in found.readings))


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


def _noise_px(session: Session) -> float:
    """Standard deviation of a corner, one axis: as stated, else the detector's median, else a usual one."""
    return session.noise.pixel_std_px or session.mirror_view.claimed_board_px or USUAL_NOISE_PX
