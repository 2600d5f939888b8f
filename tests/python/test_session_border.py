"""What a session cannot mean is refused at its border: units, ids, pixels, paths, and files of no honest size."""

from __future__ import annotations

import os
import pickle
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from mirror_posture import SessionError, load_session
from mirror_posture.session import write_session
from mirrored_session import write_mirrored
from session_folder import (
    CAMERA,
    DETECTIONS,
    FRAMES,
    POINTS,
    SESSION,
    URDF,
    replaced,
    write_folder,
)

MANY = "frame,posture,elbow,measured:elbow\n" + "".join(
    f"{i},{i},{0.1 * i:.3f},{0.1 * i * 57.29578:.3f}\n" for i in range(6)
)

THOUSANDTHS = "frame,posture,elbow,measured:elbow\n" + "".join(
    f"{i},{i},{0.1 * i:.3f},{0.0001 * i:.5f}\n" for i in range(6)
)

REFUSED: dict[str, tuple[dict[str, str | None], str, int | None, str]] = {
    "column with a blank": (
        {"frames": "frame,posture,elbow,elbow \n0,0,0.2,0.3\n"},
        "frames.csv",
        None,
        "the column 'elbow' stands there twice",
    ),
    "posture of another row": (
        {"frames": replaced(FRAMES, "5,1", "5,0")},
        "frames.csv",
        3,
        "needed one command for all frames of a posture",
    ),
    "gravity in g": (
        {"session": replaced(SESSION, "-9.81", "-1.0")},
        "session.toml",
        None,
        "needed about 9.80665 m/s²",
    ),
    "gravity in mm/s²": ({"session": replaced(SESSION, "-9.81", "-9810.0")}, "session.toml", None, "length"),
    "no gravity": ({"session": replaced(SESSION, "-9.81", "0.0")}, "session.toml", None, "length of 0"),
    "gravity without unit": (
        {
            "session": replaced(
                replaced(SESSION, "gravity = [0.0, 0.0, -9.81]\n", ""),
                "[camera_mount]",
                "[gravity]\nvector = [0.0, 0.0, -1.0]\n\n[camera_mount]",
            )
        },
        "session.toml",
        None,
        "gravity.unit is missing",
    ),
    "pixel outside": (
        {"detections": replaced(DETECTIONS, "12,13", "12,613")},
        "detections.csv",
        5,
        "outside the camera's picture of 800 × 600 px",
    ),
    "picture of one pixel": (
        {
            "camera": replaced(replaced(CAMERA, "width: 800", "width: 1"), "height: 600", "height: 1"),
            "detections": None,
        },
        "camera.yaml",
        None,
        "at least 16 px",
    ),
    "focal length in mm": (
        {"camera": replaced(CAMERA, "[693.0", "[3.5")},
        "camera.yaml",
        None,
        "is it in mm?",
    ),
    "points in mm": (
        {"points": "frame,marker,x,y,z\n0,hand,100,200,300\n1,hand,-900,10,20\n5,hand,400,-800,500\n"},
        "points.csv",
        None,
        "are they in mm?",
    ),
    "point of 1e308": ({"points": replaced(POINTS, "0.1,", "1e308,")}, "points.csv", 1, "at most 1e+12"),
    "point of 1e9": (
        {
            "points": "frame,marker,x,y,z\n0,hand,0.1,0.2,0.3\n1,hand,0.1,0.2,0.3\n5,hand,1e9,0.2,0.3\n",
            "frames": replaced(FRAMES, "1,0,2.0", "1,0,2.0"),
        },
        "points.csv",
        None,
        "mend the cells",
    ),
    "encoder in degrees": ({"frames": MANY, "detections": None}, "frames.csv", None, "is the encoder in degrees?"),
    "command in milliradians": ({"frames": THOUSANDTHS, "detections": None}, "frames.csv", None, "is the command in milli"),
    "encoder beyond its limit": (
        {"frames": replaced(FRAMES, "measured:elbow", "measured:shoulder").replace("0.41", "12")},
        "frames.csv",
        3,
        "are these degrees?",
    ),
    "origins in mm": ({"robot": replaced(URDF, "0 0 -0.1", "0 0 -100")}, "robot.urdf", None, "is it in mm?"),
    "angles in degrees": (
        {"robot": replaced(URDF, 'xyz="0 0 -0.1"', 'rpy="0 90 0" xyz="0 0 -0.1"')},
        "robot.urdf",
        None,
        "is it in degrees?",
    ),
    "square in mm": ({"session": replaced(SESSION, "0.014", "14.0")}, "session.toml", None, "board.square"),
    "ball in mm": ({"session": replaced(SESSION, "0.0116", "11.6")}, "session.toml", None, "diameter"),
    "noise of nothing": (
        {"session": replaced(SESSION, "pixel_std = 0.2", "pixel_std = 1e-300")},
        "session.toml",
        None,
        "noise.pixel_std",
    ),
    "glass in mm": ({"session": replaced(SESSION, "0.003", "3.0")}, "session.toml", None, "glass_thickness"),
    "tolerance in mm": (
        {"session": replaced(SESSION, "square", "tolerance_m = 3.0\nsquare")},
        "session.toml",
        None,
        "board.tolerance_m",
    ),
    "log without time": ({"states": "shoulder\n1\n"}, "states.csv", None, "'time_s' is missing"),
    "log that falls": (
        {"states": "time_s,shoulder\n0,0.1\n4,0.2\n3,0.2\n"},
        "states.csv",
        3,
        "needed times that rise",
    ),
    "log too short": (
        {"states": "time_s,shoulder\n0,0.1\n3,0.2\n", "frames": replaced(FRAMES, "shoulder,", "").replace(
            ",0.1,0.2,", ",0.2,").replace("-0.3,", "")},
        "frames.csv",
        3,
        "within states.csv",
    ),
    "log of no joint": ({"states": "time_s,knee\n0,0.1\n9,0.2\n"}, "states.csv", None, "no movable joint 'knee'"),
    "yaml aliases": (
        {"camera": "a: &a [1, 2]\nb: [*a, *a]\n" + CAMERA},
        "camera.yaml",
        None,
        "line 2: got a YAML alias",
    ),
    "deep yaml": ({"camera": "a: " + "[" * 400 + "]" * 400 + "\n"}, "camera.yaml", None, "deep parts"),
    "very many columns": (
        {"frames": "frame,posture," + ",".join(f"j{i}" for i in range(6000)) + "\n"},
        "frames.csv",
        None,
        "at most 5000 columns",
    ),
}  # fmt: skip


