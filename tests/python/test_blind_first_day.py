"""Blind sessions mounted by hand and with whole mistakes: what is written, what can be told, and what is counted."""

from __future__ import annotations

import csv
import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")

from mirror_lab.blind.accidents import ACCIDENTS
from mirror_lab.blind.comparison import Scored
from mirror_lab.blind.first_day_score import by_hand, first_day, outcome
from mirror_lab.blind.make import draw_causes, make_cases
from mirror_lab.blind.mistakes import MISTAKES, SLIPS
from mirror_lab.blind.mounting import _matrix, _rigid, draw_mounting
from mirror_lab.blind.setup_judge import judge_by_hand
from mirror_lab.blind.simulate import KINDS, Options, simulate
from mirror_lab.blind.write import write_session

QUICK = Options(robots=("small",), frames=(50, 51), least_postures=25)
BY_HAND = Options(robots=("small",), frames=(50, 51), least_postures=25, by_hand=True)


@pytest.mark.parametrize("kind", ["small", "ur10"])
def test_what_is_told_of_the_mounts_is_where_board_and_camera_really_are(kind: str) -> None:
    rng = np.random.default_rng(4)
    robot = KINDS[kind](rng)
    mounting = draw_mounting(rng, robot)
    board, camera = (
        _matrix(
            np.array([t[k] for k in ("rx_rad", "ry_rad", "rz_rad")]),
            np.array([t[k] for k in ("dx_m", "dy_m", "dz_m")]),
        )
        for t in mounting.answer(robot)[:2]
    )
    (body, at_board), (own, at_camera) = (
        _rigid(robot, link) for link in (robot.board_link, robot.camera_link)
    )
    real_camera = at_camera @ _matrix(*mounting.camera)
    # In the public words: the board's mount carries a camera on its body along; then the camera against the board.
    carried = at_board @ board @ np.linalg.inv(at_board) @ at_camera if body == own else at_camera
    np.testing.assert_allclose(carried @ camera, real_camera, atol=1e-12)
    np.testing.assert_allclose(at_board @ board, at_board @ _matrix(*mounting.board), atol=1e-12)


def test_a_mistake_on_a_set_up_by_hand_is_made_with_both_in_its_answer(tmp_path: Path) -> None:
    (made,) = make_cases(tmp_path, 1, 9, BY_HAND, [("case", "small", ["degrees"])])
    answer = json.loads((tmp_path / "answers" / f"{made.name}.json").read_text())
    assert [c["effect"] for c in answer["causes"]] == ["joint_unit"] and answer["causes"][0]["identifiable"]
    assert {"board_mount", "camera_mount"} <= {s["effect"] for s in answer["setup"]}


def test_with_the_set_up_free_a_gear_is_told_and_a_last_joints_zero_is_not() -> None:
    gear = simulate("case", "small", ["gear_ratio"], np.random.default_rng(11), BY_HAND)
    assert gear.mounting is not None
    assert judge_by_hand(gear, gear.mounting)["identifiable"] == gear.answer["causes"][0]["identifiable"]
    assert gear.answer["causes"][0]["gain"] > 100
    zero = simulate("case", "small", ["joint_offset"], np.random.default_rng(2), BY_HAND)
    assert zero.answer["causes"][0]["at"].endswith("_wrist") and zero.mounting is not None
    judge_by_hand(zero, zero.mounting)
    (cause,) = zero.answer["causes"]
    assert not cause["identifiable"], "the hand's marker may sit elsewhere instead"


def test_beside_mounts_by_hand_it_is_judged_whether_an_unnamed_law_shows_and_is_no_gear() -> None:
    harmonics = simulate("case", "small", ["second_harmonic"], np.random.default_rng(4), BY_HAND)
    assert harmonics.mounting is not None
    imitated = judge_by_hand(harmonics, harmonics.mounting)
    assert imitated["detectable"] and not imitated["identifiable"]
    assert imitated["rivals"] == ["gear_eccentricity@joint:r_shoulder_roll"]
    case = simulate("case", "small", ["warm_up"], np.random.default_rng(4), BY_HAND)
    assert case.mounting is not None
    large = judge_by_hand(case, case.mounting)
    assert large["identifiable"] and not large["rivals"] and large["chi2_left"] > 1000, large
    coarse = replace(case.noise, corner_px=100.0, blob_px=100.0)
    small = judge_by_hand(replace(case, noise=coarse), case.mounting)
    assert not small["detectable"] and not small["identifiable"] and small["chi2_left"] < 10, small


