"""The folder of a new session: the robot with its mounts, the camera, session.toml."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import tomli_w

from .._core import MirrorPostureError
from ..camera import Camera
from ..diagnosis.applied.xacro_tree import XacroTree, is_xacro
from ..diagnosis.applied.xml_text import BOM, XmlText, read_xml
from ..mirror import IDEAL_MIRROR, Mirror
from ..output_files import new_folder
from ..robot import Robot
from ..session.camera_info import dump_camera_info
from ..session.plausibility import check_camera
from ..session.write import mirror_keys
from ..shapes import Triangles, keep_coarse_meshes
from .from_mjcf import urdf_from_mjcf
from .mjcf_shapes import origin_text
from .mounts import CameraMount, FaceMount, MarkerMount
from .unusual import facing_apart, far_away, size_of_mirror

CAMERA_LINK, BOARD_LINK, MARKER_SUFFIX = "session_camera_optical", "session_board", "_marker"
ROOTS = ("robot", "mujoco")
"""Of a URDF or xacro, and of an MJCF."""
GRAVITY = 9.81
OWN_FILES = ("session.toml", "robot.urdf", "camera.yaml", "setup.png", "meshes")
PLAN = "plan"
"""Kept from an earlier folder: `plan --judge` says what of it is still valid."""
HUE_TOLERANCE_DEG = 15.0


@dataclass(frozen=True)
class NewSession:
    """The result: the folder, the robot in it, and what a person should check."""

    folder: Path
    robot: Robot
    camera_link: str
    board_link: str
    marker_links: dict[str, str]
    warnings: tuple[str, ...]


def require_robot_file(file: Path) -> tuple[str, str]:
    """The text of a URDF, xacro or MJCF, and its root's tag. Raises `MirrorPostureError` for no such file or another, before anything is asked about it."""
    if not file.is_file():
        raise MirrorPostureError(f"{file}: there is no such file; needed a URDF or an MJCF")
    needed = "needed a URDF or xacro (<robot>) or an MJCF (<mujoco>)"
    text = read_xml(file)
    try:
        root = XmlText(text, str(file)).root.tag
    except MirrorPostureError as error:
        raise MirrorPostureError(f"{error}; {needed}") from None
    if root not in ROOTS:
        raise MirrorPostureError(f"{file}: got <{root}>, {needed}")
    return text, root


def create_session(
    robot_file: Path,
    folder: Path,
    *,
    camera: Camera,
    camera_mount: CameraMount,
    board: dict[str, Any],
    board_mount: FaceMount,
    markers: Sequence[MarkerMount],
    ball_diameter_m: float,
    mirror: Mirror = IDEAL_MIRROR,
    packages: Mapping[str, Path] | None = None,
    xacro_arguments: Mapping[str, str] | None = None,
    also: Callable[[Path], None] | None = None,
    overwrite: bool = False,
    up: Sequence[float] = (0.0, 0.0, 1.0),
) -> NewSession:
    """Writes a session without frames: robot.urdf, camera.yaml and session.toml, which may be edited by
    hand.

    The URDF is unchanged, with the mounts as further links before its end. xacro is expanded
    (`xacro_arguments`), an MJCF is converted to a URDF of the same kinematics and shapes. Simplified copies
    of the meshes that are found (`packages`: folders of ROS packages) are kept in the folder `meshes`, for
    plans and pictures. `also` writes further files into the folder before it takes its place: all are
    there, or none. `board` are the keys of `[board]` without its link; `up` is the upward direction in the
    root's frame. The markers get evenly spaced hues.

    Raises:
        MirrorPostureError: an existing folder, a link that the robot does not have (with those that it has), a robot that cannot be read.
    """
    if folder.exists():
        _check_replaceable(folder, overwrite)
    text, root = require_robot_file(robot_file)
    unusual = check_camera(camera, "camera.yaml")
    meshes: dict[str, Triangles] = {}
    if root == "mujoco":
        text, meshes, left_out = urdf_from_mjcf(robot_file)
        unusual += left_out
    elif is_xacro(text):
        text = XacroTree(robot_file, xacro_arguments, packages).expand({})
    bare = Robot.from_urdf_text(text)
    camera_link = CAMERA_LINK if camera_mount.at_m is not None else camera_mount.link
    board_link = BOARD_LINK if board_mount.at_m is not None else board_mount.link
    marker_links = {marker.name: marker.name + MARKER_SUFFIX for marker in markers}
    mounts = [(marker_links[marker.name], marker.link, marker.link_from_mount()) for marker in markers]
    if camera_mount.at_m is not None:
        mounts.append((CAMERA_LINK, camera_mount.link, camera_mount.link_from_mount()))
    if board_mount.at_m is not None:
        mounts.append((BOARD_LINK, board_mount.link, board_mount.link_from_mount()))
    _check_links(bare, robot_file, [camera_mount.link, board_mount.link, *(m.link for m in markers)], mounts)
    text = _with_mounts(text, mounts)
    robot = Robot.from_urdf_text(text)
    tree = _metadata(robot, camera_link, camera_mount, board_link, board_mount, board)
    tree["markers"] = [
        _marker(marker, marker_links[marker.name], ball_diameter_m, 360.0 * index / len(markers))
        for index, marker in enumerate(markers)
    ]
    tree["mirror"] = mirror_keys(mirror)
    tree["gravity"] = _gravity(up)
    with new_folder(folder, owned=OWN_FILES) as part:
        (part / "robot.urdf").write_bytes(text.encode("utf-8"))
        keep_coarse_meshes(robot_file, part / "robot.urdf", packages or {}, meshes)
        (part / "camera.yaml").write_text(dump_camera_info(camera), encoding="utf-8")
        (part / "session.toml").write_text(tomli_w.dumps(tree), encoding="utf-8")
        if also is not None:
            also(part)
    places = {"the camera": camera_link, "the board": board_link}
    places |= {f"marker {name}": link for name, link in marker_links.items()}
    unusual += [
        *facing_apart(robot, camera_link, board_link),
        *far_away(bare, robot, places, mirror),
        *size_of_mirror(mirror, [(count + 1) * board["square"] for count in board["corners"]]),
    ]
    return NewSession(folder, robot, camera_link, board_link, marker_links, tuple(unusual))


