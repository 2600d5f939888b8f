"""Joints that slide: lengths where joints that turn have angles, in what is asked and in what is told."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mirror_posture import Diagnosis, MirrorPostureError, Robot
from mirror_posture.cli.values import joint_values
from mirror_posture.diagnosis import limits
from mirror_posture.diagnosis.formatting import tell_all
from small_arm import MOUNTS, URDF, run
from test_pages import rich_document

SLIDING = URDF.replace('name="pan" type="revolute"', 'name="pan" type="prismatic"').replace(
    'lower="-1.5" upper="1.5"', 'lower="-0.1" upper="0.1"'
)


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    (tmp_path / "arm.urdf").write_text(SLIDING)
    return Robot.from_urdf(tmp_path / "arm.urdf")


def test_lengths_are_asked_of_joints_that_slide(robot: Robot) -> None:
    told = joint_values(["pan=12mm", "lift=90,elbow=-0.5rad"], "--joint", robot)
    assert told == pytest.approx({"pan": 0.012, "lift": 1.5707963, "elbow": -0.5})
    assert joint_values(["pan=1.5cm", "lift=30°"], "--joint", robot)["pan"] == pytest.approx(0.015)
    for text, words in (
        ("pan=4", "pan slides: needed a length"),
        ("pan=4deg", "slides"),
        ("lift=4mm", "lift turns: needed an angle"),
    ):
        with pytest.raises(MirrorPostureError, match=words):
            joint_values([text], "--joint", robot)
    with pytest.raises(MirrorPostureError, match="JOINT=DEGREES"):
        joint_values(["pan=nanmm"], "--joint", robot)


def test_a_diagnosis_tells_lengths_of_joints_that_slide() -> None:
    document = rich_document()
    cause = {
        "effect": "joint_offset", "at": "joint:rail", "probability": 0.99, "rms_shift": 1.0,
        "parameters": {"offset_rad": {"value": 0.004, "std": 0.0001}},
    }  # fmt: skip
    limit = {"effect": "joint_offset", "at": "joint:rail", "parameters": {"offset_rad": 0.002}}
    document |= {"causes": [cause], "limits": [limit]}
    turning = Diagnosis.from_document(document)
    assert [str(q) for q in tell_all(turning.causes[0])] == ["offset +0.2292 ± 0.0057 °"]
    sliding = Diagnosis.from_document(document | {"prismatic_joints": ["rail"]})
    assert [str(q) for q in tell_all(sliding.causes[0])] == ["offset +4.00 ± 0.10 mm"]
    assert limits.line(sliding) == "These postures would have hidden (95 %) a prismatic joint's zero by 2 mm."
    assert [row.best_size for row in limits.table(sliding)] == ["2 mm"]
    with pytest.raises(MirrorPostureError, match="prismatic_joints"):
        Diagnosis.from_document(document | {"prismatic_joints": [1]})


def test_a_plan_tells_lengths_of_joints_that_slide_of_a_robot_whose_first_link_is_world(
    tmp_path: Path,
) -> None:
    """`world` is MuJoCo's own name: a body of that name was refused."""
    pytest.importorskip("mujoco")
    (tmp_path / "arm.urdf").write_text(SLIDING.replace('"base"', '"world"'))
    mounts = [word.replace("base", "world") for word in MOUNTS]
    run("init", tmp_path / "arm.urdf", tmp_path / "session", *mounts)
    with pytest.MonkeyPatch.context() as fewer:
        fewer.setattr("mirror_posture.plan.run.DRAWN", 300)
        fewer.setattr("mirror_posture.plan.run.DRAWN_FOR_A_DISTANCE", 200)
        fewer.setattr("mirror_posture.plan.run.POOL", 20)
        said = run(
            "plan", tmp_path / "session", "--mirror-size", "50x50", "--postures", 8, "--views", 1
        ).stdout
    row = next(line for line in said.splitlines() if line.startswith("│ pan"))
    zero, _, play = (cell.strip(" *") for cell in row.split("│")[2:5])
    assert zero.endswith(" mm") and play.endswith(" mm")
    plan = json.loads((tmp_path / "session" / "plan" / "plan.json").read_text())
    told = next(t for t in plan["tells"] if (t["effect"], t["at"]) == ("joint_offset", "joint:pan"))
    assert float(zero.removesuffix(" mm")) == pytest.approx(
        1000.0 * told["parameters"]["offset_rad"], rel=0.05
    )


def test_a_tilt_of_a_joint_that_slides_is_an_angle() -> None:
    tree = rich_document()
    shapes = {"probability": 0.9, "alternatives": [], "words": "", "rms_shift": 1.0}
    tree["prismatic_joints"] = ["rail"]
    tree["causes"] = [
        {"effect": effect, "at": "joint:rail", "parameters": {name: {"value": 0.01, "std": 0.001}}, **shapes}
        for effect, name in (
            ("axis_tilt", "tilt_1_rad"),
            ("joint_offset", "offset_rad"),
            ("slip", "slip_rad"),
        )
    ]
    tilt, offset, slip = (str(tell_all(cause)[0]) for cause in Diagnosis.from_document(tree).causes)
    assert tilt == "tilt 1 +0.573 ± 0.057 °"
    assert offset == "offset +10.0 ± 1.0 mm" and slip == "slip +10.0 ± 1.0 mm"
