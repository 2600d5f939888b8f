"""What a capture tells: joints in the unit that a person measures, and what is left at its end."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lifting_column import URDF
from mirror_posture import Robot
from mirror_posture.capture import Capture, Recorder
from mirror_posture.capture.live import state_of
from mirror_posture.capture.server import CaptureServer
from mirror_posture.capture.sources import Shot
from mirror_posture.plan import PlannedFrame
from mirror_posture.render import EMBEDDED_FOLDER
from mirror_posture.robots import Nominal

ROWS = [PlannedFrame(number, number, 0, {"r_elbow": 0.1 * number}) for number in range(3)]


class Nothing:
    """A source that is never at its end."""

    stills, live = False, True

    def read(self) -> Shot:
        return Shot(np.zeros((48, 64, 3), np.uint8), 0.0)

    def close(self) -> None: ...


@pytest.fixture
def capture(tmp_path: Path) -> Capture:
    return Capture(Nominal.load(EMBEDDED_FOLDER), ROWS, Nothing(), Recorder(tmp_path, ROWS))


def lifted(capture: Capture) -> Any:
    """The capture's next posture is one of an arm on a telescopic column."""
    capture.plan = [PlannedFrame(0, 0, 0, {"lift_1": 0.300, "turn": 0.3})]
    robot = Robot.from_urdf_text(URDF)
    capture.nominal = SimpleNamespace(robot=robot, metadata=capture.nominal.metadata, camera=None)  # type: ignore[assignment]
    return capture


def test_a_joint_that_slides_is_told_in_millimetres(capture: Capture) -> None:
    """Before, 0.300 m were told as 17.2 degrees."""
    following = state_of(lifted(capture))["next"]
    assert following["joints"] == [
        {"name": "lift_1", "value": 300.0, "unit": " mm"},
        {"name": "turn", "value": 17.2, "unit": "°"},
    ]
    assert following["joints_deg"] == {"turn": 17.2}


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium here")
def test_a_browser_shows_the_unit(capture: Capture, tmp_path: Path) -> None:
    server = CaptureServer(lifted(capture))
    try:
        done = subprocess.run(
            ["chromium", "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}",
             "--virtual-time-budget=4000", "--dump-dom", server.address],
            capture_output=True, timeout=60, text=True,
        )  # fmt: skip
    finally:
        server.close()
    assert done.returncode == 0, done.stderr[-500:]
    assert "<td>lift_1</td><td>300.0 mm</td>" in done.stdout and "<td>turn</td><td>17.2°</td>" in done.stdout


def test_a_plan_is_through_and_not_all_taken_where_postures_were_left_out(capture: Capture) -> None:
    for _ in ROWS:
        capture.do("skip")
    assert not capture.step()
    assert capture.message == "the plan is through; 3 postures are not taken"


@pytest.mark.parametrize(
    ("left_out", "said"),
    [(1, "the plan is through; 1 posture is not taken"), (0, "all postures of the plan are taken")],
)
def test_the_last_picture_does_not_hide_what_was_left_out(capture: Capture, left_out: int, said: str) -> None:
    for _ in range(left_out):
        capture.do("skip")
    for row in ROWS[left_out:]:
        capture._record(row, Nothing().read())
    assert capture.message == said and not capture.step()