def _written(kind: str, folder: Path, seed: int = 3) -> tuple[Any, list[dict[str, str]]]:
    case = simulate("case", "small", [kind], np.random.default_rng(seed), QUICK)
    write_session(case, folder)
    with (folder / "frames.csv").open(encoding="utf-8", newline="") as file:
        return case, list(csv.DictReader(file))


@pytest.mark.parametrize("kind", [*MISTAKES, *SLIPS])
def test_every_mistake_is_made_and_named_in_the_public_words(kind: str, tmp_path: Path) -> None:
    case, rows = _written(kind, tmp_path)
    causes = case.answer["causes"]
    assert causes and all(c["mistake"] == kind and c["at"] for c in causes)
    joints, q = case.plan.commands.joints, case.plan.commands.q_rad[case.plan.posture_of_frame]
    told = np.array([[float(row[j]) for j in joints] for row in rows])
    moved = [j for k, j in enumerate(joints) if np.abs(told[:, k] - q[:, k]).max() > 1e-3]
    places = {
        p.removeprefix("joint:") for c in causes for p in c["at"].split("<->") if p.startswith("joint:")
    }
    if kind in ("axis_sign", "marker_parent"):
        assert not moved and (tmp_path / "robot.urdf").read_text(encoding="utf-8") != case.robot.urdf
    elif kind in ("all_degrees", "clock_late"):
        assert set(moved) >= {j for k, j in enumerate(joints) if np.ptp(q[:, k]) > 0}
    else:
        assert set(moved) == places
    # Rows of one posture tell the same commands.
    by_posture: dict[str, set[tuple[float, ...]]] = {}
    for row, values in zip(rows, told, strict=True):
        by_posture.setdefault(row["posture"], set()).add(tuple(values))
    assert all(len(commands) == 1 for commands in by_posture.values())


def test_a_turned_axis_is_that_joints_alone(tmp_path: Path) -> None:
    case, _ = _written("axis_sign", tmp_path)
    joint = case.answer["causes"][0]["at"].removeprefix("joint:")
    axes = [
        {
            j.get("name"): axis.get("xyz")
            for j in ET.fromstring(text).findall("joint")
            if (axis := j.find("axis")) is not None
        }
        for text in (case.robot.urdf, (tmp_path / "robot.urdf").read_text(encoding="utf-8"))
    ]
    changed = [name for name in axes[0] if axes[0][name] != axes[1][name]]
    assert changed == [joint]


def test_a_slip_shows_from_its_row_on() -> None:
    for kind in SLIPS:
        still = simulate("case", "small", [], np.random.default_rng(8), QUICK)
        case = simulate("case", "small", [kind], np.random.default_rng(8), QUICK)
        (cause,) = case.answer["causes"]
        moved = np.abs(case.clean_blobs_px - still.clean_blobs_px).max(axis=(1, 2)) > 0.01
        moved |= np.abs(case.clean_corners_px - still.clean_corners_px).max(axis=(1, 2)) > 0.01
        assert not moved[: cause["first_frame"]].any() and moved[cause["first_frame"] :].all(), kind


def test_the_same_seed_makes_the_same_mistakes_and_set_ups(tmp_path: Path) -> None:
    few = Options(robots=("small",), frames=(20, 21), least_postures=10)
    for name, options in (("hand", replace(few, by_hand=True)), ("day", replace(few, mistakes=True))):
        (one,), (two,) = (make_cases(tmp_path / name / k, 1, 9, options) for k in "ab")
        answers = [
            json.loads((f.parent / "answers" / f"{f.name}.json").read_text(encoding="utf-8"))
            for f in (one, two)
        ]
        assert [a.pop("salt", None) is not None for a in answers] and answers[0]["causes"] == answers[1][
            "causes"
        ]
        assert (one / "frames.csv").read_bytes() == (two / "frames.csv").read_bytes()
    drawn = [draw_causes(np.random.default_rng(s), Options(mistakes=True), ["drift"]) for s in range(300)]
    assert {k for kinds in drawn for k in kinds} >= {*MISTAKES, *SLIPS}, "all kinds are drawn"


def _scored(
    truths: list[dict[str, Any]],
    said: list[str],
    verdict: str = "explained",
    where: str = "robot",
    **answer: Any,
) -> Scored:
    causes = [
        dict(zip(("effect", "at"), name.split("@"), strict=True)) | {"probability": 0.9, "parameters": {}}
        for name in said
    ]
    document = {"verdict": verdict, "causes": causes, "where": [{"at": where, "share": 1.0}]}
    return Scored("case", {"causes": truths, **answer}, document)


SWAP = {
    "effect": "joints_swapped",
    "at": "joint:a<->joint:b",
    "mistake": "joints_swapped",
    "identifiable": True,
    "rivals": [],
}
SMALL = {"effect": "gear_ratio", "at": "joint:c", "identifiable": True, "rivals": []}


