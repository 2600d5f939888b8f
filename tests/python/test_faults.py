"""Faults injected at random into corrections: no unsafe command, no wrong "converged", nothing lost. Figures: docs/faults.md."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dynamixel_bus import SimulatedBus, SimulatedServo
from mirror_lab.robots import HiddenBody, HiddenEffect
from mirror_lab.robots.pixels import MirrorInRoot, exact_points, lens_of
from mirror_posture.correct import CorrectOptions, Recorder, correct
from mirror_posture.robots import ImagePoints, Nominal
from mirror_posture.robots.servo_state import Torque
from mirror_posture.viewpoint import View

pytest.importorskip("mujoco")

from draws import draws
from faulty_robot import PIXEL_FAULTS, POSTURE, Blurred, Fault, HiddenForGood, SpotOnTheArm, trial
from mirror_posture.shapes.mujoco_picture import opengl_is_there
from views_once import views_once


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    return Nominal.load()


@pytest.fixture(scope="module", autouse=True)
def proposed() -> Iterator[None]:
    with views_once():
        yield


@pytest.mark.parametrize("kind", [k for k in PIXEL_FAULTS if k is not SpotOnTheArm], ids=lambda k: k.__name__)
def test_no_fault_makes_a_correction_unsafe_or_wrong(kind: type[Fault], nominal: Nominal) -> None:
    trials = [trial(kind, 1000 + seed, nominal) for seed in draws(2, range(3))]
    assert kind is not Fault or any(one.stop == "converged" for one in trials)
    for one in trials:
        assert one.unsafe == 0 and one.lost == 0
        assert not one.wrong, one
        if kind is HiddenForGood:
            assert one.stop == "marker_lost" or one.looks <= 2
        if kind is Fault:
            # An error may be too small to be told from noise, and too large to be called converged.
            assert one.stop == "converged" or one.cause == "too_uncertain"
            assert one.last_m < 1e-3


def test_a_spot_on_the_same_limb_is_the_known_limit(nominal: Nominal) -> None:
    """What moves with the limb as the ball would, and is no farther from its model than is believed, cannot be told from it."""
    trials = [trial(SpotOnTheArm, 1000 + seed, nominal) for seed in draws(2, range(3))]
    assert all(one.unsafe == 0 and one.lost == 0 for one in trials)


@pytest.mark.skipif(not opengl_is_there(), reason="MuJoCo finds no OpenGL here")
def test_blurred_pictures_end_well_or_not_at_all(nominal: Nominal) -> None:
    one = trial(Blurred, 1001, nominal.with_mirror(0.0), "rendered")
    assert one.unsafe == 0 and one.lost == 0 and not one.wrong


# A serial line that is cut, and is back later.

SERVOS = """
[bus]
port = "{port}"
speed_rad_per_s = 3.0
acceleration_rad_per_s2 = 30.0
current_a = 0.3
[joints.r_shoulder_pitch]
id = 1
zero_counts = 2048
direction = 1
upper_rad = 0.9
[joints.r_shoulder_roll]
id = 2
zero_counts = 1024
direction = 1
upper_rad = 2.0
[joints.r_elbow]
id = 3
zero_counts = 2048
direction = -1
"""


@pytest.fixture
def bus() -> Iterator[SimulatedBus]:
    with SimulatedBus(*(SimulatedServo(i, 1024.0 if i == 2 else 2048.0) for i in (1, 2, 3))) as bus:
        yield bus


def open_servos(bus: SimulatedBus, body: HiddenBody, nominal: Nominal, folder: Path):  # type: ignore[no-untyped-def]
    """Servos with a body on them before a mirror that a person turns."""
    pytest.importorskip("dynamixel_sdk")
    from mirror_posture.robots.dynamixel import DynamixelRobot

    file = folder / "servos.toml"
    file.write_text(SERVOS.format(port=bus.port))
    lens, rng = lens_of(nominal), np.random.default_rng(5)
    board = body.link_poses()["chest_board"][:3, 3].copy()

    class OnAStand(DynamixelRobot):
        view = View()

        def turn(self, view: View) -> None:
            self.view = view

    def eye() -> ImagePoints:
        turned = {s.joint: s.position_rad(round(bus.positions()[s.servo_id])) for s in robot.config.servos}
        body.move(turned)
        normal = robot.view.normal_in_root
        mirror = MirrorInRoot(normal, float(normal @ board) + robot.view.distance_m, 0.003, 1.52)
        return exact_points(nominal, lens, body.link_poses(), mirror, 0.1, rng)

    robot = OnAStand(nominal, file, eye)
    return robot


@pytest.mark.realtime
def test_a_line_cut_during_a_correction_loses_nothing(
    bus: SimulatedBus, nominal: Nominal, tmp_path: Path
) -> None:
    hidden = [
        HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.05}),
        HiddenEffect("gear_ratio", "joint:r_shoulder_roll", {"scale_error": 0.03}),
    ]
    body = HiddenBody(nominal.robot_file.read_text(), "base_link", nominal.metadata.gravity_m_per_s2, hidden)
    taken: list[int] = []

    def cut_after(_: object, number: int) -> None:
        taken.append(number)
        if number == 3:
            threading.Timer(0.02, lambda: setattr(bus, "mute", True)).start()

    with open_servos(bus, body, nominal, tmp_path) as robot:
        recorder = Recorder.start(tmp_path / "run", nominal, robot.joint_names)
        outcome = correct(robot, POSTURE, recorder=recorder, on_picture=cut_after)
        assert outcome.stop.kind == "robot_failed", outcome.stop.sentence
        assert outcome.stop.evidence["error"] == "LostRobotError"
        assert robot.standing.torque is not Torque.HELD
    rows = (tmp_path / "run" / "frames.csv").read_text().splitlines()
    assert len(rows) - 1 == len(taken) == outcome.views
    time.sleep(0.7)
    bus.mute = False
    with open_servos(bus, body, nominal, tmp_path) as robot:
        recorder, _ = Recorder.resume(tmp_path / "run")
        outcome = correct(robot, POSTURE, recorder=recorder)
    assert outcome.converged, outcome.stop.sentence
    assert outcome.views > len(taken)
    wanted = nominal.robot.points(nominal.robot.positions(POSTURE), "base_link", "r_hand_marker")[0]
    assert np.linalg.norm(body.link_poses()["r_hand_marker"][:3, 3] - wanted) < 1e-3
    assert bus.all_off()


@pytest.mark.realtime
def test_a_signal_in_a_correction_says_what_became_of_the_torque(
    bus: SimulatedBus, nominal: Nominal, tmp_path: Path
) -> None:
    body = HiddenBody(nominal.robot_file.read_text(), "base_link", nominal.metadata.gravity_m_per_s2, [])

    def soon(_: object, number: int) -> None:
        if number == 2:
            os.kill(os.getpid(), signal.SIGTERM)

    with open_servos(bus, body, nominal, tmp_path) as robot:
        outcome = correct(robot, POSTURE, on_picture=soon)
        assert outcome.stop.kind == "interrupted" and "SIGTERM" in outcome.stop.sentence
        assert outcome.stop.evidence["standing"] == "unpowered, torque is off: at rest"
        assert bus.all_off()


# A process that is killed.

CHILD = """
import sys, time
from mirror_posture.correct import Recorder, correct
from mirror_lab.robots import HiddenEffect, TwinOptions, TwinRobot
from mirror_posture.robots import Nominal
nominal = Nominal.load()
hidden = [HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.05}),
          HiddenEffect("backlash", "joint:r_shoulder_roll", {"width_rad": 0.04})]
