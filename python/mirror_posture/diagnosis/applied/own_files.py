"""Writes the causes into copies of the user's own files, each with its patch."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..._core import MirrorPostureError
from ...output_files import write_file
from ...session import Session
from ..result import Diagnosis
from .another_robot import require_joints, require_places
from .apply import ROBOT, parts_of, together
from .lerobot import patch_lerobot
from .own_mjcf import patch_own_mjcf
from .own_urdf import patch_own_urdf, patch_text
from .own_xacro import patch_own_xacro
from .ros2_control import patch_ros2_control
from .ur_calibration import patch_ur_calibration
from .urdf import Urdf
from .xacro_tree import XacroTree, is_xacro
from .xml_text import XmlText, read_xml

_JOINT = re.compile(r"(?:joint[: ]|origin of )([^:\s]+)")
"""In a line that tells what was written."""


@dataclass(frozen=True)
class OwnFile:
    """A user's file: its corrected copy, its patch, and the result for the causes that concern it."""

    file: Path
    patch: Path
    told: tuple[str, ...]
    moves_robot: bool = False
    """True: the robot's controller reads it; False: a model of the robot, or a simulator."""


def write_own_files(
    session: Session,
    found: Diagnosis,
    folder: Path,
    *,
    urdf: Path | None = None,
    mjcf: Path | None = None,
    lerobot: Path | None = None,
    ur: Path | None = None,
    ros2_control: Path | None = None,
    motors: str = "feetech",
    xacro_arguments: Mapping[str, str] | None = None,
    packages: Mapping[str, Path] | None = None,
) -> tuple[OwnFile, ...]:
    """Writes corrected copies of a user's files into the folder that `apply_diagnosis` writes (its `also`), and a patch for each.

    The user's files themselves stay as they are. `git apply` or `patch` in their own folder makes the change there. `urdf` may be
    xacro: of the files that it includes those are written in which something changes.

    Raises:
        MirrorPostureError: a file that is missing or another robot's; two files of one name.
    """
    causes = together(part for cause in found.causes for part in parts_of(cause))
    places = [cause.at for cause in causes]
    robot = Urdf(read_xml(session.robot_file))
    better = Urdf(read_xml(folder / ROBOT))
    sliding = {joint.name for joint in session.robot.joints if joint.kind == "prismatic"}
    files = _Files(folder)
    for own in (urdf, mjcf, lerobot, ur, ros2_control):
        if own is None:
            continue
        if not own.is_file():
            raise MirrorPostureError(f"{own}: there is no such file; needed your own file of the robot")
        tree = None
        if own is urdf:
            text = read_xml(own)
            tree = XacroTree(own, xacro_arguments, packages) if is_xacro(text) else None
            if (root := XmlText(text, str(own)).root.tag) != "robot":
                raise MirrorPostureError(
                    f"{own}: got <{root}>, needed a URDF or xacro (<robot>); an MJCF is given as --mjcf"
                )
            shown = Urdf(text if tree is None else tree.expand({}), str(own))
            require_places(own, shown, robot, places, _mounts(session))
        if tree is not None:
            patched = patch_own_xacro(tree, robot, better)
            for file, text in (patched.texts or {own: read_xml(own)}).items():
                out = files.place_of(file)
                write_file(out, text.encode("utf-8"))
                files.add(file, out, patched.told)
            continue
        out = files.place_of(own)
        check = partial(require_joints, own, robot, places)
        if own is urdf:
            told = tuple(f"joint {name}" for name in patch_own_urdf(own, robot, better, out))
        elif own is mjcf:
            told = _lines(patch_own_mjcf(own, causes, out, check))
        elif own is ur:
            told = patch_ur_calibration(own, robot, better, out)
        elif own is ros2_control:
            told = _lines(patch_ros2_control(own, causes, out, partial(check, whole=False), sliding))
        else:
            check = partial(check, what="motor", whole=False)
            told = _lines(patch_lerobot(own, causes, out, motors, check, sliding))
        files.add(own, out, told, moves_robot=own in (lerobot, ros2_control))
    return tuple(files.written)


class _Files:
    """What is written, each under a name of its own."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._taken = {path.name for path in folder.iterdir()}
        self.written: list[OwnFile] = []

    def place_of(self, own: Path) -> Path:
        """Where the copy goes: a session keeps its own robot.urdf under that name."""
        out = self._folder / (own.name if own.name not in self._taken else f"own-{own.name}")
        if out.exists():
            raise MirrorPostureError(f"{out}: is there already; rename {own}")
        return out

    def add(self, own: Path, out: Path, told: tuple[str, ...], *, moves_robot: bool = False) -> None:
        """Writes the patch of a copy."""
        patch = self._folder / f"{out.name}.patch"
        before, after = (path.read_bytes().decode("utf-8") for path in (own, out))
        write_file(patch, patch_text(before, after, own.name).encode("utf-8"))
        self.written.append(OwnFile(out, patch, told, moves_robot))


def twice_told(written: Sequence[OwnFile]) -> list[str]:
    """`JOINT: MODEL and CONTROLLER`: joints that a model's file and the controller's both correct. Used together they would count twice."""
    files: dict[bool, dict[str, str]] = {False: {}, True: {}}
    for own in written:
        for line in own.told:
            found = None if "not written" in line else _JOINT.search(line)
            if found:
                files[own.moves_robot].setdefault(found[1], own.file.name)
    return [
        f"{joint}: {files[False][joint]} and {files[True][joint]}"
        for joint in files[False]
        if joint in files[True]
    ]


def _mounts(session: Session) -> set[str]:
    """The links that hold the session's camera, board and markers: `init` adds them to the robot's own."""
    mounts = {marker.link for marker in session.markers}
    return mounts | {link for link in (session.camera_link, session.board and session.board.link) if link}


def _lines(told: dict[tuple[str, str], str]) -> tuple[str, ...]:
    return tuple(f"{effect} at {place}: {what}" for (effect, place), what in told.items())