def test_named_silent_abstained_and_misled_are_told_apart() -> None:
    assert outcome(_scored([SWAP], ["joints_swapped@joint:b<->joint:a"])) == "named"
    assert outcome(_scored([SWAP, SMALL], ["joints_swapped@joint:a<->joint:b"])) == "named"
    assert outcome(_scored([SWAP], ["joints_swapped@joint:a<->joint:b", "drift@joint:d"])) == "misled"
    assert outcome(_scored([SWAP], ["geometry@robot"])) == "misled"
    assert outcome(_scored([SWAP], [], "none")) == "silent"
    assert outcome(_scored([SWAP], [], "unknown", "joint:a")) == "abstained"
    assert outcome(_scored([SWAP], [], "unknown", "joint:d")) == "elsewhere"
    counted = first_day([_scored([SWAP, SMALL], ["joints_swapped@joint:a<->joint:b"])])
    assert (
        counted is not None and counted["small_cause_found"]["hits"] == 0 and counted["misled"]["hits"] == 0
    )


def test_zeros_that_are_a_little_off_are_small_errors_everywhere() -> None:
    told = ["joints_swapped@joint:a<->joint:b", "geometry@robot"]
    hand = {"setup": [{"effect": "board_mount", "at": "board", "dx_m": 0.003}]}
    assert outcome(_scored([SWAP], told, **hand)) == "misled"
    assert outcome(_scored([SWAP], told, **hand, zeros_rad={"c": 0.002})) == "named"


def test_a_set_up_beside_a_cause_is_no_invention_and_something_else_is() -> None:
    hand = {"setup": [{"effect": "board_mount", "at": "board", "dx_m": 0.003}]}
    right = _scored([SMALL], ["gear_ratio@joint:c", "board_mount@board", "geometry@robot"], **hand)
    right.causes[1]["parameters"]["dx_m"] = {"value": 0.0031, "std": 0.0001}
    wrong = _scored([], ["drift@joint:c"], **hand)
    counted = by_hand([right, wrong])
    assert counted is not None
    assert counted["single_named_with_only_set_up"]["hits"] == 1 and counted["none_only_set_up"]["hits"] == 0
    assert counted["mounts"]["within_95"]["of"] == 1


@pytest.mark.parametrize("kind", sorted(ACCIDENTS))
def test_an_accident_spoils_what_is_told_and_leaves_what_was_done(kind: str, tmp_path: Path) -> None:
    true, spoilt = (
        simulate("case", "small", draws, np.random.default_rng(6), QUICK) for draws in ([], [kind])
    )
    assert spoilt.told is not None
    told, done = spoilt.told.q, true.plan.commands.q_rad[true.plan.posture_of_frame]
    pixels = [np.nan_to_num(c.blobs_px) for c in (true, spoilt)]
    of_log = kind.startswith(("column", "log", "zero"))
    assert np.array_equal(told, done) == (not of_log)
    assert np.array_equal(*pixels) == of_log
    if kind.startswith("column_") or kind == "zero_lost":
        place = spoilt.answer["causes"][0]["at"].removeprefix("joint:")
        changed = np.flatnonzero(np.any(told != done, axis=0))
        assert [spoilt.plan.commands.joints[i] for i in changed] == [place]
    made = write_session(spoilt, tmp_path / "case")
    assert (tmp_path / "case" / "frames.csv").is_file(), made


def test_an_accident_without_a_word_is_met_by_abstaining_at_its_place() -> None:
    lost = {"effect": "unknown", "at": "joint:a", "mistake": "column_noisy", "identifiable": True}
    lost["tolerated"] = [{"effect": "joint_frozen", "at": "joint:a"}]
    assert outcome(_scored([lost], [], "unknown", "joint:a")) == "abstained"
    assert outcome(_scored([lost], ["joint_frozen@joint:a"])) == "named"
    assert outcome(_scored([lost], ["joint_offset@joint:a"])) == "misled"
    assert outcome(_scored([lost], [], "none")) == "silent"
    # Of two exchanges one is not enough.
    pairs = [
        {"effect": "markers_swapped", "at": f"marker:{p}"}
        for p in ("a<->marker:b", "b<->marker:c", "a<->marker:c")
    ]
    circle = [p | {"mistake": "markers_circle", "identifiable": True, "tolerated": pairs} for p in pairs[:2]]
    names = [f"{p['effect']}@{p['at']}" for p in pairs]
    assert outcome(_scored(circle, names[1:])) == "named"
    assert outcome(_scored(circle, names[2:])) == "misled"
