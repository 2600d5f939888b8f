"""A session measured: where the mirror stood in each view, and where the markers of each posture are."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from ._core import Measured, MeasureInput, MirrorPostureError
from .arguments import checked_arguments
from .measurement_residuals import WIDEN_ABOVE, Assumed, Tested, excess_of_markers, judge_views, widen_markers
from .mirror import IDEAL_MIRROR
from .session import Session, as_session
from .short_repr import ShortRepr
from .view_check import refuse_mistakes

Floats = npt.NDArray[np.float64]
Estimator = Literal["pose", "pose-snapped", "point-pair", "maximum-likelihood", "joint"]
ESTIMATORS: tuple[Estimator, ...] = get_args(Estimator)
"""From the paper's baseline (Eq. 1) to the best; `point-pair` is the paper's method (Eq. 2)."""

JOINT_MOUNT_STD_RAD = math.radians(1.0)
JOINT_MOUNT_STD_M = 0.002
"""What `joint` assumes of the camera–board transform where nothing is said: a hand-made mount."""

EXACT_STD = 1e-8
"""What is stated as exact, rad or m, where something else is not: a prior cannot hold a zero."""


class NothingMeasuredError(MirrorPostureError):
    """The session is fine and nothing can be measured from it; the message says why."""

    exit_code = 3


@dataclass(frozen=True)
class MeasureOptions:
    """How a session is measured."""

    estimator: Estimator = "maximum-likelihood"
    corner_noise_px: float | None = None
    marker_noise_px: float | None = None
    """Standard deviations of board corners and of ball centres, one axis. None: the session's, else the detector's
    (median), else what the residuals show."""
    mount_std_rad: float | None = None
    mount_std_m: float | None = None
    """How well the model's camera–board transform is known, one axis. None: exactly (`joint`: 1°, 2 mm)."""
    least_parallax_rad: float = math.radians(1.0)
    """Views of a marker whose rays differ by less give no position."""
    mount: Mount | None = None
    """A calibrated camera–board transform, which takes the place of the model's and of the two deviations above."""
    judge_markers: bool = True
    """Whether views and markers that are far off are masked, and what is off throughout widened; False leaves it to a caller who
    reads `chi_squared`."""


@dataclass(frozen=True, eq=False, repr=False)
class Mount(ShortRepr):
    """A calibrated camera–board transform, at the posture of the session's first frame."""

    camera_from_board: Floats
    """(4, 4)."""
    covariance: Floats
    """(6, 6), in the tangent `camera_from_board ∘ (Exp ω, v)`: rotation (rad) before translation (m)."""


@dataclass(frozen=True, eq=False, repr=False)
class Mirrors(ShortRepr):
    """The mirror of each frame, in the camera frame: `normal · x = distance`, normal away from the camera."""

    measured: npt.NDArray[np.bool_]
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

    posture: npt.NDArray[np.int64]
    """(K,): the posture's number."""
    marker: npt.NDArray[np.int64]
    """(K,): index into the session's markers."""
    views: npt.NDArray[np.int64]
    """(K,): in how many frames it is seen."""
    measured: npt.NDArray[np.bool_]
    """(K,); where it is False, `reason` says why and `point_in_camera_m` holds 0."""
    point_in_camera_m: Floats
    """(K, 3)."""
    covariance_m2: Floats
    """(K, 3, 3), in the camera frame."""
    model_in_camera_m: Floats
    """(K, 3): where the nominal model says that it is (relative to the board, whose place it is taken to know)."""
    root_from_camera: Floats
    """(K, 4, 4), in the first frame of the posture: as the model says, or as `joint` has corrected it."""
    reason: tuple[str | None, ...]
    chi_squared: Floats
    """(K,): sum of squared normalised residuals of the views' pixels; 0 where there is no degree of freedom."""
    degrees_of_freedom: npt.NDArray[np.int64]
    """(K,): of that; 0 where it is not measured, and by `joint`, which has one sum for the whole session."""

    def __len__(self) -> int:
        return len(self.posture)

    @property
    def point_in_root_m(self) -> Floats:
        """(K, 3): the measured position in the frame of the session's root link."""
        return _mapped(self.root_from_camera, self.point_in_camera_m)

    @property
    def model_in_root_m(self) -> Floats:
        """(K, 3): the model's position in the frame of the session's root link."""
        return _mapped(self.root_from_camera, self.model_in_camera_m)

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
    """(4, 4): how the camera sits against the model's, as calibrated or as `joint` finds it; else the identity."""
    camera_from_board_covariance: Floats | None = None
    """(6, 6): of the camera–board transform, rotation (rad) before translation (m); None where it is taken as exact."""
    chi_squared: float | None = None
    degrees_of_freedom: int | None = None
    warnings: tuple[str, ...] = ()
    """What was widened, and why: residuals above the stated noise."""


