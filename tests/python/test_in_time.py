"""What changes in the middle of a session, and what only looks like it; boards that are not flat; files of another camera.

The body that is seen is that of the simulated robots, which share nothing with the core. Board and camera stand where hands
put them: a few millimetres and half a degree beside the model, of which the session says nothing.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the mirrored session needs mirror_lab's robots")

from mirror_posture.diagnosis import Diagnosis, diagnose
from mirror_posture.diagnosis.next_step import next_step
from mirrored_session import write_mirrored
from session_breaks.kinds import Rows, read, write

SEED = 8
SEED_OF_TWO = 21
POSTURES = 60
COLUMNS = 6
"""Corners of the embedded robot's board in a row."""
MARKER = '<joint name="r_hand_marker_mount" type="fixed">\n    <origin xyz='
BY_HAND = {
    '"0.034 0 0.047" rpy="1.57079632679 0 1.57079632679"': '"0.036 0.002 0.0455" rpy="1.5788 0.006 1.5655"',
    f'{MARKER}"0 0 -0.0635"': f'{MARKER}"0.001 -0.0015 -0.0625"',
}
"""The board and the marker on the hand, as the body has them."""
HAND_OFF = {f'{MARKER}"0.001 -0.0015 -0.0625"': f'{MARKER}"0.005 -0.0055 -0.0605"'}
"""The marker on the hand once something has pushed it."""


def by_hand(urdf: str, further: dict[str, str] | None = None) -> str:
    for old, new in {**BY_HAND, **(further or {})}.items():
        assert urdf.count(old) == 1, old
        urdf = urdf.replace(old, new)
    return urdf


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_mirrored(tmp_path_factory.mktemp("sound") / "s", SEED, postures=POSTURES, built=by_hand)


@pytest.fixture(scope="module")
def of_sound(sound: Path) -> Diagnosis:
    return diagnose(sound)


def changed(whole: Path, folder: Path, name: str, change: Callable[[list[str], Rows], Rows]) -> Path:
    shutil.copytree(whole, folder)
    head, *rows = read(folder / name)
    write(folder / name, [head, *change(head, rows)])
    return folder


def test_a_marker_that_was_pushed_and_put_back_is_named_with_both_rows(sound: Path, tmp_path: Path) -> None:
    pushed = write_mirrored(
        tmp_path / "pushed", SEED, postures=POSTURES, built=lambda u: by_hand(u, HAND_OFF)
    )
    _, *off = read(pushed / "detections.csv")
    first, behind = 50, 81

    def run(head: list[str], rows: Rows) -> Rows:
        def is_off(row: list[str]) -> bool:
            return row[1] == "r_hand" and first <= int(row[0]) < behind

        return [row for row in rows if not is_off(row)] + [row for row in off if is_off(row)]

    found = diagnose(changed(sound, tmp_path / "s", "detections.csv", run))
    slips = [cause for cause in found.causes if cause.effect == "slip"]
    assert found.verdict == "explained" and [slip.at for slip in slips] == ["marker:r_hand"] * 2, (
        found.sentence
    )
    for told in (found.sentence, next_step(found)):
        assert told.count("slip at") == 1, told
    there, back = sorted(slips, key=lambda slip: slip.parameters["first_frame"].value)
    assert abs(there.parameters["first_frame"].value - first) <= 1
    assert abs(back.parameters["first_frame"].value - behind) <= 1
    motion = np.array([there.parameters[f"d{axis}_m"].value for axis in "xyz"])
    assert np.abs(motion - [0.004, -0.004, 0.002]).max() < 5e-4, motion
    again = np.array([back.parameters[f"d{axis}_m"].value for axis in "xyz"])
    assert np.abs(motion + again).max() < 5e-4, again


def test_two_markers_that_slip_have_their_own_motions_and_mounts(tmp_path: Path) -> None:
    """The motions of slips are free in every model: they must not take a mount's part, and leave out the rows before."""
    forearm = '<joint name="r_forearm_marker_mount" type="fixed">\n    <origin xyz='
    fore_off = {f'{forearm}"0.0134 0 -0.019"': f'{forearm}"0.0184 0 -0.023"'}
    folder = write_mirrored(tmp_path / "s", SEED_OF_TWO, postures=POSTURES, built=by_hand)
    for name, off, first, behind in (("r_hand", HAND_OFF, 20, 45), ("r_forearm", fore_off, 70, 10**6)):
        there = tmp_path / name
        write_mirrored(there, SEED_OF_TWO, postures=POSTURES, built=lambda u, off=off: by_hand(u, off))
        _, *moved = read(there / "detections.csv")

        def is_off(row: list[str], name: str = name, first: int = first, behind: int = behind) -> bool:
            return row[1] == name and first <= int(row[0]) < behind

        head, *rows = read(folder / "detections.csv")
        kept = [row for row in rows if not is_off(row)] + [row for row in moved if is_off(row)]
        write(folder / "detections.csv", [head, *kept])
    found = diagnose(folder)
    assert found.verdict == "explained" and not found.data.left_out, found.sentence
    slips = {
        (c.at, round(c.parameters["first_frame"].value)): np.array(
            [c.parameters[f"d{axis}_m"].value for axis in "xyz"]
        )
        for c in found.causes
        if c.effect == "slip"
    }
    hand, fore = np.array([0.004, -0.004, 0.002]), np.array([0.005, 0.0, -0.004])
    expected = {("marker:r_hand", 20): hand, ("marker:r_hand", 45): -hand, ("marker:r_forearm", 70): fore}
    assert slips.keys() == expected.keys(), found.sentence
    for which, motion in expected.items():
        assert np.abs(slips[which] - motion).max() < 2e-4, (which, slips[which])


