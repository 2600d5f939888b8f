"""Writes the causes into the user's own URDF, from which the session's robot was made."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np

from ..._core import MirrorPostureError
from ...output_files import write_file
from ...session.errors import choices
from .urdf import Urdf
from .xml_text import read_xml

SAME = 1e-9
"""rad or m: origins that differ by more are another robot's."""


def patch_own_urdf(own: Path, before: Urdf, after: Urdf, out: Path) -> list[str]:
    """Writes a user's URDF with the origins and axes that differ between two versions of a session's robot.

    Joints are matched by name; a joint that the own file lacks (a mount of the session) is left out. Returns the names
    of the joints that were changed.

    Raises:
        MirrorPostureError: a joint whose origin is not the session's: another robot, or one corrected already.
    """
    urdf = Urdf(read_xml(own), str(own))
    changed = correct_joints(urdf, before, after, f"{own}", "another robot, or corrected already")
    write_file(out, urdf.text().encode("utf-8"))
    return changed


def correct_joints(urdf: Urdf, before: Urdf, after: Urdf, shown_as: str, why: str) -> list[str]:
    """Gives a URDF the origins and axes that differ between two versions of a session's robot; returns the
    joints changed.

    Raises:
        MirrorPostureError: a joint whose origin is not the session's; `why` gives possible reasons.
    """
    changed = []
    for name in before.joints:
        moved = not np.allclose(before.origin(name), after.origin(name), rtol=0.0, atol=SAME)
        tilted = not np.allclose(before.axis(name), after.axis(name), rtol=0.0, atol=SAME)
        if name not in urdf.joints or not (moved or tilted):
            continue
        if not np.allclose(urdf.origin(name), before.origin(name), rtol=0.0, atol=SAME):
            raise MirrorPostureError(
                f"{shown_as}: the origin of joint {name!r} is not the one of the session's robot.urdf: {why}"
            )
        if moved:
            urdf.set_origin(name, after.origin(name))
        if tilted:
            urdf.set_axis(name, after.axis(name))
        changed.append(name)
    return changed


def require_places(
    own: Path, urdf: Urdf, robot: Urdf, places: Sequence[str], mounts: Collection[str]
) -> None:
    """A user's URDF has the joints and links at which something was found; where nothing of it moves, any joint of the session's robot.

    `places` are those of the causes; `mounts` are the session's own links, which the file need not have.

    Raises:
        MirrorPostureError: a file without them, with what it lacks and what it has.
    """
    moving = [name for name in robot.joints if robot.kind(name) != "fixed"]
    joints = [name for name in moving if any(name in place_joints(place) for place in places)]
    links = [link for link in sorted(robot.links) if f"link:{link}" in places and link not in mounts]
    lacks = [f"joint {name}" for name in joints if name not in urdf.joints]
    lacks += [f"link {name}" for name in links if name not in urdf.links]
    if not (joints or links) and moving and not any(name in urdf.joints for name in moving):
        lacks = [f"joint {name}" for name in moving]
    if lacks:
        has = [name for name in urdf.joints if urdf.kind(name) != "fixed"]
        raise MirrorPostureError(
            f"{own}: has no {choices(lacks)}, of the session's robot; its joints: {choices(has)}; is it another robot's? "
            "Give the file from which the session's robot.urdf was made"
        )


def place_joints(place: str) -> list[str]:
    """The joints that a place names: `joint:NAME`, or two of them (`joint:A<->joint:B`)."""
    return re.findall(r"joint:([^<]+)", place)


def patch_text(before: str, after: str, name: str) -> str:
    """The change as a unified diff, for `patch -p1` or `git apply`."""
    lines: Sequence[str] = list(
        difflib.unified_diff(
            before.splitlines(keepends=True), after.splitlines(keepends=True), f"a/{name}", f"b/{name}"
        )
    )
    return "".join(
        line if line.endswith("\n") else line + "\n\\ No newline at end of file\n" for line in lines
    )
