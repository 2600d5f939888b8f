"""A camera's intrinsics from pictures of the printed board, seen directly; and what the pictures leave weak."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from ._core import MirrorPostureError
from .arrays import Floats, Mask
from .board import Board
from .camera import Camera
from .counted import counted
from .detect.gate import IN_ONE_LINE, spans_plane

LEAST_VIEWS, GOOD_VIEWS = 4, 12
LEAST_CORNERS = 6
CELLS = (8, 6)
"""The picture in cells, across and down: a lens is known where corners were."""
GOOD_COVERAGE = 0.6
GOOD_TILT_DEG = 25.0
"""Pictures face-on alone cannot separate the focal length from the distance."""
OUTLIER = 3.0
"""A view whose residual is this many times the median's was detected wrongly, or the board bent."""
GOOD_FOCAL = 0.003
"""Relative standard deviation of the focal length: 0.3 % of it is 1 mm in 30 cm."""


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """The camera, how well each number is known, and how the pictures were spread."""

    camera: Camera
    std_px: tuple[float, float, float, float]
    """Standard deviations of fx, fy, cx, cy, px."""
    std_distortion: tuple[float, ...]
    rms_px: float
    view_rms_px: Floats
    """(V,) residual of each view that was used, px RMS of a corner."""
    used: Mask
    """(all views,) False for those left out."""
    reasons: Mapping[int, str]
    """Of each view that was left out, why."""
    coverage: float
    """Share of the picture's cells in which corners were."""
    largest_tilt_rad: float
    weak: tuple[str, ...]
    """What to improve, in words; empty where everything is good."""


def calibrate_camera(
    board: Board, corners_px: Sequence[npt.ArrayLike], size_px: tuple[int, int]
) -> CameraCalibration:
    """Focal lengths, principal point and a `plumb_bob` lens by Zhang's method, with bundle adjustment (OpenCV).

    `corners_px` holds (N, 2) for each view in the board's order, NaN where a corner was not seen. Views whose
    corners are too few or lie in one line are left out, and once those whose residual is three times the median.
    The standard deviations are those of the adjustment, scaled by its residuals.

    Raises:
        MirrorPostureError: fewer than 4 views with 6 corners that are not in one line, views of another size, an adjustment without a result.
    """
    points = [np.asarray(view, dtype=np.float64) for view in corners_px]
    for view in points:
        if view.shape != (board.corner_count, 2):
            raise MirrorPostureError(
                f"corners: got {view.shape}, needed ({board.corner_count}, 2) for a board of {board.columns} x {board.rows}"
            )
    seen = [np.asarray(np.isfinite(view).all(axis=1), dtype=bool) for view in points]
    reasons = {view: why for view, mask in enumerate(seen) if (why := _too_little(board, mask))}
    used = np.array([view not in reasons for view in range(len(seen))], dtype=bool)
    if used.sum() < LEAST_VIEWS:
        raise MirrorPostureError(
            f"calibration: got {counted(int(used.sum()), 'view')} with {LEAST_CORNERS} corners or more that are not in one line, "
            f"needed {LEAST_VIEWS}, better {GOOD_VIEWS}; take pictures that show more of the board"
        )
    in_board = board.corner_in_board_m

    def solve(chosen: Mask) -> tuple[float, Floats, Floats, list[Floats], Floats, Floats]:
        objects = [in_board[mask].astype(np.float32) for mask, use in zip(seen, chosen, strict=True) if use]
        images = [
            view[mask].astype(np.float32) for view, mask, use in zip(points, seen, chosen, strict=True) if use
        ]
        # Its threads add up the views in any order, and what rounding makes of it shows in the sixth digit: the same pictures, the same camera.
        threads = cv2.getNumThreads()
        cv2.setNumThreads(1)
        try:
            found = cv2.calibrateCameraExtended(objects, images, size_px, None, None)  # type: ignore[call-overload]
        except cv2.error as error:
            raise MirrorPostureError(f"calibration: OpenCV found no camera: {error.err}") from None
        finally:
            cv2.setNumThreads(threads)
        rms, matrix, lens, turns, _, std, _, each = found
        return float(rms), matrix, lens.ravel(), list(turns), std.ravel(), each.ravel()

    rms, matrix, lens, turns, std, each = solve(used)
    left_out = 0
    bad = each > OUTLIER * np.median(each)
    if bad.any() and (~bad).sum() >= LEAST_VIEWS:
        misfits = np.flatnonzero(used)[bad]
        median = float(np.median(each))
        for view, rms_px in zip(misfits.tolist(), each[bad], strict=True):
            reasons[view] = (
                f"residual {rms_px:.2f} px, more than {OUTLIER:g} times the median of {median:.2f} px: a bent board, blur, or a wrong grid"
            )
        used[misfits] = False
        left_out = len(misfits)
        rms, matrix, lens, turns, std, each = solve(used)
    if not (np.isfinite(matrix).all() and np.isfinite(lens).all() and np.isfinite(std[:9]).all()):
        raise MirrorPostureError(
            "calibration: the adjustment has no result; take pictures with the board tilted"
        )
    camera = Camera(
        size_px,
        (float(matrix[0, 0]), float(matrix[1, 1])),
        (float(matrix[0, 2]), float(matrix[1, 2])),
        "plumb_bob",
        tuple(float(v) for v in lens[:5]),
    )
    covered = _covered(
        [view[mask] for view, mask, use in zip(points, seen, used, strict=True) if use], size_px
    )
    coverage = float(covered.mean())
    tilt = max(float(np.arccos(min(1.0, abs(cv2.Rodrigues(turn)[0][2, 2])))) for turn in turns)
    fx, fy, cx, cy = (float(v) for v in std[:4])
    weak = _weak(int(used.sum()), left_out, covered, tilt, max(fx, fy) / camera.focal_px[0])
    return CameraCalibration(
        camera,
        (fx, fy, cx, cy),
        tuple(float(v) for v in std[4:9]),
        rms,
        np.asarray(each, dtype=np.float64),
        used,
        reasons,
        coverage,
        tilt,
        tuple(weak),
    )


