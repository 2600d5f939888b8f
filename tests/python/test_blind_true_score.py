"""The blind score on sessions whose score is known: pictures, mounts by hand, mistakes that nothing shows, an effect left out."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")

from mirror_lab.blind.comparison import Scored, invented, mixed_verdict, normalised_errors, outside_verdict
from mirror_lab.blind.first_day_score import outcome
from mirror_lab.blind.make import make_cases
from mirror_lab.blind.score import score
from mirror_lab.blind.seal import seal
from mirror_lab.blind.shrinkage import load_pixels, reference_of_folder
from mirror_lab.blind.simulate import Options

SHOWN = {"identifiable": True, "detectable": True, "rivals": []}


def _session(
    folder: Path, name: str, truths: list[dict[str, Any]], verdict: str, said: list[str], **more: Any
) -> None:
    """A session and its result; `said`: names of causes, all at 0.9."""
    (folder / "cases" / name).mkdir(parents=True)
    answer = {"id": name, "causes": truths, **more}
    seal(answer, folder / "cases" / "answers" / f"{name}.json", folder / "cases" / name / "seal.json")
    (folder / "results" / name).mkdir(parents=True)
    causes = [
        dict(zip(("effect", "at"), each.split("@"), strict=True)) | {"probability": 0.9, "parameters": {}}
        for each in said
    ]
    document = {"format": "mirror-posture/diagnosis", "version": 2, "verdict": verdict, "causes": causes}
    (folder / "results" / name / "diagnosis.json").write_text(json.dumps(document | {"where": []}))


def test_an_image_column_is_no_joint(tmp_path: Path) -> None:
    """Before, a session with pictures and a cause ended the score."""
    options = Options(robots=("small",), frames=(24, 25), least_postures=12)
    (session,) = make_cases(tmp_path, 1, 8, options, [("one", "small", ("joint_offset",))])
    answer = json.loads((tmp_path / "answers" / "one.json").read_text(encoding="utf-8"))
    pixels = load_pixels(tmp_path / "answers" / "one.npz", answer["pixels_sha256"])
    plain = reference_of_folder(session, pixels, answer)
    with (session / "frames.csv").open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    with (session / "frames.csv").open("w", encoding="utf-8", newline="") as file:
        after = header.index("time_s") + 1
        told = [[*row[:after], f"images/{row[0]}.png", *row[after:]] for row in rows]
        csv.writer(file).writerows([[*header[:after], "image", *header[after:]], *told])
    pictured = reference_of_folder(session, pixels, answer)
    assert pictured.commands.joints == plain.commands.joints
    assert np.array_equal(pictured.commands.q_rad, plain.commands.q_rad)


HAND: dict[str, Any] = {
    "setup": [{"effect": "board_mount", "at": "board", "dx_m": 0.003}],
    "zeros_rad": {"j": 0.0026, "k": -0.001},
}


def test_mounts_by_hand_are_true_and_zeros_add_to_a_wrong_zero() -> None:
    truth = {"effect": "joint_offset", "at": "joint:j", "offset_rad": 0.03}
    value = {"value": 0.0326, "std": 0.0005}
    said = [
        {"effect": "joint_offset", "at": "joint:j", "probability": 0.99, "parameters": {"offset_rad": value}},
        {"effect": "board_mount", "at": "board", "probability": 0.99, "parameters": {}},
        {"effect": "geometry", "at": "robot", "probability": 0.99, "parameters": {}},
        {"effect": "camera_mount", "at": "camera", "probability": 0.99, "parameters": {}},
    ]
    case = Scored("hand", {"causes": [truth], **HAND}, {"verdict": "explained", "causes": said})
    assert [c["effect"] for c in invented(case)] == ["camera_mount"], "this one was not displaced"
    assert normalised_errors(case) == [pytest.approx(0.0, abs=1e-9)]
    alone = Scored("exact", {"causes": [truth]}, {"verdict": "explained", "causes": said[:1]})
    assert normalised_errors(alone) == [pytest.approx(5.2)]


def test_a_session_by_hand_without_a_cause_is_no_false_alarm(tmp_path: Path) -> None:
    _session(tmp_path, "exact", [], "explained", ["drift@joint:j"])
    _session(tmp_path, "hand", [], "explained", ["board_mount@board"], **HAND)
    _session(tmp_path, "wrong", [], "explained", ["board_mount@board", "drift@joint:j"], **HAND)
    gear = {"effect": "gear_ratio", "at": "joint:j", "scale_error": 0.1, **SHOWN}
    _session(tmp_path, "gear", [gear], "explained", ["gear_ratio@joint:j", "board_mount@board"], **HAND)
    got = score(tmp_path / "cases", tmp_path / "results")
    assert (got["false_alarms"]["hits"], got["false_alarms"]["of"]) == (1, 1)
    assert got["by_hand"]["none_only_set_up"]["hits"] == 1 and got["by_hand"]["none_only_set_up"]["of"] == 2
    assert got["single_identifiable_right"]["hits"] == 1
    assert {f["session"] for f in got["failures"]} == {"exact", "wrong"}


def _beside_mounts(verdict: str, where: list[dict[str, Any]], said: list[str]) -> dict[str, bool]:
    causes = [dict(zip(("effect", "at"), name.split("@"), strict=True)) for name in said]
    truth = {"effect": "unknown", "at": "joint:j", "kind": "knee", **SHOWN}
    document = {"verdict": verdict, "causes": causes, "where": where}
    return outside_verdict(Scored("hand", {"causes": [truth], **HAND}, document))


def test_what_has_no_name_is_met_at_its_place_beside_mounts_of_larger_shares() -> None:
    mounts = [{"at": "board", "share": 0.8}, {"at": "robot", "share": 0.1}]
    at_joint = {"at": "joint:j", "share": 0.1, "depends_on": "position"}
    named = ["board_mount@board", "geometry@robot"]
    met = _beside_mounts("partial", [*mounts, at_joint], named)
    assert met["met"] and not met["false_cause"], "mounts that are displaced are no false causes"
    elsewhere = _beside_mounts("partial", [*mounts, {**at_joint, "at": "joint:k"}], named)
    assert not elsewhere["met"] and elsewhere["abstained"]
    assert not _beside_mounts("partial", mounts, named)["met"]
    false = _beside_mounts("partial", [*mounts, at_joint], [*named, "gear_ratio@joint:j"])
    assert false["met"] and false["false_cause"] and not false["confidently_wrong"]
    wrong = _beside_mounts("explained", [*mounts, {"at": "joint:j", "share": 0.1}], [*named, "drift@joint:j"])
    assert wrong["confidently_wrong"] and not wrong["met"]
    assert not _beside_mounts("explained", mounts, named)["confidently_wrong"]


def test_what_has_no_name_beside_a_cause_is_met_at_its_place(tmp_path: Path) -> None:
    gear = {"effect": "gear_ratio", "at": "joint:k", **SHOWN}
    knee = {"effect": "unknown", "at": "joint:j", "kind": "knee", **SHOWN}
    at_gear, at_knee = (
        {"at": "joint:k", "share": 0.8},
        {"at": "joint:j", "share": 0.2, "depends_on": "position"},
    )

    def told(verdict: str, where: list[dict[str, Any]], said: list[str]) -> dict[str, bool]:
        causes = [dict(zip(("effect", "at"), name.split("@"), strict=True)) for name in said]
        document = {"verdict": verdict, "causes": causes, "where": where}
        return mixed_verdict(Scored("mixed", {"causes": [gear, knee]}, document))

    met = told("partial", [at_gear, at_knee], ["gear_ratio@joint:k"])
    assert met == {"met": True, "false_cause": False, "confidently_wrong": False}
    elsewhere = told("partial", [at_gear, {**at_knee, "at": "joint:m"}], ["gear_ratio@joint:k"])
    assert not elsewhere["met"]
    pieces = told("explained", [at_gear], ["gear_ratio@joint:k", "drift@joint:j"])
    assert pieces == {"met": False, "false_cause": True, "confidently_wrong": True}
    for name, said in (("found", ["gear_ratio@joint:k"]), ("lost", [])):
        _session(tmp_path, name, [gear, knee], "partial", said, **HAND)
    got = score(tmp_path / "cases", tmp_path / "results")
    assert (got["mixed_named_found"]["hits"], got["mixed_named_found"]["of"]) == (1, 2)
    assert (got["mixed_place"]["hits"], got["mixed_place"]["of"]) == (0, 2)
    assert got["mixed_explained"]["hits"] == got["mixed_false_cause"]["hits"] == 0
    assert got["outside_met"]["of"] == got["several_identifiable_found"]["of"] == 0
    hand = got["by_hand"]
    assert hand["single_named"]["of"] == hand["several_named"]["of"] == 0, "what has no name cannot be named"
    assert [w["session"] for w in hand["wrong"]] == ["lost"]


def _told(truths: list[dict[str, Any]], verdict: str, said: list[str], where: str = "camera") -> str:
    causes = [dict(zip(("effect", "at"), name.split("@"), strict=True)) for name in said]
    document = {"verdict": verdict, "causes": causes, "where": [{"at": where}] if verdict != "none" else []}
    return outcome(Scored("case", {"causes": truths}, document))


def test_a_mistake_that_nothing_shows_is_named_only_where_it_is_told() -> None:
    spring = {"effect": "joint_compliance", "at": "joint:e", **SHOWN}
    upside = {"effect": "gravity_direction", "at": "robot", "mistake": "gravity_sign", "identifiable": False}
    both = [spring, upside]
    assert _told(both, "explained", ["joint_compliance@joint:e", "gravity_direction@robot"]) == "named"
    assert _told(both, "explained", ["gravity_direction@robot"]) == "named"
    assert _told(both, "none", []) == "silent"
    assert _told(both, "explained", ["joint_compliance@joint:e"]) == "silent"
    assert _told(both, "unknown", []) == "elsewhere"
    assert _told(both, "unknown", [], "joint:e") == "abstained"
    assert _told(both, "explained", ["gravity_direction@robot", "drift@joint:e"]) == "misled"


def test_of_a_thing_in_the_background_none_is_right() -> None:
    thing = {
        "effect": "unknown", "at": "marker:m", "mistake": "thing_in_the_background", "identifiable": False,
    }  # fmt: skip
    assert _told([thing], "none", []) == "named"
    assert _told([thing], "unknown", [], "marker:m") == "abstained"
    assert _told([thing], "unknown", [], "camera") == "elsewhere"
    assert _told([thing], "explained", ["marker_mount@marker:m"]) == "misled"


@pytest.mark.parametrize("left_out", ["drift", "joint_offset"])
def test_one_of_several_left_out_is_counted_apart(tmp_path: Path, left_out: str) -> None:
    """Before, the score ended, or judged the session by its first cause."""
    two = [
        {"effect": "joint_offset", "at": "joint:a", "offset_rad": 0.02, **SHOWN},
        {"effect": "drift", "at": "joint:c", "rate_rad_per_s": 1e-4, **SHOWN},
    ]
    _session(tmp_path, "two", two, "explained", ["joint_offset@joint:a"])
    _session(tmp_path, "one", two[:1], "explained", ["joint_offset@joint:a"], **SHOWN)
    got = score(tmp_path / "cases", tmp_path / "results", left_out)
    assert got["left_out_of_several"] == ["two"] and got["several_identifiable_found"]["of"] == 0
    assert got["outside_met"]["of"] == (left_out == "joint_offset") and got["sessions"] == 1
