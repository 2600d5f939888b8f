"""What README and docs/ print: their code blocks, the commands in them, and how each command is proved."""

from __future__ import annotations

import functools
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


@functools.cache
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
    "docs/first-hour.md": ("board", "init", "capture", "import", "check", "diagnose", "apply"),
    "docs/diagnosing.md": ("diagnose", "apply"),
    "docs/formats.md": ("check", "schema"),
}
"""By document, the commands that `test_documents.py` and `test_first_hour.py` run as they are printed, with what they print. A command that another page prints alike is
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
    "mirror Image3.jpg": Elsewhere("test_mirror_pictures.py", "mirror Image3", "a phone's public pictures, where they are: as printed"),
    "measure": Elsewhere("test_cli_commands.py", '"measure", detected, "--plot"', "of the two pictures that are drawn there"),
    "correct twin": Elsewhere("test_correct_page.py", 'words.append("--no-pictures")', "drawn pictures take a minute: run as printed, but without them"),
    "correct by-hand": Elsewhere("test_correct_page.py", '"posture.toml" in ended.stderr', "run as printed, up to the robot that is not there"),
    "correct dynamixel": Elsewhere("test_correct_page.py", '"posture.toml" in ended.stderr', "as above"),
    "correct own": Elsewhere("test_correct_page.py", '"posture.toml" in ended.stderr', "as above"),
    "calibrate-camera": Elsewhere("test_calibrate_camera.py", '"calibrate-camera"', "needs pictures of a board: they are drawn there"),
    "import": Elsewhere("test_import.py", 'run("import", *words[:1], session', "needs recordings: written there by their own libraries"),
    "init so101.urdf": Elsewhere("test_first_hour.py", "BODIES[name].words", "with a camera.yaml of the reader's own: as docs/first-hour.md prints it there"),
    "plan": Elsewhere("test_plan.py", '"plan", folder, "--mirror-size"', "20 s: planned there for an arm of boxes; what it prints is told again of the same rows by test_first_hour.py"),
    "plan my-session --judge": Elsewhere("test_plan.py", 'run("plan", folder, "--judge"', "needs a plan: one of an arm of boxes there"),
    "capture": Elsewhere("test_capture.py", 'run("capture", session, "--source", folder', "needs a camera: pictures of a folder and a film there; a browser opens the page"),
    "simulate": Elsewhere("test_simulate.py", '"simulate", str(session), "--out"', "minutes in MuJoCo: a small session there"),
    "blind make": Elsewhere("test_lab_commands.py", "blind make", "an hour: one case there"),
    "blind run": Elsewhere("test_lab_commands.py", "blind run", "an hour: what is diagnosed already there; test_blind_protocol.py runs the runner, test_fleet.py with machines"),
    "blind score": Elsewhere("test_lab_commands.py", "blind score", "one case there"),
    "moving make": Elsewhere("test_lab_commands.py", "moving make", "20 motions: one of 4 s there"),
    "moving run": Elsewhere("test_lab_commands.py", "moving run", "minutes a motion: what is diagnosed already there; test_motion.py diagnoses one"),
    "moving score": Elsewhere("test_lab_commands.py", "moving score", "of the motion that is made there"),
    "moving peers": Elsewhere("slow_documents.py", "moving peers", "two minutes: a diagnosis and MuJoCo's identification of the same motion", by_hand=True),
    "reproduce": Elsewhere("test_reproduce.py", '["reproduce", "--out"', "25 s to a quarter of an hour: some figures with few trials there"),
    "diagnose my-motion": Elsewhere("test_motion.py", '"--model"', "minutes: a short motion there"),
    "diagnose session-*": Elsewhere("test_fleet.py", '["diagnose", *folders', "needs machines of a fleet: one of threads there"),
    "apply": Elsewhere("test_apply_patch.py", "cli.app, [str(argument) for argument in arguments]", "with the user's own files: several are patched there"),
}  # fmt: skip
"""By the beginning of a command (the longest counts) what runs its like. A whole hour of docs/first-hour.md, with its pictures, takes some minutes, and is
compared by `strangers_hour.py` and `hour_in_document.py` (by hand)."""

NOT_IN_TESTS = {
    "moving peers": "two minutes, and needs mujoco[sysid], which the tests do not install: slow_documents.py runs it",
    "make": "builds everything: the CI runs it",
    "pip install": "from an index, or a build of the sources: test_wheel.py asks the installed wheel instead",
    "dask": "starts machines of a fleet: test_fleet.py starts threads",
}
"""By the beginning of a printed command, why no test runs it or its like."""

OTHERS = {
    ("docs/correcting.md", "from mirror_posture.correct import CorrectOptions"): ("test_correct_page.py", 'blocks("python")'),
    ("docs/robots.md", "from mirror_posture.correct import correct"): ("test_robots_document.py", '"TwinRobot(hidden"'),
    ("docs/robots.md", "from mirror_lab.robots import HiddenEffect"): ("test_robots_document.py", '"MujocoRobot("'),
    ("docs/robots.md", "from mirror_posture.robots import Nominal"): ("test_robots_document.py", '"ByHandRobot("'),
    ("docs/robots.md", "from mirror_posture.robots import Look"): ("test_robots_document.py", '"class MyRobot"'),
    ("docs/robots.md", "[bus]"): ("test_robots_document.py", '"torque_share"'),
    ("docs/moving.md", "from mirror_simulation.motion import diagnose_motion"): ("test_motion.py", '"--check"'),
    ("docs/diagnosing.md", "from mirror_posture.diagnosis import feed_forward"): ("test_documents.py", 'python_of("docs/diagnosing.md")'),
    ("docs/diagnosing.md", "from mirror_posture.diagnosis import OwnEffect"): ("test_documents.py", 'python_of("docs/diagnosing.md")'),
    ("docs/diagnosing.md", "import mirror_posture as mp"): ("test_documents.py", 'python_of("docs/diagnosing.md")'),
    ("README.md", "import mirror_posture as mp"): ("test_cli_commands.py", 'python_of("README.md")'),
    ("docs/measuring.md", "import mirror_posture as mp"): ("test_mirror_pictures.py", 'python_of("docs/measuring.md")'),
    ("docs/measuring.md", "ball = mp.Marker("): ("test_mirror_pictures.py", 'python_of("docs/measuring.md")'),
    ("docs/measuring.md", "image_width: 3264"): ("test_mirror_pictures.py", "image_width: 3264"),
    ("docs/formats.md", "error: detections.csv"): ("test_documents.py", '"12,1x3"'),
    ("docs/formats.md", "[points]"): ("test_session.py", "formats.md"),
    ("docs/tutorial.md", "What this plan can tell"): ("test_document_blocks.py", "test_the_tutorial_quotes_the_first_hour"),
    ("docs/tutorial.md", "│ joint offset"): ("test_document_blocks.py", "test_the_tutorial_quotes_the_first_hour"),
    ("docs/faults.md", "python tests/python/hidden_bodies.py"): ("test_correct_hidden_bodies.py", "from hidden_bodies import"),
    ("docs/faults.md", "python tests/python/faulty_robot.py"): ("test_faults.py", "from faulty_robot import"),
    ("docs/faults.md", "python tests/python/faulty_servos.py"): ("test_servo_faults.py", "from faulty_servos import"),
    ("docs/measuring.md", "pictures ──detect──▶"): ("", "a drawing"),
}  # fmt: skip
"""Blocks that are no commands of the program, by document and beginning: the test that runs or compares them, and a part of it."""


def python_of(document: str) -> list[str]:
    """The Python blocks of a document."""
    text = (PROJECT / document).read_text(encoding="utf-8")
    return [block for language, block in blocks(text) if language == "python"]


def runs_as_printed(printed: Printed) -> bool:
    """Whether a test runs it as printed, on its own page or on another that prints it alike."""
    command = printed.words.split()[1]
    return any(
        other.words == printed.words and command in RUN.get(other.document, ())
        for other in commands()
        if other.output is not None or printed.output is None
    )


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


NUMBER = r"\d+(?:\.\d+)?"
FRAMES = r"[\s━┏┓┡┩╇┳└┘┴─┃│]+"
"""Blanks and a table's lines: they follow the widths of numbers."""


def alike(printed: str, said: str) -> bool:
    """Whether an output has the words of a printed one, and its numbers within 5 %, or two in the last place: machines round differently."""
    wanted, had = (re.sub(FRAMES, " ", text).strip() for text in (printed, said))
    if re.sub(NUMBER, "#", wanted) != re.sub(NUMBER, "#", had):
        return False
    for told, found in zip(re.findall(NUMBER, wanted), re.findall(NUMBER, had), strict=True):
        last = 10.0 ** -len(told.partition(".")[2]) if "." in told else 0.0
        if abs(float(told) - float(found)) > max(0.05 * float(told) if last else 0.0, 2.0 * last):
            return False
    return True
