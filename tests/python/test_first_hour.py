"""docs/first-hour.md prints the commands that the stranger's hour runs: what they say is compared by hand (`hour_in_document.py`)."""

from __future__ import annotations

import shlex

import pytest

pytest.importorskip("mujoco")

from hour_in_document import DOCUMENT, SECTIONS, differences, printed, quoted, section_of
from strangers_hour import BODIES


@pytest.mark.parametrize(("name", "way"), SECTIONS)
def test_the_page_prints_the_commands_of_the_hour(name: str, way: str) -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    begin, end = section_of(text, SECTIONS[name, way])
    by_command = {shlex.split(line)[1]: shlex.split(line)[2:] for line in printed(text[begin:end])}
    assert len(by_command) <= 15
    if way == "folder":
        assert list(by_command) == ["board", "init", "plan", "capture", "check", "diagnose", "apply"]
        assert by_command["init"][2:] == BODIES[name].words and by_command["plan"] == [
            "session",
            *BODIES[name].plan,
        ]
    else:
        assert list(by_command) == ["import", "diagnose", "apply"]
    assert by_command["diagnose"] == ["session", "--out", "diagnosis"]


def test_a_changed_output_would_be_seen() -> None:
    line = "mirror-posture capture session --source pictures"
    output = "frame 0: board\nframe 1: board\nall postures of the plan are taken\n"
    transcript = f"```\n$ {line} --package a=b\n{output}```\n"
    section = f"```console\n$ {line}\n{quoted(line, output)}```\n"
    assert differences(section, transcript) == []
    assert differences(section.replace("all", "some"), transcript) == [f"printed otherwise: {line}"]
    assert differences("", transcript) == [f"not printed: {line}"]
