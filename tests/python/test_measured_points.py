"""Points that a tracker measured, whose frame and whose markers' mounts the session does not know: names, rows, units and
one large error among many small ones.

The body that is seen is that of the simulated robots, which share nothing with the core. What the model gets wrong is written
into its URDF, or into the log.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="the tracked session needs mirror_lab's robots")

from mirror_posture.diagnosis import Diagnosis, diagnose
from mirror_posture.diagnosis.formatting import numbers_in_words
from session_breaks.kinds import Rows, read, write
from tracked_chain import NO_ROLLS, write_chain
from tracked_session import POSTURES, write_tracked

SEED = 5
FRAME_FROM_ROOT = (
    np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]]),
    np.array([0.7, -1.2, 0.4]),
)
"""Where the tracker has the robot: a rotation and a shift, m."""


def unknown(folder: Path, mounts: bool = True) -> Path:
    """The session with its points in a frame of their own, and with `mounts` by nobody's measure."""
    turn, shift = FRAME_FROM_ROOT
    head, *rows = read(folder / "points.csv")
    for row in rows:
        row[2:] = map(repr, map(float, turn @ np.array(row[2:], float) + shift))
    write(folder / "points.csv", [head, *rows])
    told = (folder / "session.toml").read_text(encoding="utf-8")
    told = told.replace('frame = "base_link"', 'frame = "unknown"')
    if mounts:
        told = told.replace("diameter = 0.0", 'diameter = 0.0\nmount = "unknown"')
    (folder / "session.toml").write_text(told, encoding="utf-8")
    return folder


def changed(folder: Path, name: str, change: Callable[[list[str], Rows], Rows]) -> Path:
    head, *rows = read(folder / name)
    write(folder / name, [head, *change(head, rows)])
    return folder


def said(found: Diagnosis, least: float = 0.5) -> set[str]:
    return {f"{c.effect}@{c.at}" for c in found.causes if c.probability >= least}


def test_a_marker_on_another_link_is_found_in_an_unknown_frame(tmp_path: Path) -> None:
    folder = unknown(write_tracked(tmp_path / "s", SEED))
    model = (folder / "robot.urdf").read_text(encoding="utf-8")
    mount = '<joint name="r_forearm_marker_mount" type="fixed">'
    at = model.index("<parent", model.index(mount))
    own = model[at : model.index("/>", at)]
    assert own == '<parent link="r_forearm"', own
    other = model[:at] + '<parent link="r_upper_arm"' + model[at + len(own) :]
    (folder / "robot.urdf").write_text(other, encoding="utf-8")
    found = diagnose(folder)
    assert said(found) == {"marker_parent@marker:r_forearm<-link:r_forearm"}, found.sentence
    assert found.verdict == "explained" and "being fixed to link:r_forearm" in found.sentence


def y_negated(_head: list[str], rows: Rows) -> Rows:
    return [[*row[:3], repr(-float(row[3])), row[4]] for row in rows]


def test_points_in_a_left_handed_frame_are_no_joints_that_turn_the_other_way(tmp_path: Path) -> None:
    """An arm's mirror image is the arm with the signs of its joints about one direction reversed, up to its offsets."""
    folder = write_chain(tmp_path / "s", 36, {2: 0.03}, model_axes=NO_ROLLS)
    found = diagnose(changed(folder, "points.csv", y_negated))
    assert {"points_mirrored@data", "joint_offset@joint:a3"} <= said(found), found.sentence
    assert not any(c.effect in ("axis_sign", "link_length") for c in found.causes)
    assert "measured points in a left-handed frame" in found.sentence
    (zero,) = [c for c in found.causes if c.effect == "joint_offset"]
    assert abs(zero.parameters["offset_rad"].value - 0.03) < 0.003


def test_in_a_known_frame_the_coordinate_with_the_wrong_sign_is_told(tmp_path: Path) -> None:
    folder = write_tracked(tmp_path / "s", SEED)
    found = diagnose(changed(folder, "points.csv", y_negated))
    (mirrored,) = [c for c in found.causes if c.effect == "points_mirrored"]
    assert mirrored.parameters["axis"].value == 2.0 and mirrored.probability > 0.9, found.sentence
    assert found.verdict == "explained" and len(found.causes) == 1, found.sentence


