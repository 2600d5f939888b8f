"""The names that a session may use of its robot: links, movable joints and their limits, from the URDF."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

from .errors import SessionError

MOVABLE = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class RobotNames:
    """What the tables are checked against."""

    links: tuple[str, ...]
    joints: tuple[str, ...]
    """Joints that can be commanded."""
    fixed_joints: tuple[str, ...]
    largest_command: dict[str, float]
    """By joint, the larger of its limits' magnitudes, rad or m; joints without limits have no entry."""


def load_robot_names(file: Path, shown_as: str) -> RobotNames:
    """Reads the names of a URDF; the core checks the rest of it when it builds the robot."""
    try:
        tree = ElementTree.parse(file).getroot()
    except FileNotFoundError:
        raise SessionError(shown_as, "the file is missing; save the robot's nominal URDF there") from None
    except (ElementTree.ParseError, OSError, ValueError, LookupError) as error:
        raise SessionError(shown_as, f"is no URDF: {error}") from None
    if tree.tag != "robot":
        raise SessionError(shown_as, f"is no URDF: got <{tree.tag}> at the top, needed <robot>")
    links = tuple(link.get("name", "") for link in tree.findall("link"))
    joints, fixed, largest = [], [], {}
    for joint in tree.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type", "")
        if kind not in MOVABLE:
            fixed.append(name)
            continue
        joints.append(name)
        limit = joint.find("limit")
        if kind == "continuous" or limit is None:
            continue
        try:
            bounds = [abs(float(limit.get(end, "0"))) for end in ("lower", "upper")]
        except ValueError:
            raise SessionError(shown_as, f"joint {name!r}: its <limit> is not a number") from None
        if math.isfinite(max(bounds)) and max(bounds) > 0.0:
            largest[name] = max(bounds)
    return RobotNames(links, tuple(joints), tuple(fixed), largest)
