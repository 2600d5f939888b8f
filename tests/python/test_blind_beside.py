"""What comes beside causes and mistakes: small errors, mounts, joints that rest elsewhere, effects without a name; and the names of two sides."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")

from mirror_lab.blind import make
from mirror_lab.blind.effects import VOCABULARY
from mirror_lab.blind.imperfect import GEAR_RAD
from mirror_lab.blind.make import make_cases
from mirror_lab.blind.mistakes import Told, column_of, left_right, told_truly
from mirror_lab.blind.mounting import TURN_RAD
from mirror_lab.blind.outside import OUTSIDE
from mirror_lab.blind.simulate import KINDS, Case, Options, simulate
from mirror_lab.blind.views import plan_postures

QUICK = Options(robots=("small",), frames=(40, 41), least_postures=20)


def _made_out_of_step(
    folder: Path, effects: list[str], monkeypatch: pytest.MonkeyPatch
) -> tuple[Case, dict[str, Any], int]:
    """A session with small errors as it is written, its sealed answer, and how many were simulated.

    A session without small errors has other values after its mirrors are placed, as it happens where other frames are seen.
    """
    made: list[Case] = []

    def simulated(name: str, kind: str, draws: Any, rng: np.random.Generator, options: Options) -> Case:
        made.append(simulate(name, kind, draws, rng, options))
        if options.imperfect == 0.0:
            for cause in made[-1].answer["causes"]:
                cause |= {k: -v for k, v in cause.items() if k in ("offset_rad", "last_frame")}
        return made[-1]

    monkeypatch.setattr(make, "simulate", simulated)
    make_cases(folder, 1, 1, replace(QUICK, imperfect=1.0), [("one", "small", effects)])
    answer = json.loads((folder / "answers" / "one.json").read_text(encoding="utf-8"))
    assert answer["small"]
    return made[0], answer, len(made)


def test_a_sealed_mistake_beside_small_errors_is_the_one_that_was_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before, it was that of a second simulation, which could be another one."""
    case, answer, count = _made_out_of_step(tmp_path, ["right_angle_zero"], monkeypatch)
    (cause,) = answer["causes"]
    assert case.told is not None and count == 1
    off_rad = case.told.q - told_truly(case).q
    (changed,) = [j for j in case.plan.commands.joints if np.abs(off_rad[:, column_of(case, j)]).max() > 0.1]
    assert cause["at"] == f"joint:{changed}" and cause["identifiable"]
    assert off_rad[0, column_of(case, changed)] == pytest.approx(-cause["offset_rad"])


def test_the_rows_of_a_sealed_pairing_are_those_of_the_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, answer, count = _made_out_of_step(tmp_path, ["pairing"], monkeypatch)
    (cause,) = answer["causes"]
    assert count == 2 and "identifiable" in answer, "it is judged without the small errors"
    assert case.truth.pairing is not None
    assert cause["last_frame"] == min(case.truth.pairing[1], len(case.corners_px) - 4)


def test_small_errors_are_other_numbers_than_mounts() -> None:
    """Before, one generator was copied: the first gear's error was the board's first turn."""
    options = replace(QUICK, imperfect=1.0, by_hand=True)
    case = simulate("one", "small", [], np.random.default_rng(7), options)
    assert case.mounting is not None
    gear = case.answer["small"][1]["size_rad"] / GEAR_RAD
    assert abs(abs(case.mounting.board[0][0]) / TURN_RAD - gear) > 1e-6
    # The mounts are the same with and without small errors.
    exact = simulate("one", "small", [], np.random.default_rng(7), replace(options, imperfect=0.0))
    assert exact.mounting is not None
    assert np.array_equal(exact.mounting.board[0], case.mounting.board[0])


def _logged(folder: Path, joint: str) -> np.ndarray:
    table = np.genfromtxt(folder / "frames.csv", delimiter=",", names=True)
    return np.asarray(table[joint])


