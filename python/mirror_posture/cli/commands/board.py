"""`mirror-posture board`: the board as a PDF, and which sizes fit the distance."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..output import JsonOption, Output
from ..values import required_ending, two_counts

ORDER = 2
PANEL = "Setting up"


def command(
    file: Annotated[Path, typer.Argument(help="The PDF to write.", show_default=False)],
    corners: Annotated[
        str, typer.Option(help="Inner corners NXxNY: points where four squares meet. One odd, one even.")
    ] = "7x4",
    square_mm: Annotated[
        float | None, typer.Option(help="Side of a square, mm. By default what the distance asks for.")
    ] = None,
    pattern: Annotated[
        str, typer.Option(help="chessboard, or charuco (a part of it is enough, but it needs more pixels).")
    ] = "chessboard",
    marker_mm: Annotated[float | None, typer.Option(help="charuco: side of a code, mm.")] = None,
    dictionary: Annotated[str | None, typer.Option(help="charuco: OpenCV's name of the dictionary.")] = None,
    paper: Annotated[str, typer.Option(help="a4, letter, a3, a2, a1 or a0.")] = "a4",
    distance_m: Annotated[float, typer.Option(help="From the camera to the mirror, m.")] = 0.4,
    focal_px: Annotated[
        float, typer.Option(help="Focal length, px; of an unknown webcam about its picture's width.")
    ] = 1000.0,
    markers: Annotated[int, typer.Option(help="How many balls will be worn.")] = 4,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Print the robot's board: a PDF at true scale, and the balls to buy.

    The sheet shows the pattern, cutting lines, the axes, and a ruler in both directions to check the
    printer's scale. The command also prints which squares, balls and colours the distance to the mirror
    requires.

    Example: `mirror-posture board board.pdf --distance-m 0.4 --focal-px 900`

    Next: `mirror-posture calibrate-camera --help`, `mirror-posture init --help`
    """
    output = Output(as_json)
    from ..._core import MirrorPostureError
    from ...board_sheet import BoardSheet, recommend, write_board_pdf

    required_ending(file, "the file", (".pdf",))
    if file.exists() and not overwrite:
        raise MirrorPostureError(f"{file}: is there already; add --overwrite")
    nx, ny = two_counts(corners, "--corners", "7x4")
    told = recommend(distance_m, focal_px, markers)
    square = told.square_m if square_mm is None else square_mm / 1000.0
    sheet = BoardSheet(
        nx, ny, square, pattern, None if marker_mm is None else marker_mm / 1000.0, dictionary, paper.lower()
    )
    write_board_pdf(sheet, file)
    output.say(
        f"written: {file} ({nx} x {ny} inner corners, squares of {1000 * square:g} mm, {paper.lower()})"
    )
    output.say(
        "print it at 100 %, measure both rulers on it, cut along the dashes, glue it on something stiff"
    )
    if square < told.square_m:
        output.warn(
            f"squares of {1000 * square:g} mm appear with {focal_px * square / told.path_m:.0f} px at {distance_m:g} m from the "
            f"mirror; {1000 * told.square_m:g} mm or a smaller distance are safer"
        )
    rows = [
        (f"marker {index}", colour.name, f"{colour.hue_deg:.0f}", f"{1000 * told.ball_diameter_m:g}")
        for index, colour in enumerate(told.colours, 1)
    ]
    output.table(
        f"Balls for {distance_m:g} m to the mirror and a focal length of {focal_px:g} px",
        ("*ball", "*colour", "hue, degrees", "diameter mm, at least"),
        rows,
        "matt paint; no ball in the colour of clothes or furniture in the picture",
    )
    output.result({"file": file, "board": sheet.metadata(), "recommended": told})
