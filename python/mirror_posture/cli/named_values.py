"""`NAME=FOLDER`, `NAME=VALUE` and `40x60` as commands take them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path


def package_folders(given: Iterable[str]) -> dict[str, Path]:
    """Folders of ROS packages by name, of texts `NAME=FOLDER`. Raises `MirrorPostureError` for a folder that is not there."""
    from .._core import MirrorPostureError

    found = {}
    for text in given:
        name, equals, path = text.partition("=")
        if not name or not equals or not Path(path).is_dir():
            raise MirrorPostureError(f"--package: got {text!r}, needed NAME=FOLDER of a folder that is there")
        found[name] = Path(path)
    return found


def xacro_arguments(given: Iterable[str]) -> dict[str, str]:
    """Arguments of xacro by name, of texts `NAME=VALUE` or `NAME:=VALUE`. Raises `MirrorPostureError` for a text that is neither."""
    from .._core import MirrorPostureError

    found = {}
    for text in given:
        name, equals, value = text.partition("=")
        name = name.removesuffix(":")
        if not name or not equals:
            raise MirrorPostureError(f"--xacro-arg: got {text!r}, needed NAME=VALUE, as in prefix=left_")
        found[name] = value
    return found


def mirror_size(given: str | None) -> tuple[float | None, float | None]:
    """Width and height in m, of a text in cm, `40x60`; None where nothing is given. Raises `MirrorPostureError` for another text."""
    from .._core import MirrorPostureError

    if given is None:
        return None, None
    try:
        width, height = (float(part) / 100.0 for part in given.lower().split("x"))
    except ValueError:
        width = height = math.nan
    if not (0.0 < width < math.inf and 0.0 < height < math.inf):
        raise MirrorPostureError(f"--mirror-size: got {given!r}, needed WIDTHxHEIGHT in cm, as in 40x60")
    return width, height
