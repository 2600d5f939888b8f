"""`mirror-posture init`: a session's folder from a robot's file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from ...counted import counted
from ..output import JsonOption, Output
from ..values import mirror_size as wanted_size
from ..values import package_folders, two_counts, xacro_arguments

ORDER = 4
PANEL = "Setting up"
SMALLEST_BALL_MM, THINNEST_GLASS_MM = 1.0, 0.1
"""Below these a length is in m."""


def command(
    robot: Annotated[Path, typer.Argument(help="URDF, xacro or MJCF.", show_default=False)],
    folder: Annotated[Path, typer.Argument(help="The session's folder to write.", show_default=False)],
    camera: Annotated[
        str | None, typer.Option(help="Link that carries the camera. Asked for where it is left out.")
    ] = None,
    camera_at: Annotated[
        str | None,
        typer.Option(
            help="Optical centre X,Y,Z on that link, m. Without it the link is the optical frame itself."
        ),
    ] = None,
    camera_looks: Annotated[str, typer.Option(help="Where it looks, in the link's frame.")] = "1,0,0",
    camera_up: Annotated[str, typer.Option(help="What is up in its picture, in the link's frame.")] = "0,0,1",
    board: Annotated[str | None, typer.Option(help="Link that carries the board.")] = None,
    board_at: Annotated[
        str | None,
        typer.Option(help="Its centre X,Y,Z on that link, m. Without it the link is the board's frame."),
    ] = None,
    board_faces: Annotated[str, typer.Option(help="Where its printed face looks.")] = "1,0,0",
    board_up: Annotated[str, typer.Option(help="Where its arrow y points.")] = "0,0,1",
    marker: Annotated[
        list[str] | None, typer.Option(help="A ball: NAME=LINK@X,Y,Z (m, in the link's frame). Repeat it.")
    ] = None,
    corners: Annotated[str, typer.Option(help="Inner corners of the board, NXxNY.")] = "7x4",
    square_mm: Annotated[float, typer.Option(help="Side of a square as measured on the print, mm.")] = 20.0,
    ball_mm: Annotated[float, typer.Option(help="Diameter of the balls, mm.")] = 20.0,
    glass_mm: Annotated[
        float, typer.Option(help="Thickness of the mirror's pane; 0: silvered in front.")
    ] = 4.0,
    mirror_size: Annotated[
        str | None, typer.Option(help="Of the mirror, width x height, cm, for `plan`.")
    ] = None,
    mirror_at: Annotated[
        str | None,
        typer.Option(help="Its centre X,Y,Z in the root's frame, m, for `plan`, if its place is fixed."),
    ] = None,
    tolerance_mm: Annotated[
        float, typer.Option(help="How exactly you could place things: one std, mm.")
    ] = 3.0,
    tolerance_deg: Annotated[float, typer.Option(help="And turn them: one std, degrees.")] = 1.0,
    camera_file: Annotated[
        Path | None,
        typer.Option(help="The camera's ROS camera_info (camera.yaml). Without it one is guessed."),
    ] = None,
    picture: Annotated[
        str, typer.Option(help="Without --camera-file: the picture's size, WxH.")
    ] = "1280x720",
    focal_px: Annotated[
        float | None,
        typer.Option(help="Without --camera-file: focal length; by default the picture's width."),
    ] = None,
    package: Annotated[
        list[str] | None, typer.Option(help="NAME=FOLDER of a ROS package whose meshes the URDF names.")
    ] = None,
    xacro_arg: Annotated[
        list[str] | None, typer.Option(help="NAME=VALUE of a robot written in xacro. Repeat it.")
    ] = None,
    up: Annotated[
        str,
        typer.Option(help="The upward direction in the root link's frame; for a robot that hangs 0,0,-1."),
    ] = "0,0,1",
    overwrite: Annotated[
        bool,
        typer.Option(
            "--overwrite", help="Overwrite a folder that contains no pictures yet; a plan in it is kept."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Start a session: state where camera, board and balls are on the robot.

    Writes robot.urdf (your URDF unchanged, with the mounts at its end), camera.yaml, session.toml with
    tolerances, and setup.png: the robot with camera, board and balls from three sides. Look at it. All
    files can be edited by hand.

    Example: `mirror-posture init arm.urdf my-session --camera base --camera-at 0.1,0,0.3 --board base
    --board-at 0.1,0,0.1 --marker hand=gripper@0,0,0.05`

    Next: `mirror-posture plan my-session`
    """
    output = Output(as_json)
    from ..._core import MirrorPostureError
    from ...board_sheet import BoardSheet
    from ...camera import Camera
    from ...formats.session_keys import LARGEST_MARKER_M, LARGEST_TOLERANCE_M, THICKEST_GLASS_M
    from ...mirror import Mirror
    from ...new_session import (
        CameraMount,
        FaceMount,
        create_session,
        draw_setup,
        parse_marker,
        parse_vector,
        require_robot_file,
    )
    from ...session import load_camera_info

    require_robot_file(robot)
    if camera is None:
        camera = typer.prompt("Link that carries the camera", err=True)
        if camera_at is None:
            camera_at = _place("Its optical centre X,Y,Z there, m (Enter: that link is the optical frame)")
            if camera_at is not None:
                camera_looks = typer.prompt("Where it looks, in that link's frame", camera_looks, err=True)
    if board is None:
        board = typer.prompt("Link that carries the board", err=True)
        if board_at is None:
            board_at = _place("Its centre X,Y,Z there, m (Enter: that link is the board's frame)")
            if board_at is not None:
                board_faces = typer.prompt("Where its printed face looks", board_faces, err=True)
    given = list(marker or ())
    while not given:
        given = typer.prompt("Markers as NAME=LINK@X,Y,Z, with blanks between them", err=True).split()
    for option, value, least, below, unit in (
        ("--tolerance-mm", tolerance_mm, 0.0, 1000.0 * LARGEST_TOLERANCE_M, "mm"),
        ("--tolerance-deg", tolerance_deg, 0.0, 180.0, "degrees"),
        ("--glass-mm", glass_mm, 0.0, 1000.0 * THICKEST_GLASS_M, "mm"),
        ("--ball-mm", ball_mm, SMALLEST_BALL_MM, 1000.0 * LARGEST_MARKER_M, "mm"),
    ):
        if not least <= value < below:
            asked = ": is it in another unit?" if value > 0.0 else ""
            raise MirrorPostureError(
                f"{option}: got {value:g}, needed {least:g} to below {below:g} {unit}{asked}"
            )
    if 0.0 < glass_mm < THINNEST_GLASS_MM:
        raise MirrorPostureError(
            f"--glass-mm: got {glass_mm:g}, needed 0 (silvered in front), or {THINNEST_GLASS_MM:g} mm and more: is it in m?"
        )
    nx, ny = two_counts(corners, "--corners", "7x4")
    mirror_width_m, mirror_height_m = wanted_size(mirror_size)
    tolerance_m, tolerance_rad = tolerance_mm / 1000.0, math.radians(tolerance_deg)
    # The sheet's own checks: one odd, one even; a large arm's board may be larger than a desk's printer prints.
    told = BoardSheet(nx, ny, square_mm / 1000.0, paper="a0").metadata()
    if camera_file is None:
        width, height = two_counts(picture, "--picture", "1280x720")
        focal = float(width if focal_px is None else focal_px)
        if not (math.isfinite(focal) and focal > 0.0):
            raise MirrorPostureError(f"--focal-px: got {focal_px!r}, needed a number above 0")
        intrinsics = Camera(
            (width, height), (focal, focal), ((width - 1) / 2, (height - 1) / 2), name="guessed"
        )
        output.warn(
            "camera.yaml is guessed; calibrate the camera before you trust a millimetre: calibrate-camera --help"
        )
    else:
        intrinsics = load_camera_info(camera_file)

    def at(text: str | None, option: str) -> tuple[float, float, float] | None:
        return None if text is None else parse_vector(text, option)

    missing: list[str] = []

    def draw(part: Path) -> None:
        missing.extend(draw_setup(part, part / drawing.name))

    drawing = folder / "setup.png"
    made = create_session(
        robot,
        folder,
        camera=intrinsics,
        camera_mount=CameraMount(
            camera, at(camera_at, "--camera-at"), parse_vector(camera_looks, "--camera-looks"),
            parse_vector(camera_up, "--camera-up"), tolerance_m, tolerance_rad,
        ),
        board=told,
        board_mount=FaceMount(
            board, at(board_at, "--board-at"), parse_vector(board_faces, "--board-faces"),
            parse_vector(board_up, "--board-up"), tolerance_m, tolerance_rad,
        ),
        markers=[parse_marker(text, tolerance_m) for text in given],
        ball_diameter_m=ball_mm / 1000.0,
        mirror=Mirror(
            glass_mm / 1000.0,
            width_m=mirror_width_m,
            height_m=mirror_height_m,
            center_in_root_m=at(mirror_at, "--mirror-at"),
        ),
        packages=package_folders(package or ()),
        xacro_arguments=xacro_arguments(xacro_arg or ()),
        also=draw,
        overwrite=overwrite,
        up=parse_vector(up, "--up"),
    )  # fmt: skip
    for text in made.warnings:
        output.warn(text)
    if missing:
        output.say(
            f"{counted(len(missing), 'mesh was', 'meshes were')} not drawn (not found: --package NAME=FOLDER says where a ROS package lies; other kinds than STL need trimesh), as {missing[0]}"
        )
    output.say(f"written: {folder}/session.toml, robot.urdf, camera.yaml; look at {drawing}")
    output.say(f"joints that move: {', '.join(made.robot.position_names)}")
    output.result(
        {
            "folder": folder,
            "camera_link": made.camera_link,
            "board_link": made.board_link,
            "marker_links": made.marker_links,
            "joints": list(made.robot.position_names),
            "meshes_not_drawn": missing,
            "warnings": list(made.warnings),
        }
    )


def _place(question: str) -> str | None:
    """A place entered by the user; None where only Enter was pressed."""
    return typer.prompt(question, "", show_default=False, err=True) or None
