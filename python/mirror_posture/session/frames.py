"""frames.csv: the commands, in the order in which the robot executed them."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

import numpy as np

from ..input_files import path_inside
from ..robot import Joint, Robot
from .accelerometers import is_accelerometer, read_accelerometers
from .errors import Problems, SessionError, choices
from .tables import Table
from .types import Frames

OWN_COLUMNS = ("frame", "posture", "time_s", "image")
MEASURED = "measured:"
LIMIT_FACTOR = 4.0
"""A command beyond this many times the joint's limit is an error: degrees, most likely (a factor of 57)."""
FULL_TURN, MANY_TURNS, LARGEST_POSITION = 2.0 * np.pi, 100.0, 1e5
"""rad (m): a joint without a limit beyond sixteen turns gives a warning; beyond the second value it is an
error."""


def read_frames(table: Table, robot: Robot, ordered: bool) -> tuple[Frames, list[str]]:
    """The frames table, checked against the robot; and unusual findings that were kept."""
    problems = Problems()
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

    columns = [
        name for name in table.columns if name not in OWN_COLUMNS and not is_accelerometer(name, robot)
    ]
    joints = [name for name in columns if not name.startswith(MEASURED)]
    measured = [name for name in columns if name.startswith(MEASURED)]
    by_name = {joint.name: joint for joint in robot.joints}
    for column in columns:
        with problems.kept():
            _joint(table, column, by_name)
    problems.end()
    for column in columns:
        joint = by_name[column.removeprefix(MEASURED)]
        if joint.name not in robot.position_names and column == joint.name:
            warnings.append(
                f"{table.name}: {column!r} follows another joint (mimic); its column has no effect"
            )
    accelerometers = None
    with problems.kept():
        accelerometers = read_accelerometers(table, robot)
    commanded, read = _stack(table, joints, problems), _stack(table, measured, problems)
    problems.end()
    for name, values in (*zip(joints, commanded.T, strict=True), *zip(measured, read.T, strict=True)):
        with problems.kept():
            warnings += _check_unit(table, name, by_name[name.removeprefix(MEASURED)], values)
    problems.end()
    if accelerometers is None:
        raise AssertionError("accelerometers that cannot be read are a problem")
    frames = Frames(
        frame,
        posture,
        tuple(joints),
        commanded,
        tuple(name.removeprefix(MEASURED) for name in measured),
        read,
        time_s,
        image,
        ordered,
        accelerometers.links,
        accelerometers.force_m_per_s2,
        accelerometers.read,
    )
    return frames, warnings


def _stack(table: Table, columns: list[str], problems: Problems) -> np.ndarray:
    stack = np.zeros((table.rows, len(columns)))
    for index, column in enumerate(columns):
        with problems.kept():
            stack[:, index] = table.numbers(column)
    return stack


def _joint(table: Table, column: str, by_name: dict[str, Joint]) -> Joint:
    """The joint that a column speaks of; refuses one that the URDF lacks or that cannot move."""
    name = column.removeprefix(MEASURED)
    joint = by_name.get(name)
    if joint is None:
        movable = [known.name for known in by_name.values() if known.kind != "fixed"]
        raise SessionError(
            table.name,
            f"the URDF has no joint {name!r}; its joints: {choices(movable)}; rename or remove the column",
            column=column,
        )
    if joint.kind == "fixed":
        raise SessionError(
            table.name, f"the joint {name!r} is fixed in the URDF; remove the column", column=column
        )
    return joint


def _check_unit(table: Table, column: str, joint: Joint, positions: np.ndarray) -> list[str]:
    """Refuses positions in an impossible unit; returns warnings."""
    largest = max(abs(joint.lower), abs(joint.upper))
    unit, other = ("m", "mm") if joint.kind == "prismatic" else ("rad", "degrees")
    # Limits that are infinite or both zero limit nothing.
    if 0.0 < largest < MANY_TURNS:
        most = LIMIT_FACTOR * largest
        told = f"more than {LIMIT_FACTOR:g} times the joint's limit of {largest:g} {unit} in the URDF; needed {unit}"
        if column.startswith(MEASURED) and joint.kind != "prismatic" and most < FULL_TURN:
            # A limb that its servo cannot hold tips over: encoders may read that, commands may not contain
            # it.
            most, told = FULL_TURN, f"more than a full turn; needed {unit}"
    else:
        most, told = LARGEST_POSITION, f"needed at most {LARGEST_POSITION:g} {unit}"
    row = int(np.argmax(np.abs(positions) > min(most, MANY_TURNS)))
    got = abs(float(positions[row]))
    if got > most:
        raise SessionError(
            table.name, f"got {positions[row]:g}, {told}: are these {other}?", row=row + 1, column=column
        )
    if got > MANY_TURNS:
        return [
            f"{table.name}, row {row + 1}, column {column!r}: got {positions[row]:g} {unit}: are these {other}?"
        ]
    return []


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
        if name is None:
            continue
        if path_inside(folder, name) is None:
            raise SessionError(
                table_name, f"the picture {name} is a link that leads out of the session's folder; put the file itself there",
                row=row + 1, column="image",
            )  # fmt: skip
        if not (folder / name).is_file():
            raise SessionError(
                table_name, f"the picture {name} is missing; put it there, or leave the cell empty", row=row + 1,
                column="image",
            )  # fmt: skip
