"""Files made from names that may hold anything: none outside of the folder that was told, none over another, all of names that every system takes."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest
from typer.testing import CliRunner

from mirror_posture import cli
from mirror_posture.file_names import file_name_of

LONG = "n" * 300
NAMES = ["../x", "a/b", "CON", "\x07bell\x1b[2J", LONG, "..", ".", "a\\b", "C:x", "", "x.", "é", "X", "x"]
PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")


def test_every_name_has_a_file_name_of_its_own() -> None:
    made = [file_name_of(name) for name in [*NAMES, "r_elbow", "a_b", "con.stl", LONG + "n", "A/B"]]
    assert len({name.lower() for name in made}) == len(made)
    for name in made:
        assert PLAIN.fullmatch(name) and len(name) <= 100 and not name.endswith(".")
        assert name.partition(".")[0].lower() not in ("con", "prn", "aux", "nul", "com1", "lpt9")
    assert file_name_of("r_elbow") == "r_elbow" and file_name_of("wedge_1.stl") == "wedge_1.stl"


JOINTS = {"r_shoulder_pitch": "../../j", "r_shoulder_roll": "j/k", "r_elbow": 'q" <&>'}


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session whose markers and moving joints have such names."""
    pytest.importorskip("mujoco", reason="the mirrored session needs mirror_lab's robots")
    from mirrored_session import write_mirrored

    session = write_mirrored(
        tmp_path_factory.mktemp("names") / "session",
        3,
        lambda q: {**q, "r_elbow": q["r_elbow"] + 0.03},
        8,
    )
    toml = (session / "session.toml").read_text(encoding="utf-8")
    markers = dict(zip(re.findall(r'^name = "(\w+)"', toml, re.MULTILINE), NAMES, strict=False))
    for marker, name in markers.items():
        toml = toml.replace(f'name = "{marker}"', f"name = {json.dumps(name)}")
    (session / "session.toml").write_text(toml, encoding="utf-8")
    urdf = (session / "robot.urdf").read_text(encoding="utf-8")
    for joint, name in JOINTS.items():
        urdf = urdf.replace(f'"{joint}"', quoteattr(name))
    (session / "robot.urdf").write_text(urdf, encoding="utf-8")
    for file in ("frames.csv", "detections.csv"):
        out = io.StringIO()
        rows = csv.reader((session / file).read_text(encoding="utf-8").splitlines())
        csv.writer(out).writerows([[(JOINTS | markers).get(cell, cell) for cell in row] for row in rows])
        (session / file).write_text(out.getvalue(), encoding="utf-8")
    return session


def files(folder: Path) -> Iterator[Path]:
    return (path.relative_to(folder) for path in folder.rglob("*"))


@pytest.mark.filterwarnings("ignore:Glyph")
def test_no_command_writes_outside_or_over_another(hostile: Path, tmp_path: Path) -> None:
    inside = tmp_path / "a" / "b" / "c"
    inside.mkdir(parents=True)
    before = set(files(hostile))
    commands = [
        ["check", hostile],
        ["measure", hostile, "--out", inside / "m.csv", "--plot", inside / "m.png"],
        ["diagnose", hostile, "--out", inside / "found"],
        ["apply", hostile, inside / "found", "--out", inside / "better"],
    ]
    for words in commands:
        done = CliRunner().invoke(cli.app, [str(word) for word in words])
        assert done.exit_code in (0, 3), f"{words[0]}: {done.output}"
    assert set(files(hostile)) == before
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["b"] and len(
        list((tmp_path / "a/b").iterdir())
    ) == 1
    for path in files(inside):
        assert PLAIN.fullmatch(path.name) and len(path.name) < 60, path
