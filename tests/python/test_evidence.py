"""Without evidence nothing is called sound: what is left out is counted and named, and too little is told as too little."""

from __future__ import annotations

import math
import random
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

pytest.importorskip("mujoco", reason="the mirrored session needs mirror_lab's robots")

from mirror_posture import MirrorPostureError, cli, load_session
from mirror_posture.diagnosis import diagnose
from mirror_posture.diagnosis.next_step import next_step
from mirror_posture.diagnosis.page import write_report
from mirrored_session import write_mirrored
from session_breaks.kinds import Rows, read, write


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_mirrored(
        tmp_path_factory.mktemp("whole") / "session", 4, lambda q: {**q, "r_elbow": q["r_elbow"] + 0.03}, 24
    )


def changed(whole: Path, folder: Path, change: Callable[[Rows], Rows]) -> Path:
    shutil.copytree(whole, folder)
    head, *rows = read(folder / "detections.csv")
    assert head[:3] == ["frame", "target", "index"]
    write(folder / "detections.csv", [head, *change(rows)])
    return folder


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rows: [row for row in rows if row[1] != "board"], "0 of 203 observations"),
        (lambda rows: [row for row in rows if row[1] == "board"], "no marker was seen"),
        (lambda rows: [], "no marker was seen"),
    ],
    ids=["no board", "board only", "nothing"],
)
def test_no_evidence_is_no_answer(
    whole: Path, tmp_path: Path, change: Callable[[Rows], Rows], words: str
) -> None:
    found = diagnose(changed(whole, tmp_path / "s", change)).document
    assert found["verdict"] == "insufficient" and not found["causes"]
    assert words in found["sentence"], found["sentence"]
    # Of nothing no share is false.
    assert not [
        text for text in found["warnings"] if "far from the best model" in text and "no board" not in words
    ]


def test_boards_that_cannot_be_are_left_out_and_told(whole: Path, tmp_path: Path) -> None:
    chance = random.Random(1)

    def garbled(rows: Rows) -> Rows:
        return [
            [*row[:3], repr(chance.uniform(0, 799)), repr(chance.uniform(0, 599)), *row[5:]]
            if row[1] == "board" and int(row[0]) % 2
            else row
            for row in rows
        ]

    folder = changed(whole, tmp_path / "s", garbled)
    found = diagnose(folder).document
    data = found["data"]
    assert data["frames_given"] == 48 and data["frames_used"] == 24
    boards = [left for left in data["left_out"] if left["target"] == "board"]
    assert len(boards) >= 23 and all(left["frame"] % 2 == 1 and left["why"] for left in boards)
    assert (
        data["points_used"] + len([left for left in data["left_out"] if left["target"] != "board"])
        == data["points_given"]
    )
    # What is left is half of the evidence, and still right.
    assert [(cause["effect"], cause["at"]) for cause in found["causes"]] == [
        ("joint_offset", "joint:r_elbow")
    ]
    shown = CliRunner().invoke(cli.app, ["diagnose", str(folder)]).output
    assert f"used: {data['points_used']} of {data['points_given']}" in " ".join(shown.split())


def turned(row: list[str]) -> list[str]:
    return [*row[:2], str(29 - int(row[2])), *row[3:]] if row[1] == "board" else row


def flipped(row: list[str]) -> list[str]:
    return [*row[:3], f"{799.0 - float(row[3]):.4f}", *row[4:]]


@pytest.mark.parametrize(("change", "mistake"), [(turned, "board_turned"), (flipped, "picture_flipped")])
def test_what_stands_beside_a_mistake_is_kept_where_the_session_as_given_predicts_nothing(
    whole: Path, tmp_path: Path, change: Callable[[list[str]], list[str]], mistake: str
) -> None:
    found = diagnose(changed(whole, tmp_path / "s", lambda rows: [change(row) for row in rows]))
    assert {cause.effect for cause in found.causes} == {mistake, "joint_offset"}, found.sentence
    offset = next(cause for cause in found.causes if cause.effect == "joint_offset").parameters["offset_rad"]
    assert abs(offset.value - 0.03) < 4.0 * offset.std
    gap = found.gap
    assert gap.before_m is None and gap.after_m is not None and gap.noise_floor_m is not None
    assert gap.after_m < 1.1 * gap.noise_floor_m and "before nothing could be compared" in found.sentence