@pytest.mark.parametrize("mistake", ["degrees", "joint_frozen", "column_zero"])
def test_a_mistake_is_made_in_the_log_of_joints_that_rest_elsewhere(tmp_path: Path, mistake: str) -> None:
    """Before, radians were added to the column that a mistake had changed."""
    options = replace(QUICK, rest_rad=0.02)
    make_cases(tmp_path, 1, 5, options, [("one", "small", [mistake])])
    answer = json.loads((tmp_path / "answers" / "one.json").read_text(encoding="utf-8"))
    assert answer["rest_rad"] == 0.02
    (cause,) = answer["causes"]
    joint = cause["at"].removeprefix("joint:")
    logged = _logged(tmp_path / "one", joint)
    if mistake == "column_zero":
        assert not logged.any()
        return
    if mistake == "joint_frozen":
        assert np.ptp(logged[cause["first_frame"] : cause["last_frame"] + 1]) == 0
        return
    (exact,) = make_cases(tmp_path / "exact", 1, 5, QUICK, [("one", "small", [mistake])])
    sealed = json.loads((tmp_path / "exact" / "answers" / "one.json").read_text(encoding="utf-8"))
    assert sealed["causes"] == answer["causes"], "the same mistake with and without"
    rest_rad = np.radians(logged - _logged(exact, joint))
    assert np.std(rest_rad) == pytest.approx(0.02, rel=0.5)


@pytest.mark.parametrize(
    ("kind", "example", "pairs"),
    [
        ("talos", ("arm_left_1_joint", "arm_right_1_joint"), 7),
        ("romeo", ("LElbowYaw", "RElbowYaw"), 7),
        ("g1", ("left_elbow_joint", "right_elbow_joint"), 7),
        ("icub", ("l_elbow", "r_elbow"), 7),
        ("small", ("l_elbow", "r_elbow"), 4),
    ],
)
def test_the_two_sides_of_every_humanoid_are_known(kind: str, example: tuple[str, str], pairs: int) -> None:
    """Before, TALOS and Romeo had no two sides."""
    rng = np.random.default_rng(2)
    try:
        robot = KINDS[kind](rng)
    except ValueError as error:
        pytest.skip(str(error))
    plan = plan_postures(robot, rng, (20, 21), 20)
    told = Told("", plan.commands.q_rad[plan.posture_of_frame], plan.time_of_frame_s)
    case = SimpleNamespace(robot=robot, plan=plan)
    causes = left_right(rng, case, told)  # type: ignore[arg-type]
    places = {tuple(p.removeprefix("joint:") for p in c["at"].split("<->")) for c in causes}
    assert example in places and len(places) == pairs


def test_a_cause_beside_one_without_a_name_is_judged_without_it_and_it_without_the_cause(
    tmp_path: Path,
) -> None:
    plan = [("one", "small", ["gear_ratio", "knee"])]
    make_cases(tmp_path, 1, 4, QUICK, plan)
    answer = json.loads((tmp_path / "answers" / "one.json").read_text(encoding="utf-8"))
    gear, knee = answer["causes"]
    assert (gear["effect"], knee["effect"], knee["kind"]) == ("gear_ratio", "unknown", "knee")
    assert gear["at"] != knee["at"]
    for part, own in (("named", gear), ("outside", knee)):
        alone = simulate("one", "small", plan[0][2], np.random.default_rng([4, 0]), QUICK, part)
        (cause,) = alone.answer["causes"]
        assert cause == {key: own[key] for key in cause}, "the same place and size"
        report = make._judged(alone)
        assert (own["identifiable"], own["rivals"]) == (report["identifiable"], report["rivals"])
    assert answer["identifiable"] == (gear["identifiable"] and knee["identifiable"])


def test_so_many_sessions_as_asked_have_one_without_a_name_beside_their_causes() -> None:
    def drawn(share: float, number: int) -> list[str]:
        options = Options(causes=(1, 2), outside_share=0.0, outside_beside=share)
        return make.draw_causes(np.random.default_rng(number), options, sorted(VOCABULARY))

    all_beside = [drawn(1.0, k) for k in range(40)]
    alone = [len(d) == 1 for d in all_beside]
    assert all(d[-1] in OUTSIDE or d[0] in ("geometry", "pairing") for d in all_beside)
    assert not any(d in OUTSIDE for draws in all_beside for d in draws[:-1]) and sum(alone) < 10
    half = sum(drawn(0.5, k)[-1] in OUTSIDE for k in range(200))
    assert 70 < half < 120
    assert not any(set(drawn(0.0, k)) & set(OUTSIDE) for k in range(40))