def test_names_exchanged_in_a_run_of_rows_are_no_joint_that_stands_still(tmp_path: Path) -> None:
    folder = unknown(write_tracked(tmp_path / "s", SEED))
    other = {"r_hand": "r_forearm", "r_forearm": "r_hand"}

    def exchanged(head: list[str], rows: Rows) -> Rows:
        return [[row[0], other[row[1]], *row[2:]] if 30 <= int(row[0]) < 50 else row for row in rows]

    found = diagnose(changed(folder, "points.csv", exchanged))
    (swap,) = [c for c in found.causes if c.probability >= 0.5]
    assert (swap.effect, {*swap.at.split("<->")}) == (
        "markers_swapped",
        {"marker:r_hand", "marker:r_forearm"},
    )
    assert swap.parameters["share"].value == pytest.approx(20 / POSTURES, abs=0.02)
    assert numbers_in_words(swap.frames) == "30 to 49"
    assert numbers_in_words([7, 2, 1, 3, *range(10, 40, 2)]).startswith("1 to 3, 7, 10, 12, ")


def test_measurements_that_are_late_are_a_negative_delay(tmp_path: Path) -> None:
    """The log has each row's positions; the tracker's points are those of the row before."""
    folder = unknown(write_tracked(tmp_path / "s", SEED))

    def late(head: list[str], rows: Rows) -> Rows:
        return [[str(int(row[0]) + 1), *row[1:]] for row in rows if int(row[0]) + 1 < POSTURES]

    found = diagnose(changed(folder, "points.csv", late))
    (one,) = [c for c in found.causes if c.probability >= 0.5]
    assert (one.effect, one.at) == ("joint_late", "robot"), found.sentence
    assert one.parameters["delay_s"].value == pytest.approx(-2.0, abs=0.2)
    assert "late" in one.words and found.verdict == "explained"


@pytest.mark.parametrize("large_rad", [0.03, 0.0])
def test_a_large_zero_among_many_small_errors_is_a_cause(tmp_path: Path, large_rad: float) -> None:
    """Small errors everywhere can imitate it where it was not fitted, too, but only if all are larger."""
    found = diagnose(write_chain(tmp_path / "s", SEED, {3: large_rad}))
    named = [c for c in found.causes if c.effect != "geometry" and c.probability >= 0.5]
    assert [f"{c.effect}@{c.at}" for c in named] == (["joint_offset@joint:a4"] if large_rad else []), (
        found.sentence
    )
    assert found.verdict == "explained" and "geometry@robot" in said(found)
    if large_rad:
        value = named[0].parameters["offset_rad"]
        assert abs(value.value - large_rad) < 4.0 * value.std + 0.001, value


@pytest.mark.parametrize(("scale", "small"), [(1.004, 0.0), (1.0, 1.0)])
def test_lengths_that_are_all_off_by_one_factor_may_be_the_trackers_scale(
    tmp_path: Path, scale: float, small: float
) -> None:
    found = diagnose(write_chain(tmp_path / "s", SEED, {}, small=small, scale=scale, model_axes=NO_ROLLS))
    assert found.verdict == "explained", found.sentence
    hinted = [w for w in found.warnings if "one scale of all" in w]
    assert len(hinted) == int(scale != 1.0), found.warnings
    if hinted:
        percent = re.search(r"([+-][\d.]+) ± ([\d.]+) %", hinted[0])
        assert percent and abs(float(percent[1]) - 0.4) < 0.02, hinted


def test_noise_that_is_not_stated_is_asked_for(tmp_path: Path) -> None:
    """Points that scatter by 1 mm on each axis: no view measures that."""
    folder = unknown(write_tracked(tmp_path / "s", SEED))
    told = (folder / "session.toml").read_text(encoding="utf-8")
    (folder / "session.toml").write_text(told[: told.index("[noise]")], encoding="utf-8")
    rng = np.random.default_rng(3)

    def noisy(head: list[str], rows: Rows) -> Rows:
        return [[*row[:2], *(repr(float(x) + rng.normal(0.0, 0.001)) for x in row[2:])] for row in rows]

    found = diagnose(changed(folder, "points.csv", noisy))
    assert not said(found), found.sentence
    asked = [w for w in found.warnings if "point_std" in w]
    assert found.verdict == "unknown" and len(asked) == 1, found.warnings
    assumed, left = (float(x) for x in re.findall(r"([\d.]+) mm", asked[0]))
    assert assumed == 0.5 and left == pytest.approx(1.0, abs=0.1), asked
