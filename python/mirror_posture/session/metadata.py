"""session.toml: the session's metadata, each key checked where it is read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Floats
from ..board import CHARUCO, Board
from ..formats import Key, Section
from ..formats.session_keys import (
    BOARD,
    CAMERA_MOUNT,
    FRAMES,
    GRAVITY,
    GRAVITY_UNITS,
    GRAVITY_VECTOR,
    MARKERS,
    MIRROR,
    MOST_MARKERS,
    NOISE,
    POINTS,
    SHUTTER,
    STANDARD_GRAVITY,
    TOP,
)  # fmt: skip
from ..input_files import parse_toml, path_inside, read_text, reason
from ..marker import ColorRange, Marker
from ..mirror import Mirror
from ..short_repr import ShortRepr
from .errors import Problems, SessionError, choices
from .types import Noise

FILE = "session.toml"
RESERVED_TARGET = "board"
"""The name that detections.csv gives the board: no marker can have it."""
GRAVITY_TOLERANCE = 0.05
"""On Earth gravity differs by 0.3 %; a value that is off by more than this share is in another unit."""
LARGEST_GRAVITY = 300.0
"""m/s²: that of the sun. Beyond it a unit is wrong."""


@dataclass(frozen=True, eq=False, repr=False)
class Metadata(ShortRepr):
    """session.toml, read and checked; None where a section is absent."""

    robot: str
    root: str
    gravity_m_per_s2: Floats
    camera: str | None
    camera_link: str | None
    camera_tolerance: tuple[float | None, float | None]
    """m and rad, one standard deviation; None: not stated."""
    board: Board | None
    markers: tuple[Marker, ...]
    mirror: Mirror | None
    noise: Noise
    points_frame: str | None
    ordered: bool
    raw: Mapping[str, Any]
    warnings: tuple[str, ...] = field(default=())


def load_metadata(folder: Path) -> Metadata:
    """Reads `session.toml` of a folder; raises `SessionError` with the key, what was given and what was
    required, all problems in `problems`."""
    if not folder.is_dir():
        raise SessionError(folder, "is no folder; a session is one folder with a session.toml in it")
    file = folder / FILE
    try:
        if file.is_symlink() and path_inside(folder, FILE) is None:
            raise SessionError(
                FILE, "is a link that leads out of the session's folder; needed the file itself"
            )
        raw = parse_toml(read_text(file))
    except FileNotFoundError:
        raise SessionError(
            file, "the file is missing; a session is one folder with a session.toml in it"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise SessionError(FILE, f"cannot be read ({reason(error)}); needed a text file in UTF-8") from None
    except ValueError as error:
        raise SessionError(FILE, f"is not valid TOML: {error}") from None
    metadata = _check(raw)
    for key, name in (("robot", metadata.robot), ("camera", metadata.camera)):
        # A session is inside its folder, so that it can be passed on and reads no other files.
        if name is not None and path_inside(folder, name) is None:
            raise SessionError(
                FILE,
                f"{key}: got {name!r}, needed a path inside the session's folder, that no link leads out of",
            )
    return metadata


def _check(raw: dict[str, Any]) -> Metadata:
    """All keys, each problem kept; the dataclasses are made where there is none."""
    warnings: list[str] = []
    problems = Problems()
    # In another format the other keys have no meaning.
    for key in TOP.keys[:2]:
        _format(raw, key)
    reader = _Reader(problems, warnings)
    top = reader.section("", raw, TOP, known=("gravity",))
    gravity = _gravity(raw, reader)

    mount = reader.one(raw, CAMERA_MOUNT)
    board = reader.one(raw, BOARD)
    markers = reader.several(raw, MARKERS)
    mirror, noise = reader.one(raw, MIRROR), reader.one(raw, NOISE)
    points, frames = reader.one(raw, POINTS), reader.one(raw, FRAMES)
    # Used for a motion only.
    reader.one(raw, SHUTTER)
    camera, camera_link = top["camera"], None if mount is None else mount["link"]
    for wrong, problem in (
        (board is not None and camera is None, 'there is a [board] and no camera; add `camera = "camera.yaml"`'),
        (camera is not None and mount is None, "there is a camera and no [camera_mount]; add it with the camera's optical link"),
        (camera is None and mount is not None, 'there is a [camera_mount] and no camera; add `camera = "camera.yaml"`'),
    ):  # fmt: skip
        if wrong:
            problems.add(SessionError(FILE, problem))
    _names(markers, problems)
    if board is not None:
        _charuco(board, problems)
    problems.end()
    return Metadata(
        robot=top["robot"],
        root=top["root"],
        gravity_m_per_s2=gravity,
        camera=camera,
        camera_link=camera_link,
        camera_tolerance=(None, None) if mount is None else (mount["tolerance_m"], mount["tolerance_rad"]),
        board=None if board is None else _board(board),
        markers=tuple(map(_marker, markers)),
        mirror=None if mirror is None else _mirror(mirror),
        noise=Noise() if noise is None else Noise(noise["pixel_std"], noise["point_std"]),
        points_frame=None if points is None else points["frame"],
        ordered=True if frames is None else frames["ordered"],
        raw=raw,
        warnings=tuple(warnings),
    )


def _format(raw: Mapping[str, Any], key: Key) -> None:
    if key.name not in raw:
        raise SessionError(FILE, f"{key.name} is missing; needed {key.needed}")
    value = raw[key.name]
    if key.read(value) is None:
        more = "; this release reads no other" if key.name == "version" else ""
        raise SessionError(FILE, f"{key.name}: got {value!r}, needed {key.needed}{more}")


def _names(markers: Sequence[Mapping[str, Any]], problems: Problems) -> None:
    """Marker names are unique, and there are not too many."""
    if len(markers) > MOST_MARKERS:
        problems.add(SessionError(FILE, f"markers: got {len(markers)}, needed at most {MOST_MARKERS}"))
    for name, count in Counter(marker["name"] for marker in markers if marker["name"] is not None).items():
        if name == RESERVED_TARGET or count > 1:
            problem = "is the board's own name" if name == RESERVED_TARGET else "is given twice"
            problems.add(
                SessionError(FILE, f"markers: the name {name!r} {problem}; give every marker its own")
            )


def _charuco(board: Mapping[str, Any], problems: Problems) -> None:
    size, square = board["marker_size"], board["square"]
    if board["pattern"] == CHARUCO and (size is None or board["dictionary"] is None):
        problems.add(
            SessionError(
                FILE, "board: pattern charuco needs `marker_size` (m) and `dictionary` (OpenCV's name)"
            )
        )
    if size is not None and square is not None and size >= square:
        problems.add(
            SessionError(FILE, f"board.marker_size: got {size:g} m, needed less than the square ({square:g})")
        )


def _board(board: Mapping[str, Any]) -> Board:
    return Board(
        board["corners"][0],
        board["corners"][1],
        board["square"],
        board["pattern"],
        board["marker_size"],
        board["dictionary"],
        board["link"],
        board["tolerance_m"],
        board["tolerance_rad"],
    )


def _mirror(mirror: Mapping[str, Any]) -> Mirror:
    center = mirror["center"]
    return Mirror(
        mirror["glass_thickness"],
        mirror["refractive_index"],
        mirror["width"],
        mirror["height"],
        None if center is None else (center[0], center[1], center[2]),
    )


def _marker(marker: Mapping[str, Any]) -> Marker:
    color = marker["color"]
    return Marker(
        marker["name"],
        marker["link"],
        marker["diameter"],
        marker["mount"] == "known",
        None
        if color is None
        else ColorRange(color["hue"], color["hue_tolerance"], color["min_saturation"], color["min_value"]),
        marker["tolerance_m"],
    )


def _gravity(raw: Mapping[str, Any], reader: _Reader) -> Floats:
    """Gravity, m/s²: a list, or a section with `vector` and `unit`, which states that another length is
    meant."""
    if isinstance(raw.get("gravity"), dict):
        section = reader.section("gravity", raw["gravity"], GRAVITY)
        if None in section.values():
            return np.zeros(3)
        vector = np.array(section["vector"]) * GRAVITY_UNITS[section["unit"]]
        length = float(np.linalg.norm(vector))
        if length > LARGEST_GRAVITY:
            problem = f"gravity: got a length of {length:g} m/s², needed at most {LARGEST_GRAVITY:g}"
            reader.problems.add(SessionError(FILE, problem))
        return vector
    given = reader.value("", raw, GRAVITY_VECTOR)
    if given is None:
        return np.zeros(3)
    vector = np.array(given)
    length = float(np.linalg.norm(vector))
    if not abs(length - STANDARD_GRAVITY) <= GRAVITY_TOLERANCE * STANDARD_GRAVITY:
        problem = (
            f"gravity: got a length of {length:g}, needed about {STANDARD_GRAVITY:g} m/s²; if another unit or place is meant, "
            f"write a section [gravity] with vector and unit ({choices(GRAVITY_UNITS)})"
        )
        reader.problems.add(SessionError(FILE, problem))
    return vector


class _Reader:
    """Reads sections by the definitions of their keys; errors are collected, unknown keys are warnings."""

    def __init__(self, problems: Problems, warnings: list[str]) -> None:
        self.problems, self._warnings = problems, warnings

    def value(self, path: str, given: Mapping[str, Any], key: Key) -> Any:
        """A key's value, its default, or None where it is wrong."""
        name = f"{path}.{key.name}" if path else key.name
        if key.name not in given:
            if key.required:
                self.problems.add(SessionError(FILE, f"{name} is missing; needed {key.needed}"))
                return None
            return key.default
        value = key.read(given[key.name])
        if value is None:
            self.problems.add(SessionError(FILE, f"{name}: got {given[key.name]!r}, needed {key.needed}"))
        return value

    def section(
        self, path: str, given: Mapping[str, Any], section: Section, known: tuple[str, ...] = ()
    ) -> dict[str, Any]:
        """All keys of a section by name, and its subsections; None for invalid ones."""
        found = {key.name: self.value(path, given, key) for key in section.keys}
        inner = {} if not path else {one.name: self.one(given, one, path) for one in section.sections}
        names = {*found, *(one.name for one in section.sections), *known}
        for key in given:
            if key not in names:
                where = f"{path}.{key}" if path else key
                self._warnings.append(
                    f"{FILE}: {where} is not a key of the format and has no effect ({choices(sorted(names))})"
                )
        return found | inner

    def one(self, given: Mapping[str, Any], section: Section, path: str = "") -> dict[str, Any] | None:
        """A section that may be left out."""
        if section.name not in given:
            return None
        name = f"{path}.{section.name}" if path else section.name
        value = given[section.name]
        if not isinstance(value, dict):
            self.problems.add(SessionError(FILE, f"{name}: got {value!r}, needed a section [{name}]"))
            return None
        return self.section(name, value, section)

    def several(self, given: Mapping[str, Any], section: Section) -> list[dict[str, Any]]:
        """Sections of one name."""
        value = given.get(section.name, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            problem = f"{section.name}: got {value!r}, needed sections [[{section.name}]]"
            self.problems.add(SessionError(FILE, problem))
            return []
        return [self.section(f"{section.name}[{index}]", item, section) for index, item in enumerate(value)]
