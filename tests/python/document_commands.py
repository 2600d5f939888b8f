"""What README and docs/ print: their code blocks, the commands in them, and how each command is proved."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
DOCUMENTS = [
    PROJECT / "README.md",
    PROJECT / "CONTRIBUTING.md",
    *sorted(file for file in (PROJECT / "docs").rglob("*.md") if "reference" not in file.relative_to(PROJECT).parts[1:2]),
]  # fmt: skip
ANYTHING = "…"
"""In a printed output: what varies from machine to machine, within a line; alone in its line: any lines."""
ABOUT = "≈"
"""Before a number that varies from machine to machine, by at most this share:"""
VARIES = 0.1
PROGRAM = "mirror-posture"


@dataclass(frozen=True)
class Printed:
    """A command as a document prints it, and the output under it (None where it prints none)."""

    document: str
    words: str
    output: str | None = None


def blocks(text: str) -> list[tuple[str, str]]:
    """Language and text of each fenced block."""
    return re.findall(r"^```(\w*)\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def commands() -> list[Printed]:
    """All commands of the program in code blocks; of `console` blocks with their output."""
    found = []
    for file in DOCUMENTS:
        name = file.relative_to(PROJECT).as_posix()
        for language, block in blocks(file.read_text(encoding="utf-8")):
            text = block.replace("\\\n", " ")
            if language == "console":
                for part in re.split(r"^\$ ", text, flags=re.MULTILINE)[1:]:
                    line, _, output = part.partition("\n")
                    if line.startswith(PROGRAM):
                        found.append(Printed(name, " ".join(line.split()), output))
            elif language in ("", "sh", "bash"):
                for line in text.splitlines():
                    line = " ".join(re.sub(r"\s+#.*", "", line).split())
                    if line.startswith(PROGRAM):
                        found.append(Printed(name, line))
    return found


def inline_commands() -> list[Printed]:
    """Commands between backticks within sentences."""
    found = []
    for file in DOCUMENTS:
        text = re.sub(r"^```.*?^```", "", file.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        for words in re.findall(rf"`({PROGRAM} [^`]+)`", text):
            found.append(Printed(file.relative_to(PROJECT).as_posix(), " ".join(words.split())))
    return found


RUN = {
    "docs/setting-up.md": ("board", "init"),
    "docs/tutorial.md": ("board",),
    "docs/diagnosing.md": ("diagnose", "apply"),
    "docs/formats.md": ("check", "schema"),
}
"""By document, the commands that `test_documents.py` runs as they are printed."""
ELSEWHERE = {
    "correct": "test_correct_page.py runs those of the twin; those of hardware up to the missing robot",
    "render": "58 s: 12 ray-traced pictures; test_cli_commands.py renders two; slow_documents.py runs it",
    "measure": "as printed in README on those pictures: slow_documents.py; test_documents.py measures its own session",
    "demo": "`make demo` of every CI run",
    "calibrate-camera": "needs pictures of a board: test_calibrate_camera.py draws them",
    "import": "needs a recording: test_import.py writes them with their own libraries",
    "plan": "20 s: test_plan.py plans a small robot; slow_documents.py",
    "capture": "needs a camera and a browser: test_capture.py",
    "simulate": "minutes in MuJoCo: test_simulate.py",
    "blind": "an hour: test_blind_protocol.py makes, runs and scores a few; --scheduler needs machines: test_fleet.py",
    "moving": "half an hour of sessions in motion: test_moving_judge.py makes and judges a small one",
    "reproduce": "25 s to a quarter of an hour: test_reproduce.py",
    "diagnose": "with --scheduler: machines of a fleet: test_fleet.py; else docs/diagnosing.md",
    "apply": "with the user's own files: test_apply_patch.py",
    "mirror": "needs a picture of a board and its reflection: test_mirror_pictures.py",
    "init": "as printed in docs/setting-up.md; on an SO-101: strangers_hour.py",
    "board": "as printed in docs/setting-up.md",
    "check": "as printed in docs/formats.md",
    "schema": "as printed in docs/formats.md",
}
"""By command, why it is not run as printed in every test run, and by what instead."""


def same(printed: str, said: str) -> str | None:
    """None where an output is the printed one but for what is marked as varying; else what was said."""
    pattern = ""
    for line in printed.strip("\n").splitlines():
        if line.strip() == ANYTHING:
            pattern += r"(?:.*\n)*"
            continue
        words = re.escape(line.rstrip()).replace(re.escape(ANYTHING), ".+?")
        pattern += re.sub(ABOUT + r"[-+]?[\d\\.]*\d", r"([-+]?[\\d.]*\\d)", words) + r"[ ]*\n"
    lines = "".join(line.rstrip() + "\n" for line in said.strip("\n").splitlines())
    found = re.fullmatch(pattern, lines)
    if found is None:
        return lines
    numbers = [float(text) for text in re.findall(ABOUT + r"([-+]?[\d.]*\d)", printed)]
    near = all(
        abs(float(had) - told) <= VARIES * abs(told)
        for had, told in zip(found.groups(), numbers, strict=True)
    )
    return None if near else lines
