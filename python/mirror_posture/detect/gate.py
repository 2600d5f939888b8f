"""The residual of one view against a plane chessboard: a detector's success is no proof.

With a camera, the corners are undistorted and a homography from the board's plane is fitted. Every view of a flat board, direct or
mirrored, is a homography; its residual holds only measurement noise (a pane of glass adds less than 0.1 px). Without a camera, lens
distortion is left in, and a cubic polynomial on top of the homography takes it up.

A view that is labelled is then gated once more on its reprojection from the best pose before the camera, by the core's planar solver, which
has two freedoms less and so also notices a camera file of another camera.

Method: normalised direct linear transform and refinement by OpenCV's `findHomography`; the pose as in `mirror_posture.mirror`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..board import Board
from ..camera import Camera
from ..short_repr import ShortRepr
from .pose import board_pose
from .types import FloatArray

# Good views of real phone and machine-vision cameras leave 0.2 to 0.5 px (RMS distance), a grid shifted by a row or with one misplaced
# line 1.7 to 2.6 px.
DEFAULT_MAX_RESIDUAL_PX = 1.0
# Fewer corners than this cannot carry a cubic polynomial (10 terms) and still show a residual.
MIN_CORNERS_FOR_CUBIC = 24


@dataclass(frozen=True)
class GateOptions:
    """Limits for accepting a view: RMS distance of its corners from the fitted plane board, px."""

    max_residual_rms_px: float = DEFAULT_MAX_RESIDUAL_PX


@dataclass(frozen=True, eq=False, repr=False)
class GateResult(ShortRepr):
    """Residuals `(N, 2)` px of the corners, their RMS distance, the limit, and the degrees of freedom that are left."""

    residuals_px: FloatArray
    rms_px: float
    limit_px: float
    degrees_of_freedom: int

    @property
    def ok(self) -> bool:
        return self.rms_px <= self.limit_px

    @property
    def reason(self) -> str:
        if self.ok:
            return ""
        return (
            f"residual {self.rms_px:.2f} px RMS against a flat board is above the limit of {self.limit_px:.2f} px: "
            "a wrong grid, a bent board, or a camera file that is not this camera's"
        )


def board_residual(
    corners_px: FloatArray,
    board: Board,
    camera: Camera | None,
    options: GateOptions | None = None,
    visible: npt.NDArray[np.bool_] | None = None,
) -> GateResult:
    """Residual of labelled corners `(N, 2)` against the flat board, of the visible ones `(N,)` if not all are."""
    options = options or GateOptions()
    plane = board.corner_in_board_m[:, :2] / board.square_m
    pixels = corners_px
    if visible is not None:
        plane, pixels = plane[visible], pixels[visible]
    measured = pixels if camera is None else undistort(pixels, camera)
    count = len(plane)
    homography = None
    if count >= 4 and np.isfinite(measured).all():
        homography, _ = cv2.findHomography(plane, measured)
    if homography is None or not np.isfinite(homography).all():
        return GateResult(
            np.full((count, 2), np.inf), float("inf"), options.max_residual_rms_px, 2 * count - 8
        )
    residuals = measured - cv2.perspectiveTransform(plane[None], homography)[0]
    freedom = 2 * count - 8
    if camera is None and count >= MIN_CORNERS_FOR_CUBIC:
        basis = _cubic_basis(plane)
        coefficients, *_ = np.linalg.lstsq(basis, residuals, rcond=None)
        residuals = residuals - basis @ coefficients
        freedom = 2 * (count - basis.shape[1])
    rms = float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))
    return GateResult(residuals, rms, options.max_residual_rms_px, freedom)


@dataclass(frozen=True)
class PoseGate:
    """Verdict of the core's planar solver: RMS reprojection distance, None without a camera, and the reason if it is too large."""

    rms_px: float | None
    reason: str


def pose_gate(
    corners_px: FloatArray, board: Board, camera: Camera | None, options: GateOptions | None = None
) -> PoseGate:
    """Gates a whole view on its reprojection from the best pose of the board before this camera."""
    if camera is None:
        return PoseGate(None, "")
    options = options or GateOptions()
    pose = board_pose(corners_px, board, camera)
    if pose is None:
        return PoseGate(
            None, "no pose of the board before this camera explains the corners: check the camera file"
        )
    if pose.rms_px <= options.max_residual_rms_px:
        return PoseGate(pose.rms_px, "")
    return PoseGate(
        pose.rms_px,
        f"reprojection residual {pose.rms_px:.2f} px RMS from the board's best pose is above the limit of "
        f"{options.max_residual_rms_px:.2f} px: a wrong grid, or a camera file that is not this camera's",
    )


def undistort(pixels: FloatArray, camera: Camera) -> FloatArray:
    """Pixels `(N, 2)` of the same camera without distortion."""
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-10)
    points = np.ascontiguousarray(pixels, dtype=np.float64).reshape(-1, 1, 2)
    # OpenCV 4 has the variant with criteria under a name of its own.
    iterated: Any = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)
    undistorted = iterated(
        points,
        cameraMatrix=camera.matrix_px,
        distCoeffs=camera.opencv_distortion,
        R=np.eye(3),
        P=camera.matrix_px,
        criteria=criteria,
    )
    flat: FloatArray = undistorted.reshape(-1, 2).astype(np.float64)
    return flat


def _cubic_basis(plane: FloatArray) -> FloatArray:
    scaled = plane / np.abs(plane).max()
    x, y = scaled[:, 0], scaled[:, 1]
    return np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1)
