"""Figs. 13 and 14 of the paper: its statements about the loop as assertions, from few runs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from mirror_lab.reproduce import correction, correction_figure, self_rotation
from mirror_lab.robots import TwinOptions
from mirror_posture.render import View, view_planes

OPTIONS = TwinOptions(pictures=False, noise_px=0.2, seed=50)


@pytest.fixture(scope="module")
def by_gain() -> dict[float, correction.Runs]:
    # Three of the largest gain, with which the plain inverse is compared.
    return {
        gain: correction.runs_of(correction.PAPER, gain, 3 if gain == 1.0 else 2, OPTIONS)
        for gain in correction.GAINS
    }


def test_every_gain_reduces_the_error(by_gain: dict[float, correction.Runs]) -> None:
    for gain, runs in by_gain.items():
        assert runs.distance_mm[:, 0] == pytest.approx(9.3, abs=0.02)
        assert np.all(runs.distance_mm[:, -1] < 0.5 * 9.3), gain
    # The larger the gain, the nearer after one correction.
    first = [runs.mean[1] for runs in by_gain.values()]
    assert first == sorted(first, reverse=True)
    # Within the paper's 5 mm, for every gain.
    assert max(runs.mean[-1] for runs in by_gain.values()) < 5.0


def test_the_small_gain_converges_without_overshoot(by_gain: dict[float, correction.Runs]) -> None:
    smooth = by_gain[0.2]
    assert np.all(np.diff(smooth.distance_mm, axis=1) < 0.0)
    assert smooth.along.min() > 0.0
    # A fifth of what is left goes at each correction; play and curvature bend that a little.
    assert smooth.mean == pytest.approx(9.3 * 0.8 ** np.arange(5), rel=0.08)
    long = correction.runs_of(correction.PAPER, 0.2, 1, OPTIONS, corrections=15)
    assert long.mean[-1] < 1.5


def test_the_plain_pseudo_inverse_throws_the_hand_about(by_gain: dict[float, correction.Runs]) -> None:
    damped = by_gain[1.0]
    plain = correction.runs_of(correction.PLAIN, 1.0, 3, OPTIONS)
    assert plain.mean[1:].max() > 3.0 * damped.mean[1:].max()
    assert plain.std[-1] > damped.std[-1]


def test_the_joint_estimator_ends_within_a_millimetre() -> None:
    joint = correction.runs_of(correction.JOINT_OFF, correction.BEST_GAIN, 1, OPTIONS)
    eq2 = correction.runs_of(correction.EQ2_OFF, correction.BEST_GAIN, 1, OPTIONS)
    assert joint.mean[-1] < 1.0
    assert joint.mean[-1] < 0.7 * eq2.mean[-1]


def test_statements_that_are_not_so_are_said_not_to_hold(by_gain: dict[float, correction.Runs]) -> None:
    stays = correction.Runs(np.repeat(by_gain[0.2].error_mm[:, :1], 5, axis=1), by_gain[0.2].measured_mm)
    claims = {
        c.what: c.status for c in correction_figure.paper_claims(dict.fromkeys(correction.GAINS, stays), None)
    }
    assert claims["all gains"] == claims["final error"] == "does not hold"
    assert claims["λ = 0.2 converges, without overshoot"] == "does not hold"
    thrown = by_gain[0.2].error_mm.copy()
    thrown[:, 2] *= -1.0
    past = replace(by_gain[0.2], error_mm=thrown)
    claims = {c.what: c.status for c in correction_figure.paper_claims(by_gain | {0.2: past}, None)}
    assert claims["λ = 0.2 converges, without overshoot"] == "does not hold"


def test_on_its_own_legs() -> None:
    steps, yaws = self_rotation.on_its_legs(OPTIONS)
    distances = [float(np.linalg.norm(step.error_mm)) for step in steps]
    assert len(distances) == 5 and distances[0] == pytest.approx(9.3, abs=0.05)
    assert np.all(np.diff(distances) < 0.0) and distances[-1] < 5.0
    # The hips turn the robot; their play is missing.
    assert 12.0 < math.degrees(max(yaws) - min(yaws)) < 15.0


def test_the_mirror_stands_still_while_the_torso_turns() -> None:
    robot = self_rotation.StandingTwin((), OPTIONS)
    assert robot.seen_view.yaw_rad == pytest.approx(0.0, abs=1e-12)
    assert robot.seen_view.distance_m == pytest.approx(0.15)
    before = robot.body.link_poses()[self_rotation.FOOT]
    robot.command(dict.fromkeys(self_rotation.HIPS, self_rotation.TURN_RAD))
    after = robot.body.link_poses()[self_rotation.FOOT]
    # Both planes, taken to the foot, are one.
    planes = []
    for pose, view in ((before, View()), (after, robot.seen_view)):
        plane = view_planes([view], robot._board_in_root)[0]
        normal = pose[:3, :3].T @ np.array(plane.normal_in_root)
        at = pose[:3, :3].T @ (np.array(plane.center_in_root_m) - pose[:3, 3])
        planes.append((*normal, normal @ at))
    assert planes[0] == pytest.approx(planes[1], abs=1e-12)


def test_a_stop_inside_the_loop_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("mirror_lab.robots.twin.TwinRobot._look", stop)
    with pytest.raises(KeyboardInterrupt):
        correction.run_once(correction.PAPER, 0.2, 1, OPTIONS)
