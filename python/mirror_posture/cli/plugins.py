"""Commands, robots and the diagnosis of motions, which other distributions add by entry points."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points

COMMAND_GROUP = "mirror_posture.commands"
"""Entry points of this group are modules like those of `cli.commands`; the name is the command's."""
MOTION_GROUP = "mirror_posture.motion"
"""An entry point of this group diagnoses a session in motion: `(session, *, model, check, most_causes)` to a `Diagnosis` and a function that
writes its page into a folder."""
EXTRAS = {"simulate": "mujoco", "blind": "lab", "moving": "lab", "reproduce": "lab"}
"""The extra of mirror-posture that installs a command of this project's other distributions."""


def plugins(group: str) -> dict[str, EntryPoint]:
    """The entry points of a group by name; of two with one name the first on the path."""
    found: dict[str, EntryPoint] = {}
    for point in entry_points(group=group):
        found.setdefault(point.name, point)
    return found
