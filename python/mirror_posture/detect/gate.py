"""The residual of one view against a plane chessboard: a second test after a detector's success.

With a camera, the corners' rays are undistorted and a homography from the board's plane is fitted to them.
Every view of a flat board, direct or mirrored, is a homography; its residual contains only measurement
noise (a pane of glass adds less than 0.1 px). Without a camera, lens distortion remains, and a cubic
polynomial in addition to the homography absorbs it.

A labelled view is then tested once more on its reprojection from the best pose in front of the camera, by
the core's planar solver, which has two degrees of freedom less and so also notices a camera file of another
camera.

Method: normalised direct linear transform and refinement by OpenCV's `findHomography`; the pose as in
`mirror_posture.mirror`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from .._core import MirrorPostureError
from ..board import Board
from ..camera import Camera
from ..short_repr import ShortRepr
from .pose import board_pose
from .types import FloatArray

# Good views of real phone and machine-vision cameras leave 0.2 to 0.5 px (RMS distance), a grid shifted by a row or with one misplaced
# line 1.7 to 2.6 px.
DEFAULT_MAX_RESIDUAL_PX = 1.0
# Large pictures leave more pixels: a lens that its model describes to a few hundred-thousandths of the width, a board that is not quite flat. Both grow with
# the squares; a misplaced line is off by much more of one.
DEFAULT_MAX_RESIDUAL_SQUARES = 0.02
# ... up to this.
LARGEST_DEFAULT_RESIDUAL_PX = 3.0
# Fewer corners than this cannot carry a cubic polynomial (10 terms) and still show a residual.
MIN_CORNERS_FOR_CUBIC = 24
IN_ONE_LINE = "the corners that are seen lie in one line, or all but one do: needed two off every line; show more of the board"


@dataclass(frozen=True)
class GateOptions:
    """Limits for accepting a view: RMS distance of its corners from the fitted plane board, the larger of both: px, and share of the seen squares' side.

    The share never allows more than 3 px; `max_residual_rms_px` may.
    """

    max_residual_rms_px: float = DEFAULT_MAX_RESIDUAL_PX
    max_residual_squares: float = DEFAULT_MAX_RESIDUAL_SQUARES

    def __post_init__(self) -> None:
        for name in ("max_residual_rms_px", "max_residual_squares"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise MirrorPostureError(f"{name} = {value}: needed a number of at least 0")

    def limit_px(
        self, corners_px: FloatArray, board: Board, visible: npt.NDArray[np.bool_] | None = None
    ) -> float:
        """The limit for a view's corners `(N, 2)` in the board's order, px; by the smallest of its squares between corners that are visible `(N,)`."""
        seen = corners_px if visible is None else np.where(visible[:, None], corners_px, np.nan)
        grid = seen.reshape(board.rows, board.columns, 2)
        sides = np.concatenate([np.linalg.norm(np.diff(grid, axis=axis), axis=2).ravel() for axis in (0, 1)])
        sides = sides[np.isfinite(sides)]
        # A tenth of the sides may be wrong.
        share = self.max_residual_squares * float(np.quantile(sides, 0.1)) if len(sides) else 0.0
        return max(self.max_residual_rms_px, min(share, LARGEST_DEFAULT_RESIDUAL_PX))


@dataclass(frozen=True, eq=False, repr=False)
class GateResult(ShortRepr):
    """Residuals `(N, 2)` px of the corners, their RMS distance, the limit, and the degrees of freedom that are left."""

    residuals_px: FloatArray
    rms_px: float
    limit_px: float
    degrees_of_freedom: int
    no_fit: str = ""
    """Why no flat board was fitted at all; the residuals are infinite then."""

    @property
    def ok(self) -> bool:
        return self.rms_px <= self.limit_px

    @property
    def reason(self) -> str:
        if self.ok:
            return ""
        if self.no_fit:
            return self.no_fit
        return (
            f"residual {self.rms_px:.2f} px RMS against a flat board is above the limit of {self.limit_px:.2f} px: "
            "a wrong grid, a bent board, or a camera file that is not this camera's"
        )


def spans_plane(board: Board, seen: npt.NDArray[np.bool_]) -> bool:
    """Whether the seen corners `(N,)` determine the board's plane: at least two of them lie off every line, and so in two rows and two columns."""
    rows, columns = np.divmod(np.flatnonzero(seen), board.columns)
    if len(rows) < 4:
        return False
    # A line that holds all of them but one holds two of any three.
    for a, b in ((0, 1), (0, 2), (1, 2)):
        off = (columns[b] - columns[a]) * (rows - rows[a]) - (rows[b] - rows[a]) * (columns - columns[a])
        if np.count_nonzero(off) < 2:
            return False
    return True


