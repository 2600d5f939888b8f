"""What was found, in the transmissions of a `<ros2_control>` description."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from mirror_posture import MirrorPostureError
from mirror_posture.diagnosis.applied.ros2_control import patch_ros2_control
from test_apply_patch import changed_lines, found
from test_apply_xacro import CONTROL


def reported(text: str, joint: str, actuator: float, **names: float) -> float:
    """ros2_control's own rule (SimpleTransmission::actuator_to_joint): x / reduction + offset."""
    for element in ElementTree.fromstring(text).iter("transmission"):
        inner = element.find("joint")
        assert inner is not None
        if inner.get("name") != joint:
            continue
        reduction, offset = (
            eval(value[2:-1] if value.startswith("${") else value, {}, dict(names))
            for value in (inner.findtext("mechanical_reduction", "1.0"), inner.findtext("offset", "0.0"))
        )
        return actuator / reduction + offset
    raise KeyError(joint)


def test_offsets_and_reductions(tmp_path: Path) -> None:
    own, out = tmp_path / "control.xacro", tmp_path / "better.xacro"
    own.write_text(CONTROL)
    causes = found(
        ("joint_offset", "joint:elbow", {"offset_rad": -0.05}),
        ("joint_offset", "joint:wrist", {"offset_rad": 0.02}),
        ("gear_ratio", "joint:neck", {"scale_error": 0.03}),
    ).causes
    told = patch_ros2_control(own, causes, out)
    after = out.read_text()
    assert len(changed_lines(CONTROL, after)) == 4
    assert told["joint_offset", "joint:elbow"].endswith("0.03 to -0.02")
    names = {"ratio": 40.0, "neck_zero": 0.1}
    for actuator in (-20.0, 3.0):
        was = reported(CONTROL, "elbow", actuator)
        assert reported(after, "elbow", actuator) == pytest.approx(was - 0.05, abs=1e-9)
        was = reported(CONTROL, "wrist", actuator)
        assert reported(after, "wrist", actuator) == pytest.approx(was + 0.02, abs=1e-9)
        was = reported(CONTROL, "neck", actuator, **names)
        assert reported(after, "neck", actuator, **names) == pytest.approx(1.03 * was, abs=1e-9)


def test_what_cannot_be_written_is_told_with_what_to_do(tmp_path: Path) -> None:
    own, out = tmp_path / "control.xacro", tmp_path / "better.xacro"
    own.write_text(CONTROL)
    causes = found(
        ("joint_offset", "joint:shoulder", {"offset_rad": 0.05}),
        ("gear_ratio", "joint:hand", {"scale_error": 0.03}),
        ("joint_offset", "joint:knee", {"offset_rad": 0.05}),
        ("backlash", "joint:elbow", {"width_rad": 0.05}),
    ).causes
    told = patch_ros2_control(own, causes, out)
    assert out.read_text() == CONTROL and len(told) == 3
    assert told["joint_offset", "joint:shoulder"] == (
        "not written: joint shoulder has a parameter offset = '2048', whose unit only its driver knows; what the joint reports "
        "must grow by +0.05 rad"
    )
    assert "DifferentialTransmission" in told["gear_ratio", "joint:hand"]
    assert "it has shoulder, elbow" in told["joint_offset", "joint:knee"]
    own.write_text("<robot/>")
    with pytest.raises(MirrorPostureError, match="no <ros2_control>"):
        patch_ros2_control(own, causes, out)


@pytest.mark.parametrize("order", [1, -1])
def test_an_offset_and_a_gear_of_one_joint_are_written_once(order: int, tmp_path: Path) -> None:
    """θ = q + a + e q. Before: the last of them overwrote the other's offset, so it depended on their order."""
    own, out = tmp_path / "control.xacro", tmp_path / "better.xacro"
    own.write_text(CONTROL)
    error, names = 0.03, {"ratio": 40.0, "neck_zero": 0.1}
    offsets = {"elbow": -0.05, "wrist": 0.02, "neck": 0.04}
    causes = found(
        *(("joint_offset", f"joint:{name}", {"offset_rad": offset}) for name, offset in offsets.items()),
        *(("gear_ratio", f"joint:{name}", {"scale_error": error}) for name in offsets),
    ).causes[::order]
    told = patch_ros2_control(own, causes, out)
    assert len(told) == 6 and not any("not written" in line for line in told.values())
    for name, offset in offsets.items():
        assert told["joint_offset", f"joint:{name}"] == told["gear_ratio", f"joint:{name}"]
        for actuator in (-20.0, 3.0):
            was = reported(CONTROL, name, actuator, **names)
            stands = was + offset + error * was
            assert reported(out.read_text(), name, actuator, **names) == pytest.approx(stands, abs=1e-9)


def test_two_offsets_of_one_joint_are_one_element(tmp_path: Path) -> None:
    own, out = tmp_path / "control.xacro", tmp_path / "better.xacro"
    own.write_text(CONTROL)
    causes = found(*2 * [("joint_offset", "joint:wrist", {"offset_rad": 0.02})]).causes
    patch_ros2_control(own, causes, out)
    assert out.read_text().count("<offset>") == CONTROL.count("<offset>") + 1
    was = reported(CONTROL, "wrist", 3.0)
    assert reported(out.read_text(), "wrist", 3.0) == pytest.approx(was + 0.04, abs=1e-9)
