"""detections.csv: image points, one row each, as dense arrays with masks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..board import Board
from .errors import SessionError, choices
from .metadata import RESERVED_TARGET
from .tables import Table
from .types import Frames, Views

COLUMNS = ("frame", "target", "index", "u", "v")
OPTIONAL_COLUMNS = ("via", "std_px")
"""`std_px`: the detector's standard deviation of u and of v, a column of this package's own."""
WAYS = ("mirror", "direct")
EDGE_PX = 1.0
"""A point may be this far outside the picture: the centre of an object that is cut off is inside."""


def frame_rows(table: Table, frames: Frames, frames_name: str) -> np.ndarray:
    """For each row of a table its frame's row in the frames table; refuses a frame that has none."""
    number = table.integers("frame")
    row = np.minimum(np.searchsorted(frames.frame, number), len(frames) - 1)
    unknown = np.flatnonzero(frames.frame[row] != number)
    if len(unknown):
        first = int(unknown[0])
        raise SessionError(
            table.name,
            f"the frame {number[first]} has no row in {frames_name}; add it there or remove the row here",
            row=first + 1,
            column="frame",
        )
    return row


def refuse_twice(table: Table, key: np.ndarray, what: str) -> None:
    """Refuses two rows with the same key, because it is ambiguous which is meant."""
    if np.bincount(key).max(initial=0) < 2:
        return
    order = np.argsort(key, kind="stable")
    again = np.flatnonzero(np.diff(key[order]) == 0)
    if len(again):
        pair = min((int(order[i + 1]), int(order[i])) for i in again)
        raise SessionError(
            table.name, f"{what} stands there already in row {pair[1] + 1}; remove one", row=pair[0] + 1
        )


def read_detections(
    table: Table, frames: Frames, frames_name: str, board: Board | None, marker_names: tuple[str, ...],
    picture_px: tuple[int, int] | None = None,
) -> tuple[Views, Views]:  # fmt: skip
    """The observations in the mirror, and direct ones; `picture_px` is the picture's width and height,
    outside of which there is none."""
    table.require(*COLUMNS)
    corners = 0 if board is None else board.columns * board.rows
    mirror, direct = (Views.empty(len(frames), corners, len(marker_names)) for _ in range(2))
    if table.rows == 0:
        return mirror, direct
    row = frame_rows(table, frames, frames_name)
    target = _targets(table, board, marker_names)
    index = table.integers("index")
    pixel = np.stack([table.numbers("u"), table.numbers("v")], axis=1)
    if picture_px is not None:
        _check_inside(table, pixel, picture_px)
    is_direct = _ways(table)

    count = np.where(target < 0, corners, 1)
    outside = np.flatnonzero((index < 0) | (index >= count))
    if len(outside):
        first = int(outside[0])
        needed = (
            f"0 to {corners - 1}: the board has {board.columns} × {board.rows} inner corners"
            if target[first] < 0 and board is not None
            else "0 for a marker"
        )
        raise SessionError(table.name, f"got {index[first]}, needed {needed}", row=first + 1, column="index")
    # Board corners and markers on one axis: the corners first, then the markers.
    slot = np.where(target < 0, index, corners + target)
    slots = corners + len(marker_names)
    refuse_twice(table, (row * slots + slot) * 2 + is_direct, "this point of this frame")

    std = None
    if "std_px" in table.columns:
        std = table.numbers("std_px")
        bad = np.flatnonzero(std <= 0.0)
        if len(bad):
            row_number = int(bad[0]) + 1
            raise SessionError(
                table.name, f"got {std[bad[0]]:g}, needed a number above 0", row=row_number, column="std_px"
            )
        mirror, direct = (
            replace(
                view,
                board_std_px=np.zeros(view.board_seen.shape),
                marker_std_px=np.zeros(view.marker_seen.shape),
            )
            for view in (mirror, direct)
        )
    for views, chosen in ((mirror, ~is_direct), (direct, is_direct)):
        on_board, on_marker = chosen & (target < 0), chosen & (target >= 0)
        if std is not None and views.board_std_px is not None and views.marker_std_px is not None:
            views.board_std_px[row[on_board], index[on_board]] = std[on_board]
            views.marker_std_px[row[on_marker], target[on_marker]] = std[on_marker]
        views.board_px[row[on_board], index[on_board]] = pixel[on_board]
        views.board_seen[row[on_board], index[on_board]] = True
        views.marker_px[row[on_marker], target[on_marker]] = pixel[on_marker]
        views.marker_seen[row[on_marker], target[on_marker]] = True
    return mirror, direct


def _check_inside(table: Table, pixel: np.ndarray, picture_px: tuple[int, int]) -> None:
    outside = (pixel < -0.5 - EDGE_PX) | (pixel > np.array(picture_px) - 0.5 + EDGE_PX)
    rows = np.flatnonzero(outside.any(axis=1))
    if len(rows):
        row = int(rows[0])
        axis = int(np.flatnonzero(outside[row])[0])
        raise SessionError(
            table.name,
            f"got {pixel[row, axis]:g} px, outside the camera's picture of {picture_px[0]} × {picture_px[1]} px ({len(rows)} rows "
            "are); is the camera file that of these pictures, at their resolution?",
            row=row + 1,
            column="uv"[axis],
        )


def _targets(table: Table, board: Board | None, marker_names: tuple[str, ...]) -> np.ndarray:
    """The marker's number of each row, -1 for the board."""
    codes, names = table.texts("target")
    numbers = np.zeros(len(names), dtype=np.int64)
    number = {name: m for m, name in enumerate(marker_names)}
    for code, name in enumerate(names):
        if name in number:
            numbers[code] = number[name]
        elif name == RESERVED_TARGET and board is not None:
            numbers[code] = -1
        else:
            fix = (
                "add a [board] section to session.toml"
                if name == RESERVED_TARGET
                else f"valid: {choices(([RESERVED_TARGET] if board else []) + list(marker_names))}"
            )
            row = int(np.flatnonzero(codes == code)[0]) + 1
            raise SessionError(
                table.name, f"session.toml has no target {name!r}; {fix}", row=row, column="target"
            )
    return numbers[codes]


def _ways(table: Table) -> np.ndarray:
    """Whether each row was seen directly."""
    if "via" not in table.columns:
        return np.zeros(table.rows, dtype=bool)
    codes, names = table.texts("via")
    for code, name in enumerate(names):
        if name not in (*WAYS, ""):
            row = int(np.flatnonzero(codes == code)[0]) + 1
            raise SessionError(table.name, f"got {name!r}, needed {choices(WAYS)}", row=row, column="via")
    return np.array([name == "direct" for name in names], dtype=bool)[codes]