def told(look, number):
    print(number, flush=True)
    time.sleep(0.01)
with TwinRobot(hidden, TwinOptions(pictures=False, seed=7)) as robot:
    recorder = Recorder.start(sys.argv[1], nominal, robot.joint_names)
    print(0, flush=True)
    correct(robot, {"r_shoulder_pitch": -0.26, "r_shoulder_roll": 1.2, "r_elbow": 0.3}, recorder=recorder, on_picture=told)
"""


@pytest.mark.parametrize("seed", draws(2, range(4)))
def test_a_process_killed_at_any_moment_loses_nothing(nominal: Nominal, tmp_path: Path, seed: int) -> None:
    from mirror_lab.robots import TwinOptions, TwinRobot

    rng = random.Random(seed)
    after, moment_s = rng.randrange(0, 7), rng.uniform(0.0, 0.02)
    folder = tmp_path / "run"
    child = subprocess.Popen([sys.executable, "-c", CHILD, str(folder)], stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    told = -1
    for line in child.stdout:
        told = int(line)
        if told >= after:
            break
    time.sleep(moment_s)
    child.kill()
    told = max([told, *(int(line) for line in child.stdout if line.strip())])
    child.wait(20.0)
    hidden = [
        HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.05}),
        HiddenEffect("backlash", "joint:r_shoulder_roll", {"width_rad": 0.04}),
    ]
    recorder, _ = Recorder.resume(folder)
    assert len(recorder.past().looks) >= told, "every picture that was told of is there"
    with TwinRobot(hidden, TwinOptions(pictures=False, seed=8), nominal) as robot:
        outcome = correct(robot, POSTURE, CorrectOptions(), recorder=recorder)
        truth = robot.marker_truth_m()["r_hand"]
    assert outcome.converged, outcome.stop.sentence
    wanted = nominal.robot.points(nominal.robot.positions(POSTURE), "base_link", "r_hand_marker")[0]
    assert np.linalg.norm(truth - wanted) < 1e-3
