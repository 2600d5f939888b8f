"""A diagnosis is applied once: its causes of the camera and the setup count as the robot's do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture import MirrorPostureError
from mirror_posture.diagnosis.applied import apply_diagnosis
from mirror_posture.diagnosis.fingerprint import KEY, fingerprint
from session_folder import CAMERA, SESSION, replaced, write_folder
from test_apply_patch import found


@pytest.mark.parametrize(
    "cause",
    [
        ("camera_focal", "camera", {"scale_error": 0.02}),
        ("camera_center", "camera", {"du_px": 2.0, "dv_px": 0.0}),
        ("lens_distortion", "camera", {"dk1": 0.01}),
        ("camera_resolution", "camera", {"factor": 0.5, "du_px": 0.0, "dv_px": 0.0}),
        ("board_scale", "board", {"scale_error": 0.01}),
        ("mirror_glass", "mirror", {"thickness_m": 0.004}),
        ("gravity_direction", "robot", {"rx_rad": 0.1, "ry_rad": 0.0, "rz_rad": 0.0}),
    ],
    ids=lambda cause: cause[0],
)
def test_no_cause_is_applied_twice(cause: tuple[str, str, dict[str, float]], tmp_path: Path) -> None:
    """Before: factors of the camera and the board multiplied."""
    session = mp.load_session(write_folder(tmp_path / "session"))
    diagnosis = found(cause, document={KEY: fingerprint(session)})
    once = mp.load_session(apply_diagnosis(session, diagnosis, tmp_path / "once").folder)
    with pytest.raises(MirrorPostureError, match=r"another session \(the numbers of its camera, board"):
        apply_diagnosis(once, diagnosis, tmp_path / "twice")
    assert not (tmp_path / "twice").exists()


def test_an_older_diagnosis_states_no_setup_and_is_accepted(tmp_path: Path) -> None:
    session = mp.load_session(write_folder(tmp_path / "session"))
    older = {key: value for key, value in fingerprint(session).items() if key != "setup_sha256"}
    apply_diagnosis(session, found(document={KEY: older}), tmp_path / "better")
    with pytest.raises(MirrorPostureError, match=r"its robot.urdf differ"):
        apply_diagnosis(session, found(document={KEY: older | {"robot_sha256": "0"}}), tmp_path / "other")


def test_another_spelling_of_the_same_numbers_is_the_same_session(tmp_path: Path) -> None:
    camera = replaced(replaced(CAMERA, "693.0", "6.93e2"), "head", "eye")
    camera = replaced(replaced(camera, "plumb_bob", "rational_polynomial"), "cols: 5", "cols: 8")
    camera = replaced(camera, "0.003]", "0.003, 0, 0, 0]")
    setup = replaced(SESSION, "square = 0.014", "square = 14e-3")
    first = fingerprint(mp.load_session(write_folder(tmp_path / "a")))
    respelt = mp.load_session(write_folder(tmp_path / "b", session=setup))
    assert fingerprint(respelt) == first
    # The same coefficients of another model of lenses are told apart; its last zeros are not.
    rational = fingerprint(mp.load_session(write_folder(tmp_path / "c", camera=camera)))
    assert rational["setup_sha256"] != first["setup_sha256"]
    assert (rational["robot_sha256"], rational["frames_sha256"]) == (
        first["robot_sha256"],
        first["frames_sha256"],
    )
    bare = replace(respelt, camera=None, board=None, mirror=None, gravity_m_per_s2=np.zeros(3))
    assert len(fingerprint(bare)["setup_sha256"]) == 64