def _gravity(up: Sequence[float]) -> list[float]:
    """Gravity in the root's frame, m/s²."""
    length = math.hypot(*up)
    if not length > 0.0:
        raise MirrorPostureError("--up: got 0,0,0, needed a direction")
    return [0.0 if part == 0.0 else -GRAVITY * part / length for part in up]


def _check_replaceable(folder: Path, overwrite: bool) -> None:
    """Whether an existing folder contains no more than a new session (and a plan, which is kept), and may
    be overwritten."""
    others = (
        sorted(path.name for path in folder.iterdir() if path.name not in (*OWN_FILES, PLAN))
        if folder.is_dir()
        else [""]
    )
    if others:
        raise MirrorPostureError(
            f"{folder}: is there already{f', with {others[0]}' if others[0] else ''}; give another folder"
        )
    if not overwrite:
        raise MirrorPostureError(
            f"{folder}: is there already; give another folder, or --overwrite to write it anew"
        )


def _check_links(
    robot: Robot, file: Path, named: Sequence[str], mounts: Sequence[tuple[str, str, Any]]
) -> None:
    for name in named:
        if name not in robot.link_names:
            raise MirrorPostureError(f"{file}: has no link {name!r}; it has {', '.join(robot.link_names)}")
    new = [name for name, _, _ in mounts]
    for name in new:
        if name in robot.link_names or new.count(name) > 1:
            raise MirrorPostureError(
                f"{file}: the link {name!r} is there already; give the marker another name"
            )


def _with_mounts(text: str, mounts: Sequence[tuple[str, str, Any]]) -> str:
    """The URDF with further links, each on a fixed joint, before its end."""
    lines = "".join(
        f"  <link name={quoteattr(name)}/>\n"
        f'  <joint name={quoteattr(name + "_mount")} type="fixed">\n'
        f"    <parent link={quoteattr(parent)}/>\n    <child link={quoteattr(name)}/>\n    {origin_text(pose)}\n  </joint>\n"
        for name, parent, pose in mounts
    )
    # Where the root ends: a comment may follow that looks like its end, and a blank may stand in the tag.
    before = text[: len(text) - len(text.removeprefix(BOM))]
    data = text.removeprefix(BOM).encode("utf-8")
    end = data.rfind(b"</", 0, XmlText(text).root.end)
    told = "\n  <!-- What was mounted for the session. -->\n" + lines
    return before + data[:end].decode("utf-8") + told + data[end:].decode("utf-8")


def _metadata(
    robot: Robot,
    camera_link: str,
    camera: CameraMount,
    board_link: str,
    board_mount: FaceMount,
    board: dict[str, Any],
) -> dict[str, Any]:
    return {
        "format": "mirror-posture/session",
        "version": 1,
        "robot": "robot.urdf",
        "camera": "camera.yaml",
        "root": robot.link_names[0],
        "camera_mount": {"link": camera_link, **_tolerances(camera)},
        "board": {**board, "link": board_link, **_tolerances(board_mount)},
    }


def _tolerances(mount: CameraMount | FaceMount) -> dict[str, float]:
    told = {"tolerance_m": mount.tolerance_m, "tolerance_rad": mount.tolerance_rad}
    return {key: value for key, value in told.items() if value is not None}


def _marker(marker: MarkerMount, link: str, diameter_m: float, hue_deg: float) -> dict[str, Any]:
    told: dict[str, Any] = {"name": marker.name, "link": link, "diameter": diameter_m, "mount": "known"}
    if marker.tolerance_m is not None:
        told["tolerance_m"] = marker.tolerance_m
    color = {"hue": hue_deg, "hue_tolerance": HUE_TOLERANCE_DEG, "min_saturation": 0.5, "min_value": 0.2}
    return {**told, "color": color}
