"""`mirror-posture calibrate`: how camera and board are fixed to each other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..._core import MirrorPostureError
from ..output import JsonOption, Output, SessionArgument, write_json

if TYPE_CHECKING:
    import numpy as np

    from ...board import Board
    from ...camera import Camera

ORDER = 50
PANEL = "Measuring"
STILL = 1e-6
"""Frames whose nominal transforms differ by less (matrix elements) have the same head position."""


def command(
    session: SessionArgument,
    out: Annotated[
        Path | None, typer.Option(help="Write the transform for `measure --mount`, as .json.")
    ] = None,
    second_camera: Annotated[
        Path | None,
        typer.Option(help="camera.yaml of a second camera: calibrate the paper's way, without a mirror."),
    ] = None,
    second_pictures: Annotated[
        Path | None,
        typer.Option(help="Folder with robot/ and second/: pictures of one name were taken together."),
    ] = None,
    stand: Annotated[
        str | None,
        typer.Option(help="The standing board, NXxNYxMM: inner corners and squares, as in 9x6x20."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Calibrate how the camera is fixed to the board: the largest part of every marker's error.

    From mirror views alone: three or more frames with the mirror turned AND tilted between them. Views in a
    cross are good; by turning alone one direction is almost undetermined, and the result says so. Or the
    paper's way: a second camera sees the board on the chest and a second board in the robot's view
    (`--second-camera`, `--second-pictures`, `--stand`); the two boards must differ in their number of
    corners.

    Example: `mirror-posture calibrate my-session --out mount.json` and then `mirror-posture measure
    my-session --mount mount.json`
    """
    output = Output(as_json)
    import numpy as np

    from ...measurement import nominal_camera_from_board
    from ..detected import load_detected

    given = (second_camera, second_pictures, stand)
    if any(item is not None for item in given) and any(item is None for item in given):
        raise MirrorPostureError(
            "a second camera needs all of --second-camera, --second-pictures and --stand"
        )
    if second_camera is not None and second_pictures is not None and stand is not None:
        from ...session import load_session

        loaded = load_session(session)
        nominal = nominal_camera_from_board(loaded)[0]
        found: Any = _by_second_camera(loaded, second_camera, second_pictures, stand)
    else:
        loaded = load_detected(output, session)
        transforms = nominal_camera_from_board(loaded)
        nominal = transforms[0]
        still = np.abs(transforms - nominal).max(axis=(1, 2)) < STILL
        if not still.all():
            output.warn(
                f"the head moves: only the {still.sum()} of {len(still)} frames with its first position are used"
            )
        found = _by_mirror(loaded, still)

    difference = found.camera_from_board @ np.linalg.inv(nominal)
    # A marker's error follows that of the board's centre.
    shift = found.camera_from_board[:3, 3] - nominal[:3, 3]
    turn = float(np.degrees(np.arccos(np.clip((np.trace(difference[:3, :3]) - 1.0) / 2.0, -1.0, 1.0))))
    std = np.sqrt(np.diag(found.covariance))
    rows = [
        (
            "board in camera, mm (x y z)",
            "  ".join(f"{1000.0 * v:.3f}" for v in found.camera_from_board[:3, 3]),
        ),
        ("± mm, along the board's axes", "  ".join(f"{1000.0 * v:.3f}" for v in std[3:])),
        ("± degrees, about the board's axes", "  ".join(f"{np.degrees(v):.4f}" for v in std[:3])),
        ("from the model: board's centre, mm", "  ".join(f"{1000.0 * v:+.3f}" for v in shift)),
        ("from the model: turn, degrees", f"{turn:.4f}"),
    ]
    result = {
        "camera_from_board": found.camera_from_board,
        "covariance": found.covariance,
        "nominal_camera_from_board": nominal,
        "shift_in_camera_m": shift,
        "turn_rad": np.radians(turn),
        "warning": found.warning,
    }
    if hasattr(found, "views"):
        rows += [
            ("views used", f"{len(found.views)}"),
            ("reprojection, mean px", f"{found.reprojection_mean_px:.3f}"),
        ]
        result |= {
            "frames": loaded.frames.frame[found.views],
            "refused": {int(loaded.frames.frame[row]): reason for row, reason in found.reasons.items()},
            "reprojection_mean_px": found.reprojection_mean_px,
        }
        for row, reason in found.reasons.items():
            output.warn(f"frame {loaded.frames.frame[row]}: not used ({reason})")
    else:
        rows.append(
            ("agreement of the snapshots, chi²", f"{found.chi_squared:.1f} of {found.degrees_of_freedom}")
        )
        result |= {"chi_squared": found.chi_squared, "degrees_of_freedom": found.degrees_of_freedom}
    output.table("Camera and board", ("*", "~"), rows)
    if found.warning:
        output.warn(found.warning)
    if out is not None:
        write_json(out, result)
        output.say(f"written: {out}")
        output.say(f"next: mirror-posture measure {session} --mount {out}")
    output.result(result)