def folder_with(place: Path, changed: dict[str, str | None]) -> Path:
    folder = write_folder(place, **changed)
    if (states := changed.get("states")) is not None:
        (folder / "states.csv").write_text(states)
    if changed.get("detections", "") is None and "points" not in changed:
        (folder / "points.csv").write_text(POINTS.splitlines()[0] + "\n")
    return folder


@pytest.mark.parametrize("name", REFUSED)
def test_refuses(name: str, tmp_path: Path) -> None:
    changed, file, row, words = REFUSED[name]
    with pytest.raises(SessionError) as caught:
        load_session(folder_with(tmp_path / "session", changed))
    error = caught.value
    assert error.file.name == file and error.row == row, str(error)
    assert words in str(error) and "\n" not in str(error), str(error)


def test_a_stated_unit_of_gravity_is_taken(tmp_path: Path) -> None:
    text = replaced(SESSION, "gravity = [0.0, 0.0, -9.81]\n", "")
    text += '\n[gravity]\nvector = [0.0, 0.0, -0.1654]\nunit = "g"\n'
    moon = load_session(write_folder(tmp_path / "moon", session=text))
    np.testing.assert_allclose(moon.gravity_m_per_s2, [0, 0, -1.622], atol=1e-3)
    write_session(moon, tmp_path / "again")
    np.testing.assert_array_equal(load_session(tmp_path / "again").gravity_m_per_s2, moon.gravity_m_per_s2)


def test_tolerances_are_read_and_written(tmp_path: Path) -> None:
    text = replaced(SESSION, 'link = "camera_optical"', 'link = "camera_optical"\ntolerance_rad = 0.02')
    text = replaced(text, "square", "tolerance_m = 0.003\ntolerance_rad = 0.0\nsquare")
    text = replaced(text, "diameter", "tolerance_m = 0.001\ndiameter")
    write_session(load_session(write_folder(tmp_path / "in", session=text)), tmp_path / "out")
    for folder in ("in", "out"):
        session = load_session(tmp_path / folder)
        assert (session.camera_tolerance_m, session.camera_tolerance_rad) == (None, 0.02)
        assert session.board is not None and (session.board.tolerance_m, session.board.tolerance_rad) == (
            0.003,
            0.0,
        )
        assert [marker.tolerance_m for marker in session.markers] == [0.001, None]
        assert session.warnings == ()


def test_joints_are_read_from_the_log(tmp_path: Path) -> None:
    frames = "frame,posture,time_s,elbow\n0,0,0.0,0.2\n1,1,2.0,0.2\n5,2,4.0,0.4\n"
    log = "time_s,shoulder,elbow,measured:elbow\n-1,0,9,0\n1,0.2,9,0.4\n3,0,9,0.8\n5,-0.4,9,0\n"
    folder = folder_with(tmp_path / "in", {"frames": frames, "states": log})
    write_session(load_session(folder), tmp_path / "out")
    for session in (load_session(folder), load_session(tmp_path / "out")):
        assert session.frames.joint_names == ("elbow", "shoulder")
        np.testing.assert_allclose(session.frames.commanded, [[0.2, 0.1], [0.2, 0.1], [0.4, -0.2]])
        np.testing.assert_allclose(session.frames.measured[:, 0], [0.2, 0.6, 0.4])
        assert session.states is not None and session.states.joint_names == ("shoulder", "elbow")


