"""session.toml: the session's metadata, each key checked where it is read."""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..board import CHESSBOARD, PATTERNS, Board
from ..input_files import path_inside, read_text, reason
from ..marker import ColorRange, Marker
from ..mirror import FLOAT_GLASS_INDEX, Mirror
from ..short_repr import ShortRepr
from .errors import SessionError, choices
from .types import Floats, Noise

if sys.version_info >= (3, 11):
    import tomllib
else:  # pragma: no cover
    import tomli as tomllib

FILE = "session.toml"
FORMAT = "mirror-posture/session"
VERSION = 1
MOUNTS = ("known", "unknown")
RESERVED_TARGET = "board"
"""The name that detections.csv gives the board: no marker can have it."""

MOST_MARKERS = 1000
STANDARD_GRAVITY = 9.80665
GRAVITY_TOLERANCE = 0.05
"""On Earth gravity differs by 0.3 %; what is off by more than this share is in another unit."""
GRAVITY_UNITS = {"m/s^2": 1.0, "cm/s^2": 1e-2, "mm/s^2": 1e-3, "g": STANDARD_GRAVITY}
LARGEST_GRAVITY = 300.0
"""m/s²: that of the sun. Beyond it a unit is wrong."""
LARGEST_SQUARE_M, LARGEST_MARKER_M, THICKEST_GLASS_M = 0.5, 0.5, 0.05
"""Beyond these a length is in mm."""
LARGEST_INDEX = 3.0
"""Diamond has 2.4."""
LARGEST_PIXEL_STD, LARGEST_POINT_STD_M, LARGEST_TOLERANCE_M = 20.0, 0.05, 0.5
"""Beyond these a measurement would hide whatever is wrong with a robot: the unit is another."""

_MISSING = object()


@dataclass(frozen=True, eq=False, repr=False)
class Metadata(ShortRepr):
    """session.toml, read and checked; None where a section is absent."""

    robot: str
    root: str
    gravity_m_per_s2: Floats
    camera: str | None
    camera_link: str | None
    camera_tolerance: tuple[float | None, float | None]
    """m and rad, one standard deviation; None: not said."""
    board: Board | None
    markers: tuple[Marker, ...]
    mirror: Mirror | None
    noise: Noise
    points_frame: str | None
    ordered: bool
    raw: Mapping[str, Any]
    warnings: tuple[str, ...] = field(default=())