@pytest.mark.parametrize("quarters", [1, 3])
def test_a_board_mounted_a_quarter_turned_is_found_though_its_grid_is_not_square(
    whole: Path, tmp_path: Path, quarters: int
) -> None:
    """Printed with as many squares along x as along y before, and turned."""
    stated = (whole / "session.toml").read_text()
    nx, ny = (int(n) for n in re.findall(r"corners = \[(\d+), (\d+)\]", stated)[0])
    assert nx != ny

    def mounted(row: list[str]) -> list[str]:
        ix, iy = int(row[2]) % nx, int(row[2]) // nx
        index = ix * ny + ny - 1 - iy if quarters == 1 else (nx - 1 - ix) * ny + iy
        return [*row[:2], str(index), *row[3:]] if row[1] == "board" else row

    folder = changed(whole, tmp_path / "s", lambda rows: [mounted(row) for row in rows])
    (folder / "session.toml").write_text(stated.replace(f"corners = [{nx}, {ny}]", f"corners = [{ny}, {nx}]"))
    found = diagnose(folder)
    assert {cause.effect for cause in found.causes} == {"board_turned", "joint_offset"}, found.sentence
    turn = next(cause for cause in found.causes if cause.effect == "board_turned").parameters["turn_rad"]
    assert abs(turn.value - (4 - quarters) * math.pi / 2.0) < 1e-9 and found.verdict == "explained"


def test_corners_far_noisier_than_stated_are_no_agreement(whole: Path, tmp_path: Path) -> None:
    def rounded(rows: Rows) -> Rows:
        return [[*row[:3], *(str(round(float(px), -1)) for px in row[3:5]), *row[5:]] for row in rows]

    assert diagnose(changed(whole, tmp_path / "s", rounded)).verdict in ("unknown", "insufficient")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_mirrored(tmp_path_factory.mktemp("sound") / "session", 5, lambda q: q, 24)


def test_boards_counted_from_the_other_end_in_some_frames_are_not_nothing(
    sound: Path, tmp_path: Path
) -> None:
    """The rest agrees, but a third of the frames is no view of the board as it is described."""
    folder = changed(
        sound, tmp_path / "s", lambda rows: [turned(r) if int(r[0]) % 3 == 0 else r for r in rows]
    )
    found = diagnose(folder)
    assert not found.causes and "But in 16 of 48 frames no flat mirror explains" in found.sentence
    assert next_step(found).startswith("Look at the frames of which much was left out (0, 3, 6, ")
    page = write_report(load_session(folder), found, tmp_path).read_text(encoding="utf-8")
    assert '<span class="verdict partial">No gap where it could be compared</span>' in page
    assert "But in" not in diagnose(sound).sentence


def test_rows_that_belong_to_other_pictures_are_to_be_looked_at(sound: Path, tmp_path: Path) -> None:
    """Where a few frames lost several observations, there is something to mend, though the model is right."""
    folder = tmp_path / "s"
    shutil.copytree(sound, folder)
    head, *rows = read(folder / "frames.csv")
    first = head.index("frame") if "frame" in head else 0
    joints = [k for k, name in enumerate(head) if name.startswith("r_")]
    for one, other in ((6, 30), (7, 31)):
        for k in joints:
            rows[one][k], rows[other][k] = rows[other][k], rows[one][k]
    write(folder / "frames.csv", [head, *rows])
    found = diagnose(folder)
    assert found.verdict == "none", found.sentence
    told = next_step(found)
    frames = ", ".join(rows[k][first] for k in (6, 7, 30, 31))
    assert f"much was left out ({frames})" in told and "nothing to mend" in told
    (tmp_path / "page").mkdir()
    page = write_report(load_session(folder), found, tmp_path / "page").read_text()
    assert "Whoever recorded:" in page and "Nobody." not in page
    assert next_step(diagnose(sound)).startswith("Nothing to mend")


