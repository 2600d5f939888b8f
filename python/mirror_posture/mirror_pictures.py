"""Mirrors and markers from pictures alone: a board and its reflection, balls in the mirror; no robot needed.

camera = load_camera_info("camera.yaml")
mirror = mirror_from_picture(camera, Board(7, 6, 0.025), "picture.jpg")
mirror.normals, mirror.offsets_m, mirror.covariances_m2
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from ._core import MirrorPostureError
from .arguments import checked_arguments
from .arrays import Floats
from .board import CHESSBOARD, Board
from .camera import Camera
from .detect import (
    BoardOptions,
    BoardPrediction,
    DetectionOptions,
    DetectionSetup,
    GateOptions,
    PictureDetections,
    PicturePrediction,
    detect_picture,
)
from .marker import Marker
from .mirror import MirrorEstimates, PlanarPoses, Rig, planar_poses
from .picture_residuals import agreeing_views, of_its_size, tested_mirrors
from .short_repr import ShortRepr
from .triangulate import MarkerPositions, triangulate

Picture = str | os.PathLike[str] | npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False, repr=False)
class SeenMarkers(ShortRepr):
    """Markers of one posture, measured in several views: `positions` has one row for each of `names`,
    `mirrors` one for each picture.

    `camera_from_board` (4, 4) is as given, or measured, and then `camera_from_board_covariance` (6, 6) is
    its covariance, rotation first (rad, m). `unseen` says for each name why a view (its index) does not
    show it, `warnings` which deviations were increased and why.
    """

    names: tuple[str, ...]
    positions: MarkerPositions
    mirrors: MirrorEstimates
    camera_from_board: Floats
    camera_from_board_covariance: Floats | None
    unseen: dict[str, dict[int, str]]
    warnings: tuple[str, ...] = ()


@checked_arguments
def mirror_from_picture(
    camera: Camera,
    board: Board,
    picture: Picture,
    *,
    camera_from_board: npt.ArrayLike | None = None,
    glass_thickness_m: float = 0.0,
    gate: GateOptions | None = None,
) -> MirrorEstimates:
    """The mirror in one picture, a path or a BGR array: the plane `n·x = d` in the camera frame, m, with
    the covariance of its foot point.

    The picture shows the board and its reflection. The direct view gives the board's pose, both together
    give the mirror (maximum likelihood). With a known `camera_from_board` (4, 4) the reflection is
    sufficient, and mirrored or rotated pictures are named. Without it they cannot be detected, because a
    chessboard looks alike in a mirror. The result has one row. If its corners fit no mirror within their
    noise, the covariance is increased to match the residuals.

    Raises `MirrorPostureError` for a picture that cannot be read or has another size than the camera's, and
    where a view is not found or is not reliable: the message says which and why.
    """
    found = _seen(camera, board, (), picture, camera_from_board, gate)
    mirrored = _trusted(found, "mirror")
    pose, covariance = camera_from_board, None
    if pose is None:
        poses = _direct(camera, board, found)
        pose, covariance = poses.camera_from_pattern[0], poses.covariances[0]
    rig = Rig(camera, board, np.asarray(pose, dtype=np.float64), covariance, glass_thickness_m)
    return tested_mirrors(rig, mirrored[0][None], mirrored[1], [found.source])[0]


@checked_arguments
def mirrors_from_pictures(
    camera: Camera,
    board: Board,
    pictures: Sequence[Picture],
    *,
    camera_from_board: npt.ArrayLike | None = None,
    glass_thickness_m: float = 0.0,
    gate: GateOptions | None = None,
) -> tuple[MirrorEstimates | MirrorPostureError, ...]:
    """`mirror_from_picture` of each picture, in the given order; an error with the reason in place of a
    mirror that was not measured."""
    found: list[MirrorEstimates | MirrorPostureError] = []
    for picture in pictures:
        try:
            found.append(
                mirror_from_picture(
                    camera,
                    board,
                    picture,
                    camera_from_board=camera_from_board,
                    glass_thickness_m=glass_thickness_m,
                    gate=gate,
                )
            )
        except MirrorPostureError as error:
            found.append(error)
    return tuple(found)


@checked_arguments
def markers_from_views(
    camera: Camera,
    board: Board,
    markers: Sequence[Marker],
    pictures: Sequence[Picture],
    *,
    camera_from_board: npt.ArrayLike | None = None,
    glass_thickness_m: float = 0.0,
    gate: GateOptions | None = None,
) -> SeenMarkers:
    """Balls' places in the camera frame, m, with covariance, from two or more pictures in which only the
    mirror moved.

    Camera, board and balls stay fixed to each other. Each picture shows the board's reflection (and, where
    `camera_from_board` (4, 4) is not given, the board itself) and the balls in the mirror. Each ball's
    virtual rays meet at the ball (maximum likelihood). A marker that fewer than two pictures show, or whose outlines
    have not the size of its diameter at that place, is masked with its reason.

    Raises `MirrorPostureError` for fewer than two pictures, one that cannot be read, and where a view of
    the board is not found or is not reliable.
    """
    if len(pictures) < 2:
        raise MirrorPostureError(
            f"pictures: got {len(pictures)}, needed two or more, the mirror moved in between"
        )
    if not markers:
        raise MirrorPostureError("markers: none given, needed at least one")
    found = [_seen(camera, board, tuple(markers), picture, camera_from_board, gate) for picture in pictures]
    corners = [_trusted(one, "mirror") for one in found]
    pose, covariance = camera_from_board, None
    if pose is None:
        pose, covariance = _joined([_direct(camera, board, one) for one in found])
    pose = np.asarray(pose, dtype=np.float64)
    mirrors, warnings = tested_mirrors(
        Rig(camera, board, pose, covariance, glass_thickness_m),
        np.stack([one[0] for one in corners]),
        float(np.sqrt(np.mean([one[1] ** 2 for one in corners]))),
        [one.source for one in found],
    )
    parts = []
    unseen: dict[str, dict[int, str]] = {}
    for index, marker in enumerate(markers):
        views = [one.markers[index] for one in found]
        unseen[marker.name] = {i: view.reason for i, view in enumerate(views) if not view.ok}
        rows = np.array([i if view.ok and mirrors.valid[i] else -1 for i, view in enumerate(views)])
        pixels = [view.sphere_center_px or view.pixel_px or (0.0, 0.0) for view in views]
        stds = [view.std_px for view, row in zip(views, rows, strict=True) if row >= 0 and view.std_px]
        noise = float(np.sqrt(np.mean(np.square(stds)))) if stds else 1.0
        part = triangulate(mirrors, rows[None], np.array([pixels], dtype=np.float64), noise_px=noise)
        part = agreeing_views(part, 2 * int((rows >= 0).sum()) - 3)
        used = {int(row): view for row, view in zip(rows, views, strict=True) if row >= 0}
        parts.append(of_its_size(part, marker, camera, mirrors, used))
    names = tuple(marker.name for marker in markers)
    return SeenMarkers(names, _stacked(parts), mirrors, pose, covariance, unseen, warnings)


def _seen(
    camera: Camera,
    board: Board,
    markers: tuple[Marker, ...],
    picture: Picture,
    camera_from_board: npt.ArrayLike | None,
    gate: GateOptions | None,
) -> PictureDetections:
    if board.pattern != CHESSBOARD:
        raise MirrorPostureError(
            f"board pattern = {board.pattern!r}: mirrors from pictures need a chessboard"
        )
    known = camera_from_board is not None
    options = DetectionOptions(
        board=BoardOptions(views=("mirror",) if known else ("direct", "mirror"), gate=gate or GateOptions())
    )
    told = None
    if known:
        told = PicturePrediction(
            BoardPrediction(camera_from_board=np.asarray(camera_from_board, dtype=np.float64))
        )
    shown = picture if isinstance(picture, np.ndarray) else Path(picture)
    return detect_picture(shown, DetectionSetup(board, markers, camera), told, options)


def _direct(camera: Camera, board: Board, found: PictureDetections) -> PlanarPoses:
    """The board's pose where a picture shows it directly; one row."""
    corners, noise_px = _trusted(found, "direct")
    poses = planar_poses(camera, board, corners[None], noise_px=noise_px)
    if not poses.valid[0]:
        raise MirrorPostureError(
            f"{found.source}: no pose of the board explains its direct view ({poses.reasons[0]})"
        )
    return poses


