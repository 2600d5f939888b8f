"""Values as commands take them: `JOINT=DEGREES` or with a unit, `NAME=FOLDER`, `NAME=VALUE`, `7x4`, `40x60`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from .._core import MirrorPostureError

if TYPE_CHECKING:
    import typer

    from ..robot import Robot

ANGLES = {"rad": 1.0, "deg": math.radians(1.0), "°": math.radians(1.0), "": math.radians(1.0)}
LENGTHS = {"mm": 0.001, "cm": 0.01, "m": 1.0}


def joint_values(given: Iterable[str], option: str, robot: Robot | None = None) -> dict[str, float]:
    """Joint name to rad or m, from texts such as `elbow=15`, `elbow=0.26rad`, `rail=12mm`, or several with
    commas between them.

    Raises `MirrorPostureError`, which names the option, what was given and what is required, for an invalid
    text, a number that is not finite, and (with a robot) a length for a revolute joint or an angle for a
    prismatic one.
    """
    kinds = {} if robot is None else {joint.name: joint.kind for joint in robot.joints}
    found: dict[str, float] = {}
    for text in given:
        for part in text.split(","):
            joint, equals, value = (piece.strip() for piece in part.partition("="))
            unit = next((u for u in ("rad", "mm", "cm", "deg", "°", "m") if value.endswith(u)), "")
            try:
                number = float(value.removesuffix(unit))
            except ValueError:
                equals = ""
            if not equals or not math.isfinite(number):
                raise MirrorPostureError(
                    f"{option}: got {part!r}, needed JOINT=DEGREES (or a unit: 0.26rad, 12mm), as in elbow=15"
                )
            if joint in kinds and (kinds[joint] == "prismatic") != (unit in LENGTHS):
                needed = (
                    "slides: needed a length, as in {}=12mm"
                    if unit in ANGLES
                    else "turns: needed an angle, as in {}=15"
                )
                raise MirrorPostureError(f"{option}: got {part!r}, and {joint} {needed.format(joint)}")
            found[joint] = number * (ANGLES | LENGTHS)[unit]
    return found


def package_folders(given: Iterable[str]) -> dict[str, Path]:
    """Folders of ROS packages by name, of texts `NAME=FOLDER`. Raises `MirrorPostureError` for a folder that is not there."""
    found = {}
    for text in given:
        name, equals, path = text.partition("=")
        if not name or not equals or not Path(path).is_dir():
            raise MirrorPostureError(f"--package: got {text!r}, needed NAME=FOLDER of a folder that is there")
        found[name] = Path(path)
    return found


def xacro_arguments(given: Iterable[str]) -> dict[str, str]:
    """Arguments of xacro by name, of texts `NAME=VALUE` or `NAME:=VALUE`. Raises `MirrorPostureError` for a text that is neither."""
    found = {}
    for text in given:
        name, equals, value = text.partition("=")
        name = name.removesuffix(":")
        if not name or not equals:
            raise MirrorPostureError(f"--xacro-arg: got {text!r}, needed NAME=VALUE, as in prefix=left_")
        found[name] = value
    return found


def required_ending(file: Path | None, option: str, endings: Iterable[str]) -> None:
    """Raises `MirrorPostureError`, which names the option, for a file of another ending: before any work is done for it."""
    if file is not None and file.suffix.lower() not in (known := list(endings)):
        raise MirrorPostureError(
            f"{option}: got {str(file)!r}, needed a file that ends with {' or '.join(known)}"
        )


def two_counts(given: str, option: str, example: str) -> tuple[int, int]:
    """Two whole numbers above 0, of a text such as `7x4`. Raises `MirrorPostureError`, which names the option, for another text."""
    try:
        first, second = (int(part) for part in given.lower().replace("×", "x").split("x"))
    except ValueError:
        first = second = 0
    if min(first, second) < 1:
        raise MirrorPostureError(f"{option}: got {given!r}, needed two whole numbers, as in {example}")
    return first, second


def mirror_size(given: str | None) -> tuple[float | None, float | None]:
    """Width and height in m, of a text in cm, `40x60`; None where nothing is given. Raises `MirrorPostureError` for another text, and for
    sizes that no mirror has."""
    from ..formats.session_keys import LARGEST_MIRROR_M, SMALLEST_MIRROR_M

    if given is None:
        return None, None
    try:
        width, height = (float(part) / 100.0 for part in given.lower().split("x"))
    except ValueError:
        width = height = math.nan
    if not (0.0 < width < math.inf and 0.0 < height < math.inf):
        raise MirrorPostureError(f"--mirror-size: got {given!r}, needed WIDTHxHEIGHT in cm, as in 40x60")
    small = min(width, height) < SMALLEST_MIRROR_M
    if small or max(width, height) >= LARGEST_MIRROR_M:
        raise MirrorPostureError(
            f"--mirror-size: got {given!r}, a mirror of {1000 * width:g} x {1000 * height:g} mm; needed WIDTHxHEIGHT in cm, each from "
            f"{100 * SMALLEST_MIRROR_M:g} to below {100 * LARGEST_MIRROR_M:g}, as in 40x60: is it in {'m' if small else 'mm'}?"
        )
    return width, height


def given_options(context: typer.Context) -> set[str]:
    """The names of a command's parameters that were given on the command line, also with their default's value."""
    sources = {name: context.get_parameter_source(name) for name in context.params}
    # By name: some releases of typer have click's classes twice.
    return {name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE"}
