"""docs/first-hour.md: every command that it prints is run, and what it prints compared.

Pictures are what takes minutes: `recorded_hour` puts what was detected in them in their place, and a small film for a recording's. `plan` looks for
postures for 20 s: those that it found are judged again instead (`plan --judge`), and must tell what the page prints. A whole hour, with the
pictures, is compared by hand: `strangers_hour.py`, `hour_in_document.py`.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import pyarrow.csv
import pytest
from typer.testing import CliRunner

pytest.importorskip("mujoco")

from document_commands import ANYTHING, alike, same
from hour_in_document import DOCUMENT, SECTIONS, differences, printed, quoted, section_of
from mirror_posture import cli
from mirror_posture.robots import Look, Nominal
from recorded_hour import FOLDER, SMALL, Pattern, RecordedHour, as_if_detected
from strangers_hour import BODIES, described, recorded, write_lerobot, write_mcap

PICTURES_UNSEEN = "no detections yet: looking for the board and the balls in the pictures first\n"
"""Said before the detector runs, which does not here."""


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Path]]:
    """The robots, each in a folder of its own, with the session that `init` makes as the page prints it."""
    robots, packages = described()
    text = DOCUMENT.read_text(encoding="utf-8")
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        # What the two pictures show is tested where they are drawn.
        patch.setattr(
            "mirror_posture.new_session.draw_setup", lambda folder, file: [][: file.write_bytes(b"")]
        )
        patch.setattr("mirror_posture.diagnosis.page.write_report", lambda session, found, folder: folder)
        for name in ("so101", "g1-swapped"):
            folder = tmp_path_factory.mktemp(name)
            shutil.copy(robots / BODIES[name].urdf, folder)
            begin, end = section_of(text, SECTIONS[name, "folder"])
            for line, output in printed(text[begin:end]).items():
                if line.split()[1] == "init":
                    where = [f"--package={package}={path}" for package, path in packages.items()]
                    compare(folder, patch, line, output, *where)
            found[name] = folder
        yield found


def compare(folder: Path, patch: pytest.MonkeyPatch, line: str, output: str, *more: str) -> str:
    """Runs a printed command in a folder and compares what it says."""
    patch.chdir(folder)
    done = CliRunner().invoke(cli.app, [*shlex.split(line)[1:], *more])
    assert done.exit_code == 0, f"{line}: {done.output}"
    told = done.stderr + done.stdout
    good = same(output, told) is None if ANYTHING in output else alike(output, told)
    assert good, f"{line} prints another output than the page:\n{told}\n{output}"
    return done.output


@pytest.mark.parametrize(("name", "way"), SECTIONS)
def test_every_command_says_what_the_page_prints(
    name: str, way: str, sessions: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    begin, end = section_of(text, SECTIONS[name, way])
    page = {line.split()[1]: (line, output) for line, output in printed(text[begin:end]).items()}
    hour = RecordedHour(FOLDER / f"{name}-{way}")
    here = tmp_path / "hour"
    shutil.copytree(sessions[name if name in sessions else "so101"], here)
    session = here / "session"
    nominal = Nominal.load(session)
    assert nominal.camera is not None
    if way == "folder":
        shutil.copytree(hour.folder / "plan", session / "plan")
        compare_plan(here, monkeypatch, page["plan"][1])
        hour.write_blank_pictures(here / "pictures", nominal.camera.size_px)
        detector = hour.detector(nominal)

        def look(_: Nominal, seen: Look) -> Look:
            return as_if_detected(seen, next(detector))

        monkeypatch.setattr("mirror_posture.capture.loop.detect_look", look)
        compare(here, monkeypatch, *page["capture"])
        compare(here, monkeypatch, *page["check"])
    else:
        write = {"mcap": write_mcap, "lerobot": write_lerobot}[way]
        write(here, list(recorded(Pattern(hour), BODIES[name])))  # type: ignore[arg-type]
        camera = (session / "camera.yaml").read_text(encoding="utf-8")
        width, height = nominal.camera.size_px
        small = camera.replace(f"image_width: {width}", f"image_width: {SMALL[0]}").replace(f"image_height: {height}", f"image_height: {SMALL[1]}")  # fmt: skip
        (session / "camera.yaml").write_text(small, encoding="utf-8")
        line, output = page["import"]
        compare(here, monkeypatch, line, re.sub(r"\(correlation [0-9.]+\)", "(correlation …)", output))
        (session / "camera.yaml").write_text(camera, encoding="utf-8")
        # A picture in which nothing was found is looked at again: of the camera's size, and nothing is in it.
        shutil.rmtree(session / "images")
        hour.write_blank_pictures(session / "images", nominal.camera.size_px)
    table = pyarrow.csv.read_csv(session / "frames.csv").to_pylist()
    for row, wanted in zip(table, hour.rows, strict=True):
        assert {key: row[key] for key in wanted} == pytest.approx(wanted, abs=1e-6)
    shutil.copy(hour.folder / "detections.csv", session)
    line, output = page["diagnose"]
    compare(here, monkeypatch, line, output.replace(PICTURES_UNSEEN, ""))
    compare(here, monkeypatch, *page["apply"])
    document = json.loads((here / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))
    assert {(cause["effect"], cause["at"]) for cause in document["causes"]} == BODIES[name].truth()


def compare_plan(folder: Path, patch: pytest.MonkeyPatch, output: str) -> None:
    """What the page prints of a plan is what its rows tell: sizes, twins, where the mirror stands, what was warned of."""
    patch.chdir(folder)
    plan = json.loads((folder / "session" / "plan" / "plan.json").read_text(encoding="utf-8"))
    done = CliRunner().invoke(cli.app, ["plan", "session", "--judge"])
    assert done.exit_code == 0, done.output
    told, _ = done.stdout.split("every row of ")
    head, body = output.split("What this plan can tell")
    body, written = body.split("written: ")
    assert alike("What this plan can tell" + body, told), told
    assert head == "".join(f"warning: {text}\n" for text in plan["warnings"]) + (
        "looking for the mirror's place\ndrawing postures\nchoosing among … pictures\nordering them on free paths\nwhat they will tell\n"
    )
    assert (
        written.startswith("session/plan/postures.csv, views.csv, plan.json;")
        and "next: mirror-posture capture session" in written
    )


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
    table = "┃ a ┃\n│ 0.099 ± 0.01 mm │ of 36\n"
    assert alike(table, "┃   a ┃\n│ 0.1 ± 0.01 mm │ of 36\n")
    for other in (
        "0.11 ± 0.01 mm │ of 36",
        "0.099 ± 0.01 mm │ of 35",
        "0.099 ± 0.01 ° │ of 36",
        "0.099 ± 0.04 mm │ of 36",
    ):
        assert not alike(table, f"┃ a ┃\n│ {other}\n")
    line = "mirror-posture capture session --source pictures"
    output = "frame 0: board\nframe 1: board\nall postures of the plan are taken\n"
    transcript = f"```\n$ {line} --package a=b\n{output}```\n"
    section = f"```console\n$ {line}\n{quoted(line, output)}```\n"
    assert differences(section, transcript) == []
    assert differences(section.replace("all", "some"), transcript) == [f"printed otherwise: {line}"]
    assert differences("", transcript) == [f"not printed: {line}"]