def _too_little(board: Board, seen: Mask) -> str:
    """Why a view of these corners (N,) tells nothing of a camera; empty where it does. One such view makes OpenCV give up all of them."""
    if seen.sum() < LEAST_CORNERS:
        return f"got {counted(int(seen.sum()), 'corner')}, needed {LEAST_CORNERS}; show more of the board"
    return "" if spans_plane(board, seen) else IN_ONE_LINE


def _covered(views: Sequence[Floats], size_px: tuple[int, int]) -> Mask:
    """In which of the picture's cells (down, across) corners were."""
    points = np.concatenate(views)
    across = np.clip((points[:, 0] / size_px[0] * CELLS[0]).astype(int), 0, CELLS[0] - 1)
    down = np.clip((points[:, 1] / size_px[1] * CELLS[1]).astype(int), 0, CELLS[1] - 1)
    covered = np.zeros(CELLS[::-1], dtype=bool)
    covered[down, across] = True
    return covered


def _emptiest(covered: Mask) -> str:
    """The part of the picture, of three by three, with the fewest cells in which corners were; of equal ones a corner, where the lens bends most."""
    share = {
        f"{row} {column}": float(part.mean())
        for row, rows in zip(("upper", "middle", "lower"), np.array_split(covered, 3), strict=True)
        for column, part in zip(("left", "middle", "right"), np.array_split(rows, 3, axis=1), strict=True)
    }
    return min(share, key=lambda name: (share[name], name.count("middle"))).replace("middle middle", "middle")


def _weak(views: int, left_out: int, covered: Mask, tilt_rad: float, focal_std: float) -> list[str]:
    weak = []
    coverage = float(covered.mean())
    if views < GOOD_VIEWS:
        weak.append(f"{counted(views, 'view')}: take {GOOD_VIEWS} or more")
    if left_out:
        weak.append(
            f"{counted(left_out, 'view does', 'views do')} not fit the others: look at them (bent board, blur, a wrong grid)"
        )
    if coverage < GOOD_COVERAGE:
        weak.append(
            f"corners in {100 * coverage:.0f} % of the picture: hold the board into the corners and edges too, the {_emptiest(covered)} first"
        )
    if np.degrees(tilt_rad) < GOOD_TILT_DEG:
        weak.append(
            f"largest tilt {np.degrees(tilt_rad):.0f}°: tilt the board by 30° to 45° in all directions"
        )
    if focal_std > GOOD_FOCAL:
        weak.append(f"focal length known to {100 * focal_std:.1f} % only: tilt more, come nearer")
    return weak
