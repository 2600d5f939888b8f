"""The gap of simulator against reality: simulated markers beside those that the session's pictures show.

The mirror of each frame is fitted to the board's reflection, with camera and board where the simulator has them. In pixels
the gap is the distance between a marker's image and its prediction, frame by frame. In metres it is how far a posture's views
move its markers from where the simulator has them, all of them set free together, the mirrors' planes too, as a diagnosis does it:

    minimise  ∑ |r − P δ − J f|² / σ² + fᵀ Σ⁻¹ f + |δ|² / 0.05²

with r seen less predicted images, P and J their derivatives by the markers' places and by the mirrors' feet, Σ what the corners
leave of the feet. What lies along a single view's ray is not seen and does not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mirror_posture import MirrorPostureError
from mirror_posture._core import Measured
from mirror_posture.arrays import Floats, Integers, Mask
from mirror_posture.measurement import MeasureOptions
from mirror_posture.measurement.inputs import core_input
from mirror_posture.mirror import IDEAL_MIRROR
from mirror_posture.optics import ball_center_pixels, see_in_mirror
from mirror_posture.session import Session
from mirror_posture.short_repr import ShortRepr

from .motion import Rest

POINT_STEP_M = 1e-5
FREE_MARKER_M = 0.05
"""How far a free marker may be from its prediction: keeps finite what only one view shows of it."""
CORNER_NOISE_PX = 0.2
"""Default noise where neither the session nor a detector states it: it is the weight of corners relative to
markers and moves no minimum."""


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedGap(ShortRepr):
    """RMS distances. The arrays are by marker, in the session's order; NaN where a marker was never seen (not measured)."""

    rms_px: float | None
    rms_m: float | None
    marker_rms_px: Floats
    marker_rms_m: Floats
    pixels: int
    measured: int


def simulated_gap(session: Session, rest: Rest, rows: Mask | None = None) -> SimulatedGap:
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
    done = core_input(session, camera_from_board).ladder(
        "maximum_likelihood",
        corner_noise_px=noise,
        marker_noise_px=noise,
        least_parallax_rad=MeasureOptions().least_parallax_rad,
    )
    mirror = np.array([reason is None for reason in done.mirror_reason], dtype=bool)
    images = _images(session, done, mirror & counted, marker_in_camera)
    squares_px = _pixel_squares(images, done.foot_covariance_m2, noise)
    squares_m = _metre_squares(session, images, _direct(session, counted, marker_in_camera), done, noise)
    return SimulatedGap(
        _rms(np.concatenate(squares_px)),
        _rms(np.concatenate(squares_m)),
        np.array([_rms(s) or np.nan for s in squares_px]),
        np.array([_rms(s) or np.nan for s in squares_m]),
        sum(map(len, squares_px)),
        sum(map(len, squares_m)),
    )


@dataclass(frozen=True, eq=False, repr=False)
class _Images(ShortRepr):
    """Seen less predicted images (F, markers, 2), their derivatives by a marker's place and by the mirror's foot; zeros where not `seen`."""

    residual: Floats
    by_point: Floats
    by_foot: Floats
    seen: Mask
    usable: Mask
    """(F,): frames whose mirror is measured."""


def _images(session: Session, done: Measured, usable: Mask, marker_in_camera: Floats) -> _Images:
    """The markers in the mirror, of the usable frames."""
    frames, markers = usable.shape[0], len(session.markers)
    residual, seen = np.zeros((frames, markers, 2)), np.zeros((frames, markers), dtype=bool)
    by_point, by_foot = np.zeros((frames, markers, 2, 3)), np.zeros((frames, markers, 2, 3))
    for m in range(markers):
        rows = np.flatnonzero(usable & session.mirror_view.marker_seen[:, m])
        if len(rows):
            residual[rows, m], by_point[rows, m], by_foot[rows, m], seen[rows, m] = _residuals(
                session, m, rows, done.foot_m[rows], marker_in_camera[rows, m]
            )
    residual[~seen], by_point[~seen], by_foot[~seen] = 0.0, 0.0, 0.0
    return _Images(residual, by_point, by_foot, seen, usable)


def _direct(session: Session, counted: Mask, marker_in_camera: Floats) -> _Images:
    """The markers that the camera sees without the mirror."""
    assert session.camera is not None
    view = session.direct_view
    frames, markers = len(counted), len(session.markers)
    residual, by_point = np.zeros((frames, markers, 2)), np.zeros((frames, markers, 2, 3))
    seen = np.zeros((frames, markers), dtype=bool)
    if view.marker_seen.shape == seen.shape:
        seen = view.marker_seen & counted[:, None] & (marker_in_camera[..., 2] > POINT_STEP_M)
    points = marker_in_camera[seen]
    if len(points):
        images = view.marker_px[seen]
        for diameter in {marker.diameter_m for marker in session.markers} - {0.0}:
            balls = np.broadcast_to([m.diameter_m == diameter for m in session.markers], seen.shape)[seen]
            distance = np.linalg.norm(points[balls], axis=1)
            centre = ball_center_pixels(session.camera, images[balls], diameter, distance)
            images[balls] = np.where(
                np.asarray(centre.valid)[:, None], np.asarray(centre.pixels_px), images[balls]
            )
        residual[seen] = images - session.camera.project(points)
        steps = POINT_STEP_M * np.eye(3)
        by_point[seen] = np.stack(
            [session.camera.project(points + s) - session.camera.project(points - s) for s in steps], axis=2
        ) / (2.0 * POINT_STEP_M)
    return _Images(residual, by_point, np.zeros_like(by_point), seen, counted)


