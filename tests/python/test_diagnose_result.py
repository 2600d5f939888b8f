"""The diagnosis as dataclasses, in people's units, and with markers withheld."""

from __future__ import annotations

import importlib
import json
from pathlib import Path

import pytest

import mirror_posture as mp
from mirror_posture.diagnosis import Cause, Diagnosis, Estimate
from mirror_posture.diagnosis.formatting import ground_words, left_out_words, percent, tell, tell_all
from mirror_posture.diagnosis.markers import marker_of_place, only_markers
from mirror_posture.diagnosis.next_postures import write_next_postures
from mirror_posture.session.frames import read_frames
from mirror_posture.session.tables import read_table
from session_folder import write_folder

DOCUMENT = {
    "format": "mirror-posture/diagnosis",
    "version": 1,
    "verdict": "explained",
    "sentence": "said",
    "causes": [
        {
            "effect": "backlash",
            "at": "joint:elbow",
            "probability": 0.9,
            "parameters": {"width_rad": {"value": 0.041, "std": 0.0012}},
            "alternatives": [{"effect": "stiction", "at": "joint:elbow", "probability": 0.08}],
        }
    ],
    "where": [{"at": "joint:elbow", "share": 1.0}],
    "gap": {
        "before_m": 0.008,
        "after_m": 0.0006,
        "noise_floor_m": 0.0005,
        "closed": 0.98,
        "closed_ci95": [0.97, 1.0],
        "held_out_postures": 80,
        "checked": [
            {
                "session": "other",
                "before_m": 0.007,
                "after_m": 0.001,
                "ground": {
                    "after_m": 0.0006,
                    "yields_rad_per_nm": [5.8e-6, 1e-6, 0.0],
                    "std_rad_per_nm": [4e-7, 5e-7, 1e-3],
                },
                "left_out": {"points": 1, "points_given": 1236, "boards": 2},
            }
        ],
    },
    "next_postures": [{"elbow": 0.2}],
    "said_by_a_newer_version": {"kept": True},
}


def test_what_was_not_estimated_is_not_printed_as_zero() -> None:
    """Beside mounts by hand the small errors everywhere are zeros of joints; their lengths are no part of the model."""
    values = {"spread_m": Estimate(0.0, 0.0), "spread_rad": Estimate(0.0028, 0.0009)}
    (told,) = tell_all(Cause("geometry", "robot", 0.99, values))
    assert "°" in str(told)
    shift = Cause(
        "marker_mount", "marker:a", 0.99, {"dx_m": Estimate(0.0, 0.001), "dy_m": Estimate(0.01, 0.0)}
    )
    assert len(tell_all(shift)) == 2


def test_the_public_format_becomes_dataclasses_and_comes_back_whole(tmp_path: Path) -> None:
    file = tmp_path / "diagnosis.json"
    file.write_text(json.dumps(DOCUMENT), encoding="utf-8")
    found = Diagnosis.load(tmp_path)
    (cause,) = found.causes
    assert (cause.effect, cause.at, cause.parameters["width_rad"].std) == ("backlash", "joint:elbow", 0.0012)
    assert cause.alternatives[0].effect == "stiction"
    assert found.gap.closed_ci95 == (0.97, 1.0) and found.gap.checked[0].after_m == 0.001
    ground = found.gap.checked[0].ground
    assert ground is not None and ground.after_m == 0.0006
    # What is below three deviations is not told.
    assert ground_words(ground).startswith(
        "its base turns by +5.8 ± 0.4 µrad/N m about x under the robot's weight"
    )
    left_out = found.gap.checked[0].left_out
    assert left_out is not None and left_out_words(left_out) == (
        "left out of it as false: 1 of 1236 observations of markers and 2 boards that no flat mirror explains"
    )
    assert found.next_postures == ({"elbow": 0.2},)
    assert json.loads(found.to_json()) == DOCUMENT


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"version": 3}, "version 3"),
        ({"version": True}, "version True"),
        ({"verdict": "perhaps"}, "perhaps"),
        ({"gap": {"before_m": 1.0}}, "after_m"),
        ({"causes": [{"effect": "drift"}]}, "parameters"),
    ],
)
def test_what_is_no_diagnosis_is_refused_by_file_and_reason(
    tmp_path: Path, change: dict[str, object], named: str
) -> None:
    file = tmp_path / "diagnosis.json"
    file.write_text(json.dumps(DOCUMENT | change), encoding="utf-8")
    with pytest.raises(mp.MirrorPostureError, match=named) as refused:
        Diagnosis.load(file)
    assert str(file) in str(refused.value)


