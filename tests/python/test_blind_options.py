"""Options of the blind check that contradict each other or what is there: each is refused with the fix."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mirror_posture.cli.app import app

pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")

from mirror_lab.blind import BlindError
from mirror_lab.blind.make import make_cases
from mirror_lab.blind.simulate import Options

QUICK = Options(robots=("small",), frames=(20, 21), least_postures=10)
PLAN = [("case-0000", "small", ["joint_offset"]), ("case-0001", "small", ["drift"])]


def refused(line: str) -> str:
    done = CliRunner().invoke(app, line.split())
    if "this command is not installed" in done.output:
        pytest.skip("joins with the installed mirror-posture-lab")
    assert done.exit_code == 1, done.output
    return " ".join(done.output.split())


@pytest.mark.parametrize(
    ("options", "fix"),
    [
        (
            "--setup by-hand --outside 0 --effect camera_mount",
            "belongs to the set-up: needed an exact set-up",
        ),
        ("--setup by-hand --outside 0 --effect pairing", "needed an exact set-up"),
        ("--setup by-hand --outside 0 --effect geometry", "needed an exact set-up"),
        ("--effect drift --mistakes", "leave one of them out"),
        ("--effect drift --accidents", "leave one of them out"),
        ("--outside-beside 0.5 --mistakes", "which stand alone; leave one of them out"),
        ("--outside-beside 0.5 --accidents", "which stand alone; leave one of them out"),
        ("--pictures --effect markers_swapped", "leave out --pictures"),
        ("--pictures --effect slip_board", "leave out --pictures"),
        ("--pictures --effect column_zero", "leave out --pictures"),
        ("--renderer mitsuba", "add --pictures"),
        ("--effect gremlins", "known are joint_offset"),
        ("--least 3 --most 2", "needed a least number up to the largest"),
        ("--frames 300 200", "needed a least number, from 1, up to the largest"),
        ("--frames 0 10", "needed a least number, from 1, up to the largest"),
    ],
)
def test_options_that_contradict_each_other_are_refused(tmp_path: Path, options: str, fix: str) -> None:
    told = refused(f"blind make {tmp_path / 'set'} --cases 1 --robot small --workers 1 {options}")
    assert fix in told
    assert not (tmp_path / "set").exists()


def test_the_least_number_of_frames_may_be_the_largest(tmp_path: Path) -> None:
    (made,) = make_cases(tmp_path, 1, 0, replace(QUICK, frames=(20, 20)), PLAN[:1])
    assert (made / "seal.json").is_file()


def test_a_set_that_was_stopped_is_finished_and_another_is_refused(tmp_path: Path) -> None:
    (first,) = make_cases(tmp_path, 1, 3, QUICK, PLAN[:1])
    sealed = (first / "seal.json").read_bytes()
    assert not (first / "set.json").exists() and not (tmp_path / "set.json").exists(), "it tells the causes"
    # The rest, and more of the same set.
    assert len(make_cases(tmp_path, 2, 3, QUICK, PLAN)) == 2
    assert (first / "seal.json").read_bytes() == sealed
    for seed, options, plan, differs in (
        (4, QUICK, PLAN, "seed 3, got 4"),
        (3, replace(QUICK, noise_told=False), PLAN, "noise_told True, got False"),
        (3, QUICK, [PLAN[0], ("case-0001", "small", ["gear_ratio"])], "small drift, got small gear_ratio"),
        (3, QUICK, None, "plan one, got none"),
    ):
        with pytest.raises(BlindError, match=f"{differs}; use another folder"):
            make_cases(tmp_path, 2, seed, options, plan)
    (tmp_path / "answers" / "set.json").unlink()
    with pytest.raises(BlindError, match="use another folder"):
        make_cases(tmp_path, 2, 3, QUICK, PLAN)


def test_where_nothing_was_made_yet_other_options_are_taken(tmp_path: Path) -> None:
    make_cases(tmp_path, 0, 3, QUICK, [])
    assert len(make_cases(tmp_path, 1, 4, QUICK, PLAN[:1])) == 1
