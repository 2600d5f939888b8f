"""`mirror-posture calibrate-camera`: the camera's intrinsics from pictures of the board."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...counted import counted
from ..output import JsonOption, Output
from ..values import two_counts

if TYPE_CHECKING:
    from ...board import Board

ORDER = 6
PANEL = "Setting up"


def command(
    pictures: Annotated[
        Path,
        typer.Argument(
            help="Folder with pictures of the board, seen directly; a new one with --source.",
            show_default=False,
        ),
    ],
    source: Annotated[
        str | None,
        typer.Option(help="Takes the pictures by itself: webcam:0, rtsp://ADDRESS, or a film."),
    ] = None,
    most: Annotated[int, typer.Option(help="With --source: how many pictures at most.", min=4)] = 30,
    out: Annotated[Path, typer.Option(help="camera.yaml to write (ROS camera_info).")] = Path("camera.yaml"),
    corners: Annotated[str, typer.Option(help="Inner corners of the board, NXxNY.")] = "7x4",
    square_mm: Annotated[float, typer.Option(help="Side of a square as measured on the print, mm.")] = 20.0,
    charuco: Annotated[
        str | None, typer.Option(help="The board is a ChArUco of `board`, with this dictionary.")
    ] = None,
    marker_mm: Annotated[
        float | None, typer.Option(help="With --charuco: side of a code, mm. By default 0.75 of a square.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Calibrate the camera: 12 or more pictures of the printed board, tilted, and in all parts of the
    picture.

    Hold the board in front of the camera, without a mirror. Do not change focus and zoom afterwards. The
    command prints the parameters with their standard deviations, the residual, how much of the picture was
    covered, and what is weak.

    With --source a picture is taken whenever the board is held still in a new place. After each picture it
    says what is still weak, and it ends by itself when nothing is. Ctrl-C ends it too: the pictures stay in
    the folder, to be calibrated without --source.

    Example: `mirror-posture calibrate-camera pictures --corners 7x4 --square-mm 20 --out
    my-session/camera.yaml --overwrite`

    Next: `mirror-posture init --help` (it takes the file as --camera-file)
    """
    output = Output(as_json)
    import numpy as np

    from ..._core import MirrorPostureError
    from ...camera_calibration import calibrate_camera
    from ...detect import (
        BoardOptions,
        DetectionOptions,
        DetectionSetup,
        detect_pictures,
        list_pictures,
    )
    from ...output_files import write_file
    from ...session.camera_info import dump_camera_info

    if out.exists() and not overwrite:
        raise MirrorPostureError(f"{out}: is there already; add --overwrite")
    nx, ny = two_counts(corners, "--corners", "7x4")
    board = _board(nx, ny, square_mm / 1000.0, charuco, None if marker_mm is None else marker_mm / 1000.0)
    options = DetectionOptions(board=BoardOptions(views=("direct",)))
    if source is not None:
        from ...capture.board_pictures import take_board_pictures
        from ...capture.sources import open_source

        opened = open_source(source, None)
        try:
            count = take_board_pictures(opened, board, pictures, most, output.say)
        except KeyboardInterrupt:
            if pictures.is_dir() and any(pictures.iterdir()):
                output.warn(
                    f"the pictures are kept in {pictures}; the same command without --source calibrates with them"
                )
            raise
        finally:
            opened.close()
        output.say(f"{counted(count, 'picture is', 'pictures are')} in {pictures}")
        if count == 0:
            raise MirrorPostureError(
                f"--source {source}: the board was not held still in it; is it {corners}?"
            )
    files = list_pictures(pictures)
    with output.counting("detecting", len(files)) as counted_off:
        detected = detect_pictures(
            files,
            DetectionSetup(board, (), None),
            options=options,
            progress=lambda done, _: counted_off(done),
        )
    readable = [each for each in detected if not each.error]
    if not readable:
        raise MirrorPostureError(f"{detected[0].error}; no picture of {pictures} can be read")
    size = (readable[0].width_px, readable[0].height_px)
    found, names, refused = [], [], []
    for file, each in zip(files, detected, strict=True):
        if each.error:
            refused.append((file.name, each.error.removeprefix(f"{file}: ")))
            continue
        if (each.width_px, each.height_px) != size:
            raise MirrorPostureError(
                f"{file}: is {each.width_px} x {each.height_px}, the first picture is {size[0]} x {size[1]}; one camera, one size"
            )
        view = each.boards[0]
        if not view.ok or view.corners_px is None:
            refused.append((file.name, view.reason))
            continue
        seen = np.ones(board.corner_count, bool) if view.visible is None else np.asarray(view.visible, bool)
        found.append(np.where(seen[:, None], view.corners_px, np.nan))
        names.append(file.name)
    for name, reason in refused:
        output.warn(f"{name}: not used ({reason})")
    done = calibrate_camera(board, found, size)
    write_file(out, dump_camera_info(done.camera))
    camera, std = done.camera, done.std_px
    output.table(
        f"Camera of {int(done.used.sum())} views, {size[0]} x {size[1]} px",
        ("*", "value", "± one std"),
        [
            ("fx, px", f"{camera.focal_px[0]:.2f}", f"{std[0]:.2f}"),
            ("fy, px", f"{camera.focal_px[1]:.2f}", f"{std[1]:.2f}"),
            ("cx, px", f"{camera.center_px[0]:.2f}", f"{std[2]:.2f}"),
            ("cy, px", f"{camera.center_px[1]:.2f}", f"{std[3]:.2f}"),
            *(
                (name, f"{value:.5f}", f"{deviation:.5f}")
                for name, value, deviation in zip(
                    ("k1", "k2", "p1", "p2", "k3"), camera.distortion, done.std_distortion, strict=True
                )
            ),
            ("residual, px RMS", f"{done.rms_px:.3f}", ""),
            ("picture covered, %", f"{100 * done.coverage:.0f}", ""),
            ("largest tilt, degrees", f"{np.degrees(done.largest_tilt_rad):.0f}", ""),
        ],
    )
    for number, why in sorted(done.reasons.items()):
        output.warn(f"{names[number]}: left out ({why})")
    for text in done.weak:
        output.warn(text)
    output.say(f"written: {out}")
    output.result(
        {
            "file": out,
            "camera": camera,
            "std_px": done.std_px,
            "std_distortion": done.std_distortion,
            "rms_px": done.rms_px,
            "views": [name for name, use in zip(names, done.used, strict=True) if use],
            "left_out": [name for name, use in zip(names, done.used, strict=True) if not use],
            "refused": [{"picture": name, "reason": reason} for name, reason in refused],
            "coverage": done.coverage,
            "weak": list(done.weak),
        }
    )


def _board(nx: int, ny: int, square_m: float, charuco: str | None, marker_m: float | None) -> Board:
    """The board as it was made, by `board` or by others: of any size, on any material."""
    from ..._core import MirrorPostureError
    from ...board import CHARUCO, Board
    from ...board_sheet.layout import MARKER_SHARE
    from ...detect.charuco import charuco_board

    if charuco is None:
        if marker_m is not None:
            raise MirrorPostureError(
                f"--marker-mm: got {1000 * marker_m:g} for a chessboard, which has no codes; needed --charuco with it, or leave it away"
            )
        if nx % 2 == ny % 2:
            raise MirrorPostureError(
                f"--corners: got {nx}x{ny}, needed one odd and one even count of inner corners (as {nx}x{ny + 1}): "
                "a chessboard looks the same after half a turn otherwise, and no picture of it is used"
            )
        return Board(nx, ny, square_m)
    board = Board(
        nx, ny, square_m, CHARUCO, MARKER_SHARE * square_m if marker_m is None else marker_m, charuco
    )
    # Refuses a dictionary that OpenCV lacks, or that has too few codes, before any picture is taken.
    charuco_board(board)
    return board
