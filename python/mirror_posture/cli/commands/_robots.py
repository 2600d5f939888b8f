"""Robots by name, as the command line opens them."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

from ..._core import MirrorPostureError
from ...input_files import given_text, parse_toml
from ...robots import CommandedRobot, Nominal
from ...session.tables import LARGEST_NUMBER
from ..plugins import plugins

ROBOT_GROUP = "mirror_posture.robots"
"""Entry points of this group open robots by name: called with the settings, the nominal session, and what talks to the user."""
SIMULATED = ("twin", "mujoco")
"""Robots of the distribution mirror-posture-lab."""
SERVOS = {"dynamixel": "DynamixelRobot", "feetech": "FeetechRobot"}
"""Makes of servos: a module of `robots` each, and its robot."""
NAMES = (*SIMULATED, "by-hand", *SERVOS)
OWN = "own"
"""A robot of somebody's own class."""
OF_ROBOTS = {
    "inbox": ("by-hand",),
    "servos": tuple(SERVOS),
    "camera": tuple(SERVOS),
    "robot_class": (OWN,),
    "pictures": SIMULATED,
    "noise_px": SIMULATED,
    "stand_error_deg": SIMULATED,
    "seed": SIMULATED,
    "meshes": SIMULATED[:1],
}
"""Options that only these robots have; `hide` is told apart by `open_robot`, because further simulated robots can be installed."""


def refuse_others_options(robot: str | None, given: Collection[str]) -> None:
    """Raises `MirrorPostureError` for an option (by its parameter's name) that was given and that this robot would pass over.

    `robot` is None where nobody but a person moves one. Robots of other distributions have options of their own: they are not judged.
    """
    if robot is not None and robot not in (*NAMES, OWN):
        return
    for option in OF_ROBOTS:
        if option in given and robot not in OF_ROBOTS[option]:
            raise MirrorPostureError(
                f"--{option.replace('_', '-')}: got {'no robot' if robot is None else robot}, needed {' or '.join(OF_ROBOTS[option])}, which alone has "
                "this option; leave it out, or name that robot"
            )


def open_robot(settings: Mapping[str, Any], nominal: Nominal, say: Callable[[str], object]) -> CommandedRobot:
    """The robot that the settings of `correct` name.

    Raises `MirrorPostureError` for an unknown name, a class that cannot be loaded, an extra that is not installed.
    """
    own = settings.get("robot_class")
    if own:
        return _own(str(own), nominal)
    name = settings["robot"]
    joined = plugins(ROBOT_GROUP)
    if settings["hide"] and name not in joined:
        raise MirrorPostureError(
            f"--hide: only simulated robots ({', '.join(SIMULATED)}) can hide something, not {name}"
        )
    if name in joined:
        return joined[name].load()(settings, nominal, say)  # type: ignore[no-any-return]
    if name in SIMULATED:
        raise MirrorPostureError(
            f"{name}: simulated robots are not installed; pip install 'mirror-posture[lab]'"
        )
    if name == "by-hand":
        from ...robots.by_hand import ByHandRobot

        folder = settings.get("inbox")
        if not folder:
            raise MirrorPostureError("by-hand: needs --inbox FOLDER, where the pictures will be saved")
        return ByHandRobot(nominal, folder, say=say)
    if name in SERVOS:
        try:
            made = getattr(importlib.import_module(f"...robots.{name}", __package__), SERVOS[name])
        except ImportError:
            raise MirrorPostureError(
                f"the servos' SDK is not installed; pip install 'mirror-posture[{name}]'"
            ) from None

        if not settings.get("servos"):
            raise MirrorPostureError(
                f"{name}: needs --servos FILE (TOML), which says which servo is which joint"
            )
        eye = settings.get("eye") or camera_eye(settings["camera"], nominal)
        robot = made(nominal, settings["servos"], eye)
        return robot  # type: ignore[no-any-return]
    raise MirrorPostureError(
        f"robot: got {name!r}, needed one of {', '.join(NAMES)}, or --robot-class MODULE:CLASS"
    )


def _own(name: str, nominal: Nominal) -> CommandedRobot:
    module, colon, kind = name.partition(":")
    try:
        made = getattr(importlib.import_module(module), kind) if colon else None
    except (ImportError, AttributeError) as error:
        raise MirrorPostureError(f"--robot-class {name}: {error}") from None
    if made is None:
        raise MirrorPostureError(f"--robot-class: got {name!r}, needed MODULE:CLASS, as in my_robot:MyRobot")
    try:
        robot = made(nominal)
    except TypeError as error:
        raise MirrorPostureError(
            f"--robot-class {name}: is called with the nominal session and nothing else ({error})"
        ) from None
    missing = [part for part in ("command", "look", "rest", "close", "nominal") if not hasattr(robot, part)]
    if missing:
        raise MirrorPostureError(
            f"--robot-class {name}: lacks {', '.join(missing)}; derive it from mirror_posture.robots.RobotBase"
        )
    return robot  # type: ignore[no-any-return]


def camera_eye(index: int, nominal: Nominal) -> Callable[[], Any]:
    """A camera of this machine as an eye: one fresh picture a call, BGR.

    Raises `MirrorPostureError` where it cannot be opened.
    """
    from ...capture.sources import CameraSource, drop_stale
    from ...robots import NoLookError

    source = CameraSource(index, nominal.camera, "--camera")

    def eye() -> Any:
        try:
            # What the driver has buffered was taken before the robot stood still.
            drop_stale(source)
            return source.read().picture
        except MirrorPostureError as error:
            raise NoLookError(str(error)) from None

    return eye


def read_posture(file: Path) -> dict[str, float]:
    """A target posture from a file: TOML or JSON with `joint = position`, rad (m for a prismatic joint).

    Raises `MirrorPostureError` for a file that is neither.
    """
    import json

    needed = "`joint = position` in rad, TOML or JSON"
    text = given_text(file, needed)
    try:
        tree = json.loads(text) if file.suffix == ".json" else parse_toml(text)
    except (ValueError, RecursionError, OverflowError) as error:
        raise MirrorPostureError(
            f"{file}: cannot be read ({' '.join(str(error).split())}); needed {needed}"
        ) from None
    tree = tree.get("joints", tree) if isinstance(tree, dict) else None
    if not isinstance(tree, dict):
        raise MirrorPostureError(f"{file}: got no keys; needed {needed}")
    bad = [
        name
        for name, value in tree.items()
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < LARGEST_NUMBER
    ]
    if bad or not tree:
        raise MirrorPostureError(
            f"{file}: {f'joint {bad[0]!r}' if bad else 'no joint'}: needed `joint = position`, rad (m)"
        )
    return {str(name): float(value) for name, value in tree.items()}
