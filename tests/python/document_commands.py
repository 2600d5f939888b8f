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
    "docs/first-hour.md": ("board",),
    "docs/diagnosing.md": ("diagnose", "apply"),
    "docs/formats.md": ("check", "schema"),
}
"""By document, the commands that `test_documents.py` runs as they are printed, with what they print. A command that another page prints alike is
run by that."""


@dataclass(frozen=True)
class Elsewhere:
    """What runs the like of a printed command that is not run as printed in every test run."""

    file: str
    """Of tests/python."""
    like: str
    """A part of that file: the command as it is run there."""
    why: str
    by_hand: bool = False
    """Whether no test run has it; `file` is a script then."""


ELSEWHERE = {
    "render": Elsewhere("test_cli_commands.py", '"render", folder, "--postures", 1', "12 ray-traced pictures take a minute: two are drawn there"),
    "render look.png": Elsewhere("test_mesh_pictures.py", '"--preview")', "needs an arm with meshes: one of boxes is drawn there"),
    "render rehearsal": Elsewhere("test_mesh_pictures.py", '"render", tmp_path / "drawn"', "as above; a plan of 36 pictures takes a minute"),
    "measure": Elsewhere("test_cli_commands.py", '"measure", detected, "--plot"', "of the two pictures that are drawn there"),
    "correct twin": Elsewhere("test_correct_page.py", 'words.append("--no-pictures")', "drawn pictures take a minute: run as printed, but without them"),
    "correct by-hand": Elsewhere("test_correct_page.py", '"posture.toml" in ended.stderr', "run as printed, up to the robot that is not there"),
    "correct dynamixel": Elsewhere("test_correct_page.py", '"posture.toml" in ended.stderr', "as above"),
    "correct own": Elsewhere("test_correct_page.py", '"posture.toml" in ended.stderr', "as above"),
    "calibrate-camera": Elsewhere("test_calibrate_camera.py", '"calibrate-camera"', "needs pictures of a board: they are drawn there"),
    "import": Elsewhere("test_import.py", 'run("import", *words[:1], session', "needs recordings: written there by their own libraries"),
    "init so101.urdf": Elsewhere("test_init.py", "init", "needs the arm's meshes; printed output: hour_in_document.py"),
    "init g1_29dof_rev_1_0.urdf": Elsewhere("test_init.py", "init", "as above"),
    "plan": Elsewhere("test_plan.py", '"plan", folder, "--mirror-size"', "20 s: planned there for an arm of boxes; printed output: hour_in_document.py"),
    "plan my-session --judge": Elsewhere("test_plan.py", 'run("plan", folder, "--judge"', "needs a plan: one of an arm of boxes there"),
    "capture": Elsewhere("test_capture.py", 'run("capture", session, "--source", folder', "needs a camera: pictures of a folder and a film there; a browser opens the page"),
    "check": Elsewhere("test_documents.py", 'run_printed("docs/formats.md")', "of the hour's session; printed output: hour_in_document.py"),
    "simulate": Elsewhere("test_simulate.py", '"simulate", str(session), "--out"', "minutes in MuJoCo: a small session there"),
    "blind make": Elsewhere("test_lab_commands.py", "blind make", "an hour: one case there"),
    "blind run": Elsewhere("test_lab_commands.py", "blind run", "an hour: what is diagnosed already there; test_blind_protocol.py runs the runner, test_fleet.py with machines"),
    "blind score": Elsewhere("test_lab_commands.py", "blind score", "one case there"),
    "moving make": Elsewhere("test_lab_commands.py", "moving make", "20 motions: one of 4 s there"),
    "moving run": Elsewhere("test_lab_commands.py", "moving run", "minutes a motion: what is diagnosed already there; test_motion.py diagnoses one"),
    "moving score": Elsewhere("test_lab_commands.py", "moving score", "of the motion that is made there"),
    "moving peers": Elsewhere("slow_documents.py", "moving peers", "two minutes: a diagnosis and MuJoCo's identification of the same motion", by_hand=True),
    "reproduce": Elsewhere("test_reproduce.py", '["reproduce", "--out"', "25 s to a quarter of an hour: some figures with few trials there"),
    "diagnose": Elsewhere("test_documents.py", 'run_printed("docs/diagnosing.md")', "of the hour's sessions; printed output: hour_in_document.py"),
    "diagnose my-motion": Elsewhere("test_motion.py", '"--model"', "minutes: a short motion there"),
    "diagnose session-*": Elsewhere("test_fleet.py", '["diagnose", *folders', "needs machines of a fleet: one of threads there"),
    "apply": Elsewhere("test_apply_patch.py", "cli.app, [str(argument) for argument in arguments]", "with the user's own files: several are patched there"),
}  # fmt: skip
"""By the beginning of a command (the longest counts) what runs its like. What the commands of docs/first-hour.md print is compared with a whole hour,
some minutes each, by `strangers_hour.py` and `hour_in_document.py` (by hand); what those of README print on drawn pictures by `slow_documents.py`."""


def elsewhere(words: str) -> Elsewhere | None:
    """What runs the like of a command; of its beginnings the longest one counts."""
    told = words.removeprefix(f"{PROGRAM} ")
    known = [start for start in ELSEWHERE if told == start or told.startswith(f"{start} ")]
    return ELSEWHERE[max(known, key=len)] if known else None


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
