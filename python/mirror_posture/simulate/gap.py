"""The gap of simulator against reality: simulated markers beside those that the session's pictures show.

The mirror of each frame is fitted to the board's reflection, with camera and board where the simulator has them. In pixels
the gap is the distance between a marker's image and its prediction, frame by frame; in metres the distance between the
marker that a posture's views measure (maximum likelihood, both in the camera's frame) and the simulated one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .._core import Measured, MeasureInput, MirrorPostureError
from ..measurement import MeasureOptions
from ..optics import ball_center_pixels, see_in_mirror
from ..session import Session
from ..short_repr import ShortRepr
from .motion import Rest

Floats = npt.NDArray[np.float64]
CORNER_NOISE_PX = 0.2
"""Where neither the session nor a detector states the noise: it weighs corners against markers and moves no minimum."""


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedGap(ShortRepr):
    """RMS distances. The arrays are by marker, in the session's order; NaN where a marker was never seen (not measured)."""

    rms_px: float | None
    rms_m: float | None
    marker_rms_px: Floats
    marker_rms_m: Floats
    pixels: int
    measured: int


def simulated_gap(session: Session, rest: Rest, rows: npt.NDArray[np.bool_] | None = None) -> SimulatedGap:
    """Compares a simulated body with a session's observations, over all frames or those of a mask.

    Raises:
        MirrorPostureError: a session without camera and board: its gap needs the mirror.
    """
    if session.camera is None or session.board is None or session.camera_link is None:
        raise MirrorPostureError(
            f"{session.folder}: has no camera and board; what MuJoCo simulates is compared in the mirror's pictures"
        )
    counted = np.ones(len(session.frames), dtype=bool) if rows is None else rows
    camera_from_root = np.linalg.inv(rest.root_from_link[session.camera_link])
    camera_from_board = camera_from_root @ rest.root_from_link[session.board.link]
    marker_in_camera = np.stack(
        [(camera_from_root @ rest.root_from_link[m.link])[:, :3, 3] for m in session.markers], axis=1
    )
    noise = session.noise.pixel_std_px or CORNER_NOISE_PX
    done = measure_input(session, camera_from_board).ladder(
        "maximum_likelihood",
        corner_noise_px=noise,
        marker_noise_px=noise,
        least_parallax_rad=MeasureOptions().least_parallax_rad,
    )
    mirror = np.array([reason is None for reason in done.mirror_reason], dtype=bool)
    squares_px = _pixel_squares(session, done, mirror & counted, marker_in_camera, noise)
    squares_m = _metre_squares(session, done, counted, marker_in_camera)
    return SimulatedGap(
        _rms(np.concatenate(squares_px)),
        _rms(np.concatenate(squares_m)),
        np.array([_rms(s) or np.nan for s in squares_px]),
        np.array([_rms(s) or np.nan for s in squares_m]),
        sum(map(len, squares_px)),
        sum(map(len, squares_m)),
    )


def measure_input(session: Session, camera_from_board: Floats) -> MeasureInput:
    """What the measurement takes of a session whose camera and board stand at `camera_from_board` (F, 4, 4)."""
    assert session.camera is not None and session.board is not None
    seen, direct, mirror = session.mirror_view, session.direct_view, session.mirror
    extra = {} if mirror is None else {"refractive_index": mirror.refractive_index}
    return MeasureInput(
        camera=session.camera.core,
        board_corners=(session.board.columns, session.board.rows),
        square_m=session.board.square_m,
        diameters_m=[marker.diameter_m for marker in session.markers],
        glass_thickness_m=mirror.glass_thickness_m if mirror else 0.0,
        posture=session.frames.posture.tolist(),
        camera_from_board=np.ascontiguousarray(camera_from_board),
        board_px=seen.board_px,
        board_seen=seen.board_seen,
        marker_px=seen.marker_px,
        marker_seen=seen.marker_seen,
        direct_px=direct.marker_px,
        direct_seen=direct.marker_seen,
        **extra,
    )