def load_metadata(folder: Path) -> Metadata:
    """Reads `session.toml` of a folder; raises `SessionError` with the key, what was got and what was needed."""
    file = folder / FILE
    try:
        if file.is_symlink() and path_inside(folder, FILE) is None:
            raise SessionError(
                FILE, "is a link that leads out of the session's folder; needed the file itself"
            )
        raw = tomllib.loads(read_text(file))
    except FileNotFoundError:
        raise SessionError(
            file, "the file is missing; a session is one folder with a session.toml in it"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise SessionError(FILE, f"cannot be read ({reason(error)}); needed a text file in UTF-8") from None
    # A very deep or odd document can fail below the parser with errors of Python's own.
    except (tomllib.TOMLDecodeError, ValueError, RecursionError) as error:
        raise SessionError(FILE, f"is not valid TOML: {error}") from None
    metadata = _check(raw)
    for key, name in (("robot", metadata.robot), ("camera", metadata.camera)):
        # A session lies in its folder, so that it can be passed on, and reads nobody else's files.
        if name is not None and path_inside(folder, name) is None:
            raise SessionError(
                FILE,
                f"{key}: got {name!r}, needed a path inside the session's folder, that no link leads out of",
            )
    return metadata


def _check(raw: dict[str, Any]) -> Metadata:
    warnings: list[str] = []
    top = _Section("", raw, warnings)
    kind = top.text("format")
    if kind != FORMAT:
        raise SessionError(FILE, f"format: got {kind!r}, needed {FORMAT!r}")
    version = top.whole("version")
    if version != VERSION:
        raise SessionError(FILE, f"version: got {version}, needed {VERSION}; this release reads no other")
    robot, root = top.text("robot"), top.text("root")
    gravity = _gravity(raw, top)
    camera = top.text("camera", None)

    mount = top.section("camera_mount")
    camera_link = mount.text("link") if mount else None
    camera_tolerance = _tolerances(mount) if mount else (None, None)
    board = _board(top.section("board"))
    markers = tuple(_marker(section) for section in top.sections("markers"))
    if len(markers) > MOST_MARKERS:
        raise SessionError(FILE, f"markers: got {len(markers)}, needed at most {MOST_MARKERS}")
    names = Counter(marker.name for marker in markers)
    for name, count in names.items():
        if name == RESERVED_TARGET or count > 1:
            problem = "is the board's own name" if name == RESERVED_TARGET else "is given twice"
            raise SessionError(FILE, f"markers: the name {name!r} {problem}; give every marker its own")
    mirror_section = top.section("mirror")
    mirror = None
    if mirror_section:
        mirror = Mirror(
            mirror_section.number("glass_thickness", 0.0, at_least=0.0, below=THICKEST_GLASS_M),
            mirror_section.number("refractive_index", FLOAT_GLASS_INDEX, at_least=1.0, below=LARGEST_INDEX),
        )
    noise_section = top.section("noise")
    noise = Noise()
    if noise_section:
        noise = Noise(
            noise_section.number("pixel_std", None, above=0.0, below=LARGEST_PIXEL_STD),
            noise_section.number("point_std", None, above=0.0, below=LARGEST_POINT_STD_M),
        )
    points = top.section("points")
    points_frame = points.text("frame") if points else None
    frames = top.section("frames")
    ordered = frames.flag("ordered", True) if frames else True
    for section in (mount, mirror_section, noise_section, points, frames):
        if section:
            section.close()
    top.close()
    if board is not None and camera is None:
        raise SessionError(FILE, 'there is a [board] and no camera; add `camera = "camera.yaml"`')
    if camera is not None and camera_link is None:
        raise SessionError(
            FILE, "there is a camera and no [camera_mount]; add it with the camera's optical link"
        )
    if camera is None and camera_link is not None:
        raise SessionError(FILE, 'there is a [camera_mount] and no camera; add `camera = "camera.yaml"`')
    return Metadata(
        robot, root, gravity, camera, camera_link, camera_tolerance, board, markers, mirror, noise, points_frame, ordered, raw,
        tuple(warnings),
    )  # fmt: skip


def _board(section: _Section | None) -> Board | None:
    if section is None:
        return None
    corners = section.wholes("corners", 2)
    if min(corners) < 2:
        raise SessionError(
            FILE, f"board.corners: got {corners}, needed at least 2 inner corners along x and y"
        )
    pattern = section.text("pattern", CHESSBOARD, one_of=PATTERNS)
    marker_size = section.number("marker_size", None, above=0.0)
    dictionary = section.text("dictionary", None)
    if pattern == "charuco" and (marker_size is None or dictionary is None):
        raise SessionError(
            FILE, "board: pattern charuco needs `marker_size` (m) and `dictionary` (OpenCV's name)"
        )
    square = section.number("square", above=0.0, below=LARGEST_SQUARE_M)
    if marker_size is not None and marker_size >= square:
        raise SessionError(
            FILE, f"board.marker_size: got {marker_size:g} m, needed less than the square ({square:g})"
        )
    board = Board(
        corners[0],
        corners[1],
        square,
        pattern,
        marker_size,
        dictionary,
        section.text("link"),
        *_tolerances(section),
    )
    section.close()
    return board


def _marker(section: _Section) -> Marker:
    color_section = section.section("color")
    color = None
    if color_section:
        color = ColorRange(
            color_section.number("hue", at_least=0.0, below=360.0),
            color_section.number("hue_tolerance", above=0.0, below=180.0),
            color_section.number("min_saturation", 0.0, at_least=0.0, below=1.0),
            color_section.number("min_value", 0.0, at_least=0.0, below=1.0),
        )
        color_section.close()
    marker = Marker(
        section.text("name"),
        section.text("link"),
        section.number("diameter", 0.0, at_least=0.0, below=LARGEST_MARKER_M),
        section.text("mount", "known", one_of=MOUNTS) == "known",
        color,
        section.number("tolerance_m", None, at_least=0.0, below=LARGEST_TOLERANCE_M),
    )
    section.close()
    return marker


def _tolerances(section: _Section) -> tuple[float | None, float | None]:
    """One standard deviation by which the real place may differ from the URDF's, m and rad; None where not said."""
    return (
        section.number("tolerance_m", None, at_least=0.0, below=LARGEST_TOLERANCE_M),
        section.number("tolerance_rad", None, at_least=0.0, below=math.pi),
    )


def _gravity(raw: dict[str, Any], top: _Section) -> Floats:
    """Gravity, m/s²: a list, or a section with `vector` and `unit`, which says that another length is meant."""
    section = top.section("gravity") if isinstance(raw.get("gravity"), dict) else None
    if section is not None:
        vector = (
            np.array(section.numbers("vector", 3))
            * GRAVITY_UNITS[section.text("unit", one_of=tuple(GRAVITY_UNITS))]
        )
        section.close()
        length = float(np.linalg.norm(vector))
        if length > LARGEST_GRAVITY:
            raise SessionError(
                FILE, f"gravity: got a length of {length:g} m/s², needed at most {LARGEST_GRAVITY:g}"
            )
        return vector
    vector = np.array(top.numbers("gravity", 3))
    length = float(np.linalg.norm(vector))
    if abs(length - STANDARD_GRAVITY) > GRAVITY_TOLERANCE * STANDARD_GRAVITY:
        raise SessionError(
            FILE,
            f"gravity: got a length of {length:g}, needed about {STANDARD_GRAVITY:g} m/s²; if another unit or place is meant, "
            f"write a section [gravity] with vector and unit ({choices(GRAVITY_UNITS)})",
        )
    return vector


class _Section:
    """One table of session.toml: reads keys with their type and range, and reports the keys nobody asked for."""

    def __init__(self, path: str, keys: dict[str, Any], warnings: list[str]) -> None:
        self._path, self._keys, self._warnings = path, keys, warnings
        self._asked: set[str] = set()

    def _name(self, key: str) -> str:
        return f"{self._path}.{key}" if self._path else key

    def _fail(self, key: str, value: Any, needed: str) -> SessionError:
        return SessionError(FILE, f"{self._name(key)}: got {value!r}, needed {needed}")

    def _get(self, key: str, default: Any, needed: str) -> Any:
        self._asked.add(key)
        if key in self._keys:
            return self._keys[key]
        if default is _MISSING:
            raise SessionError(FILE, f"{self._name(key)} is missing; needed {needed}")
        return default

    def text(self, key: str, default: Any = _MISSING, one_of: tuple[str, ...] = ()) -> Any:
        needed = f"one of {choices(one_of)}" if one_of else "a name (text)"
        value = self._get(key, default, needed)
        if value is default and key not in self._keys:
            return value
        if not isinstance(value, str) or not value.strip() or (one_of and value not in one_of):
            raise self._fail(key, value, needed)
        return value

    def flag(self, key: str, default: bool) -> bool:
        value = self._get(key, default, "true or false")
        if not isinstance(value, bool):
            raise self._fail(key, value, "true or false")
        return value

    def whole(self, key: str) -> int:
        value = self._get(key, _MISSING, "a whole number")
        if isinstance(value, bool) or not isinstance(value, int):
            raise self._fail(key, value, "a whole number")
        return value

    def wholes(self, key: str, count: int) -> list[int]:
        needed = f"a list of {count} whole numbers"
        value = self._get(key, _MISSING, needed)
        if not isinstance(value, list) or len(value) != count:
            raise self._fail(key, value, needed)
        # Larger boards are typing errors, which would ask for all memory.
        if any(isinstance(item, bool) or not isinstance(item, int) or not 0 < item <= 100 for item in value):
            raise self._fail(key, value, needed + " from 1 to 100")
        return value

    def number(
        self,
        key: str,
        default: Any = _MISSING,
        *,
        at_least: float = -math.inf,
        above: float = -math.inf,
        below: float = math.inf,
    ) -> Any:
        bounds = [
            text
            for text, given in (
                (f"at least {at_least:g}", at_least > -math.inf),
                (f"above {above:g}", above > -math.inf),
                (f"below {below:g}", below < math.inf),
            )
            if given
        ]
        needed = " ".join(["a finite number", " and ".join(bounds)]).strip()
        value = self._get(key, default, needed)
        if key not in self._keys:
            return value
        number = _number(value)
        if number is None or number < at_least or number <= above or number >= below:
            raise self._fail(key, value, needed)
        return number

    def numbers(self, key: str, count: int) -> list[float]:
        needed = f"a list of {count} finite numbers"
        value = self._get(key, _MISSING, needed)
        found = [_number(item) for item in value] if isinstance(value, list) else []
        if len(found) != count or any(item is None for item in found):
            raise self._fail(key, value, needed)
        return [item for item in found if item is not None]

    def section(self, key: str) -> _Section | None:
        value = self._get(key, None, "a section")
        if value is None:
            return None
        if not isinstance(value, dict):
            raise self._fail(key, value, f"a section [{self._name(key)}]")
        return _Section(self._name(key), value, self._warnings)

    def sections(self, key: str) -> list[_Section]:
        value = self._get(key, [], "sections")
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self._fail(key, value, f"sections [[{self._name(key)}]]")
        return [_Section(f"{key}[{index}]", item, self._warnings) for index, item in enumerate(value)]

    def close(self) -> None:
        """Warns of every key that the format does not know: it is kept, and has no effect."""
        for key in self._keys:
            if key not in self._asked:
                known = choices(sorted(self._asked))
                self._warnings.append(
                    f"{FILE}: {self._name(key)} is not a key of the format and has no effect ({known})"
                )


def _number(value: Any) -> float | None:
    """A TOML number as a finite double, or None."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