def test_a_marker_that_works_loose_is_no_sure_single_step(tmp_path: Path) -> None:
    """What wanders all the time is left beside a slip at the same marker: then the slip is not told as certain."""
    folder = write_mirrored(tmp_path / "s", 5, lambda q: q, 60)
    head, *rows = read(folder / "detections.csv")
    last = max(int(row[0]) for row in rows)
    for row in rows:
        if row[1] == "r_hand":
            row[3:5] = [str(float(px) + 6.0 * int(row[0]) / last) for px in row[3:5]]
    write(folder / "detections.csv", [head, *rows])
    found = diagnose(folder)
    assert found.verdict in ("partial", "unknown") and found.where[0].at == "marker:r_hand"
    assert all(cause.probability < 0.5 for cause in found.causes), found.causes


def test_a_board_at_another_place_and_a_link_of_another_length_are_not_told_apart(
    sound: Path, tmp_path: Path
) -> None:
    """The board's 12 mm on the base that carries the arms are a shift of these arms, to the mirror: neither is certain."""
    folder = tmp_path / "s"
    shutil.copytree(sound, folder)
    urdf = folder / "robot.urdf"
    text = urdf.read_text()
    assert text.count('"0.034 0 0.047"') == 1
    urdf.write_text(text.replace('"0.034 0 0.047"', '"0.034 0.012 0.047"'))
    found = diagnose(folder)
    assert found.verdict == "explained", found.sentence
    told = {(c.effect, c.at): c.probability for c in found.causes}
    told |= {(a.effect, a.at): a.probability for c in found.causes for a in c.alternatives}
    assert told.get(("board_mount", "board"), 0.0) > 0.3, told
    assert all(p < 0.7 for (effect, _), p in told.items() if effect == "link_length"), told
    assert next_step(found).startswith("Measure the board's place on its link with a rule")


def robot_changed(whole: Path, folder: Path, change: Callable[[str], str]) -> Path:
    shutil.copytree(whole, folder)
    urdf = folder / "robot.urdf"
    before = urdf.read_text(encoding="utf-8")
    after = change(before)
    assert after != before
    urdf.write_text(after, encoding="utf-8")
    return folder


def test_a_camera_link_that_is_no_optical_frame_is_refused_with_the_fix(sound: Path, tmp_path: Path) -> None:
    """No mirror explains any board then, and what would be named of the few markers is arbitrary."""
    optical, body = 'rpy="-1.74532925199 0 -1.57079632679"', 'rpy="0 0.17453292520 0"'
    folder = robot_changed(sound, tmp_path / "s", lambda urdf: urdf.replace(optical, body))
    with pytest.raises(MirrorPostureError, match=r"not its optical frame.*turned by rpy = -pi/2, 0, -pi/2"):
        diagnose(folder)
    told = CliRunner().invoke(cli.app, ["diagnose", str(folder), "--out", str(tmp_path / "out")])
    assert told.exit_code == 1 and " ".join(told.output.split()).count(folder.name + ": ") == 1, told.output


def test_a_robot_without_masses_is_told(sound: Path, tmp_path: Path) -> None:
    """Nothing of gravity can be tried: an empty result does not say that nothing yields."""
    without = re.compile(r"<inertial>.*?</inertial>", re.DOTALL)
    told = diagnose(robot_changed(sound, tmp_path / "s", lambda urdf: without.sub("", urdf))).warnings
    assert [text for text in told if "no link behind a joint a mass" in text and "joint_compliance" in text]
    assert not [text for text in diagnose(sound).warnings if "a mass" in text]
