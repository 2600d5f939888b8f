"""By hand: what is printed, which picture is taken, and that no half a file ever is."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture.correct.viewpoints import Viewpoint, go
from mirror_posture.robots import (
    JointLimits,
    LostRobotError,
    NoLookError,
    Nominal,
    TurnsView,
    UnsafeCommandError,
)
from mirror_posture.robots.by_hand import ByHandOptions, ByHandRobot
from mirror_posture.viewpoint import View

QUICK = ByHandOptions(longest_wait_s=5.0, still_s=0.1, poll_s=0.01)


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    return Nominal.load()


@pytest.fixture
def robot(nominal: Nominal, tmp_path: Path) -> Iterator[ByHandRobot]:
    lines: list[str] = []
    robot = ByHandRobot(nominal, tmp_path, QUICK, say=lines.append)
    robot.lines = lines  # type: ignore[attr-defined]
    yield robot
    robot.close()


def coded(shade: int, suffix: str = ".png") -> bytes:
    rng = np.random.default_rng(shade)
    picture = rng.integers(0, 40, (600, 800, 3), dtype=np.uint8) + np.uint8(shade)
    good, data = cv2.imencode(suffix, picture)
    assert good
    return data.tobytes()


def shade(picture: np.ndarray | None) -> int:
    assert picture is not None
    return round(float(picture.mean()) - 19.5)


def later(work: Callable[[], object], after_s: float = 0.05) -> threading.Thread:
    thread = threading.Thread(target=lambda: (time.sleep(after_s), work()))
    thread.start()
    return thread


def test_it_says_what_to_do_in_degrees_and_radians(robot: ByHandRobot) -> None:
    robot.command({"r_elbow": 0.3, "l_elbow": 0.1})
    robot.command({"r_elbow": 0.25})
    robot.turn(View(-0.2, 0.1, 0.2))
    robot.rest()
    said = "\n".join(robot.lines)  # type: ignore[attr-defined]
    assert "r_elbow" in said and "+17.189°  +0.30000 rad" in said
    assert "+14.324°  +0.25000 rad   (was   +17.189°" in said
    assert "11° to its left" in said and "6° towards it" in said and "200 mm" in said
    assert said.splitlines()[-1].startswith("REST")
    assert sum("l_elbow" in line for line in said.splitlines()) == 1, "only what changes is told again"
    assert isinstance(robot, TurnsView)


def test_the_first_posture_and_view_are_told_where_both_are_zero(nominal: Nominal, tmp_path: Path) -> None:
    """Before, a correction whose first posture was all zeros printed LOOK alone, and the robot stood anywhere."""
    lines: list[str] = []
    robot = ByHandRobot(nominal, tmp_path, QUICK, say=lines.append)
    go(robot, Viewpoint(View()), dict.fromkeys(robot.joint_names, 0.0))
    for value in (40, 50):
        thread = later(lambda value=value: (tmp_path / f"{value}.png").write_bytes(coded(value)))
        assert shade(robot.look().picture_bgr) == value
        thread.join()
    count = len(robot.joint_names)
    told = [line.split()[0] for line in lines]
    assert told == ["MOVE"] * count + ["TURN", "LOOK", "took", "LOOK", "took"], "once, the posture first"
    assert (
        all("+0.000°" in line for line in lines[:count])
        and "TURN   the robot 0° to its right" in lines[count]
    )


def test_the_first_posture_is_told_before_the_first_view(robot: ByHandRobot) -> None:
    go(robot, Viewpoint(View(0.1)), dict.fromkeys(robot.joint_names, 0.0))
    told = [line.split()[0] for line in robot.lines]  # type: ignore[attr-defined]
    assert told == ["MOVE"] * len(robot.joint_names) + ["TURN"]


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_file_that_is_still_being_written_is_not_read(robot: ByHandRobot, suffix: str) -> None:
    data, file = coded(100, suffix), robot.folder / f"a{suffix}"
    times: list[float] = []

    def slowly() -> None:
        with file.open("wb") as out:
            for part in range(5):
                out.write(data[part * len(data) // 5 : (part + 1) * len(data) // 5])
                out.flush()
                time.sleep(0.15)  # longer than `still_s`: its size alone says that it is done
        times.append(time.monotonic())

    robot.command({"r_elbow": 0.3})
    thread = later(slowly)
    look = robot.look()
    taken = time.monotonic()
    thread.join()
    assert taken > times[0] - 0.15
    expected = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert look.picture_bgr is not None and np.array_equal(look.picture_bgr, expected)
    assert look.commanded["r_elbow"] == 0.3 and look.view == View()


def test_pictures_from_before_the_command_are_not_taken(robot: ByHandRobot) -> None:
    (robot.folder / "old.png").write_bytes(coded(10))
    robot.command({"r_elbow": 0.3})
    thread = later(lambda: (robot.folder / "new.png").write_bytes(coded(50)))
    assert shade(robot.look().picture_bgr) == 50
    thread.join()
    (robot.folder / "between.png").write_bytes(coded(80))
    robot.turn(View(0.2))
    thread = later(lambda: (robot.folder / "newer.png").write_bytes(coded(120)))
    assert shade(robot.look().picture_bgr) == 120
    thread.join()


def test_a_camera_that_always_writes_one_name_is_understood(robot: ByHandRobot) -> None:
    for value in (20, 60, 90):
        robot.command({"r_elbow": value / 100.0})
        thread = later(lambda value=value: (robot.folder / "latest.png").write_bytes(coded(value)))
        assert shade(robot.look().picture_bgr) == value
        thread.join()


def test_other_files_and_unfinished_copies_are_passed_over(robot: ByHandRobot) -> None:
    def work() -> None:
        (robot.folder / "notes.txt").write_text("x")
        (robot.folder / ".a.png").write_bytes(coded(5))
        (robot.folder / "b.png.part").write_bytes(coded(70))
        (robot.folder / "empty.png").write_bytes(b"")
        time.sleep(0.3)
        (robot.folder / "b.png.part").rename(robot.folder / "b.png")

    thread = later(work)
    assert shade(robot.look().picture_bgr) == 70
    thread.join()


def test_of_two_new_pictures_the_newer_is_taken_and_both_are_done_with(
    nominal: Nominal, tmp_path: Path
) -> None:
    options = ByHandOptions(longest_wait_s=0.6, still_s=0.2, poll_s=0.01)
    robot = ByHandRobot(nominal, tmp_path, options, say=lambda line: None)
    robot.turn(View())
    (tmp_path / "1.png").write_bytes(coded(30))
    time.sleep(0.02)
    (tmp_path / "2.png").write_bytes(coded(40))
    assert shade(robot.look().picture_bgr) == 40
    with pytest.raises(NoLookError, match=r"no picture came .* within 0\.6 s"):
        robot.look()


def test_a_broken_picture_is_told_and_waited_over(nominal: Nominal, tmp_path: Path) -> None:
    robot = ByHandRobot(nominal, tmp_path, ByHandOptions(0.5, 0.05, 0.01), say=lambda line: None)
    robot.turn(View())
    (tmp_path / "half.png").write_bytes(coded(30)[:5000])
    with pytest.raises(NoLookError, match=r"half\.png.*broken"):
        robot.look()


def test_a_folder_that_vanishes_is_a_lost_robot(nominal: Nominal, tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    robot = ByHandRobot(nominal, folder, QUICK, say=lambda line: None)
    shutil.rmtree(folder)
    with pytest.raises(LostRobotError, match="folder of pictures"):
        robot.look()
    with pytest.raises(mp.MirrorPostureError, match="is no folder"):
        ByHandRobot(nominal, folder)


def test_narrower_limits_and_fewer_joints(nominal: Nominal, tmp_path: Path) -> None:
    robot = ByHandRobot(nominal, tmp_path, limits={"r_elbow": JointLimits(0.0, 1.0)}, say=lambda line: None)
    assert robot.joint_names == ("r_elbow",)
    with pytest.raises(UnsafeCommandError, match="from 0 to 1"):
        robot.command({"r_elbow": 1.2})
    with pytest.raises(mp.MirrorPostureError, match=r"no joint of robot\.urdf"):
        ByHandRobot(nominal, tmp_path, limits={"tail": JointLimits(0.0, 1.0)})
