"""Commands and robots that other distributions add by entry points."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points

COMMAND_GROUP = "mirror_posture.commands"
"""Entry points of this group are modules like those of `cli.commands`; the name is the command's."""


def plugins(group: str) -> dict[str, EntryPoint]:
    """The entry points of a group by name; of two with one name the first on the path."""
    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=group):
        found.setdefault(point.name, point)
    return found