def test_turning_joints_may_differ_within_a_posture(tmp_path: Path) -> None:
    """A joint that moves neither camera, board nor markers against each other turns the view only."""
    urdf = replaced(
        URDF,
        '<link name="base"/>',
        '<link name="foot"/><link name="base"/><joint name="turn" type="continuous"><parent link="foot"/>'
        '<child link="base"/><axis xyz="0 0 1"/></joint>',
    )
    frames = "frame,posture,turn,elbow\n0,0,0.1,0.2\n1,0,0.5,0.2\n5,1,0.1,0.2\n"
    session = load_session(write_folder(tmp_path, robot=urdf, frames=frames, points=None, session=replaced(
        SESSION, '[points]\nframe = "unknown"\n', "")))  # fmt: skip
    assert session.frames.commanded[:2, 0].tolist() == [0.1, 0.5]


def test_all_problems_are_told_at_once(tmp_path: Path) -> None:
    folder = write_folder(
        tmp_path,
        camera=replaced(CAMERA, "[693.0", "[-693.0"),
        points=replaced(POINTS, "0.1,", "x,"),
        detections=replaced(DETECTIONS, "hand", "foot"),
    )
    with pytest.raises(SessionError) as caught:
        load_session(folder)
    assert [p.file.name for p in caught.value.problems] == ["camera.yaml", "detections.csv", "points.csv"]
    assert caught.value.problems[0] is caught.value
    text = subprocess.run(
        [sys.executable, "-m", "mirror_posture", "check", str(folder)], capture_output=True, text=True
    )
    assert text.returncode == 1
    assert text.stderr.count("error:") == 3 and all(str(p) in text.stderr for p in caught.value.problems)


@pytest.mark.parametrize(
    "name", ["session.toml", "robot.urdf", "camera.yaml", "frames.csv", "detections.csv"]
)
def test_only_regular_files_within_the_folder(name: str, tmp_path: Path) -> None:
    outside = write_folder(tmp_path / "outside")
    folder = write_folder(tmp_path / "session")
    (folder / name).unlink()
    (folder / name).symlink_to(outside / name)
    with pytest.raises(SessionError, match="link"):
        load_session(folder)
    (folder / name).unlink()
    os.mkfifo(folder / name)
    with pytest.raises(SessionError, match="no regular file"):
        load_session(folder)
    (folder / name).unlink()
    # A link within the folder is a name like any other.
    (folder / "kept").write_bytes((outside / name).read_bytes())
    (folder / name).symlink_to("kept")
    assert load_session(folder).marker_names == ("hand", "elbow_ball")


def test_a_picture_by_a_link_that_leaves_is_refused(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "session", detections=None, frames="frame,posture,image\n0,0,images/a.png\n",
                          points=POINTS.splitlines()[0] + "\n")  # fmt: skip
    (folder / "images").symlink_to(tmp_path)
    (tmp_path / "a.png").write_bytes(b"secret")
    with pytest.raises(SessionError, match="link that leads out") as caught:
        load_session(folder)
    assert caught.value.row == 1


BOMBS = {
    "merged yaml": ("camera.yaml", "a: &a {x: 1}\n" + "".join(
        f"{chr(98 + i)}: &{chr(98 + i)} {{<<: [{', '.join(['*' + chr(97 + i)] * 9)}]}}\n" for i in range(20))),
    "long toml": ("session.toml", "x = " + "[" * 100_000),
    "large toml": ("session.toml", "# " + "x" * 2_000_000),
    "columns": ("frames.csv", "frame,posture," + ",".join(f"a{i}" for i in range(100_000)) + "\n"),
    "attributes": ("robot.urdf", "<robot><link" + "".join(f' a{i}="1"' for i in range(200_000)) + "/></robot>"),
    "markers": ("session.toml", SESSION + "".join(
        f'\n[[markers]]\nname = "m{i}"\nlink = "base"\n' for i in range(10_000))),
}  # fmt: skip