def test_a_joint_that_warms_up_is_no_slip_of_anything(tmp_path: Path) -> None:
    rows: Iterator[int] = count()

    def warm(q: dict[str, float]) -> dict[str, float]:
        return {**q, "r_shoulder_pitch": q["r_shoulder_pitch"] + 0.04 * (1 - math.exp(-next(rows) / 7.0))}

    folder = write_mirrored(tmp_path / "s", SEED, warm, POSTURES, built=by_hand)
    found = diagnose(folder)
    assert found.verdict in ("partial", "unknown"), found.sentence
    assert not [c for c in found.causes if c.effect == "slip" and c.probability > 0.5], found.causes


def bent(per_frame: Callable[[int], float]) -> Callable[[list[str], Rows], Rows]:
    """Corners beside where a flat board has them, as the square of their column, up to 0.9 px."""

    def change(head: list[str], rows: Rows) -> Rows:
        index = head.index("index")
        for row in rows:
            if row[1] == "board":
                x = (int(row[index]) % COLUMNS) / (COLUMNS - 1) * 2 - 1
                row[4] = repr(float(row[4]) + per_frame(int(row[0])) * 0.9 * (x * x - 1 / 3))
        return rows

    return change


def test_a_bent_board_is_not_nothing(sound: Path, of_sound: Diagnosis, tmp_path: Path) -> None:
    assert "flat" not in of_sound.sentence
    found = diagnose(changed(sound, tmp_path / "s", "detections.csv", bent(lambda frame: 1.0)))
    assert found.verdict in ("unknown", "partial") and "beside a flat grid" in found.sentence, found.sentence
    assert next(place for place in found.where if place.at == "board").depends_on == "nothing"
    shape = found.fields[0]
    assert (shape.at, shape.over) == ("board", "board") and len(shape.at_points) == 30


def test_a_board_that_flutters_is_not_nothing(sound: Path, tmp_path: Path) -> None:
    sign = np.random.default_rng(3).normal(size=2 * POSTURES)
    found = diagnose(
        changed(sound, tmp_path / "s", "detections.csv", bent(lambda frame: 1.5 * float(sign[frame])))
    )
    assert found.verdict in ("unknown", "partial"), found.sentence
    assert "in each picture in another way" in " ".join([found.sentence, *found.warnings]), found.sentence


def test_corners_found_beside_their_place_are_left_out_and_no_bent_board(
    sound: Path, of_sound: Diagnosis, tmp_path: Path
) -> None:
    rng = np.random.default_rng(11)
    off: list[tuple[int, str]] = []

    def some(head: list[str], rows: Rows) -> Rows:
        for row in rows:
            if row[1] == "board" and rng.random() < 0.005:
                row[3], row[4] = (
                    repr(float(row[k]) + (12.0 if rng.random() < 0.5 else -12.0)) for k in (3, 4)
                )
                off.append((int(row[0]), row[head.index("index")]))
        return rows

    found = diagnose(changed(sound, tmp_path / "s", "detections.csv", some))
    told = [one for one in found.data.left_out if one.target == "board"]
    assert [(one.frame, one.why.split()[1]) for one in told] == off and len(off) > 8, told
    assert found.verdict == "explained" == of_sound.verdict, found.sentence
    assert "bent" not in " ".join([found.sentence, *found.warnings])


def test_a_file_of_another_crop_is_one_mistake_of_the_file(sound: Path, tmp_path: Path) -> None:
    """Another resolution explains most of it at first, and a focal length would then undo its factor."""
    folder = tmp_path / "s"
    shutil.copytree(sound, folder)
    camera = folder / "camera.yaml"
    lines = camera.read_text(encoding="utf-8")
    data = next(line for line in lines.splitlines() if "data:" in line)
    numbers = [float(x) for x in data[data.index("[") + 1 : data.index("]")].split(",")]
    moved = [*numbers[:2], numbers[2] + 100.0, *numbers[3:5], numbers[5] + 75.0, *numbers[6:]]
    camera.write_text(lines.replace(data, data[: data.index("[")] + str(moved) + data[data.index("]") + 1 :]))
    found = diagnose(folder)
    told = [cause for cause in found.causes if cause.at == "camera" and cause.effect != "camera_mount"]
    assert [cause.effect for cause in told] in (["camera_resolution"], ["camera_center"]), told
    assert abs(told[0].parameters["du_px"].value + 100.0) < 4.0, told[0].parameters
    assert abs(told[0].parameters["dv_px"].value + 75.0) < 4.0, told[0].parameters


def test_a_column_in_half_turns_is_another_unit_beside_mounts_by_hand(sound: Path, tmp_path: Path) -> None:
    def half_turns(head: list[str], rows: Rows) -> Rows:
        at = head.index("r_shoulder_roll")
        for row in rows:
            row[at] = repr(float(row[at]) / math.pi)
        return rows

    found = diagnose(changed(sound, tmp_path / "s", "frames.csv", half_turns))
    told = {(cause.effect, cause.at) for cause in found.causes}
    assert ("joint_unit", "joint:r_shoulder_roll") in told, told
    assert not [1 for effect, _ in told if effect == "gear_ratio"], told
