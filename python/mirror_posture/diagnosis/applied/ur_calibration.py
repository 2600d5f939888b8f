"""Writes the joints' origins into a Universal Robots calibration file (`ur_calibration`,
`default_kinematics.yaml`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ..._core import MirrorPostureError
from ...formats.keys import finite
from ...input_files import given_text, parse_yaml
from ...output_files import write_file
from ...rotations import nearest_rpy, rotation_of_rpy
from .urdf import Urdf

JOINTS = {
    "shoulder": "shoulder_pan_joint",
    "upper_arm": "shoulder_lift_joint",
    "forearm": "elbow_joint",
    "wrist_1": "wrist_1_joint",
    "wrist_2": "wrist_2_joint",
    "wrist_3": "wrist_3_joint",
}
"""Sections of the file, and the joint whose origin each tells (the URDF's name may have a prefix)."""
KEYS = ("x", "y", "z", "roll", "pitch", "yaw")
SAME_M, SAME_TURN = 1e-5, 1e-5
"""A file that lies farther from the session's URDF is another robot's."""
UNCHANGED = 1e-9


def patch_ur_calibration(own: Path, before: Urdf, after: Urdf, out: Path) -> tuple[str, ...]:
    """Writes a calibration file whose joints' origins are those of the corrected robot; returns what was written.

    The numbers that change are changed in the file's text; all else stays. `ur_description` builds its URDF from them.

    Raises:
        MirrorPostureError: no such file, not one of Universal Robots', or another robot's than the session's.
    """
    text = given_text(own, "a Universal Robots calibration file")
    try:
        tree = parse_yaml(text, "a Universal Robots calibration")
    except ValueError as error:
        raise MirrorPostureError(f"{own}: {error}") from None
    sections = tree.get("kinematics") if isinstance(tree, dict) else None
    if not isinstance(sections, dict) or not set(JOINTS) <= set(sections):
        raise MirrorPostureError(
            f"{own}: is no calibration of Universal Robots: needed `kinematics:` with {', '.join(JOINTS)}"
        )
    places = _places(text)
    changes: list[tuple[int, int, str]] = []
    told = []
    for section, suffix in JOINTS.items():
        name = next((joint for joint in before.joints if joint.endswith(suffix)), None)
        if name is None:
            raise MirrorPostureError(
                f"{own}: the session's robot has no joint {suffix}; is it a Universal Robots arm?"
            )
        values = [sections[section].get(key) if isinstance(sections[section], dict) else None for key in KEYS]
        if any(finite(value) is None for value in values):
            raise MirrorPostureError(f"{own}, {section}: needed numbers {', '.join(KEYS)}")
        numbers = np.array(values, dtype=float)
        pose = before.origin(name)
        away = np.abs(rotation_of_rpy(numbers[3:]) - pose[:3, :3]).max()
        if np.abs(numbers[:3] - pose[:3, 3]).max() > SAME_M or away > SAME_TURN:
            raise MirrorPostureError(
                f"{own}, {section}: is not the origin of {name} in the session's URDF; give the file of this robot, as it was"
            )
        new = after.origin(name)
        wanted = np.concatenate([new[:3, 3], nearest_rpy(new[:3, :3], numbers[3:])])
        if np.allclose(new, pose, atol=UNCHANGED):
            continue
        for key, old, value in zip(KEYS, numbers, wanted, strict=True):
            if abs(value - old) > UNCHANGED:
                start, end = places[section, key]
                changes.append((start, end, f"{float(value) + 0.0:.12g}"))
        told.append(f"{section}: origin of {name}")
    for start, end, new_text in sorted(changes, reverse=True):
        text = text[:start] + new_text + text[end:]
    write_file(out, text.encode("utf-8"))
    return tuple(told)


def _places(text: str) -> dict[tuple[str, str], tuple[int, int]]:
    """Where each number of `kinematics` stands in the text."""
    found: dict[tuple[str, str], tuple[int, int]] = {}

    def entries(node: Any) -> list[tuple[str, Any]]:
        return [(key.value, value) for key, value in node.value] if isinstance(node, yaml.MappingNode) else []

    for top, sections in entries(yaml.compose(text, Loader=yaml.SafeLoader)):
        for section, numbers in entries(sections) if top == "kinematics" else ():
            for key, node in entries(numbers):
                found[section, key] = (node.start_mark.index, node.end_mark.index)
    return found
