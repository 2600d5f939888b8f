"""Overlay pictures of the detections, for a visual check.

Corner 0 has a ring and the board's x and y axes. Each ball has its fitted outline, a ring whose colour and
gap show the uncertainty of its centre, and its name. A masked view is crossed out. A strip under the
picture lists every view with its figures, or the reason why it is masked.
"""

from __future__ import annotations

import textwrap
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from ..arguments import checked_arguments
from ..picture_files import write_picture
from .reading import Picture, as_picture
from .types import BoardView, FloatArray, MarkerView, PictureDetections, Pixels

# Narrower pictures are enlarged, so that lines of one pixel do not hide what they mark.
ENLARGE_BELOW_PX = 1400
FONT = cv2.FONT_HERSHEY_SIMPLEX

GOOD = (80, 220, 60)
BAD = (60, 60, 255)
AXIS_X = (40, 40, 255)
AXIS_Y = (40, 220, 40)
FIRST = (0, 230, 255)
CORNER = (255, 170, 30)
WHITE = (255, 255, 255)
STRIP = (32, 32, 32)
# Colours of the ring around a ball by the deviation of its centre, px: up to the first, to the second, and beyond.
SURE = ((0.1, (80, 220, 60)), (0.3, (40, 200, 255)), (float("inf"), (40, 120, 255)))
# A deviation is drawn enlarged by this factor, as the gap between outline and ring.
GAP_PER_STD = 20.0


