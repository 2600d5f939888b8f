"""frames.csv: what was commanded, in the order in which the robot executed it."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

import numpy as np

from .errors import SessionError, choices
from .robot_names import RobotNames
from .tables import Table
from .types import Frames

OWN_COLUMNS = ("frame", "posture", "time_s", "image")
MEASURED = "measured:"
LIMIT_FACTOR = 4.0
"""A command beyond this many times the joint's limit cannot be meant: degrees, most likely (a factor of 57)."""


def read_frames(table: Table, robot: RobotNames, ordered: bool) -> tuple[Frames, list[str]]:
    """The frames table, checked against the robot; second, what is odd and was kept."""
    table.require("frame", "posture")
    if table.rows == 0:
        raise SessionError(table.name, "has no rows; needed one row for each captured picture")
    frame = table.integers("frame")
    falls = np.flatnonzero(np.diff(frame) <= 0)
    if len(falls):
        row = int(falls[0]) + 1
        twice = int(frame[row]) in set(frame[:row].tolist())
        problem = (
            f"the frame {frame[row]} stands there twice"
            if twice
            else f"got {frame[row]} after {frame[row - 1]}"
        )
        raise SessionError(
            table.name,
            f"{problem}; needed unique, rising numbers: the order of execution",
            row=row + 1,
            column="frame",
        )
    posture = table.integers("posture")
    warnings = []
    time_s = table.numbers("time_s") if "time_s" in table.columns else None
    if time_s is not None and ordered and (np.diff(time_s) < 0).any():
        row = int(np.flatnonzero(np.diff(time_s) < 0)[0]) + 2
        warnings.append(
            f"{table.name}, row {row}: time_s falls though the rows are in the order of execution; "
            "write `ordered = false` under [frames] in session.toml if they are not"
        )
    image = _images(table) if "image" in table.columns else None

    joints = [name for name in table.columns if name not in OWN_COLUMNS and not name.startswith(MEASURED)]
    measured = [name for name in table.columns if name.startswith(MEASURED)]
    for column in joints + measured:
        _check_joint(table, column, column.removeprefix(MEASURED), robot)
    commanded = _stack(table, joints)
    for index, joint in enumerate(joints):
        _check_unit(table, joint, commanded[:, index], robot)
    frames = Frames(
        frame,
        posture,
        tuple(joints),
        commanded,
        tuple(name.removeprefix(MEASURED) for name in measured),
        _stack(table, measured),
        time_s,
        image,
        ordered,
    )
    return frames, warnings


def _stack(table: Table, columns: list[str]) -> np.ndarray:
    if not columns:
        return np.zeros((table.rows, 0))
    return np.stack([table.numbers(column) for column in columns], axis=1)


def _check_joint(table: Table, column: str, joint: str, robot: RobotNames) -> None:
    if joint in robot.joints:
        return
    if joint in robot.fixed_joints:
        raise SessionError(
            table.name, f"the joint {joint!r} is fixed in the URDF; remove the column", column=column
        )
    raise SessionError(
        table.name,
        f"the URDF has no joint {joint!r}; its joints: {choices(robot.joints)}; rename or remove the column",
        column=column,
    )


def _check_unit(table: Table, joint: str, commanded: np.ndarray, robot: RobotNames) -> None:
    largest = robot.largest_command.get(joint)
    if largest is None:
        return
    beyond = np.flatnonzero(np.abs(commanded) > LIMIT_FACTOR * largest)
    if len(beyond):
        row = int(beyond[0])
        raise SessionError(
            table.name,
            f"got {commanded[row]:g}, more than {LIMIT_FACTOR:g} times the joint's limit of {largest:g} in the URDF; "
            "needed rad (m for a prismatic joint): are these degrees (or mm)?",
            row=row + 1,
            column=joint,
        )


def _images(table: Table) -> tuple[str | None, ...]:
    codes, names = table.texts("image")
    for code, name in enumerate(names):
        path = PurePosixPath(name)
        if path.is_absolute() or ".." in path.parts or "\\" in name or "\0" in name:
            row = int(np.flatnonzero(codes == code)[0]) + 1
            raise SessionError(
                table.name,
                f"got {name!r}, needed a path inside the session's folder, with /",
                row=row,
                column="image",
            )
    return tuple(names[code] or None for code in codes)


def check_images_exist(folder: Path, table_name: str, frames: Frames) -> None:
    """Refuses a frame whose picture is missing."""
    for row, name in enumerate(frames.image or ()):
        if name is not None and not (folder / name).is_file():
            raise SessionError(
                table_name, f"the picture {name} is missing; put it there, or leave the cell empty", row=row + 1,
                column="image",
            )  # fmt: skip