@checked_arguments
def measure(session: Session | str | os.PathLike[str], options: MeasureOptions | None = None) -> Measurement:
    """Measures a session (or a folder) by one estimator: each frame's mirror from the board's reflection, then each posture's markers.

    A marker needs two views (frames of one `posture`) before mirrors that stand differently; all its views are used. Positions
    are in the camera frame of the posture; covariances contain the noise of the pixels, the mirrors' and the mount's.

    Each view's residual is tested against the noise: a view or marker that is far off is masked, what is off throughout
    widens the covariances and stands in `warnings`.

    Raises `MirrorPostureError` for a session without camera or board or without detections, or whose pictures are mirrored, turned, of
    another board or of another camera (`view_check`); `NothingMeasuredError` where no mirror at all can be estimated. What concerns one
    frame or marker is a mask with a reason.
    """
    return measure_all(session, (options or MeasureOptions(),))[0]


@checked_arguments
def measure_all(
    session: Session | str | os.PathLike[str], options: Sequence[MeasureOptions]
) -> list[Measurement]:
    """Measures a session in several ways; what they share is done once."""
    for one in options:
        if one.estimator not in ESTIMATORS:
            raise MirrorPostureError(
                f"estimator: got {one.estimator!r}, needed one of {', '.join(ESTIMATORS)}"
            )
    session = as_session(session)
    nominal = nominal_camera_from_board(session)
    if not session.detected:
        raise MirrorPostureError(
            f"{session.folder}: has pictures and no detections yet; run `mirror-posture detect` on it first"
        )
    refuse_mistakes(session)
    return [_measure(session, nominal, one) for one in options]


def _measure(session: Session, nominal: Floats, options: MeasureOptions) -> Measurement:
    mounted = options.mount
    calibrated = np.eye(4) if mounted is None else mounted.camera_from_board @ np.linalg.inv(nominal[0])
    core = _core_input(session, calibrated @ nominal)
    if all(core.mirrors_refused):
        reason = core.mirrors_refused[0]
        raise NothingMeasuredError(
            f"{session.folder}: no frame shows the board in the mirror (first frame: {reason})"
        )
    corner_noise, marker_noise = _noise_px(session, core, options)
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
    # Who judges by himself gets the estimator as it is: a correction's steps are weighed by these covariances.
    tested = (
        judge_views(session, core, assumed, parallax, joint)
        if options.judge_markers
        else Tested(assumed, {}, ())
    )
    if tested.left_out:
        session = _without_boards(session, tested.left_out)
        core = _core_input(session, calibrated @ nominal)
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
    seen = session.mirror_view.marker_seen
    views = np.array(
        [seen[frames.posture == p, m].sum() for p, m in zip(posture, marker, strict=True)], dtype=np.int64
    )
    camera_link = str(session.camera_link)
    model = np.zeros((len(posture), 3))
    for index, spec in enumerate(session.markers):
        mine = marker == index
        model[mine] = session.robot.points(session.positions[row[mine]], camera_link, spec.link)
    # The board is where the model says; where the camera sits elsewhere, it is the camera that moved.
    root_from_camera = _a_from_b(session, session.root_link, camera_link)[row] @ np.linalg.inv(correction)
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
        _mapped(correction[None], model),
        root_from_camera,
        reason,
        done.point_chi_squared,
        done.point_degrees_of_freedom,
    )