@checked_arguments
def draw_overlay(picture: Picture, detections: PictureDetections) -> Picture:
    """The picture `(H, W, 3)` BGR with its detections drawn, and a strip of text below it."""
    bgr = as_picture(picture, detections.source)
    factor = 2 if bgr.shape[1] < ENLARGE_BELOW_PX else 1
    canvas: Pixels = (
        cv2.resize(bgr, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
        if factor > 1
        else bgr.copy()
    )
    pen = _Pen(canvas, float(factor), max(1, round(canvas.shape[1] / 1600)))
    for board in detections.boards:
        _draw_board(pen, board)
    for marker in detections.markers:
        _draw_marker(pen, marker)
    _draw_names(pen, detections)
    return np.vstack([canvas, _strip(canvas.shape[1], pen.weight, detections)])


@checked_arguments
def write_overlay(path: Path | str, picture: Picture, detections: PictureDetections) -> None:
    """Writes the overlay as a picture file. Raises `MirrorPostureError` if it cannot be written."""
    write_picture(path, draw_overlay(picture, detections))


class _Pen:
    """Draws at sub-pixel places of the original picture on the enlarged canvas."""

    # Fractional bits of OpenCV's fixed-point drawing coordinates.
    SHIFT = 4

    def __init__(self, canvas: Pixels, factor: float, weight: int) -> None:
        self.canvas = canvas
        self.factor = factor
        self.weight = weight

    def place(self, pixel: FloatArray) -> FloatArray:
        """Canvas coordinates of a pixel: pixel centres stay centres."""
        return (np.asarray(pixel, dtype=np.float64) + 0.5) * self.factor - 0.5

    def _fixed(self, at: FloatArray) -> tuple[int, int]:
        limited = np.clip(at, -1e6, 1e6)
        return round(float(limited[0] * 2**self.SHIFT)), round(float(limited[1] * 2**self.SHIFT))

    def line(
        self, start: FloatArray, end: FloatArray, color: tuple[int, int, int], weight: int | None = None
    ) -> None:
        a, b = self._fixed(self.place(start)), self._fixed(self.place(end))
        cv2.line(self.canvas, a, b, color, weight or self.weight, cv2.LINE_AA, self.SHIFT)

    def arrow(self, start: FloatArray, end: FloatArray, color: tuple[int, int, int]) -> None:
        a, b = (tuple(round(float(x)) for x in np.clip(self.place(p), -1e6, 1e6)) for p in (start, end))
        cv2.arrowedLine(self.canvas, a, b, color, 2 * self.weight, cv2.LINE_AA, tipLength=0.25)

    def ring(self, center: FloatArray, radius_canvas: float, color: tuple[int, int, int]) -> None:
        at = self._fixed(self.place(center))
        cv2.circle(
            self.canvas, at, int(radius_canvas * 2**self.SHIFT), color, self.weight, cv2.LINE_AA, self.SHIFT
        )

    def text(self, text: str, at: FloatArray, color: tuple[int, int, int], scale: float = 0.55) -> None:
        """Text on a dark plate, kept inside of the picture; `at` is its lower left in the original picture."""
        size = scale * self.weight
        (width, height), base = cv2.getTextSize(text, FONT, size, self.weight)
        place = self.place(at)
        x = int(np.clip(place[0], 2, max(2, self.canvas.shape[1] - width - 4)))
        y = int(np.clip(place[1], height + 4, max(height + 4, self.canvas.shape[0] - base - 2)))
        plate = self.canvas[max(y - height - 3, 0) : y + base + 1, max(x - 3, 0) : x + width + 4]
        plate[:] = (plate * 0.35).astype(np.uint8)
        cv2.putText(self.canvas, text, (x, y), FONT, size, color, self.weight, cv2.LINE_AA)

    def text_size(self, text: str, scale: float = 0.55) -> tuple[int, int]:
        """Width and height of a text on the canvas."""
        (width, height), _ = cv2.getTextSize(text, FONT, scale * self.weight, self.weight)
        return width, height

    def holds(self, box: tuple[float, float, float, float]) -> bool:
        """Whether a box (left, top, right, bottom) of the original picture lies within it."""
        height, width = self.canvas.shape[:2]
        return (
            box[0] >= 0.0 and box[1] >= 0.0 and box[2] * self.factor < width and box[3] * self.factor < height
        )

    def cross_out(self, low: FloatArray, high: FloatArray) -> None:
        self.line(low, high, BAD, 2 * self.weight)
        self.line(np.array([low[0], high[1]]), np.array([high[0], low[1]]), BAD, 2 * self.weight)


def _arms(length: float) -> tuple[FloatArray, FloatArray]:
    """Half arms of a cross, px."""
    return np.array([length, 0.0]), np.array([0.0, length])


def _draw_board(pen: _Pen, view: BoardView) -> None:
    if view.corners_px is None:
        return
    corners = view.corners_px if view.visible is None else view.corners_px[view.visible]
    if len(corners) == 0:
        return
    low, high = corners.min(axis=0), corners.max(axis=0)
    color = CORNER if view.ok else BAD
    across, upright = _arms(3.5 * pen.weight / pen.factor)
    for corner in corners:
        pen.line(corner - across, corner + across, color)
        pen.line(corner - upright, corner + upright, color)
    if view.ok:
        _draw_axes(pen, view)
    else:
        pen.cross_out(low, high)
    pen.text(*_title(view, low, high, len(corners)), GOOD if view.ok else BAD)


def _title(view: BoardView, low: FloatArray, high: FloatArray, corners: int) -> tuple[str, FloatArray]:
    """A board's title and its place, px, above the box of its corners."""
    spacing = float(np.sqrt(np.prod(high - low) / corners))
    title = f"board ({view.via}), residual {view.residual_rms_px or 0.0:.2f} px"
    return title if view.ok else f"board ({view.via}) masked", low - np.array([spacing, 1.4 * spacing])


def _title_box(pen: _Pen, view: BoardView) -> list[tuple[float, ...]]:
    """What a board's title covers, px; nothing where none is drawn."""
    if view.corners_px is None:
        return []
    corners = view.corners_px if view.visible is None else view.corners_px[view.visible]
    if len(corners) == 0:
        return []
    text, (left, bottom) = _title(view, corners.min(axis=0), corners.max(axis=0), len(corners))
    width, height = (side / pen.factor for side in pen.text_size(text))
    return [(left - 2.0, bottom - height - 2.0, left + width + 2.0, bottom + 3.0)]


def _draw_axes(pen: _Pen, view: BoardView) -> None:
    """Ring at corner 0 and the axes along the next corners, if they were measured."""
    assert view.corners_px is not None
    grid = view.grid_px
    if grid is None:
        return
    origin = grid[0, 0]
    square = float(np.linalg.norm(grid[0, 1] - origin)) * pen.factor
    for name, end, color in (
        ("x", grid[0, min(2, grid.shape[1] - 1)], AXIS_X),
        ("y", grid[min(2, grid.shape[0] - 1), 0], AXIS_Y),
    ):
        pen.arrow(origin, end, color)
        direction = (end - origin) / max(float(np.linalg.norm(end - origin)), 1e-9)
        pen.text(name, end + direction * 14.0 * pen.weight / pen.factor, color)
    pen.ring(origin, max(5.0 * pen.weight, 0.3 * square), FIRST)
    away = origin - 0.5 * (grid[0, 1] + grid[1, 0] - 2.0 * origin)
    pen.text("0", origin + 1.3 * (away - origin), FIRST)


def _draw_marker(pen: _Pen, view: MarkerView) -> None:
    if view.pixel_px is None:
        return
    center = np.array(view.pixel_px)
    radius = 8.0 if view.outline is None else view.outline.semi_major_px
    color = GOOD if view.ok else BAD
    if view.outline is not None:
        _draw_outline(pen, view, color)
    across, upright = _arms(4.0 * pen.weight / pen.factor)
    pen.line(center - across, center + across, WHITE)
    pen.line(center - upright, center + upright, WHITE)
    if not view.ok:
        half = np.array([radius, radius])
        pen.cross_out(center - half, center + half)
    elif view.std_px is not None:
        gap = 2.0 / pen.factor + min(GAP_PER_STD * view.std_px, 2.0 * radius)
        pen.ring(center, (radius + gap) * pen.factor, _sureness(view.std_px))


def _sureness(std_px: float) -> tuple[int, int, int]:
    return next(color for limit, color in SURE if std_px <= limit)


def _draw_names(pen: _Pen, detections: PictureDetections) -> None:
    """Each ball's name and deviation, where it covers no ball, no other name and no board's title."""
    shown = [view for view in detections.markers if view.pixel_px is not None]
    taken = [box for view in detections.boards for box in _title_box(pen, view)]
    for view in shown:
        u, v = view.pixel_px or (0.0, 0.0)
        radius = _room(view)
        taken.append((u - radius, v - radius, u + radius, v + radius))
    for view in shown:
        text = f"{view.name} +- {view.std_px or 0.0:.2f} px" if view.ok else f"{view.name} masked"
        color = _sureness(view.std_px or 0.0) if view.ok else BAD
        width, height = (side / pen.factor for side in pen.text_size(text))
        (u, v), radius = view.pixel_px or (0.0, 0.0), _room(view)
        across, down = radius + 4.0, radius + height + 4.0
        # To the right, the left, below, above, and the corners; then farther out.
        places = [
            (
                u + turn_u * across * far - (width if turn_u < 0 else 0.5 * width if turn_u == 0 else 0.0),
                v + turn_v * down * far + 0.5 * height,
            )
            for far in (1.0, 1.7, 2.6)
            for turn_u, turn_v in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
        ]
        boxes = [(x - 2.0, y - height - 2.0, x + width + 2.0, y + 3.0) for x, y in places]
        free = [
            i
            for i, box in enumerate(boxes)
            if not any(_overlap(box, other) for other in taken) and pen.holds(box)
        ]
        best = free[0] if free else 0
        taken.append(boxes[best])
        pen.text(text, np.array(places[best]), color)


def _room(view: MarkerView) -> float:
    """Radius of what is drawn around a ball, px."""
    radius = 8.0 if view.outline is None else view.outline.semi_major_px
    return radius + (2.0 + min(GAP_PER_STD * (view.std_px or 0.0), 2.0 * radius) if view.ok else 0.0)


def _overlap(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _draw_outline(pen: _Pen, view: MarkerView, color: tuple[int, int, int]) -> None:
    assert view.outline is not None
    turn = np.linspace(0.0, 2.0 * np.pi, 73)
    c, s = np.cos(view.outline.angle_rad), np.sin(view.outline.angle_rad)
    major, minor = view.outline.semi_major_px * np.cos(turn), view.outline.semi_minor_px * np.sin(turn)
    points = np.array(view.outline.center_px) + np.stack(
        [c * major - s * minor, s * major + c * minor], axis=1
    )
    for start, end in pairwise(points):
        pen.line(start, end, color)


def _strip(width: int, weight: int, detections: PictureDetections) -> Picture:
    """The text below the picture, one entry for each view."""
    size = 0.5 * weight
    letter = cv2.getTextSize("n" * 50, FONT, size, weight)[0][0] / 50.0
    columns = max(30, int((width - 24) / letter))
    lines: list[tuple[str, tuple[int, int, int]]] = []
    for entry, good in _entries(detections):
        color = GOOD if good else (130, 130, 255)
        lines += [(line, color) for line in textwrap.wrap(entry, columns, subsequent_indent="    ")]
    step = int(22 * weight)
    strip = np.empty((step * len(lines) + step // 2, width, 3), dtype=np.uint8)
    strip[:] = STRIP
    for number, (line, color) in enumerate(lines):
        cv2.putText(strip, line, (10, step * (number + 1)), FONT, size, color, weight, cv2.LINE_AA)
    return strip


def _entries(detections: PictureDetections) -> list[tuple[str, bool]]:
    entries = [(f"{Path(detections.source).name}   {detections.width_px} x {detections.height_px}", True)]
    if detections.error:
        entries.append((detections.error, False))
    for board in detections.boards:
        if board.ok and board.std_px is not None:
            seen = board.std_px if board.visible is None else board.std_px[board.visible]
            entries.append(
                (
                    f"board ({board.via}): {len(seen)} corners, residual {board.residual_rms_px:.3f} px, std {seen.mean():.3f} px",
                    True,
                )
            )
        else:
            entries.append((f"board ({board.via}) masked: {board.reason}", False))
    for marker in detections.markers:
        if marker.ok:
            share = (
                "" if marker.visible_fraction is None else f", {100.0 * marker.visible_fraction:.0f} % seen"
            )
            entries.append(
                (f"{marker.name}: std {marker.std_px or 0.0:.3f} px{share}, {marker.center_kind}", True)
            )
        else:
            entries.append((f"{marker.name} masked: {marker.reason}", False))
    return entries
