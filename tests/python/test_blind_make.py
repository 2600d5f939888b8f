"""Blind sessions as they are made: the same from the same seed, complete, and judged as geometry says they must be."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")

from mirror_lab.blind import BlindError
from mirror_lab.blind.comparison import Scored, invented
from mirror_lab.blind.effects import VOCABULARY
from mirror_lab.blind.errors import NoPlaceError, UnstableError
from mirror_lab.blind.fitting import fit
from mirror_lab.blind.identify import judge
from mirror_lab.blind.make import make_cases
from mirror_lab.blind.outside import OUTSIDE
from mirror_lab.blind.reference import clean_pixels, reference_of
from mirror_lab.blind.simulate import KINDS, Case, Options, simulate

QUICK = Options(robots=("small",), frames=(50, 51), least_postures=25)
FEW = Options(robots=("small",), frames=(20, 21), least_postures=10)
"""Where no number of a session is looked at."""


def _case(effects: list[str], seed: int, options: Options = QUICK) -> Case:
    return simulate("case", "small", effects, np.random.default_rng(seed), options)


@pytest.mark.parametrize("effect", [*VOCABULARY, *OUTSIDE])
def test_every_effect_changes_what_is_seen_and_tells_its_place(effect: str) -> None:
    case = _case([effect], 4)
    (cause,) = case.answer["causes"]
    assert cause["effect"] == ("unknown" if effect in OUTSIDE else effect)
    assert cause["at"].split(":")[0] in {
        "joint",
        "link",
        "marker",
        "camera",
        "board",
        "mirror",
        "robot",
        "data",
    }
    nominal = fit(reference_of(case), [], clean_pixels(case)[2])
    assert nominal.chi2 > 5, "a fault that nobody can see is none"


def test_a_session_without_faults_is_the_nominal_model_and_noise() -> None:
    case = _case([], 5, Options(robots=("small",), frames=(80, 81), simple_laws=True))
    assert judge(case)["nominal_chi2"] < 0.5


def test_where_a_body_never_comes_to_rest_another_is_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[str] = []

    def unstable_first(name: str, kind: str, *rest: object) -> Case:
        drawn.append(name)
        if len(drawn) == 1:
            raise UnstableError("the simulated body became unstable")
        return simulate(name, kind, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr("mirror_lab.blind.make.simulate", unstable_first)
    (made,) = make_cases(tmp_path, 1, 3, FEW)
    assert len(drawn) == 2 and (made / "seal.json").is_file()
    answer = json.loads((tmp_path / "answers" / f"{made.name}.json").read_text(encoding="utf-8"))
    assert answer["seed"] == [3, 0, 1], "the draw can be repeated"


def test_the_same_seed_makes_the_same_session(tmp_path: Path) -> None:
    plan = [("again", "small", ["drift"])]
    one, two = (make_cases(tmp_path / n, 1, 11, FEW, plan)[0] for n in ("a", "b"))
    for name in ("frames.csv", "detections.csv", "robot.urdf", "camera.yaml", "session.toml"):
        assert (one / name).read_bytes() == (two / name).read_bytes(), name
    other = make_cases(tmp_path / "c", 1, 12, FEW, plan)[0]
    assert (one / "detections.csv").read_bytes() != (other / "detections.csv").read_bytes()


def test_a_session_tells_nothing_of_its_cause_and_every_row_is_in_the_picture(tmp_path: Path) -> None:
    plan = [("hidden", "small", ["camera_focal"])]
    folder = make_cases(tmp_path, 1, 1, FEW, plan)[0]
    assert sorted(p.name for p in folder.iterdir()) == [
        "camera.yaml",
        "detections.csv",
        "frames.csv",
        "robot.urdf",
        "seal.json",
        "session.toml",
    ]
    for path in folder.iterdir():
        assert "camera_focal" not in path.read_text(encoding="utf-8")
    with (folder / "detections.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert all(0 <= float(r["u"]) <= 799 and 0 <= float(r["v"]) <= 599 for r in rows)
    answer = json.loads((tmp_path / "answers" / "hidden.json").read_text(encoding="utf-8"))
    assert answer["causes"][0]["effect"] == "camera_focal"


def test_a_known_degeneracy_is_found_and_a_clear_cause_is_not_called_tied() -> None:
    """A last joint set off along its own axis moves its one marker just as a wrong mount does."""
    for seed in range(400):
        case = _case(["link_length"], seed)
        (cause,) = case.answer["causes"]
        last = case.robot.next_body(case.robot.index[cause["at"].removeprefix("link:")])
        assert last is not None
        carried, axis = case.robot.moves(case.robot.bodies[last].joint), case.robot.bodies[last].axis
        shift = np.array([cause["dx_m"], cause["dy_m"], cause["dz_m"]])
        if len(carried) == 1 and np.linalg.norm(np.cross(axis, shift)) < 1e-12:
            break
    else:
        pytest.fail("no draw set a last joint off along its axis")
    told = judge(case)
    assert told["detectable"] and not told["identifiable"]
    assert f"marker_mount@marker:{carried[0]}" in told["rivals"]
    clear = judge(_case(["board_scale"], 3))
    assert clear["identifiable"] and clear["rivals"] == [] and clear["own_chi2"] < 5


def test_the_same_sessions_come_from_one_process_and_from_two(tmp_path: Path) -> None:
    plan = [(f"s{i}", "small", ["joint_offset"]) for i in range(3)]
    told: list[tuple[str, int]] = []
    one = make_cases(tmp_path / "one", 3, 5, FEW, plan)
    two = make_cases(
        tmp_path / "two", 3, 5, FEW, plan, workers=2, progress=lambda n, left: told.append((n, left))
    )
    assert sorted(n for n, _ in told) == ["s0", "s1", "s2"] and [left for _, left in told] == [2, 1, 0]
    for a, b in zip(one, two, strict=True):
        assert (a / "detections.csv").read_bytes() == (b / "detections.csv").read_bytes()
        answers = [json.loads((p.parent / "answers" / f"{p.name}.json").read_bytes()) for p in (a, b)]
        assert {**answers[0], "salt": 0} == {**answers[1], "salt": 0}


@pytest.mark.parametrize("kind", KINDS)
def test_every_robot_of_the_default_can_be_seen_and_is_right_without_faults(kind: str) -> None:
    options = Options(frames=(60, 61), simple_laws=True)
    try:
        case = simulate("case", kind, [], np.random.default_rng(6), options)
    except BlindError as e:
        if "example-robot-data" in str(e):
            pytest.skip(str(e))
        raise
    assert np.isfinite(case.blobs_px).all(-1).mean() > 0.7
    # MuJoCo's bodies and ray paths against plain kinematics and reflections: over thousands of pixels nothing is
    # left but the second order of a ball's outline.
    assert judge(case)["nominal_chi2"] < 2


def test_what_is_seen_twice_as_noisily_is_no_longer_told_apart() -> None:
    """Margins are χ² over the session's noise: they fall with its square, and rivals come up."""
    case = _case(["gear_ratio"], 9)
    clear = judge(case)
    case.noise = replace(case.noise, corner_px=100 * case.noise.corner_px, blob_px=100 * case.noise.blob_px)
    noisy = judge(case)
    assert clear["detectable"] and not noisy["detectable"]
    assert noisy["nominal_chi2"] == pytest.approx(clear["nominal_chi2"] / 1e4, rel=0.05)


