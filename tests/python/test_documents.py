"""README and docs/: every command that is printed is one that the program takes; those that take no minutes and no hardware are run, and
what they print is compared; links lead somewhere."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import typer.main
from typer.testing import CliRunner

import mirror_posture
from document_commands import (
    DOCUMENTS,
    ELSEWHERE,
    PROGRAM,
    PROJECT,
    RUN,
    Printed,
    blocks,
    commands,
    elsewhere,
    inline_commands,
    python_of,
    runs_as_printed,
    same,
)
from mirror_posture.cli.app import app
from session_folder import DETECTIONS, URDF, replaced, write_folder
from tracked_session import write_tracked

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

GROUP = typer.main.get_command(app)
GROUP.list_commands(typer.Context(GROUP))  # type: ignore[attr-defined]  # builds all of them
PRINTED = commands()
JOINED = {
    command
    for package in ("mirror_lab", "mirror_simulation")
    for command in tomllib.loads(
        (PROJECT / "python" / package / "pyproject.toml").read_text(encoding="utf-8")
    )["project"]["entry-points"]["mirror_posture.commands"]
}
"""Commands of the other distributions: where only the sources are on the path they have not joined."""


def parse(words: list[str]) -> None:
    """Lets the program read a command line without running it; raises as it would."""
    command, context = GROUP, None
    while hasattr(command, "commands") and words:
        context = command.make_context(words[0], [], parent=context, resilient_parsing=True)
        name, *words = words
        assert name in command.commands, f"{name} is no command"
        command = command.commands[name]
    command.make_context("", list(words), parent=context)


def test_the_documents_print_commands() -> None:
    assert len(PRINTED) >= 20 and {p.document for p in PRINTED} >= {"README.md", *RUN}


@pytest.mark.parametrize("printed", PRINTED, ids=lambda p: f"{p.document}: {p.words}")
def test_every_printed_command_is_taken_and_proved(printed: Printed) -> None:
    words = shlex.split(printed.words)[1:]
    if words[0] in JOINED and words[0] not in GROUP.commands:  # type: ignore[attr-defined]
        pytest.skip(f"{words[0]} joins with another distribution")
    parse(words)
    assert runs_as_printed(printed) or elsewhere(printed.words) is not None, (
        "say in document_commands.py how it is proved"
    )


@pytest.mark.parametrize("start", ELSEWHERE)
def test_what_runs_the_like_of_a_command_is_there(start: str) -> None:
    proof = ELSEWHERE[start]
    assert proof.like in (PROJECT / "tests" / "python" / proof.file).read_text(encoding="utf-8")
    assert proof.by_hand != proof.file.startswith("test_")
    for name in re.findall(r"\w+\.py", proof.why):
        assert (PROJECT / "tests" / "python" / name).is_file(), name
    # What nobody prints any more needs no proof.
    asked = [p for p in PRINTED if elsewhere(p.words) is proof and not runs_as_printed(p)]
    assert asked, f"{start}: no page prints it, or all are run as printed"


def test_every_command_within_a_sentence_is_taken() -> None:
    tried = 0
    for printed in inline_commands():
        words = shlex.split(printed.words)[1:]
        # `mirror-posture correct ROBOT … --feed-forward diagnosis`: shortened for the sentence.
        if "…" in printed.words or "ROBOT" in words or len(words) < 2:
            assert words[0] in {*GROUP.commands, *JOINED}, printed  # type: ignore[attr-defined]
            continue
        if words[0] in JOINED and words[0] not in GROUP.commands:  # type: ignore[attr-defined]
            continue
        parse(words)
        tried += 1
    assert tried > 5


def test_every_help_has_an_example_and_what_is_next_and_both_are_taken() -> None:
    said = set()
    for name, command in GROUP.commands.items():  # type: ignore[attr-defined]
        if name in JOINED - {"simulate"}:
            continue
        parts = dict(
            re.findall(r"^ *(Example|Next): (.*?)(?:\n\n|\Z)", command.help, re.MULTILINE | re.DOTALL)
        )
        assert "Example" in parts, name
        said |= {name} if "Next" in parts else set()
        for words in re.findall(rf"`{PROGRAM} ([^`]+)`", " ".join(" ".join(parts.values()).split())):
            if "--help" not in words:
                parse(shlex.split(words.partition(" > ")[0]))
    assert said >= {
        "board",
        "init",
        "calibrate-camera",
        "plan",
        "capture",
        "import",
        "check",
        "detect",
        "diagnose",
    }


def test_a_wrong_option_would_be_seen() -> None:
    with pytest.raises(Exception, match="estimators"):
        parse(["measure", "my-session", "--estimators", "all"])


def run_printed(document: str) -> None:
    done = set()
    for printed in PRINTED:
        words = shlex.split(printed.words)[1:]
        if printed.document != document or words[0] not in RUN[document] or "--lerobot" in words:
            continue
        if printed in done:
            continue
        done.add(printed)
        ended = CliRunner().invoke(app, words, env={"COLUMNS": "120"})
        assert ended.exit_code == 0, f"{printed.words}: {ended.output}"
        if printed.output is not None:
            said = same(printed.output, ended.output)
            assert said is None, f"{document} prints another output of {printed.words} than it has:\n{said}"


def test_setting_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.urdf").write_text(
        URDF.replace('lower"', 'gripper"').replace("hand_marker", "palm"), encoding="utf-8"
    )
    run_printed("docs/setting-up.md")
    assert (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF")
    assert (tmp_path / "my-session" / "setup.png").is_file()


def test_tutorial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its further commands need the arm's meshes and half an hour: strangers_hour.py runs them."""
    monkeypatch.chdir(tmp_path)
    run_printed("docs/tutorial.md")


