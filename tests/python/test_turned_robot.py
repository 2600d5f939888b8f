"""A robot that turns before its mirror on its own legs, and the postures of the session that comes of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from correct_child import OPTIONS, POSTURE
from mirror_lab.reproduce.self_rotation import VIEW_JOINTS, StandingTwin
from mirror_lab.robots import HiddenEffect, TwinOptions
from mirror_posture import MirrorPostureError, load_session
from mirror_posture.correct import CorrectOptions, Recorder, correct, make_target
from mirror_posture.correct.turned import check_turning
from mirror_posture.picture_files import write_picture
from mirror_posture.robots import Look, Nominal
from mirror_posture.session import SessionError
from small_arm import run

OFF = (HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": math.radians(3.0)}),)
TURNING = CorrectOptions(step=OPTIONS.step, stop=OPTIONS.stop, view_joints=VIEW_JOINTS, extra_views=0)
FOOT = 4
"""The embedded robot's marker r_foot."""


class SeesItsFeet(StandingTwin):
    """Its camera sees the feet, wherever they are."""

    def _look(self) -> Look:
        look = super()._look()
        assert look.points is not None
        look.points.marker_seen[FOOT] = True
        look.points.marker_px[FOOT] = (300.0 + 40.0 * self.commanded["r_hip_yaw"], 470.0)
        return look


@pytest.mark.parametrize("kind", [StandingTwin, SeesItsFeet])
def test_turning_by_the_hips_is_recorded_read_and_gone_on_with(
    tmp_path: Path, kind: type[StandingTwin]
) -> None:
    """The example of docs/correcting.md. Before, its looks ran and the session was refused: two commands in one posture."""
    out = tmp_path / "run"

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    robot = kind(OFF, TwinOptions(pictures=False))
    recorder = Recorder.start(out, robot.nominal, robot.joint_names)
    assert correct(robot, POSTURE, TURNING, recorder=recorder, on_look=stop).stop.kind == "interrupted"
    assert len(load_session(out).frames) == 2
    recorder, _ = Recorder.resume(out)
    outcome = correct(kind(OFF, TwinOptions(pictures=False, seed=1)), POSTURE, TURNING, recorder=recorder)
    assert outcome.converged, outcome.stop.sentence
    session = load_session(out)
    hip = session.frames.commanded[:, session.frames.joint_names.index("r_hip_yaw")]
    assert session.warnings == () and np.ptp(hip) == pytest.approx(math.radians(15.0))
    assert not session.mirror_view.marker_seen[:, FOOT].any(), (
        "of a foot that the hips move nothing is recorded"
    )
    assert session.mirror_view.marker_seen[:, 0].all()


def with_a_leg(tmp_path: Path, seen: str) -> Path:
    """A recorded look from two viewpoints, by the hips, and what is seen of a foot besides."""
    out = tmp_path / "run"
    robot = StandingTwin(OFF, TwinOptions(pictures=False))
    recorder = Recorder.start(out, robot.nominal, robot.joint_names)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    correct(robot, POSTURE, TURNING, recorder=recorder, on_look=stop)
    with (out / "detections.csv").open("a") as stream:
        stream.write(seen)
    return out


def test_a_marker_that_moves_within_a_posture_is_refused_where_it_is_seen(tmp_path: Path) -> None:
    once = with_a_leg(tmp_path, "")
    assert len(load_session(once).frames) == 2
    with (once / "detections.csv").open("a") as stream:
        stream.write("1,r_foot,0,300,400,0.1\n")
    with pytest.raises(
        SessionError, match=r"column 'r_hip_yaw'.*in posture 0, whose first row 1 has 0; needed one command"
    ):
        load_session(once)
    # Of pictures in which nothing was looked for yet any marker may be found.
    (once / "detections.csv").unlink()
    for number in range(2):
        write_picture(once / f"images/{number}.png", np.zeros((720, 960, 3), np.uint8))
    rows = (once / "frames.csv").read_text().splitlines()
    for number in (1, 2):
        cells = rows[number].split(",")
        cells[3] = f"images/{number - 1}.png"
        rows[number] = ",".join(cells)
    (once / "frames.csv").write_text("\n".join([*rows, ""]))
    with pytest.raises(SessionError, match="r_hip_yaw"):
        load_session(once)


