"""The layout of the sheet: the squares, the codes and the frame of the board, in metres."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from .._core import MirrorPostureError
from ..arrays import Mask
from ..board import Board

Rectangle = tuple[float, float, float, float]
"""Left, bottom, width, height, m, from the sheet's lower left corner; y is up."""

PAPERS_M = {
    "a4": (0.210, 0.297),
    "letter": (0.2159, 0.2794),
    "a3": (0.297, 0.420),
    "a2": (0.420, 0.594),
    "a1": (0.594, 0.841),
    "a0": (0.841, 1.189),
}
"""Width and height of a sheet, upright."""
QUIET_SQUARES = 1.0
"""White border around the pattern, in squares: without it detectors lose the outer squares on dark clothes."""
EDGE_M = 0.008
"""No printer prints nearer to the paper's edge than this."""
TEXT_M = 0.052
"""Height kept for the text below the board, with the horizontal ruler."""
RULER_M = 0.016
"""Width kept left of the board for the vertical ruler."""
DEFAULT_DICTIONARY = "DICT_4X4_250"
MARKER_SHARE = 0.75
"""Side of a code, in squares: OpenCV's corners stay clear of the code's edge."""


@dataclass(frozen=True)
class BoardSheet:
    """A board to be printed: inner corners, side of a square (m), pattern, paper.

    A chessboard has one odd and one even count of inner corners: only then do the colours of the squares
    distinguish it from itself after half a turn. A ChArUco board has codes, so a part of it is sufficient.

    Raises:
        MirrorPostureError: counts that leave the board ambiguous, a size that does not fit the paper.
    """

    corners_x: int = 7
    corners_y: int = 4
    square_m: float = 0.02
    pattern: str = "chessboard"
    marker_size_m: float | None = None
    dictionary: str | None = None
    paper: str = "a4"

    def __post_init__(self) -> None:
        x, y = self.corners_x, self.corners_y
        if self.paper not in PAPERS_M:
            raise MirrorPostureError(f"paper: got {self.paper!r}, needed one of {', '.join(PAPERS_M)}")
        if not (3 <= x <= 40 and 3 <= y <= 40):
            raise MirrorPostureError(f"corners: got {x}x{y}, needed 3 to 40 inner corners each way")
        if not (math.isfinite(self.square_m) and 0.002 <= self.square_m <= 0.2):
            raise MirrorPostureError(f"square: got {1000 * self.square_m:g} mm, needed 2 to 200 mm")
        if self.pattern not in ("chessboard", "charuco"):
            raise MirrorPostureError(f"pattern: got {self.pattern!r}, needed one of chessboard, charuco")
        if self.pattern == "chessboard" and (x % 2 == y % 2):
            raise MirrorPostureError(
                f"corners: got {x}x{y}, needed one odd and one even count of inner corners (as {x}x{y + 1}): "
                "a chessboard looks the same after half a turn otherwise"
            )
        if self.pattern == "charuco":
            if self.dictionary is None:
                object.__setattr__(self, "dictionary", DEFAULT_DICTIONARY)
            if self.marker_size_m is None:
                object.__setattr__(self, "marker_size_m", MARKER_SHARE * self.square_m)
            _charuco(self)
        elif self.marker_size_m is not None or self.dictionary is not None:
            given = "a marker's size" if self.marker_size_m is not None else "a dictionary"
            raise MirrorPostureError(
                f"pattern: got {given} with a chessboard, which has no codes; needed the pattern charuco, or leave it away"
            )
        self.placement()

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the printed squares."""
        return (self.corners_x + 1) * self.square_m, (self.corners_y + 1) * self.square_m

    def placement(self) -> Placement:
        """Where the pattern lies on the sheet; the sheet is turned where the board then fits."""
        width, height = self.size_m
        quiet = 2.0 * QUIET_SQUARES * self.square_m
        need = width + quiet + 2.0 * EDGE_M + RULER_M, height + quiet + 2.0 * EDGE_M + TEXT_M
        upright = PAPERS_M[self.paper]
        for sheet in (upright, upright[::-1]):
            if need[0] <= sheet[0] + 1e-9 and need[1] <= sheet[1] + 1e-9:
                free = sheet[0] - RULER_M - width
                left = RULER_M + free / 2.0
                bottom = sheet[1] - EDGE_M - QUIET_SQUARES * self.square_m - height
                return Placement(sheet, left, bottom)
        largest = max(
            min(
                (sheet[0] - 2 * EDGE_M - RULER_M) / (self.corners_x + 1 + 2 * QUIET_SQUARES),
                (sheet[1] - 2 * EDGE_M - TEXT_M) / (self.corners_y + 1 + 2 * QUIET_SQUARES),
            )
            for sheet in (upright, upright[::-1])
        )
        raise MirrorPostureError(
            f"square: {1000 * self.square_m:g} mm with {self.corners_x}x{self.corners_y} corners does not fit on {self.paper}; "
            f"at most {math.floor(10000 * largest) / 10:g} mm fit, or take a larger paper"
        )

    @property
    def axes_turned(self) -> bool:
        """Whether the board's x axis points to the printed left and y down (a ChArUco of an even by an odd count)."""
        return self.pattern == "charuco" and self.corners_y % 2 == 1 and self.corners_x % 2 == 0

    def dark(self) -> list[Rectangle]:
        """The black rectangles on the sheet: the squares, and for ChArUco the codes' cells."""
        placed, s = self.placement(), self.square_m
        top = placed.bottom_m + self.size_m[1]
        columns, rows = self.corners_x + 1, self.corners_y + 1
        # From the top, as OpenCV numbers a ChArUco board, whose square at the top left is dark; a chessboard's dark
        # square is the one at the lower left: the format's rule, "beyond corner 0 (towards -x, -y) is dark".
        start = 0 if self.pattern == "charuco" else (rows - 1) % 2
        squares = [
            (placed.left_m + c * s, top - (r + 1) * s, s, s)
            for r in range(rows)
            for c in range(columns)
            if (r + c) % 2 == start
        ]
        return squares + (self._codes(placed.left_m, top) if self.pattern == "charuco" else [])

    def _codes(self, left: float, top: float) -> list[Rectangle]:
        """The black cells of the codes, joined along rows."""
        board = _charuco(self)
        dictionary = board.getDictionary()
        cells = dictionary.markerSize + 2
        found: list[Rectangle] = []
        for identity, corners in zip(np.asarray(board.getIds()).ravel(), board.getObjPoints(), strict=True):
            picture = cv2.aruco.generateImageMarker(dictionary, int(identity), cells)
            x0, y0 = np.asarray(corners)[:, :2].min(axis=0)
            cell = float(self.marker_size_m or 0.0) / cells
            for row in range(cells):
                for start, length in _runs(picture[row] < 128):
                    found.append((left + x0 + start * cell, top - y0 - (row + 1) * cell, length * cell, cell))
        return found

    def board(self, link: str = "") -> Board:
        """The board as the detectors and a session know it."""
        return Board(
            self.corners_x,
            self.corners_y,
            self.square_m,
            self.pattern,
            self.marker_size_m,
            self.dictionary,
            link,
        )

    def metadata(self, link: str = "board") -> dict[str, object]:
        """The section `[board]` of session.toml for this board."""
        told: dict[str, object] = {
            "link": link,
            "corners": [self.corners_x, self.corners_y],
            "square": self.square_m,
            "pattern": self.pattern,
        }
        if self.pattern == "charuco":
            told |= {"marker_size": self.marker_size_m, "dictionary": self.dictionary}
        return told


@dataclass(frozen=True)
class Placement:
    """The sheet as it is printed (width, height), and the lower left corner of the squares on it, m."""

    sheet_m: tuple[float, float]
    left_m: float
    bottom_m: float


def _charuco(sheet: BoardSheet) -> cv2.aruco.CharucoBoard:
    """OpenCV's board of a sheet; a dictionary that is missing or too small is refused by the detector's own check."""
    from ..detect.charuco import charuco_board

    return charuco_board(sheet.board())


def _runs(black: Mask) -> list[tuple[int, int]]:
    """Start and length of the runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], black, [False]]).astype(np.int8)))
    return [(int(a), int(b - a)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
