"""Measures a session: the mirror of each view, and the markers of each posture."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .._core import Measured, MeasureInput
from ..arguments import checked_arguments
from ..arrays import Floats
from ..session import Session, as_session
from ..view_check import refuse_mistakes
from .inputs import a_from_b, core_input, noise_px, nominal_camera_from_board, require_detected
from .options import EXACT_STD, JOINT_MOUNT_STD_M, JOINT_MOUNT_STD_RAD, MeasureOptions
from .residuals import WIDEN_ABOVE, Assumed, Tested, excess_of_markers, judge_views, widen_markers
from .types import Markers, Measurement, Mirrors, NothingMeasuredError, mapped


@checked_arguments
def measure(session: Session | str | os.PathLike[str], options: MeasureOptions | None = None) -> Measurement:
    """Measures a session (or a folder) by one estimator: each frame's mirror from the board's reflection,
    then each posture's markers.

    A marker needs two views (frames of one `posture`) with differently oriented mirrors; all its views are
    used. Positions are in the camera frame of the posture; covariances contain the noise of the pixels, the
    mirrors' and the mount's.

    Each view's residual is tested against the noise: an outlying view or marker is masked; a deviation that
    is too small throughout is increased, with an entry in `warnings`.

    Raises `MirrorPostureError` for a session without camera or board or without detections, or whose
    pictures are mirrored, rotated, of another board or of another camera (`view_check`);
    `NothingMeasuredError` where no mirror at all can be estimated. What concerns one frame or marker is a
    mask with a reason.
    """
    return measure_all(session, (options or MeasureOptions(),))[0]


@checked_arguments
def measure_all(
    session: Session | str | os.PathLike[str], options: Sequence[MeasureOptions]
) -> list[Measurement]:
    """Measures a session (or a folder) by each of several options; the session is loaded and checked once.

    Returns one measurement for each of `options`, in their order; each is what `measure` returns for it.

    Raises:
        MirrorPostureError: an unknown estimator, or what `measure` raises: no camera or board, no detections, pictures that are not
            what they claim.
        NothingMeasuredError: no mirror can be estimated by one of the options.
    """
    session = as_session(session)
    nominal = nominal_camera_from_board(session)
    require_detected(session)
    refuse_mistakes(session)
    return [_measure(session, nominal, one) for one in options]


def _measure(session: Session, nominal: Floats, options: MeasureOptions) -> Measurement:
    mounted = options.mount
    calibrated = np.eye(4) if mounted is None else mounted.camera_from_board @ np.linalg.inv(nominal[0])
    core = core_input(session, calibrated @ nominal)
    if all(core.mirrors_refused):
        reason = core.mirrors_refused[0]
        raise NothingMeasuredError(
            f"{session.folder}: no frame shows the board in the mirror (first frame: {reason})"
        )
    corner_noise, marker_noise = noise_px(session, core, options)
    stated = options.mount_std_rad is not None or options.mount_std_m is not None
    joint = options.estimator == "joint"
    mount = None if mounted is None else mounted.covariance
    if mount is None and (stated or joint):
        rotation = options.mount_std_rad if stated else JOINT_MOUNT_STD_RAD
        translation = options.mount_std_m if stated else JOINT_MOUNT_STD_M
        stds = np.array([rotation or 0.0] * 3 + [translation or 0.0] * 3)
        mount = np.diag(np.maximum(stds, EXACT_STD) ** 2)
    parallax = options.least_parallax_rad
    assumed = Assumed(corner_noise, marker_noise, mount)
    # A caller who tests residuals himself gets the estimator's result unchanged: a correction's steps are
    # weighted by these covariances.
    tested = (
        judge_views(session, core, assumed, parallax, joint)
        if options.judge_markers
        else Tested(assumed, {}, ())
    )
    if tested.left_out:
        session = _without_boards(session, tested.left_out)
        core = core_input(session, calibrated @ nominal)
    name = options.estimator.replace("-", "_")
    done, assumed, warnings = _run(core, name, tested.assumed, parallax, options.judge_markers)
    mirror_reason = tuple(tested.left_out.get(row, reason) for row, reason in enumerate(done.mirror_reason))
    mirrors = Mirrors(
        np.array([reason is None for reason in mirror_reason], dtype=bool),
        done.foot_m,
        done.foot_covariance_m2,
        done.corner_rms_px,
        mirror_reason,
    )
    return Measurement(
        options.estimator,
        assumed.corner_noise_px,
        assumed.marker_noise_px,
        session.marker_names,
        mirrors,
        _markers(session, done, done.camera_from_nominal_camera @ calibrated, options.judge_markers),
        done.camera_from_nominal_camera @ calibrated,
        done.camera_from_board_covariance,
        done.chi_squared,
        done.degrees_of_freedom,
        (*tested.warnings, *warnings),
    )


def _run(
    core: MeasureInput, estimator: str, assumed: Assumed, least_parallax_rad: float, may_widen: bool
) -> tuple[Measured, Assumed, list[str]]:
    """Measures, and once more with the noise that the residuals show where that is larger than assumed."""

    def once(noise: Assumed) -> Measured:
        shared: dict[str, Any] = {
            "corner_noise_px": noise.corner_noise_px,
            "marker_noise_px": noise.marker_noise_px,
            "least_parallax_rad": least_parallax_rad,
            "camera_from_board_covariance": noise.mount_covariance,
        }
        return core.joint(**shared) if estimator == "joint" else core.ladder(estimator, **shared)

    done = once(assumed)
    if not may_widen:
        return done, assumed, []
    if estimator == "joint":
        ratio = (
            math.sqrt(done.chi_squared / max(done.degrees_of_freedom or 1, 1)) if done.chi_squared else 1.0
        )
        wider = replace(
            assumed,
            corner_noise_px=assumed.corner_noise_px * ratio,
            marker_noise_px=assumed.marker_noise_px * ratio,
        )
    else:
        ratio = excess_of_markers(done.point_chi_squared, done.point_degrees_of_freedom)
        wider = replace(assumed, marker_noise_px=assumed.marker_noise_px * ratio)
    if ratio <= WIDEN_ABOVE:
        return done, assumed, []
    what = "corners and balls" if estimator == "joint" else "balls"
    warning = f"the residuals of {what} are {ratio:.1f} times the noise that was stated or detected: ± is widened by it"
    return once(wider), wider, [warning]


def _without_boards(session: Session, rows: Iterable[int]) -> Session:
    seen = session.mirror_view.board_seen.copy()
    seen[list(rows)] = False
    return replace(session, mirror_view=replace(session.mirror_view, board_seen=seen))


def _markers(session: Session, done: Measured, correction: Floats, judge: bool) -> Markers:
    posture, marker = done.posture, done.marker
    frames = session.frames
    # First row of each posture: its camera frame is the posture's (the head is still within one).
    numbers, first = np.unique(frames.posture, return_index=True)
    row = first[np.searchsorted(numbers, posture)]
    counts = np.zeros((len(numbers), len(session.markers)), dtype=np.int64)
    np.add.at(counts, np.searchsorted(numbers, frames.posture), session.mirror_view.marker_seen)
    views = counts[np.searchsorted(numbers, posture), marker]
    camera_link = str(session.camera_link)
    model = np.zeros((len(posture), 3))
    for index, spec in enumerate(session.markers):
        mine = marker == index
        model[mine] = session.robot.points(session.positions[row[mine]], camera_link, spec.link)
    # The board is where the model says; if the camera is displaced relative to it, the camera is moved.
    root_from_camera = a_from_b(session, session.root_link, camera_link)[row] @ np.linalg.inv(correction)
    covariance = done.point_covariance_m2
    disagree: list[str | None] = [None] * len(posture)
    if judge:
        covariance, disagree = widen_markers(
            covariance, done.point_chi_squared, done.point_degrees_of_freedom
        )
    reason = tuple(why or other for why, other in zip(done.marker_reason, disagree, strict=True))
    measured = np.array([why is None for why in reason], dtype=bool)
    return Markers(
        posture,
        marker,
        views,
        measured,
        np.where(measured[:, None], done.point_in_camera_m, 0.0),
        covariance,
        mapped(correction[None], model),
        root_from_camera,
        reason,
        done.point_chi_squared,
        done.point_degrees_of_freedom,
    )
