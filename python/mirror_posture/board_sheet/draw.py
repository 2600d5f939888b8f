"""The sheet as a vector PDF: squares, rulers, cutting lines, axes and instructions."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from .._core import MirrorPostureError
from ..output_files import write_file
from .layout import EDGE_M, QUIET_SQUARES, BoardSheet

RULER_MM = 100
"""Length of both rulers: long enough that half a millimetre is half a percent."""
SMALL_PT, LEADING_M = 8.0, 0.0039
POINTS_PER_M = 72.0 / 0.0254
"""PDF's unit is 1/72 of an inch."""


def write_board_pdf(sheet: BoardSheet, file: str | os.PathLike[str]) -> Path:
    """Writes the sheet as a PDF at true scale; returns the file.

    Everything but the text is drawn as filled rectangles and lines in PDF's own units, so that no picture
    is scaled. The document requests viewers to switch off "fit to page". A ruler in both directions shows
    the printer's scale, because many printers stretch the direction in which the paper is fed.

    Raises:
        MirrorPostureError: reportlab is not installed, or the file cannot be written.
    """
    try:
        from reportlab.pdfgen import canvas
    except ImportError:
        raise MirrorPostureError(
            "a PDF needs the package reportlab: pip install 'mirror-posture[print]'"
        ) from None
    placed = sheet.placement()
    page = canvas.Canvas("", pagesize=tuple(POINTS_PER_M * v for v in placed.sheet_m), invariant=True)
    page.setTitle(f"Board {sheet.corners_x}x{sheet.corners_y}, squares of {1000 * sheet.square_m:g} mm")
    page.setAuthor("mirror-posture")
    page.setViewerPreference("PrintScaling", "None")
    page.scale(POINTS_PER_M, POINTS_PER_M)
    page.setFillGray(0.0)
    for rectangle in sheet.dark():
        page.rect(*rectangle, stroke=0, fill=1)
    _cutting_lines(page, sheet)
    _rulers(page)
    _axes(page, sheet)
    _text(page, sheet)
    page.showPage()
    return write_file(file, page.getpdfdata())


def _cutting_lines(page: Any, sheet: BoardSheet) -> None:
    """Grey dashes one square outside of the pattern: the white border is part of the board."""
    placed, (width, height), quiet = sheet.placement(), sheet.size_m, QUIET_SQUARES * sheet.square_m
    page.saveState()
    page.setStrokeGray(0.6)
    page.setLineWidth(0.0002)
    page.setDash([0.002, 0.002])
    page.rect(placed.left_m - quiet, placed.bottom_m - quiet, width + 2 * quiet, height + 2 * quiet)
    page.restoreState()


def _rulers(page: Any) -> None:
    """A ruler along the bottom and one along the left edge."""
    left, bottom = EDGE_M + 0.008, EDGE_M + 0.004
    page.setLineWidth(0.0002)
    page.setStrokeGray(0.0)
    for step in range(RULER_MM + 1):
        length = 0.005 if step % 10 == 0 else 0.0035 if step % 5 == 0 else 0.002
        at = step / 1000.0
        page.line(left + at, bottom, left + at, bottom + length)
        page.line(left - 0.003 - length, bottom + at, left - 0.003, bottom + at)
        if step % 20 == 0 and step:
            _write(page, left + at, bottom - 0.003, str(step), 6.0, centred=True)
    page.line(left, bottom, left + RULER_MM / 1000.0, bottom)
    page.line(left - 0.003, bottom, left - 0.003, bottom + RULER_MM / 1000.0)


def _axes(page: Any, sheet: BoardSheet) -> None:
    """The board's axes in its white border, from the printed corner that is beyond corner 0."""
    placed, (width, height), s = sheet.placement(), sheet.size_m, sheet.square_m
    sign = -1.0 if sheet.axes_turned else 1.0
    x0 = placed.left_m + (width if sheet.axes_turned else 0.0)
    y0 = placed.bottom_m + (height if sheet.axes_turned else 0.0)
    away, length, tip = 0.35 * s, 1.6 * s, 0.15 * s
    page.saveState()
    # Grey lines thinner than a tenth of a square: no detector takes them for the pattern.
    page.setStrokeGray(0.45)
    page.setLineWidth(max(0.0002, 0.02 * s))
    x, y = x0, y0 - sign * away
    page.line(x, y, x + sign * length, y)
    page.line(x + sign * length, y, x + sign * (length - tip), y + tip)
    page.line(x + sign * length, y, x + sign * (length - tip), y - tip)
    size = max(5.0, 0.35 * s * POINTS_PER_M)
    _write(page, x + sign * (length + 1.2 * tip), y - 0.1 * s, "x", size, centred=True)
    x, y = x0 - sign * away, y0
    page.line(x, y, x, y + sign * length)
    page.line(x, y + sign * length, x + tip, y + sign * (length - tip))
    page.line(x, y + sign * length, x - tip, y + sign * (length - tip))
    # Text is placed at its baseline: below an arrow that points down it needs its own height.
    _write(
        page, x, y + sign * (length + tip) - (0.35 * s if sheet.axes_turned else 0.0), "y", size, centred=True
    )
    page.restoreState()


def _text(page: Any, sheet: BoardSheet) -> None:
    x, y = sheet.corners_x, sheet.corners_y
    name = "ChArUco " + str(sheet.dictionary) if sheet.pattern == "charuco" else "Chessboard"
    lines = [
        f"{name}: {x} x {y} inner corners (points where four squares meet), squares of {1000 * sheet.square_m:g} mm",
        'Print at 100 % ("actual size"), not "fit to page". Then measure both rulers with a steel ruler: 0 to 100 must be 100 mm.',
        "If a ruler measures m mm, write square = "
        f"{sheet.square_m:g} x m / 100 into [board] of session.toml; if the two differ by over 0.3 mm, use another printer.",
        "Cut along the dashes (the white border belongs to the board), glue it on something stiff and flat: no bubbles, no gloss.",
        "This way up: the arrows x and y are the axes of the board's link; z points out of the paper; the origin is the centre.",
    ]
    left, top = EDGE_M + 0.016, EDGE_M + 0.0125 + LEADING_M * len(lines)
    width = sheet.placement().sheet_m[0] - left - EDGE_M
    for index, line in enumerate(lines):
        _write(page, left, top - LEADING_M * index, line, SMALL_PT, widest_m=width)


def _write(
    page: Any, x: float, y: float, text: str, size_pt: float, *, centred: bool = False, widest_m: float = 1.0
) -> None:
    """Text at a place in metres, made smaller where it would leave the page."""
    page.saveState()
    page.translate(x, y)
    page.scale(1.0 / POINTS_PER_M, 1.0 / POINTS_PER_M)
    needed = page.stringWidth(text, "Helvetica", size_pt) / POINTS_PER_M
    page.setFont("Helvetica", size_pt * min(1.0, widest_m / needed))
    page.setFillGray(0.2)
    (page.drawCentredString if centred else page.drawString)(0, 0, text)
    page.restoreState()