def nominal_camera_from_board(session: Session) -> Floats:
    """(F, 4, 4), as the model says at the commanded joint positions.

    Raises `MirrorPostureError` for a session without camera or board.
    """
    if session.camera_link is None or session.camera is None:
        raise MirrorPostureError(
            f"{session.folder}: has no camera; only what a camera sees in a mirror is measured"
        )
    if session.board is None:
        raise MirrorPostureError(
            f"{session.folder}: has no [board], whose reflection tells where the mirror stands"
        )
    return _a_from_b(session, session.camera_link, session.board.link)


def _a_from_b(session: Session, link_a: str, link_b: str) -> Floats:
    robot = session.robot
    poses = robot.forward_kinematics(session.positions)
    root_from_a, root_from_b = (poses[:, robot.link_index(link)] for link in (link_a, link_b))
    return np.linalg.solve(root_from_a, root_from_b).astype(np.float64, copy=False)


def _core_input(session: Session, camera_from_board: Floats) -> MeasureInput:
    camera, board = session.camera, session.board
    assert camera is not None and board is not None
    seen, direct = session.mirror_view, session.direct_view
    return MeasureInput(
        camera=camera.core,
        board_corners=board.corners,
        square_m=board.square_m,
        diameters_m=[marker.diameter_m for marker in session.markers],
        **(session.mirror or IDEAL_MIRROR).glass,
        posture=session.frames.posture.tolist(),
        camera_from_board=camera_from_board,
        board_px=seen.board_px,
        board_seen=seen.board_seen,
        marker_px=seen.marker_px,
        marker_seen=seen.marker_seen,
        direct_px=direct.marker_px,
        direct_seen=direct.marker_seen,
    )


def _noise_px(session: Session, core: MeasureInput, options: MeasureOptions) -> tuple[float, float]:
    """Standard deviations of corners and of ball centres, one axis: as stated, else as detected, else by the residuals.

    Medians, since a few views may be bad. Ball centres are never taken to be better than corners, whose noise was measured
    on many more points.
    """
    stated, seen = session.noise.pixel_std_px, session.mirror_view
    corner = options.corner_noise_px or stated or _claimed_px(seen.board_std_px)
    marker = options.marker_noise_px or stated or _claimed_px(seen.marker_std_px)
    if corner is not None and marker is not None:
        return corner, marker
    corner = corner or _corner_noise_px(session, core, options)
    if marker is None:
        done = core.ladder(
            "maximum_likelihood",
            corner_noise_px=corner,
            marker_noise_px=corner,
            least_parallax_rad=options.least_parallax_rad,
        )
        marker = corner * excess_of_markers(done.point_chi_squared, done.point_degrees_of_freedom)
    return corner, marker


def _claimed_px(std_px: Floats | None) -> float | None:
    """The median of the detector's standard deviations; None where it gave none."""
    given = np.zeros(0) if std_px is None else std_px[std_px > 0.0]
    return float(np.median(given)) if len(given) else None


def _corner_noise_px(session: Session, core: MeasureInput, options: MeasureOptions) -> float:
    done = core.ladder(
        "maximum_likelihood", marker_noise_px=1.0, least_parallax_rad=options.least_parallax_rad
    )
    good = np.array([reason is None for reason in done.mirror_reason])
    if not good.any():
        reason = next(reason for reason in done.mirror_reason if reason is not None)
        raise NothingMeasuredError(f"{session.folder}: no mirror can be estimated ({reason})")
    corners = session.mirror_view.board_seen.sum(axis=1)[good]
    # Two numbers a corner, three of them spent on the plane.
    per_axis = done.corner_rms_px[good] ** 2 * corners / np.maximum(2 * corners - 3, 1)
    return float(np.sqrt(np.median(per_axis)))


def _mapped(a_from_b: Floats, point_in_b: Floats) -> Floats:
    result: Floats = np.einsum("kij,kj->ki", a_from_b[:, :3, :3], point_in_b) + a_from_b[:, :3, 3]
    return result
