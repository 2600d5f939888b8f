"""`mirror-posture mirror`: a mirror's plane from pictures of a board in front of it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..output import ExitCode, JsonOption, MaxResidualPx, MaxResidualSquares, Output
from ..values import two_counts

ORDER = 45
PANEL = "Measuring"


def command(
    pictures: Annotated[
        list[Path],
        typer.Argument(
            help="Pictures that show the board and its reflection, or their folder.", show_default=False
        ),
    ],
    camera: Annotated[Path, typer.Option(help="The camera's ROS camera_info YAML.", show_default=False)],
    board: Annotated[
        str, typer.Option(help="Inner corners of the chessboard, as in 7x6.", show_default=False)
    ],
    square: Annotated[float, typer.Option(help="Side of a square, m.", show_default=False)],
    glass: Annotated[float, typer.Option(help="Thickness of the mirror's glass before its silver, m.")] = 0.0,
    max_residual_px: MaxResidualPx = 1.0,
    max_residual_squares: MaxResidualSquares = 0.02,
    as_json: JsonOption = False,
) -> None:
    """Measure a mirror from pictures that show a chessboard directly and in the mirror; no robot needed.

    Each picture gives the plane n·x = d in the camera's frame with its deviation. The board needs an odd and an even count of inner corners, so that
    its labels are unique.

    Example: `mirror-posture mirror picture.jpg --camera camera.yaml --board 7x6 --square 0.025`
    """
    output = Output(as_json)
    import numpy as np

    from ..._core import MirrorPostureError
    from ...board import Board
    from ...detect import GateOptions, list_pictures
    from ...formats.session_keys import LARGEST_SQUARE_M, THICKEST_GLASS_M
    from ...mirror_pictures import mirrors_from_pictures
    from ...session.camera_info import load_camera_info

    for option, value, below in (
        ("--square", square, LARGEST_SQUARE_M),
        ("--glass", glass, THICKEST_GLASS_M),
    ):
        if not 0.0 <= value < below:
            asked = ": is it in mm?" if value > 0.0 else ""
            raise MirrorPostureError(f"{option}: got {value:g} m, needed 0 to below {below:g} m{asked}")
    pictures = [file for place in pictures for file in (list_pictures(place) if place.is_dir() else [place])]
    printed = Board(*two_counts(board, "--board", "7x6"), square)
    found = mirrors_from_pictures(
        load_camera_info(camera),
        printed,
        pictures,
        glass_thickness_m=glass,
        gate=GateOptions(max_residual_px, max_residual_squares),
    )
    rows, results = [], []
    for picture, mirror in zip(pictures, found, strict=True):
        if isinstance(mirror, MirrorPostureError):
            output.warn(str(mirror))
            results.append({"picture": picture, "error": str(mirror)})
            continue
        if not mirror.valid[0]:
            output.warn(f"{picture}: no mirror ({mirror.reasons[0]})")
            results.append({"picture": picture, "error": mirror.reasons[0]})
            continue
        normal, std_m = mirror.normals[0], float(np.sqrt(np.trace(mirror.covariances_m2[0])))
        rows.append(
            (
                str(picture),
                "  ".join(f"{v:+.5f}" for v in normal),
                f"{1000.0 * mirror.offsets_m[0]:.2f}",
                f"{1000.0 * std_m:.2f}",
                f"{mirror.rms_px[0]:.3f}",
            )
        )
        results.append(
            {
                "picture": picture,
                "normal": normal,
                "offset_m": mirror.offsets_m[0],
                "foot_covariance_m2": mirror.covariances_m2[0],
                "rms_px": mirror.rms_px[0],
            }
        )
    output.table(
        "Mirrors in the camera's frame", ("*picture", "normal", "distance mm", "± mm", "residual px"), rows
    )
    output.result({"mirrors": results})
    if not rows:
        output.warn(
            "no mirror could be measured: a picture must show the whole board twice, directly and in the mirror"
        )
        raise typer.Exit(ExitCode.NOTHING)