def _pixel_squares(images: _Images, foot_covariance_m2: Floats, noise_px: float) -> list[Floats]:
    """By marker: squared distances between observed and predicted image, px².

    The mirror of a frame is a nuisance parameter of all that the frame shows: to the plane from its
    corners, with covariance Σ, the markers' residuals r with J = ∂pixel/∂foot add `δ = (Σ⁻¹ + ∑ JᵀJ / σ²)⁻¹
    ∑ Jᵀ r / σ²`.
    """
    by_foot, residual, usable = images.by_foot, images.residual, images.usable
    information = np.zeros((len(usable), 3, 3))
    information[usable] = np.linalg.inv(foot_covariance_m2[usable])
    information += np.einsum("fmik,fmil->fkl", by_foot, by_foot) / noise_px**2
    information[~usable] = np.eye(3)
    moved = np.linalg.solve(
        information, np.einsum("fmik,fmi->fk", by_foot, residual)[..., None] / noise_px**2
    )
    left = residual - np.einsum("fmik,fk->fmi", by_foot, moved[..., 0])
    return [(left[images.seen[:, m], m] ** 2).sum(axis=1) for m in range(images.seen.shape[1])]


def _metre_squares(
    session: Session, mirrored: _Images, direct: _Images, done: Measured, noise_px: float
) -> list[Floats]:
    """By marker: squared distances between the measured and the simulated place, m², one a posture that shows it."""
    frames, markers = mirrored.seen.shape
    _, posture = np.unique(session.frames.posture, return_inverse=True)
    count = int(posture.max()) + 1 if frames else 0
    normal = np.zeros((count, 3 * markers, 3 * markers))
    pull = np.zeros((count, 3 * markers))
    for images in (mirrored, direct):
        feet = np.where(images.usable[:, None, None], done.foot_covariance_m2, 0.0)
        j = images.by_foot.reshape(frames, 2 * markers, 3)
        spread = j @ np.nan_to_num(feet) @ np.swapaxes(j, 1, 2) + noise_px**2 * np.eye(2 * markers)
        blocks = np.zeros((frames, markers, 2, markers, 3))
        blocks[:, range(markers), :, range(markers)] = np.swapaxes(images.by_point, 0, 1)
        p = blocks.reshape(frames, 2 * markers, 3 * markers)
        weighed = np.linalg.solve(spread, p)
        np.add.at(normal, posture, np.swapaxes(p, 1, 2) @ weighed)
        rows = images.residual.reshape(frames, 2 * markers, 1)
        np.add.at(pull, posture, (np.swapaxes(weighed, 1, 2) @ rows)[..., 0])
    normal += np.eye(3 * markers) / FREE_MARKER_M**2
    moved = np.linalg.solve(normal, pull[..., None]).reshape(count, markers, 3)
    shown = np.zeros((count, markers), dtype=bool)
    np.logical_or.at(shown, posture, mirrored.seen | direct.seen)
    return [(moved[shown[:, m], m] ** 2).sum(axis=1) for m in range(markers)]


def _residuals(
    session: Session, m: int, rows: Integers, foot_m: Floats, points: Floats
) -> tuple[Floats, Floats, Floats, Mask]:
    """Seen less predicted image of one marker (N, 2), its derivatives by its place and by the mirror's foot (N, 2, 3), a mask (N,)."""
    assert session.camera is not None
    camera, marker = session.camera, session.markers[m]
    told = see_in_mirror(camera, foot_m, points, **(session.mirror or IDEAL_MIRROR).glass)
    seen, good = session.mirror_view.marker_px[rows, m], np.asarray(told.valid).copy()
    if marker.diameter_m > 0.0:
        normal = foot_m / np.linalg.norm(foot_m, axis=1, keepdims=True)
        depth = np.einsum("ni,ni->n", normal, foot_m - points)
        path = np.linalg.norm(points + 2.0 * depth[:, None] * normal, axis=1)
        centre = ball_center_pixels(camera, seen, marker.diameter_m, path)
        good &= np.asarray(centre.valid)
        seen = centre.pixels_px
    return seen - told.pixels_px, np.asarray(told.by_point), np.asarray(told.by_foot_point), good


def _rms(squares: Floats | Sequence[float]) -> float | None:
    values = np.asarray(squares, dtype=float)
    return float(np.sqrt(values.mean())) if len(values) else None
