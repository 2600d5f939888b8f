"""Finds chessboards, direct or mirrored, and determines the labels of their corners.

Several detectors and several preparations of the picture are tried in turn. Each grid found is refined on
the original picture and must pass three tests: the pattern's (`pattern`), the labels' (`labels`) and the
residual's (`gate`). The first grid that passes all three is used; the failures of the others are kept in
`attempts`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import numpy.typing as npt

from ..arguments import checked_arguments
from ..board import Board
from ..camera import Camera
from . import corners, gate, labels, pattern
from .board_search import Candidate, Places, candidates, scale_of
from .hidden import read_partly_seen, without_outliers
from .places import resized
from .prediction import predicted_corners_px
from .types import BoardPrediction, BoardView, FloatArray, Pixels, Via, check_board


@dataclass(frozen=True)
class BoardOptions:
    """What views of the board to expect in a picture.

    `views`: one entry for each expected view. A board is always nearer than its reflection, so of several views the nearest is the
    direct one, if a direct one is expected. `strict_count`: more boards than expected masks them all, since which is which is then open.
    """

    views: tuple[Via, ...] = ("mirror",)
    strict_count: bool = True
    gate: gate.GateOptions = field(default_factory=gate.GateOptions)


@dataclass(frozen=True)
class _Found:
    """A grid that passed the checks that need no labels, or (`reason` set) the best that did not. `seen` (ny, nx): corners that something hides are where the others have them."""

    grid: FloatArray
    seen: npt.NDArray[np.bool_]
    dark_first: bool
    window_half_px: int
    method: str
    reason: str = ""


@checked_arguments
def detect_boards(
    gray: Pixels,
    board: Board,
    camera: Camera | None = None,
    prediction: BoardPrediction | None = None,
    options: BoardOptions | None = None,
) -> tuple[BoardView, ...]:
    """Detects the expected views of one chessboard in a grey picture (H, W) uint8; masked views carry their reason.

    Returns one `BoardView` for each expected view, direct first where one is expected, the others by falling size.
    """
    check_board(board)
    options = options or BoardOptions()
    attempts: list[str] = []
    found, failed = _search_all(gray, board, camera, options, attempts)
    expected = len(options.views)
    trail = tuple(attempts)
    if not found:
        reason = failed.reason if failed else _nothing_found(board)
        corners_px = None if failed is None else failed.grid.reshape(-1, 2)
        return tuple(BoardView(False, reason, via, corners_px, attempts=trail) for via in options.views)
    if len(found) > expected and options.strict_count:
        if prediction is None or prediction.corners_px is None:
            reason = (
                f"{len(found)} boards found where {expected} were expected: predict the board's place, expect more views, "
                "or keep the other boards out of the picture"
            )
            return tuple(
                BoardView(
                    False,
                    reason,
                    options.views[0],
                    item.grid.reshape(-1, 2),
                    method=item.method,
                    attempts=trail,
                )
                for item in found
            )
        centre = prediction.corners_px.mean(axis=0)
        found.sort(key=lambda item: float(np.linalg.norm(item.grid.mean(axis=(0, 1)) - centre)))
        found = found[:expected]
    found.sort(key=lambda item: -_area_px2(item.grid))
    order = sorted(options.views, key=lambda via: via != "direct")
    views = []
    for index, via in enumerate(order):
        if index < len(found):
            views.append(
                replace(_label(gray, found[index], via, board, camera, prediction, options), attempts=trail)
            )
        else:
            views.append(
                BoardView(False, f"only {len(found)} of {expected} boards found", via, attempts=trail)
            )
    return tuple(views)


@checked_arguments
def measure_grid(
    gray: Pixels,
    grid: FloatArray,
    board: Board,
    camera: Camera | None = None,
    via: Via = "mirror",
    prediction: BoardPrediction | None = None,
    options: BoardOptions | None = None,
) -> BoardView:
    """Checks, refines and labels a grid `(ny, nx, 2)` px that something else found (a detector, a tracker)."""
    options = options or BoardOptions()
    item = _examine(gray, Candidate("given", np.asarray(grid, dtype=np.float64)), board, camera, options)
    if item.reason:
        return BoardView(False, item.reason, via, item.grid.reshape(-1, 2), method="given")
    return _label(gray, item, via, board, camera, prediction, options)


def _nothing_found(board: Board) -> str:
    return (
        f"no chessboard of {board.columns} × {board.rows} inner corners found: it is not in the picture, cut off, hidden, too small, "
        "blurred or badly lit; or [board] corners is not its count of inner corners"
    )


def _search_all(
    gray: Pixels, board: Board, camera: Camera | None, options: BoardOptions, attempts: list[str]
) -> tuple[list[_Found], _Found | None]:
    """All boards of the picture, with the found ones painted over one by one, and the best grid that failed
    a check."""
    found: list[_Found] = []
    failed: _Found | None = None
    scale = scale_of(gray)
    shown = Places(resized(gray, scale), board.corner_count)
    limit = len(options.views) + (1 if options.strict_count else 0)
    while len(found) < limit:
        # The search for a surplus board is the quick one: it only guards against a mistaken identity.
        quick = len(found) >= len(options.views)
        item = None
        for candidate in candidates(lambda: _remaining(gray, found), scale, board, shown, quick):
            examined = _examine(gray, candidate, board, camera, options)
            if not examined.reason:
                item = examined
                break
            attempts.append(f"{candidate.method}: {examined.reason}")
            # A hidden part of the board is a better reason than the failure of a whole grid.
            if failed is None or (candidate.shown is not None and failed.seen.all()):
                failed = examined
        if item is None:
            break
        attempts.append(f"{item.method}: accepted")
        found.append(item)
        shown.cover((_outline(item.grid) + 0.5) * scale - 0.5)
    return found, failed


def _examine(
    gray: Pixels,
    candidate: Candidate,
    board: Board,
    camera: Camera | None,
    options: BoardOptions,
) -> _Found:
    """Refines a grid and runs the checks that do not need labels."""
    grid = candidate.grid
    if candidate.shown is not None:
        partly = read_partly_seen(gray, grid, candidate.shown, board, camera, options.gate)
        return _Found(
            partly.grid,
            partly.seen,
            partly.dark_first,
            partly.window_half_px,
            candidate.method,
            partly.reason,
        )
    # A homography does not care for labels: any symmetry of the grid has the same residual.
    refined = corners.refine(gray, grid.reshape(-1, 2), board, camera, options.gate)
    refined_grid = refined.corners_px.reshape(grid.shape)
    check = pattern.check_pattern(gray, refined_grid)
    everything = np.ones(board.corner_count, dtype=bool)
    kept = without_outliers(refined.corners_px, everything, board, camera, options.gate, refined.residual)
    if not check.reason and not kept.all():
        others = _examine(
            gray,
            Candidate(candidate.method, refined_grid, kept.reshape(grid.shape[:2])),
            board,
            camera,
            options,
        )
        if not others.reason:
            return others
    return _Found(
        refined_grid,
        np.ones(grid.shape[:2], dtype=bool),
        check.dark_first,
        refined.window_half_px,
        candidate.method,
        "; ".join(filter(None, (check.reason, refined.residual.reason))),
    )


def _label(
    gray: Pixels,
    item: _Found,
    via: Via,
    board: Board,
    camera: Camera | None,
    prediction: BoardPrediction | None,
    options: BoardOptions,
) -> BoardView:
    # A board with one odd and one even count of corners has one labelling.
    alike = (board.columns + board.rows) % 2 == 0
    predicted = predicted_corners_px(item.grid, board, camera, prediction, via) if alike else None
    settled = labels.settle_labels(item.grid, item.dark_first, board, via, predicted)
    # The labelled corners are the grid's, in another order.
    order = np.abs(settled.corners_px[:, None] - item.grid.reshape(1, -1, 2)).sum(axis=2).argmin(axis=1)
    seen = item.seen.ravel()[order]
    some = None if seen.all() else seen
    residual = gate.board_residual(settled.corners_px, board, camera, options.gate, some)
    covariances = corners.scale_by_residual(
        corners.noise_covariances(gray, settled.corners_px, item.window_half_px, board, some), residual, some
    )
    # With a camera, the view must also be that of a board at some pose: fewer freedoms than a homography's, and the camera file is checked.
    calibrated = gate.pose_gate(settled.corners_px, board, camera, options.gate, some)
    reason = settled.reason or residual.reason or calibrated.reason
    return BoardView(
        ok=not reason,
        reason=reason,
        via=via,
        corners_px=np.where(seen[:, None], settled.corners_px, 0.0),
        covariances_px2=covariances,
        visible=seen,
        residual_rms_px=residual.rms_px if calibrated.rms_px is None else calibrated.rms_px,
        residual_limit_px=residual.limit_px,
        method=item.method,
        corners_x=board.columns,
    )


def _area_px2(grid: FloatArray) -> float:
    return float(cv2.contourArea(cv2.convexHull(grid.reshape(-1, 2).astype(np.float32))))


def _outline(grid: FloatArray) -> FloatArray:
    """Corners of a found board with its outer squares, px."""
    ny, nx = grid.shape[:2]
    outline = np.array([grid[0, 0], grid[0, -1], grid[-1, -1], grid[-1, 0]])
    middle = outline.mean(axis=0)
    grown: FloatArray = middle + (outline - middle) * (1.0 + 2.4 / (min(nx, ny) - 1))
    return grown


def _remaining(gray: Pixels, found: list[_Found]) -> Pixels:
    """The picture with all boards that were found painted over, one by one."""
    for item in found:
        gray = _painted(gray, _outline(item.grid))
    return gray


def _painted(gray: Pixels, outline_px: FloatArray) -> Pixels:
    """The picture with a found board painted over."""
    covered = gray.copy()
    # A typical grey, from every eighth pixel.
    cv2.fillConvexPoly(covered, np.rint(outline_px).astype(np.int32), int(np.median(gray[::8, ::8])))
    result: Pixels = covered
    return result
