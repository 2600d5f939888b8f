"""Writes the causes into the user's own URDF, from which the session's robot was made."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..._core import MirrorPostureError
from ...output_files import write_file
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
