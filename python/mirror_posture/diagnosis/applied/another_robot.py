"""Whether a user's file is of the session's robot: the joints and links at which something was found are in it."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from ...session.errors import another_robots
from .urdf import Urdf

OF = "the session's robot"
Check = Callable[[Sequence[str]], None]
"""Takes the names of a file's joints; raises `MirrorPostureError` where they are another robot's."""


def require_places(
    own: Path, urdf: Urdf, robot: Urdf, places: Sequence[str], mounts: Collection[str]
) -> None:
    """A user's URDF has the joints and links at which something was found; where nothing of it moves, any joint of the session's robot.

    `places` are those of the causes; `mounts` are the session's own links, which the file need not have.

    Raises:
        MirrorPostureError: a file without them, with what it lacks and what it has.
    """
    links = [link for link in sorted(robot.links) if f"link:{link}" in places and link not in mounts]
    wanted = _found_at(robot, places) or ([] if links else _moving(robot))
    lacks = _lacking(wanted, urdf.joints, whole=bool(_found_at(robot, places)))
    told = [f"joint {name}" for name in lacks] + [f"link {name}" for name in links if name not in urdf.links]
    if told:
        fix = "Give the file from which the session's robot.urdf was made"
        raise another_robots(own, told, OF, _moving(urdf), fix)


def require_joints(
    own: Path,
    robot: Urdf,
    places: Sequence[str],
    has: Sequence[str],
    *,
    what: str = "joint",
    whole: bool = True,
) -> None:
    """Another file of the user's has the joints at which something was found; where nothing of it moves, any joint of the session's robot.

    `has` are the names in the file, of what it calls `what`. `whole`: a file of the whole robot has all of them; one of a controller may
    be of a part of it (one of two arms), and one of them is enough.

    Raises:
        MirrorPostureError: a file without them, with what it lacks and what it has.
    """
    found = _found_at(robot, places)
    lacks = _lacking(found or _moving(robot), has, whole=whole and bool(found))
    if lacks:
        fix = f"Give the file of this robot; its {what}s need the names of the joints in the session's robot.urdf"
        raise another_robots(own, [f"{what} {name}" for name in lacks], OF, has, fix, f"{what}s")


def place_joints(place: str) -> list[str]:
    """The joints that a place names: `joint:NAME`, or two of them (`joint:A<->joint:B`)."""
    return re.findall(r"joint:([^<]+)", place)


def _moving(urdf: Urdf) -> list[str]:
    return [name for name in urdf.joints if urdf.kind(name) != "fixed"]


def _found_at(robot: Urdf, places: Sequence[str]) -> list[str]:
    """The joints of the robot that the places name."""
    return [name for name in _moving(robot) if any(name in place_joints(place) for place in places)]


def _lacking(wanted: Sequence[str], has: Collection[str], *, whole: bool) -> list[str]:
    """What is wanted and is not there; unless `whole`, nothing where a part of it is there."""
    missing = [name for name in wanted if name not in has]
    return missing if whole or len(missing) == len(wanted) else []