def test_a_robot_that_cannot_have_the_drawn_causes_is_drawn_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(NoPlaceError, match="no free place left for 'geometry'"):
        _case(["geometry", "geometry"], 0)
    seeds: list[object] = []

    def refusing(name: str, kind: str, draws: list[str], rng: np.random.Generator, options: Options) -> Case:
        seeds.append(rng.bit_generator.seed_seq.entropy)  # type: ignore[attr-defined]
        if len(seeds) < 3:
            raise NoPlaceError("none")
        return simulate(name, kind, [], rng, options)

    monkeypatch.setattr("mirror_lab.blind.make.simulate", refusing)
    make_cases(tmp_path, 1, 7, FEW)
    assert seeds == [[7, 0], [7, 0, 1], [7, 0, 2]]
    answer = json.loads((tmp_path / "answers" / "case-0000.json").read_text(encoding="utf-8"))
    assert answer["seed"] == [7, 0, 2]


def test_an_unknown_effect_is_named_with_those_that_are_known() -> None:
    with pytest.raises(BlindError, match=r"gremlins.*joint_offset"):
        _case(["gremlins"], 0)


def test_joints_that_rest_elsewhere_change_the_log_alone(tmp_path: Path) -> None:
    plan = [("rest", "small", ["drift"])]
    exact, off = (
        make_cases(tmp_path / name, 1, 12, replace(QUICK, rest_rad=rest), plan)[0]
        for name, rest in (("exact", 0.0), ("off", 0.01))
    )
    assert (exact / "detections.csv").read_bytes() == (off / "detections.csv").read_bytes()

    def logged(folder: Path) -> tuple[list[str], np.ndarray]:
        rows = list(csv.reader((folder / "frames.csv").open(encoding="utf-8")))
        return rows[0], np.array(rows[1:], float)

    (header, was), (_, is_) = logged(exact), logged(off)
    postures, joints = was[:, header.index("posture")], was[:, header.index("time_s") + 1 :]
    moved = is_[:, header.index("time_s") + 1 :] - joints
    first = [int(np.flatnonzero(postures == p)[0]) for p in np.unique(postures)]
    for p in np.unique(postures):
        # Views of one posture share its errors.
        assert np.ptp(moved[postures == p], axis=0).max() < 1e-9
    still = np.ptp(joints, axis=0) == 0
    assert not moved[:, still].any()
    assert np.std(moved[np.ix_(first, np.flatnonzero(~still))]) == pytest.approx(0.01, rel=0.2)
    answer = json.loads((tmp_path / "off/answers/rest.json").read_text(encoding="utf-8"))
    assert answer["rest_rad"] == 0.01


def test_small_errors_come_beside_the_same_causes_and_may_be_named(tmp_path: Path) -> None:
    plan = [("kit", "small", ["gear_ratio"])]
    answers = {}
    for name, imperfect in (("exact", 0.0), ("kit", 1.0)):
        make_cases(tmp_path / name, 1, 14, replace(QUICK, imperfect=imperfect), plan)
        answers[name] = json.loads((tmp_path / name / "answers/kit.json").read_text(encoding="utf-8"))
    assert answers["exact"]["causes"] == answers["kit"]["causes"], (
        "the same cause, judged without the small errors"
    )
    assert "pixels_sha256" not in answers["kit"], "its small errors are no part of the judge's model"
    small = answers["kit"]["small"]
    joints = {c["at"] for c in small if c["effect"] == "joint_offset"}
    given = [c for c in small if c["effect"] in ("backlash", "joint_compliance")]
    assert len(joints) >= 3 and {c["at"] for c in given} == joints, "each joint has play or gives"
    before, after = (answers[n]["true_marker_gap_rms_m"] for n in ("exact", "kit"))
    assert abs(after - before) > 1e-5
    said = {"verdict": "explained", "causes": [{"effect": c["effect"], "at": c["at"]} for c in small]}
    assert not invented(Scored("kit", answers["kit"], said)), "a small error that is there is no invention"
    assert len(invented(Scored("kit", answers["exact"], said))) == len(small)
