"""Sessions as `init` makes them, made once in a process and copied: its drawing of the set-up takes the most of a small test's time."""

from __future__ import annotations

import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

from typer.testing import CliRunner

from mirror_posture import cli

_MADE: dict[tuple[str, ...], TemporaryDirectory[str]] = {}


def initialised(robot: Path, folder: Path, *words: str) -> Path:
    """`folder`, as the command `init robot folder words` makes it; the tests of `init` itself call the command."""
    which = (robot.name, robot.read_text(), folder.name, *words)
    if which not in _MADE:
        place = TemporaryDirectory()
        here = shutil.copy(robot, place.name)
        arguments = ["init", str(here), str(Path(place.name) / folder.name), *words]
        result = CliRunner().invoke(cli.app, arguments)
        assert result.exit_code == 0, f"{result.exit_code}: {result.output}\n{result.exception!r}"
        _MADE[which] = place
    shutil.copytree(Path(_MADE[which].name) / folder.name, folder)
    return folder