@pytest.mark.parametrize(
    ("name", "value", "std", "text"),
    [
        ("offset_rad", 0.0608593, 0.00014840, "offset +3.4870 ± 0.0085 °"),
        ("dx_m", -0.0042893, 0.00005, "dx -4.289 ± 0.050 mm"),
        ("compliance_rad_per_nm", 0.01, 0.001, "compliance 0.573 ± 0.057 °/N m"),
        # Thousandths where zeros behind the point could not be counted at a glance.
        ("compliance_rad_per_nm", 1e-5, 2e-6, "compliance 0.57 ± 0.11 ·10⁻³ °/N m"),
        ("rate_rad_per_s", 1e-5, 1e-6, "rate +2.06 ± 0.21 °/h"),
        ("scale_error", 0.0395, 0.0006, "scale error +3.950 ± 0.060 %"),
        ("curvature_per_m", 0.02, 0.001, "curvature +0.0200 ± 0.0010 1/m"),
        ("first_frame", 42.0, 0.0, "first frame 42 ± 0.0"),
        ("thickness_m", 0.003, 0.0002, "thickness 3.00 ± 0.20 mm"),
        # A pane of no thickness, as a diagnosis tells it of a session that states one.
        ("thickness_m", 0.0, 0.0002, "thickness 0.00 ± 0.20 mm (no glass: silvered in front)"),
    ],
)
def test_parameters_are_told_in_degrees_and_millimetres(
    name: str, value: float, std: float, text: str
) -> None:
    assert str(tell(name, Estimate(value, std))) == text


def test_a_probability_short_of_certainty_is_not_rounded_up_to_it() -> None:
    assert [percent(p) for p in (0.5, 0.99, 0.994, 1.0)] == ["50 %", "99.0 %", "99.4 %", "100 %"]


def test_a_withheld_marker_leaves_nothing_of_itself(tmp_path: Path) -> None:
    session = mp.load_session(write_folder(tmp_path / "session"))
    kept = only_markers(session, ["elbow_ball"])
    assert kept.marker_names == ("elbow_ball",)
    assert kept.mirror_view.marker_px[2, 0].tolist() == [12.0, 13.0]
    assert kept.mirror_view.marker_seen.sum() == 1 and not kept.direct_view.marker_seen.any()
    assert kept.points is not None and kept.points.seen.sum() == 1
    assert (kept.mirror_view.board_seen == session.mirror_view.board_seen).all()
    with pytest.raises(mp.MirrorPostureError, match="marker:hand, marker:elbow_ball"):
        marker_of_place(session, "marker:foot")
    with pytest.raises(mp.MirrorPostureError, match="all markers"):
        mp.diagnose(session, withhold=["marker:hand", "elbow_ball"])


def test_the_function_keeps_its_name_when_its_modules_are_loaded() -> None:
    importlib.import_module("mirror_posture.diagnosis.recording")
    assert callable(mp.diagnose)


def test_the_next_postures_are_a_frames_table_that_a_session_can_take(tmp_path: Path) -> None:
    found = Diagnosis.from_document(
        DOCUMENT | {"next_postures": [{"elbow": 0.2}, {"elbow": -0.3, "shoulder": 0.1}]}
    )
    folder = write_folder(tmp_path / "session", detections=None, points=None)
    write_next_postures(found, folder / "frames.csv")
    frames = read_frames(read_table(folder / "frames.csv"), mp.Robot.from_urdf(folder / "robot.urdf"), True)[
        0
    ]
    assert frames.joint_names == ("elbow", "shoulder")
    assert frames.commanded.tolist() == [[0.2, 0.0], [-0.3, 0.1]]
