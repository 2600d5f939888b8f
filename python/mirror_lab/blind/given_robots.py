"""Robots that the user gives: a URDF or an MJCF that has the rig's mounts in it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from .errors import BlindError
from .mjcf import urdf_of_mjcf
from .robots import Robot, read_bodies

SUFFIXES = {".urdf", ".xml", ".mjcf"}


def from_file(path: Path, rng: np.random.Generator) -> Robot:
    """A robot from a URDF or an MJCF (a file whose outermost element is `mujoco`).

    Raises BlindError where the file is missing, is neither, or lacks the mounts.
    """
    if not path.is_file():
        raise BlindError(f"{path}: no such file; a robot is a URDF or an MJCF")
    try:
        outermost = ET.parse(path).getroot().tag
    except ET.ParseError as e:
        raise BlindError(f"{path} is not XML: {e}") from e
    if outermost == "mujoco":
        return from_text(urdf_of_mjcf(path), path, rng)
    if outermost != "robot":
        raise BlindError(f"{path}: got an XML of <{outermost}>; needed <robot> (URDF) or <mujoco> (MJCF)")
    return from_urdf(path, rng)


def from_urdf(path: Path, rng: np.random.Generator) -> Robot:
    """Any robot whose URDF has a link `camera_optical`, one that ends in `_board`, and markers that end in
    `_marker`.

    The root is the link that carries the board. Commanded are the joints between the root and the markers.
    """
    return from_text(path.read_text(encoding="utf-8"), path, rng)


def from_text(text: str, path: Path, rng: np.random.Generator) -> Robot:
    """The same from a URDF in memory; errors name `path`."""
    links = [element.get("name", "") for element in ET.fromstring(text).findall("link")]
    boards = [n for n in links if n.endswith("_board")]
    markers = [n.removesuffix("_marker") for n in links if n.endswith("_marker")]
    if "camera_optical" not in links or len(boards) != 1 or not markers:
        raise BlindError(
            f"{path}: a robot of the blind check needs the links `camera_optical`, "
            f"one `…_board` and `…_marker`s; "
            f"got boards {boards}, markers {markers}"
        )
    parents = {
        j.find("child").get("link"): j  # type: ignore[union-attr]
        for j in ET.fromstring(text).findall("joint")
    }
    root = parents[boards[0]].find("parent").get("link")  # type: ignore[union-attr]
    while root in parents and parents[root].get("type") == "fixed":
        root = parents[root].find("parent").get("link")  # type: ignore[union-attr]
    bodies = read_bodies(text, str(root))
    robot = Robot(
        path.stem,
        text,
        str(root),
        bodies,
        [],
        {},
        markers,
        0.0,
        (8, 5),
        0.0,
        (0, 0),
        (1280, 960),
        (930, 1100),
        0,
    )
    robot.board_link = boards[0]
    missing = [m for m in [*(f"{m}_marker" for m in markers), "camera_optical"] if m not in robot.index]
    if missing:
        raise BlindError(
            f"{path}: {', '.join(missing)} does not hang on {root!r}, the link that carries the board"
        )
    used: set[int] = set()
    for m in markers:
        used |= set(robot.ancestors(robot.index[f"{m}_marker"]))
    for i in sorted(used):
        b = bodies[i]
        if b.joint_type == "hinge":
            middle, half = (b.lower + b.upper) / 2, min((b.upper - b.lower) / 2, 1.6) * 0.85
            robot.ranges[b.joint] = (middle - half, middle + half)
    robot.commanded = sorted(robot.ranges)
    reach = max(
        sum(float(np.linalg.norm(bodies[i].xyz_m)) for i in robot.ancestors(robot.index[f"{m}_marker"]))
        for m in markers
    )
    small = reach < 0.4
    robot.length_scale_m = 0.0125 * reach
    robot.marker_diameter_m = 0.0116 if small else 0.03
    robot.board_square_m = 0.010 if small else 0.03
    robot.path_length_m = (1.6 * reach, 3.0 * reach) if not small else (1.4 * reach, 2.8 * reach)
    if small:
        robot.image_size, robot.focal_px = (800, 600), (620.0, 760.0)
    return robot
