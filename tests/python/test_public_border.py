"""The border of the public API: a wrong argument is a `MirrorPostureError`; records are short, picklable, safe to compare."""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture import calibrate, correct, detect, diagnosis, mirror, optics, session, triangulate
from mirror_posture.robots import JointLimits, check_command
from mirror_posture.robots.errors import NotSettledError, UnsafeCommandError
from session_folder import URDF, write_folder

MODULES = (mp, calibrate, correct, detect, diagnosis, mirror, optics, session, triangulate)


def public_functions() -> dict[str, Callable[..., Any]]:
    """Every function that a public module lists, or, without a list, defines."""
    found: dict[str, Callable[..., Any]] = {}
    for module in MODULES:
        names = getattr(module, "__all__", None) or [
            name
            for name, thing in vars(module).items()
            if getattr(thing, "__module__", "") == module.__name__
        ]
        for name in names:
            thing = getattr(module, name)
            if inspect.isfunction(thing) and not name.startswith("_"):
                found[f"{thing.__module__}.{name}"] = thing
    return found


def methods_of_a_robot() -> dict[str, Callable[..., Any]]:
    robot = mp.Robot.from_urdf_text(URDF)
    names = [name for name, thing in vars(mp.Robot).items() if inspect.isfunction(thing) and name[0] != "_"]
    return {f"Robot.{name}": getattr(robot, name) for name in (*names, "from_urdf", "from_urdf_text")}


EVERYTHING = public_functions() | methods_of_a_robot()


class Odd:
    """Something that no function can use."""


@pytest.mark.parametrize("wrong", [Odd(), 3 + 4j, np.array(["a", "b"])], ids=["object", "complex", "text"])
@pytest.mark.parametrize("name", sorted(EVERYTHING))
def test_an_argument_of_a_wrong_type_is_told(name: str, wrong: object) -> None:
    function = EVERYTHING[name]
    needed = [
        p
        for p in inspect.signature(function).parameters.values()
        if p.default is p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    ]
    if not needed:
        pytest.skip("takes nothing that it must have")
    by_place = [wrong for p in needed if p.kind is not p.KEYWORD_ONLY]
    by_name = {p.name: wrong for p in needed if p.kind is p.KEYWORD_ONLY}
    with pytest.raises(mp.MirrorPostureError) as told:
        function(*by_place, **by_name)
    assert str(told.value), "an error that says nothing"


def test_the_list_of_functions_is_not_empty() -> None:
    names = {name.rpartition(".")[2] for name in EVERYTHING}
    assert {
        "measure",
        "load_session",
        "estimate_mirrors",
        "forward_kinematics",
        "diagnose",
        "correct",
    } <= names
    assert len(names) > 40


def test_the_review_s_four_examples(tmp_path: Path) -> None:
    robot = mp.Robot.from_urdf_text(URDF)
    calls: list[Callable[[], object]] = [
        lambda: mp.measure(str(tmp_path / "no such folder")),
        lambda: session.load_camera_info("no such file"),
        lambda: robot.forward_kinematics(np.zeros(3)),
        lambda: check_command({"j": "x"}, {"j": JointLimits(-1.0, 1.0)}, "robot"),  # type: ignore[dict-item]
    ]
    for call in calls:
        with pytest.raises(mp.MirrorPostureError):
            call()


def test_shapes_are_told_in_words() -> None:
    robot = mp.Robot.from_urdf_text(URDF)
    with pytest.raises(mp.MirrorPostureError, match=r"forward_kinematics: .*positions"):
        robot.forward_kinematics(np.zeros(3))


def test_a_folder_is_taken_where_a_session_is(tmp_path: Path) -> None:
    folder = write_folder(tmp_path)
    assert session.as_session(str(folder)).folder == folder
    loaded = mp.load_session(folder)
    assert session.as_session(loaded) is loaded
    with pytest.raises(mp.MirrorPostureError, match="has no pictures"):
        mp.detect_session(folder)


def test_records_are_short_and_comparable(tmp_path: Path) -> None:
    loaded = mp.load_session(write_folder(tmp_path))
    for record in (loaded, loaded.frames, loaded.mirror_view):
        assert len(repr(record)) < 1500, type(record)
        assert record == record and (record == pickle.loads(pickle.dumps(record))) is False
    assert "board_seen" in repr(loaded.mirror_view) and "3 × " in repr(loaded.mirror_view)


def test_robot_camera_and_session_survive_pickling(tmp_path: Path) -> None:
    loaded = mp.load_session(write_folder(tmp_path))
    again = pickle.loads(pickle.dumps(loaded))
    assert again.camera == loaded.camera and again.robot == loaded.robot and again.markers == loaded.markers
    np.testing.assert_array_equal(again.positions, loaded.positions)
    np.testing.assert_array_equal(again.mirror_view.board_px, loaded.mirror_view.board_px)
    np.testing.assert_array_equal(
        again.robot.forward_kinematics(again.positions), loaded.robot.forward_kinematics(loaded.positions)
    )
    point = [[0.1, 0.2, 1.0]]
    np.testing.assert_array_equal(again.camera.project(point), loaded.camera.project(point))


def test_errors_come_back_from_pickling(tmp_path: Path) -> None:
    folder = write_folder(tmp_path)
    rows = (folder / "frames.csv").read_text(encoding="utf-8").splitlines()
    (folder / "frames.csv").write_text(
        "\n".join([rows[0], *(row.replace(",0.", ",x") for row in rows[1:])]) + "\n", encoding="utf-8"
    )
    with pytest.raises(session.SessionError) as caught:
        mp.load_session(folder)
    # The first problem is one of all problems: an error that holds itself.
    assert caught.value.problems[0] is caught.value
    again = pickle.loads(pickle.dumps(caught.value))
    assert str(again) == str(caught.value) and again.row == caught.value.row and again.problems[0] is again
    assert [str(one) for one in again.problems] == [str(one) for one in caught.value.problems]
    refused = UnsafeCommandError("elbow: beyond its limits", joint="elbow", position=3.0)
    for error in (refused, NotSettledError("elbow: still moving", joints=("elbow",))):
        back = pickle.loads(pickle.dumps(error))
        assert type(back) is type(error) and str(back) == str(error) and vars(back) == vars(error)


def test_modules_are_reachable_from_the_package() -> None:
    assert mp.detect is detect and mp.optics is optics and mp.mirror is mirror and mp.session is session
    for name in mp.__dir__():
        getattr(mp, name)