def test_formats(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_folder(tmp_path / "my-session")
    run_printed("docs/formats.md")
    # The refusal that the page shows.
    write_folder(tmp_path / "broken", detections=replaced(DETECTIONS, "12,13", "12,1x3"))
    ended = CliRunner().invoke(app, ["check", "broken"])
    (shown,) = [
        block
        for block in blocks((PROJECT / "docs/formats.md").read_text(encoding="utf-8"))
        if block[1].startswith("error: ")
    ]
    assert ended.exit_code == 1 and ended.stderr == shown[1]


def test_diagnosing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tracked robot whose elbow's zero is off: diagnosed, written back, and then there is nothing left."""
    monkeypatch.chdir(tmp_path)
    folder = write_tracked(tmp_path / "my-session", 4)
    robot = folder / "robot.urdf"
    # The model's zero is moved instead of the body's.
    text = robot.read_text(encoding="utf-8")
    joint = re.search(r'<joint name="r_elbow".*?</joint>', text, re.DOTALL)
    assert joint
    turned = joint[0].replace("<origin ", '<origin rpy="0 0.04 0" ')
    assert turned != joint[0]
    robot.write_text(text.replace(joint[0], turned), encoding="utf-8")
    run_printed("docs/diagnosing.md")
    assert (tmp_path / "diagnosis" / "report.html").is_file()
    # The page's Python, on the same session.
    shutil.copytree(folder, tmp_path / "other-session")
    sent: list[dict[str, float]] = []
    names = {
        "mp": mirror_posture,
        "session": mirror_posture.load_session(folder),
        "robot": SimpleNamespace(command=sent.append),
    }
    for block in python_of("docs/diagnosing.md"):
        exec(block, names)
    # Its elbow stands 0.04 rad too far: it is sent as much less far.
    assert sent[-1]["r_elbow"] == pytest.approx(0.8 - 0.04, abs=0.003)
    assert names["found"].verdict == "explained"


def test_outputs_are_compared() -> None:
    assert same("a ≈1.50 mm\n…\nend", "a 1.44 mm\nmore\nand more\nend") is None
    assert same("a ≈1.50 mm\n…\nend", "a 1.30 mm\nend") is not None
    assert same("a 1.50 mm", "a 1.51 mm") is not None and same("a … mm", "a b c mm") is None


@pytest.mark.parametrize("file", DOCUMENTS, ids=lambda f: f.relative_to(PROJECT).as_posix())
def test_links_lead_somewhere(file: Path) -> None:
    text = re.sub(r"^```.*?^```", "", file.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        place = (file.parent / path).resolve() if path else file
        assert place.exists() or "reference/" in path or path.startswith("rust/"), f"{target} is not there"
        if anchor and place.suffix == ".md":
            heads = re.findall(r"^#+ (.*)$", place.read_text(encoding="utf-8"), re.MULTILINE)
            slugs = {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}
            assert anchor in slugs, f"{target}: the page has no such heading"


NOTEBOOKS = sorted((PROJECT / "docs" / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda f: f.stem)
def test_notebooks_print_what_they_show(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Cell by cell in one namespace, as a notebook's kernel runs them; numbers may differ by a tenth, or two in the last place."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for cell in json.loads(file.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] != "code":
            continue
        exec(compile("".join(cell["source"]), str(file), "exec"), names)
        said = capsys.readouterr().out
        shown = "".join("".join(output["text"]) for output in cell["outputs"])
        number = r"-?\d+(?:\.\d+)?"
        assert re.sub(number, "#", said) == re.sub(number, "#", shown)
        for had, told in zip(re.findall(number, said), re.findall(number, shown), strict=True):
            last = 10.0 ** -len(told.partition(".")[2])
            assert abs(float(had) - float(told)) <= max(0.1 * abs(float(told)), 2.0 * last), (said, shown)


def test_there_are_notebooks() -> None:
    assert {file.stem for file in NOTEBOOKS} == {"measure", "diagnose", "correct"}


def test_the_site_names_pages_that_are_there() -> None:
    site = (PROJECT / "mkdocs.yml").read_text(encoding="utf-8")
    named = set(re.findall(r"([\w/-]+\.md)$", site, re.MULTILINE))
    there = {file.relative_to(PROJECT / "docs").as_posix() for file in (PROJECT / "docs").rglob("*.md")}
    there = {name for name in there if not name.startswith("reference/")}
    # A page that is not named stands under "More".
    assert {name for name in named if not name.startswith("reference/")} <= there