def test_an_arm_that_moves_within_a_posture_is_refused(tmp_path: Path) -> None:
    out = with_a_leg(tmp_path, "")
    rows = (out / "frames.csv").read_text().splitlines()
    column = rows[0].split(",").index("r_elbow")
    cells = rows[2].split(",")
    cells[column] = "0.1"
    (out / "frames.csv").write_text("\n".join([rows[0], rows[1], ",".join(cells), ""]))
    with pytest.raises(
        SessionError, match=r"column 'r_elbow'.*got 0.1 in posture 0, whose first row 1 has 0.8"
    ):
        load_session(out)


def test_a_joint_that_others_follow_does_not_turn_the_robot(tmp_path: Path) -> None:
    """Before, a joint that moves a marker by <mimic> alone was taken as one that turns the whole robot."""
    nominal = Nominal.load()
    text = nominal.robot_file.read_text()
    elbow = text.index('<joint name="r_elbow"')
    end = text.index("</joint>", elbow)
    (tmp_path / "robot.urdf").write_text(text[:end] + '<mimic joint="r_hip_yaw"/>' + text[end:])
    for name in ("session.toml", "camera.yaml"):
        (tmp_path / name).write_bytes((nominal.folder / name).read_bytes())
    target = make_target(
        Nominal.load(tmp_path), {"r_shoulder_roll": 0.9}, CorrectOptions(markers=("r_hand",))
    )
    with pytest.raises(MirrorPostureError, match="'r_hip_yaw' lies between camera, board and a marker"):
        check_turning(target, [{"r_hip_yaw": 0.0}, {"r_hip_yaw": 0.3}])


def test_the_documents_example_ends_with_a_stop_and_a_session(tmp_path: Path) -> None:
    """The twin of the command line hangs by its torso: its hips turn nothing, and that is what it tells."""
    out = tmp_path / "run"
    words = ("--turn-by", "r_hip_yaw=0,l_hip_yaw=0", "--turn-by", "r_hip_yaw=15,l_hip_yaw=15")
    joints = ("--joint", "r_shoulder_pitch=-30,r_shoulder_roll=50,r_elbow=45")
    run("correct", "twin", "--out", out, "--no-pictures", *joints, *words, code=3)
    assert load_session(out).warnings == () and (out / "outcome.json").is_file()


def test_a_picture_that_is_detected_again_is_recorded_without_the_feet(tmp_path: Path) -> None:
    """Which joints turn the robot is known from before the first look, whatever kills the process after it."""
    out = tmp_path / "run"
    robot = StandingTwin(OFF, TwinOptions(pictures=False))
    recorder = Recorder.start(out, robot.nominal, robot.joint_names)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    correct(robot, POSTURE, TURNING, recorder=recorder, on_picture=stop)
    with (out / "detections.csv").open("a") as stream:
        stream.write("0,r_foot,0,300,400,0.1\n")
    recorder, header = Recorder.resume(out)
    assert header["turning"] == ["r_hip_yaw", "l_hip_yaw"]
    assert (
        not recorder.past().looks[0].points.marker_seen[FOOT]
        and recorder.past().looks[0].points.marker_seen[0]
    )  # type: ignore[union-attr]
    assert not load_session(out).mirror_view.marker_seen[:, FOOT].any()
    file = out / "correction.json"
    file.write_text(file.read_text().replace('"r_hip_yaw",\n  "l_hip_yaw"\n ]\n}', "3]}"))
    with pytest.raises(MirrorPostureError, match=r"turning: got \[3\], needed a list of names"):
        Recorder.resume(out)