def _by_mirror(loaded: Any, still: np.ndarray) -> Any:
    import numpy as np

    from ...calibrate import calibrate_from_mirror_views
    from ...mirror import IDEAL_MIRROR

    seen = loaded.mirror_view
    corners = np.where((seen.board_seen & still[:, None])[..., None], seen.board_px, np.nan)
    shown = np.flatnonzero(np.isfinite(corners).any(axis=(1, 2)))
    if not len(shown):
        raise MirrorPostureError(f"{loaded.folder}: no frame shows the board in the mirror")
    glass = (loaded.mirror or IDEAL_MIRROR).glass
    return calibrate_from_mirror_views(loaded.camera, loaded.board, corners, **glass)


def _by_second_camera(loaded: Any, camera_file: Path, folder: Path, stand_text: str) -> Any:
    import numpy as np

    from ...board import Board
    from ...calibrate import calibrate_with_second_camera
    from ...detect import list_pictures
    from ...session import load_camera_info

    try:
        nx, ny, millimetres = stand_text.lower().split("x")
        stand = Board(int(nx), int(ny), float(millimetres) / 1000.0)
    except ValueError:
        raise MirrorPostureError(f"--stand: got {stand_text!r}, needed NXxNYxMM, as in 9x6x20") from None
    chest = loaded.board
    if set(stand.corners) == set(chest.corners):
        raise MirrorPostureError(
            f"--stand: both boards have {chest.columns} × {chest.rows} corners and cannot be distinguished; use another board"
        )
    second = load_camera_info(camera_file)
    names = [file.name for file in list_pictures(folder / "robot")]
    if missing := [name for name in names if not (folder / "second" / name).is_file()]:
        raise MirrorPostureError(
            f"{folder / 'second' / missing[0]}: the picture that belongs to robot/{missing[0]} is missing"
        )
    stand_robot, stand_second, chest_second = [], [], []
    for name in names:
        stand_robot.append(_direct_corners(folder / "robot" / name, stand, loaded.camera))
        stand_second.append(_direct_corners(folder / "second" / name, stand, second))
        chest_second.append(_direct_corners(folder / "second" / name, chest, second))
    return calibrate_with_second_camera(
        loaded.camera,
        second,
        chest,
        stand,
        stand_in_robot_camera_px=np.stack(stand_robot),
        stand_in_second_camera_px=np.stack(stand_second),
        chest_in_second_camera_px=np.stack(chest_second),
    )


def _direct_corners(file: Path, board: Board, camera: Camera) -> Any:
    from ...detect import BoardOptions, DetectionOptions, DetectionSetup, detect_picture

    options = DetectionOptions(board=BoardOptions(views=("direct",)))
    views = detect_picture(file, DetectionSetup(board, (), camera), options=options).boards
    good = next((view for view in views if view.ok), None)
    if good is None:
        reason = next(
            (view.reason for view in views if not view.ok), "it is seen in a mirror, needed directly"
        )
        raise MirrorPostureError(f"{file}: the {board.columns} × {board.rows} board was not found: {reason}")
    return good.corners_px