CHECKS = """
import re, runpy, sys
from pathlib import Path
sys.argv[1:] = ["check", sys.argv[1]]
code = 0
try:
    runpy.run_module("mirror_posture", run_name="__main__", alter_sys=True)
except SystemExit as end:
    code = end.code
# Not getrusage: its figure of a child begins with the parent's.
print(code, re.search(r"VmHWM:\\s*(\\d+)", Path("/proc/self/status").read_text())[1])
"""


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_are_refused_at_once(name: str, tmp_path: Path) -> None:
    file, text = BOMBS[name]
    folder = write_folder(tmp_path)
    (folder / file).write_text(text)
    begun = time.process_time()
    with pytest.raises(SessionError):
        load_session(folder)
    assert time.process_time() - begun < 2.0
    if not Path("/proc/self/status").exists():
        return
    # A process of its own: the most that this one has taken so far would hide it.
    done = subprocess.run([sys.executable, "-c", CHECKS, str(folder)], capture_output=True, text=True)
    code, most_kb = done.stdout.split()[-2:]
    # 135 MB are promised, the program's own start included, and a third to spare.
    assert code == "1" and int(most_kb) < 180_000, (done.stdout, done.stderr)


def test_parquet_that_unfolds_is_refused(tmp_path: Path) -> None:
    folder = write_folder(tmp_path)
    (folder / "frames.csv").unlink()
    zeros = pa.array(np.zeros(16_000_000, dtype=np.int64))
    pyarrow.parquet.write_table(
        pa.table({"frame": zeros, "posture": zeros}), folder / "frames.parquet", compression="zstd"
    )
    assert (folder / "frames.parquet").stat().st_size < 1_000_000
    with pytest.raises(SessionError, match="cells"):
        load_session(folder)


def test_a_camera_that_looks_away_is_a_warning(tmp_path: Path) -> None:
    assert load_session(write_folder(tmp_path / "as it is")).warnings == ()
    away = replaced(
        URDF, '<child link="chest_board"/>', '<child link="chest_board"/><origin rpy="3.14159 0 0"/>'
    )
    (warning,) = load_session(write_folder(tmp_path / "away", robot=away)).warnings
    assert "both must look at the mirror" in warning and "'camera_optical'" in warning


def test_a_refusal_comes_back_from_another_process_whole() -> None:
    error = SessionError("frames.csv", "got nothing", row=3, column="elbow")
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.row, again.column, again.file) == (str(error), 3, "elbow", error.file)


def test_a_board_cannot_look_nearer_than_it_is(tmp_path: Path) -> None:
    folder = write_mirrored(tmp_path / "session", 1, postures=4)
    load_session(folder)
    text = (folder / "session.toml").read_text()
    (folder / "session.toml").write_text(text.replace("square = 0.014", "square = 0.001"))
    with pytest.raises(
        SessionError,
        match=r"looks 0\.\d+ m away, nearer than the 0\.\d+ m straight.*Is its square of 0\.001 m in m",
    ):
        load_session(folder)


def test_a_robot_is_larger_than_its_board(tmp_path: Path) -> None:
    folder = write_mirrored(tmp_path / "session", 1, postures=4)
    file = next(folder.glob("*.urdf"))
    small = re.sub(
        r'xyz="([^"]+)"',
        lambda m: 'xyz="' + " ".join(str(1e-3 * float(x)) for x in m[1].split()) + '"',
        file.read_text(),
    )
    file.write_text(small)
    with pytest.raises(SessionError, match=r"smaller than a fifth of its board's .* divided by 1000"):
        load_session(folder)


def test_where_the_board_is_seen_is_where_its_face_must_look(tmp_path: Path) -> None:
    """The board's corners are at the left of the picture: a face that looks there, and a little back, does face what shows it."""
    for angle, warned in (("-1.62", 0), ("1.4", 1)):
        turned = replaced(
            URDF, '<child link="chest_board"/>', f'<child link="chest_board"/><origin rpy="0 {angle} 0"/>'
        )
        assert len(load_session(write_folder(tmp_path / angle, robot=turned)).warnings) == warned


def test_points_of_an_unknown_frame_may_be_anywhere(tmp_path: Path) -> None:
    text = "frame,marker,x,y,z\n0,hand,100.1,0.2,0.3\n1,hand,100.2,0.2,0.3\n5,hand,100.3,0.1,0.3\n"
    points = load_session(write_folder(tmp_path, points=text)).points
    assert points is not None and points.point_m[0, 0, 0] == 100.1


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted in /proc")
def test_small_tables_start_no_pool_of_threads(tmp_path: Path) -> None:
    # A process that ends right after reading must not wait for, or be aborted by, readers that are still at work.
    folder = write_folder(tmp_path)
    count = "len(os.listdir('/proc/self/task'))"
    code = f"import os, sys, mirror_posture.session.tables, pyarrow as pa; before = {count}; mirror_posture.load_session(sys.argv[1]); print({count} - before, pa.cpu_count())"
    told = subprocess.run([sys.executable, "-c", code, str(folder)], capture_output=True, text=True)
    started = int(told.stdout.split()[0])
    # Arrow's one thread that reads files.
    assert told.returncode == 0 and started <= 1, told