def board_residual(
    corners_px: FloatArray,
    board: Board,
    camera: Camera | None,
    options: GateOptions | None = None,
    visible: npt.NDArray[np.bool_] | None = None,
) -> GateResult:
    """Residual of labelled corners `(N, 2)` against the flat board, of the visible ones `(N,)` if not all are."""
    options = options or GateOptions()
    limit = options.limit_px(corners_px, board, visible)
    plane = board.corner_in_board_m[:, :2] / board.square_m
    pixels = corners_px
    if visible is not None:
        plane, pixels = plane[visible], pixels[visible]
    count = len(plane)
    if visible is not None and not spans_plane(board, visible):
        return _unfitted(count, limit, IN_ONE_LINE)
    view = _view_plane(pixels, camera)
    homography = None
    if count >= 4 and view is not None and np.isfinite(view.measured).all():
        homography, _ = cv2.findHomography(plane, view.measured)
    fitted = None
    if view is not None and homography is not None and np.isfinite(homography).all():
        fitted = view.to_pixels(cv2.perspectiveTransform(plane[None], homography)[0])
    if fitted is None:
        return _unfitted(
            count,
            limit,
            "no flat board fits its corners: a wrong grid, or a camera file that is not this camera's",
        )
    residuals = pixels - fitted
    freedom = 2 * count - 8
    if camera is None and count >= MIN_CORNERS_FOR_CUBIC:
        basis = cubic_basis(plane)
        coefficients, *_ = np.linalg.lstsq(basis, residuals, rcond=None)
        residuals = residuals - basis @ coefficients
        freedom = 2 * (count - basis.shape[1])
    rms = float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))
    return GateResult(residuals, rms, limit, freedom)


def _unfitted(count: int, limit_px: float, why: str) -> GateResult:
    return GateResult(np.full((count, 2), np.inf), float("inf"), limit_px, 2 * count - 8, why)


@dataclass(frozen=True)
class PoseGate:
    """Verdict of the core's planar solver: RMS reprojection distance, None without a camera, and the reason if it is too large."""

    rms_px: float | None
    reason: str


def pose_gate(
    corners_px: FloatArray,
    board: Board,
    camera: Camera | None,
    options: GateOptions | None = None,
    visible: npt.NDArray[np.bool_] | None = None,
) -> PoseGate:
    """Gates a view on its reprojection from the best pose of the board before this camera."""
    if camera is None:
        return PoseGate(None, "")
    options = options or GateOptions()
    pose = board_pose(corners_px, board, camera, visible)
    if pose is None:
        return PoseGate(
            None, "no pose of the board before this camera explains the corners: check the camera file"
        )
    limit = options.limit_px(corners_px, board, visible)
    if pose.rms_px <= limit:
        return PoseGate(pose.rms_px, "")
    return PoseGate(
        pose.rms_px,
        f"reprojection residual {pose.rms_px:.2f} px RMS from the board's best pose is above the limit of "
        f"{limit:.2f} px: a wrong grid, or a camera file that is not this camera's",
    )


@dataclass(frozen=True, eq=False, repr=False)
class _ViewPlane(ShortRepr):
    """Corners as an ideal camera that looks at their middle would see them, in its px, and the way back to
    this camera's pixels."""

    measured: FloatArray
    camera: Camera | None
    camera_from_view: FloatArray

    def to_pixels(self, points: FloatArray) -> FloatArray | None:
        if self.camera is None:
            return points
        rays = np.column_stack([points / self.camera.mean_focal_px, np.ones(len(points))])
        try:
            return self.camera.project(rays @ self.camera_from_view.T)
        except MirrorPostureError:
            return None


def _view_plane(pixels: FloatArray, camera: Camera | None) -> _ViewPlane | None:
    if camera is None:
        return _ViewPlane(pixels, None, np.eye(3))
    try:
        rays = camera.unproject(pixels)
    except MirrorPostureError:
        return None
    # Looked at straight on, also a fisheye's side is a plane picture.
    forward = rays.mean(axis=0)
    forward = forward / np.linalg.norm(forward)
    # Across (0, 1, 0) and forward; `np.cross` takes some ten times as long for one vector.
    x, y, z = forward.tolist()
    flat = max(math.hypot(x, z), 1e-12)
    right = [z / flat, 0.0, -x / flat]
    down = [y * right[2], z * right[0] - x * right[2], -y * right[0]]
    camera_from_view = np.column_stack([right, down, forward])
    seen = rays @ camera_from_view
    if not (seen[:, 2] > 0.05).all():
        return None
    return _ViewPlane(seen[:, :2] / seen[:, 2:] * camera.mean_focal_px, camera, camera_from_view)


def cubic_basis(plane: FloatArray) -> FloatArray:
    """Monomials up to the third degree of places (N, 2) in the board's plane, (N, 10)."""
    scaled = plane / np.abs(plane).max()
    x, y = scaled[:, 0], scaled[:, 1]
    return np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1)
