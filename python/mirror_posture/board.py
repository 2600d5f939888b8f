"""The printed board: its pattern, its inner corners, its mount."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ._core import MirrorPostureError
from .arrays import Floats

CHESSBOARD = "chessboard"
CHARUCO = "charuco"
PATTERNS = (CHESSBOARD, CHARUCO)
LEAST_CORNERS = 2


@dataclass(frozen=True)
class Board:
    """A board of `columns × rows` inner corners, origin at the centre, z out of the printed face.

    Corners are numbered `index = iy * columns + ix`. Raises `MirrorPostureError` for numbers that make no board.
    """

    columns: int
    rows: int
    square_m: float
    """Side of a square."""
    pattern: str = CHESSBOARD
    """What is printed: `"chessboard"`, or `"charuco"` (a chessboard with codes in its light squares, of which a part is enough)."""
    marker_size_m: float | None = None
    """Of a ChArUco board, which needs it: side of its ArUco markers, below `square_m`."""
    dictionary: str | None = None
    """Of a ChArUco board, which needs it: OpenCV's name of its markers' dictionary, as `DICT_4X4_50`."""
    link: str = ""
    """The link that it is fixed to; empty where there is no robot."""
    tolerance_m: float | None = None
    """One standard deviation, along one axis, by which the real place may differ from the URDF's, m. 0: exact; None: not stated
    (a diagnosis then estimates it)."""
    tolerance_rad: float | None = None
    """The same of its orientation, about one axis, rad."""

    def __post_init__(self) -> None:
        counts = (self.columns, self.rows)
        if not all(isinstance(n, (int, np.integer)) and n >= LEAST_CORNERS for n in counts):
            raise MirrorPostureError(
                f"board corners = [{self.columns}, {self.rows}]: needed at least {LEAST_CORNERS} inner corners along x and y; "
                "count the points where four squares meet, not the squares"
            )
        if not _positive(self.square_m):
            raise MirrorPostureError(f"board square = {self.square_m}: needed the side of a square above 0 m")
        if self.pattern not in PATTERNS:
            raise MirrorPostureError(
                f"board pattern = {self.pattern!r}: valid are {CHESSBOARD!r} and {CHARUCO!r}"
            )
        if self.pattern == CHARUCO and (self.marker_size_m is None or self.dictionary is None):
            raise MirrorPostureError(
                'a "charuco" board needs marker_size (m) and dictionary (such as "DICT_4X4_50")'
            )
        size = self.marker_size_m
        if size is not None and not (_positive(size) and size < self.square_m):
            raise MirrorPostureError(
                f"board marker_size = {size}: must lie between 0 and the square's side {self.square_m}"
            )

    @property
    def corners(self) -> tuple[int, int]:
        """Inner corners along x and y."""
        return self.columns, self.rows

    @property
    def corner_count(self) -> int:
        """Number of inner corners."""
        return self.columns * self.rows

    @cached_property
    def corner_in_board_m(self) -> Floats:
        """The corners, (columns · rows, 3), m, in the board's frame: index `iy · columns + ix`."""
        iy, ix = np.divmod(np.arange(self.corner_count), self.columns)
        x = (ix - (self.columns - 1) / 2) * self.square_m
        y = (iy - (self.rows - 1) / 2) * self.square_m
        return np.stack([x, y, np.zeros_like(x)], axis=1)


def _positive(value: object) -> bool:
    number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    return number and math.isfinite(value) and value > 0.0  # type: ignore[arg-type, operator]