def _joined(poses: Sequence[PlanarPoses]) -> tuple[Floats, Floats]:
    """One pose from several measurements of it, weighted by their information, in the tangent at the first: `pose ∘ (Exp ω, v)`."""
    first = poses[0].camera_from_pattern[0]
    information, pull = np.zeros((6, 6)), np.zeros(6)
    for one in poses:
        step = np.linalg.solve(first, one.camera_from_pattern[0])
        tangent = np.concatenate([cv2.Rodrigues(step[:3, :3])[0].ravel(), step[:3, 3]])
        weight = np.linalg.inv(one.covariances[0])
        information += weight
        pull += weight @ tangent
    mean = np.linalg.solve(information, pull)
    step = np.eye(4)
    step[:3, :3], step[:3, 3] = cv2.Rodrigues(mean[:3])[0], mean[3:]
    joined: Floats = first @ step
    covariance = np.linalg.inv(information).astype(np.float64, copy=False)
    return joined, covariance


def _stacked(parts: Sequence[MarkerPositions]) -> MarkerPositions:
    """One row of each."""
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name, value in vars(parts[0]).items()
        if isinstance(value, np.ndarray)
    }
    reasons = {row: part.reasons[0] for row, part in enumerate(parts) if not part.valid[0]}
    return MarkerPositions(triangulator=parts[0].triangulator, reasons=reasons, **arrays)


def _trusted(found: PictureDetections, via: str) -> tuple[Floats, float]:
    """Corners (N, 2) px, NaN where hidden, and the standard deviation of one axis, px, of a view (`direct`, `mirror`) that passed its checks."""
    view = next((view for view in found.boards if view.via == via), None)
    if view is None or not view.ok or view.corners_px is None or view.std_px is None:
        # Where the boards can't be told apart, none is a mirror's, and all say why.
        refused = [board for board in found.boards if not board.ok] if view is None else [view]
        reason = refused[0].reason if refused else "not found"
        seen = "seen directly" if via == "direct" else "in the mirror"
        raise MirrorPostureError(f"{found.source}: board {seen}: {reason}")
    shown = np.ones(len(view.corners_px), dtype=bool) if view.visible is None else view.visible
    corners = np.where(shown[:, None], view.corners_px, np.nan)
    return corners, float(np.sqrt(np.mean(view.std_px[shown] ** 2)))