def _pixel_squares(
    session: Session, done: Measured, usable: npt.NDArray[np.bool_], marker_in_camera: Floats, noise_px: float
) -> list[Floats]:
    """By marker: squared distances between seen and predicted image, px².

    The mirror of a frame is a nuisance of all that the frame shows: to the plane that its corners tell, with covariance Σ, the
    markers' residuals r with J = ∂pixel/∂foot add `δ = (Σ⁻¹ + ∑ JᵀJ / σ²)⁻¹ ∑ Jᵀ r / σ²`.
    """
    frames, markers = usable.shape[0], len(session.markers)
    residual, seen = np.zeros((frames, markers, 2)), np.zeros((frames, markers), dtype=bool)
    by_foot = np.zeros((frames, markers, 2, 3))
    for m in range(markers):
        rows = np.flatnonzero(usable & session.mirror_view.marker_seen[:, m])
        if len(rows):
            residual[rows, m], by_foot[rows, m], seen[rows, m] = _residuals(
                session, m, rows, done.foot_m[rows], marker_in_camera[rows, m]
            )
    residual[~seen], by_foot[~seen] = 0.0, 0.0
    information = np.zeros((frames, 3, 3))
    information[usable] = np.linalg.inv(done.foot_covariance_m2[usable])
    information += np.einsum("fmik,fmil->fkl", by_foot, by_foot) / noise_px**2
    information[~usable] = np.eye(3)
    moved = np.linalg.solve(
        information, np.einsum("fmik,fmi->fk", by_foot, residual)[..., None] / noise_px**2
    )
    left = residual - np.einsum("fmik,fk->fmi", by_foot, moved[..., 0])
    return [(left[seen[:, m], m] ** 2).sum(axis=1) for m in range(markers)]


def _residuals(
    session: Session, m: int, rows: npt.NDArray[np.int64], foot_m: Floats, points: Floats
) -> tuple[Floats, Floats, npt.NDArray[np.bool_]]:
    """Seen less predicted image of one marker (N, 2), its derivative by the mirror's foot (N, 2, 3), and a mask (N,)."""
    assert session.camera is not None
    camera, mirror, marker = session.camera, session.mirror, session.markers[m]
    extra = {} if mirror is None else {"refractive_index": mirror.refractive_index}
    thickness = mirror.glass_thickness_m if mirror else 0.0
    told = see_in_mirror(camera, foot_m, points, glass_thickness_m=thickness, **extra)
    seen, good = session.mirror_view.marker_px[rows, m], np.asarray(told.valid).copy()
    if marker.diameter_m > 0.0:
        normal = foot_m / np.linalg.norm(foot_m, axis=1, keepdims=True)
        depth = np.einsum("ni,ni->n", normal, foot_m - points)
        path = np.linalg.norm(points + 2.0 * depth[:, None] * normal, axis=1)
        centre = ball_center_pixels(camera, seen, marker.diameter_m, path)
        good &= np.asarray(centre.valid)
        seen = centre.pixels_px
    return seen - told.pixels_px, np.asarray(told.by_foot_point), good


def _metre_squares(
    session: Session, done: Measured, counted: npt.NDArray[np.bool_], marker_in_camera: Floats
) -> list[Floats]:
    """By marker: squared distances between the measured and the simulated place, m²."""
    posture, marker = np.asarray(done.posture), np.asarray(done.marker)
    numbers, first = np.unique(session.frames.posture, return_index=True)
    row = first[np.searchsorted(numbers, posture)]
    good = np.array([reason is None for reason in done.marker_reason], dtype=bool)
    square = ((done.point_in_camera_m - marker_in_camera[row, marker]) ** 2).sum(axis=1)
    return [square[good & counted[row] & (marker == m)] for m in range(len(session.markers))]


def _rms(squares: Floats | Sequence[float]) -> float | None:
    values = np.asarray(squares, dtype=float)
    return float(np.sqrt(values.mean())) if len(values) else None
