"""Loading a session: what is read, and every refusal of the format, with the file, the row and the fix in it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest

from mirror_posture import MirrorPostureError, SessionError, load_session
from mirror_posture.session import write_session
from session_folder import (
    CAMERA,
    DATA,
    DETECTIONS,
    FRAMES,
    POINTS,
    SESSION,
    URDF,
    replaced,
    with_accelerometer,
    write_folder,
)


def test_reads_what_the_files_say(tmp_path: Path) -> None:
    session = load_session(write_folder(tmp_path))
    assert session.root_link == "base" and session.camera_link == "camera_optical"
    assert session.marker_names == ("hand", "elbow_ball")
    assert session.markers[0].color is not None and session.markers[0].color.hue_tolerance_deg == 12.0
    assert session.markers[0].mount_known and not session.markers[1].mount_known
    assert session.mirror is not None and session.mirror.glass_thickness_m == 0.003
    assert session.noise.pixel_std_px == 0.2 and session.noise.point_std_m == 0.0005
    assert session.camera is not None and session.camera.distortion == (0.01, -0.02, 0.001, -0.001, 0.003)
    assert session.camera.matrix_px[1, 1] == 694.0

    frames = session.frames
    assert frames.frame.tolist() == [0, 1, 5] and frames.posture.tolist() == [0, 0, 1]
    assert frames.joint_names == ("shoulder", "elbow") and frames.measured_names == ("elbow",)
    assert frames.commanded[2].tolist() == [-0.3, 0.4] and frames.measured[:, 0].tolist() == [
        0.21,
        0.19,
        0.41,
    ]
    assert frames.time_s is not None and frames.time_s.tolist() == [0.0, 2.0, 4.0]
    assert frames.ordered and frames.image is None

    seen = session.mirror_view
    assert np.argwhere(seen.board_seen).tolist() == [[0, 0], [0, 5]]
    assert seen.board_px[0, 5].tolist() == [101.0, 201.0]
    assert np.argwhere(seen.marker_seen).tolist() == [[0, 0], [2, 1]]
    assert np.argwhere(session.direct_view.marker_seen).tolist() == [[1, 0]]
    assert session.direct_view.marker_px[1, 0].tolist() == [301.5, 311.5]
    assert session.points is not None and session.points.frame_link == "unknown"
    assert session.points.point_m[2, 1].tolist() == [-0.1, -0.2, -0.3]
    assert session.points.seen.tolist() == [[True, False], [False, False], [False, True]]
    assert session.warnings == ()


def test_board_corners_run_along_x_first(tmp_path: Path) -> None:
    board = load_session(write_folder(tmp_path)).board
    assert board is not None
    np.testing.assert_allclose(board.corner_in_board_m[0], [-0.014, -0.007, 0.0])
    np.testing.assert_allclose(board.corner_in_board_m[1], [0.0, -0.007, 0.0], atol=1e-18)
    np.testing.assert_allclose(board.corner_in_board_m[5], [0.014, 0.007, 0.0])


def test_parquet_tables_read_like_csv(tmp_path: Path) -> None:
    plain = load_session(write_folder(tmp_path / "csv"))
    folder = write_folder(tmp_path / "parquet")
    for stem in ("frames", "detections", "points"):
        table = pyarrow.csv.read_csv(folder / f"{stem}.csv")
        for index, name in enumerate(table.column_names):  # as pandas writes labels
            if pa.types.is_string(table.schema.field(name).type):
                table = table.set_column(index, name, table[name].dictionary_encode())
        pyarrow.parquet.write_table(table, folder / f"{stem}.parquet")
        (folder / f"{stem}.csv").unlink()
    session = load_session(folder)
    np.testing.assert_array_equal(session.frames.commanded, plain.frames.commanded)
    np.testing.assert_array_equal(session.mirror_view.board_px, plain.mirror_view.board_px)
    np.testing.assert_array_equal(session.direct_view.marker_seen, plain.direct_view.marker_seen)
    assert session.points is not None and plain.points is not None
    np.testing.assert_array_equal(session.points.point_m, plain.points.point_m)


def test_points_alone_need_no_camera_and_no_board(tmp_path: Path) -> None:
    start, end = SESSION.index("[camera_mount]"), SESSION.index("[[markers]]")
    text = replaced(SESSION[:start] + SESSION[end:], 'camera = "camera.yaml"\n', "")
    text = replaced(text, "[mirror]\nglass_thickness = 0.003\nrefractive_index = 1.52\n", "")
    session = load_session(write_folder(tmp_path, session=text, camera=None, detections=None))
    assert session.camera is None and session.board is None and session.mirror is None
    assert not session.detected and not session.mirror_view.any_seen


def test_cells_with_blanks_and_a_byte_order_mark_are_read(tmp_path: Path) -> None:
    text = "\ufeff" + replaced(DETECTIONS, "100.5,200.25", " 100.5 , 200.25").replace("\n", "\r\n")
    session = load_session(write_folder(tmp_path, detections=text))
    assert session.mirror_view.board_px[0, 0].tolist() == [100.5, 200.25]


def test_unknown_keys_and_columns_are_kept_and_named(tmp_path: Path) -> None:
    text = replaced(SESSION, "square = 0.014", "square = 0.014\npaper = 'A4'") + "\n[operator]\nname = 'N'\n"
    detections = "\n".join(
        line + (",score" if i == 0 else ",0.9") for i, line in enumerate(DETECTIONS.splitlines())
    )
    session = load_session(write_folder(tmp_path, session=text, detections=detections))
    assert session.metadata["operator"] == {"name": "N"}
    joined = "\n".join(session.warnings)
    assert "board.paper" in joined and "operator" in joined and "'score'" in joined


def test_a_joint_without_column_and_a_frame_without_points_are_fine(tmp_path: Path) -> None:
    frames = "frame,posture\n0,0\n1,0\n5,1\n9,2\n"
    session = load_session(write_folder(tmp_path, frames=frames))
    assert session.frames.joint_names == () and session.frames.commanded.shape == (4, 0)
    assert not session.mirror_view.marker_seen[3].any()


@pytest.mark.parametrize("tables", ["csv", "parquet"])
def test_accelerometers_are_read_and_written(tables: Literal["csv", "parquet"], tmp_path: Path) -> None:
    session = load_session(write_folder(tmp_path / "given", frames=with_accelerometer("lower")))
    again = load_session(write_session(session, tmp_path / "again", tables=tables))
    for frames in (session.frames, again.frames):
        assert frames.accelerometer_links == ("lower",) and frames.measured_names == ("elbow",)
        assert frames.accelerometer_read.tolist() == [[True], [False], [True]]
        assert frames.accelerometer_m_per_s2[:, 0].tolist() == [[0.1, 0.2, 9.8], [0, 0, 0], [0.3, 0.4, 9.7]]
    assert not session.warnings and not again.warnings


# What is changed, and what the refusal must say: the file, the row where there is one, and the fix.
REFUSALS = {
    # A file or column that is missing.
    "no session.toml": ({"session": None}, "session.toml", None, "missing"),
    "no urdf": ({"robot": None}, "robot.urdf", None, "missing"),
    "no camera": ({"camera": None}, "camera.yaml", None, "missing"),
    "no frames": ({"frames": None}, "frames.csv", None, "missing"),
    "nothing observed": (
        {
            "detections": None,
            "points": None,
            "session": replaced(SESSION, '[points]\nframe = "unknown"\n', ""),
        },
        "detections.csv",
        None,
        "nothing was observed",
    ),
    "no points": ({"points": None}, "points.csv", None, "missing"),
    "no posture column": ({"frames": "frame,shoulder\n0,0.1\n"}, "frames.csv", None, "'posture' is missing"),
    "no u column": ({"detections": "frame,target,index,v\n"}, "detections.csv", None, "'u' is missing"),
    "no marker column": ({"points": "frame,x,y,z\n0,1,2,3\n"}, "points.csv", None, "'marker' is missing"),
    "no frames rows": ({"frames": "frame,posture\n"}, "frames.csv", None, "no rows"),
    "empty file": ({"frames": ""}, "frames.csv", None, "cannot be read as a table"),
    "picture missing": (
        {"detections": None, "frames": "frame,posture,image\n0,0,a.png\n", "points": "frame,marker,x,y,z\n"},
        "frames.csv",
        1,
        "the picture a.png is missing",
    ),
    # A joint that the URDF does not have.
    "unknown joint": (
        {"frames": replaced(FRAMES, ",elbow,", ",elbw,")},
        "frames.csv",
        None,
        "shoulder, elbow",
    ),
    "unknown encoder": (
        {"frames": replaced(FRAMES, "measured:elbow", "measured:wrist")},
        "frames.csv",
        None,
        "no joint 'wrist'",
    ),
    "accelerometer on no link": (
        {"frames": with_accelerometer("wrist")},
        "frames.csv",
        None,
        "no link 'wrist'; its links: base, upper, lower",
    ),
    "accelerometer without z": (
        {"frames": replaced(with_accelerometer("lower"), "accelerometer:lower:z", "measured:shoulder")},
        "frames.csv",
        None,
        "'accelerometer:lower:z': the column is missing; needed accelerometer:<link>:x, :y and :z",
    ),
    "accelerometer's axis": (
        {"frames": replaced(with_accelerometer("lower"), "accelerometer:lower:z", "accelerometer:lower:w")},
        "frames.csv",
        None,
        "names no axis of a link; needed accelerometer:<link>:x, :y and :z",
    ),
    "accelerometer in part": (
        {"frames": replaced(with_accelerometer("lower"), "0.1,0.2,9.8\n", "0.1,,9.8\n")},
        "frames.csv",
        1,
        "'accelerometer:lower:y': got an empty cell beside others",
    ),
    "accelerometer nan": (
        {"frames": replaced(with_accelerometer("lower"), "0.3,0.4,9.7", "0.3,nan,9.7")},
        "frames.csv",
        3,
        "column 'accelerometer:lower:y': got 'nan', needed a finite number",
    ),
    "accelerometer text": (
        {"frames": replaced(with_accelerometer("lower"), "0.3,0.4,9.7", "0.3,down,9.7")},
        "frames.csv",
        3,
        "column 'accelerometer:lower:y': got 'down', needed a finite number",
    ),
    "accelerometer of zero": (
        {"frames": replaced(with_accelerometer("lower"), "0.3,0.4,9.7", "0,0,0")},
        "frames.csv",
        3,
        "a reading of zero",
    ),
    "fixed joint": ({"frames": replaced(FRAMES, ",elbow,", ",chest,")}, "frames.csv", None, "is fixed"),
    # A non-finite or unparsable number.
    "nan command": ({"frames": replaced(FRAMES, "-0.3", "nan")}, "frames.csv", 3, "finite number"),
    "inf pixel": ({"detections": replaced(DETECTIONS, "101,201", "inf,201")}, "detections.csv", 2, "finite"),
    "text pixel": ({"detections": replaced(DETECTIONS, "12,13", "12,1x3")}, "detections.csv", 5, "'1x3'"),
    "empty cell": ({"points": replaced(POINTS, "0.1,0.2", "0.1,")}, "points.csv", 1, "an empty cell"),
    "fractional frame": ({"frames": replaced(FRAMES, "\n1,0", "\n1.5,0")}, "frames.csv", 2, "whole number"),
    "ragged row": ({"detections": replaced(DETECTIONS, "12,13,", "12,")}, "detections.csv", 5, "5 cells"),
    # An index outside the board.
    "index too large": (
        {"detections": replaced(DETECTIONS, "board,5", "board,6")},
        "detections.csv",
        2,
        "0 to 5",
    ),
    "index negative": (
        {"detections": replaced(DETECTIONS, "board,0", "board,-1")},
        "detections.csv",
        1,
        "0 to 5",
    ),
    "marker index": (
        {"detections": replaced(DETECTIONS, "hand,0", "hand,1")},
        "detections.csv",
        3,
        "0 for a marker",
    ),
    # A frame with no row in frames.csv.
    "detection of no frame": (
        {"detections": replaced(DETECTIONS, "\n5,", "\n4,")},
        "detections.csv",
        5,
        "frames.csv",
    ),
    "point of no frame": ({"points": replaced(POINTS, "\n5,", "\n7,")}, "points.csv", 2, "frames.csv"),
    # Two rows for one point.
    "detection twice": (
        {"detections": replaced(DETECTIONS, "0,board,5", "0,board,0")},
        "detections.csv",
        2,
        "already in row 1",
    ),
    "point twice": (
        {"points": replaced(POINTS, "5,elbow_ball", "0,hand")},
        "points.csv",
        2,
        "already in row 1",
    ),
    "frame twice": ({"frames": replaced(FRAMES, "\n1,0", "\n0,0")}, "frames.csv", 2, "twice"),
    "frames fall": ({"frames": replaced(FRAMES, "\n5,1", "\n-5,1")}, "frames.csv", 3, "rising"),
    # A link that does not exist.
    "root": (
        {"session": replaced(SESSION, 'root = "base"', 'root = "b"')},
        "session.toml",
        None,
        "no link 'b'",
    ),
    "camera link": (
        {"session": replaced(SESSION, 'link = "camera_optical"', 'link = "eyes"')},
        "session.toml",
        None,
        "camera_mount.link",
    ),
    "board link": (
        {"session": replaced(SESSION, 'link = "chest_board"', 'link = "chest"')},
        "session.toml",
        None,
        "board.link",
    ),
    "marker link": (
        {"session": replaced(SESSION, 'link = "hand_marker"', 'link = "hand"')},
        "session.toml",
        None,
        "markers[0].link",
    ),
    "points frame": (
        {"session": replaced(SESSION, 'frame = "unknown"', 'frame = "lab"')},
        "session.toml",
        None,
        "points.frame",
    ),
    # A unit that cannot be meant.
    "degrees": ({"frames": replaced(FRAMES, "-0.3", "-17.0")}, "frames.csv", 3, "degrees"),
    "no deviation": (
        {
            "detections": DETECTIONS.replace(",via", ",via,std_px")
            .replace("mirror\n", "mirror,0\n")
            .replace("direct\n", "direct,1\n")
        },
        "detections.csv",
        1,
        "above 0",
    ),
    # Names.
    "unknown target": (
        {"detections": replaced(DETECTIONS, "hand", "foot")},
        "detections.csv",
        3,
        "board, hand",
    ),
    "unknown marker": ({"points": replaced(POINTS, "hand", "foot")}, "points.csv", 1, "hand, elbow_ball"),
    "unknown via": (
        {"detections": replaced(DETECTIONS, "direct", "window")},
        "detections.csv",
        4,
        "mirror, direct",
    ),
    "column twice": ({"frames": "frame,posture,elbow,elbow\n0,0,1,2\n"}, "frames.csv", None, "twice"),
    # session.toml.
    "no toml": ({"session": "a = ["}, "session.toml", None, "not valid TOML"),
    "other format": ({"session": replaced(SESSION, "posture/session", "x")}, "session.toml", None, "format"),
    "other version": (
        {"session": replaced(SESSION, "version = 1", "version = 2")},
        "session.toml",
        None,
        "version",
    ),
    "no root": (
        {"session": replaced(SESSION, 'root = "base"\n', "")},
        "session.toml",
        None,
        "root is missing",
    ),
    "bad gravity": ({"session": replaced(SESSION, "-9.81]", "]")}, "session.toml", None, "3 finite numbers"),
    "nan gravity": (
        {"session": replaced(SESSION, "-9.81]", "nan]")},
        "session.toml",
        None,
        "3 finite numbers",
    ),
    "bad square": ({"session": replaced(SESSION, "0.014", "-0.014")}, "session.toml", None, "board.square"),
    "bad hue": (
        {"session": replaced(SESSION, "hue = 0.0", "hue = 360.0")},
        "session.toml",
        None,
        "color.hue",
    ),
    "bad mount": (
        {"session": replaced(SESSION, '"unknown"', '"glued"')},
        "session.toml",
        None,
        "known, unknown",
    ),
    "board as marker": (
        {"session": replaced(SESSION, '"hand"', '"board"')},
        "session.toml",
        None,
        "own name",
    ),
    "marker twice": ({"session": replaced(SESSION, '"elbow_ball"', '"hand"')}, "session.toml", None, "twice"),
    "charuco": (
        {"session": replaced(SESSION, '"chessboard"', '"charuco"')},
        "session.toml",
        None,
        "dictionary",
    ),
    "path outside": (
        {"session": replaced(SESSION, "robot.urdf", "../robot.urdf")},
        "session.toml",
        None,
        "inside",
    ),
    "mirror without board": (
        {"session": SESSION[: SESSION.index("[board]")] + SESSION[SESSION.index("[[markers]]") :]},
        "detections.csv",
        1,
        "[board]",
    ),
    "points without section": (
        {"session": replaced(SESSION, '[points]\nframe = "unknown"\n', "")},
        "session.toml",
        None,
        "no [points]",
    ),
    # Camera and robot.
    "no yaml": ({"camera": "a: ["}, "camera.yaml", None, "no YAML"),
    "yaml list": ({"camera": "- 1\n"}, "camera.yaml", None, "got a list"),
    "no width": ({"camera": replaced(CAMERA, "image_width: 800", "")}, "camera.yaml", None, "image_width"),
    "focal length": ({"camera": replaced(CAMERA, "[693.0", "[-693.0")}, "camera.yaml", None, "focal"),
    "skew": ({"camera": replaced(CAMERA, "[693.0, 0.0", "[693.0, 0.5")}, "camera.yaml", None, "no skew"),
    "matrix": ({"camera": replaced(CAMERA, "0.0, 1.0]", "1.0]")}, "camera.yaml", None, "needed 9"),
    "lens model": (
        {"camera": replaced(CAMERA, "plumb_bob", "fisheye")},
        "camera.yaml",
        None,
        "plumb_bob, rational",
    ),
    "coefficients": (
        {"camera": replaced(CAMERA, "-0.001, ", "")[:-9] + "]}\n"},
        "camera.yaml",
        None,
        "needed 5",
    ),
    "nan in camera": ({"camera": replaced(CAMERA, "399.5", ".nan")}, "camera.yaml", None, "finite"),
    "no xml": ({"robot": "<robot>"}, "robot.urdf", None, "is not URDF"),
    "other xml": ({"robot": "<sdf/>"}, "robot.urdf", None, "needed <robot>"),
    "two roots": (
        {"robot": replaced(URDF, '<link name="upper"/>', '<link name="upper"/><link name="x"/>')},
        "robot.urdf",
        None,
        "2 root",
    ),
    "loop": (
        {"robot": replaced(URDF, '<child link="elbow_marker"/>', '<child link="upper"/>')},
        "robot.urdf",
        None,
        "upper",
    ),
    "limit": ({"robot": replaced(URDF, 'lower="-1.5"', 'lower="low"')}, "robot.urdf", None, "limit"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_refuses_with_file_row_and_fix(case: str, tmp_path: Path) -> None:
    changed, file, row, says = REFUSALS[case]
    with pytest.raises(SessionError) as caught:
        load_session(write_folder(tmp_path, **changed))
    error = caught.value
    assert isinstance(error, MirrorPostureError)
    assert error.file.name == file and error.row == row, str(error)
    assert says in str(error), str(error)
    assert "\n" not in str(error)
    if row is not None:
        assert re.search(rf"row {row} \(line {row + 1}\)", str(error))


def test_refuses_a_folder_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="is no folder"):
        load_session(tmp_path / "nowhere")


def test_refuses_two_forms_of_one_table(tmp_path: Path) -> None:
    folder = write_folder(tmp_path)
    pyarrow.parquet.write_table(pa.table({"frame": [0]}), folder / "points.parquet")
    with pytest.raises(SessionError, match=r"also points\.parquet"):
        load_session(folder)


def test_names_row_and_column_of_a_bad_parquet_cell(tmp_path: Path) -> None:
    folder = write_folder(tmp_path, points=None)
    columns = {
        "frame": [0, 5],
        "marker": ["hand", "hand"],
        "x": [0.0, None],
        "y": [0.0, 0.0],
        "z": [0.0, 0.0],
    }
    pyarrow.parquet.write_table(pa.table(columns), folder / "points.parquet")
    with pytest.raises(SessionError, match=r"points\.parquet, row 2, column 'x': got an empty cell"):
        load_session(folder)


def test_a_joint_that_follows_another_is_kept_without_effect(tmp_path: Path) -> None:
    robot = replaced(
        URDF, '<axis xyz="0 1 0"/>\n  </joint>', '<axis xyz="0 1 0"/><mimic joint="shoulder"/>\n  </joint>'
    )
    session = load_session(write_folder(tmp_path, robot=robot))
    assert any("'elbow' follows another joint" in warning for warning in session.warnings)
    assert session.positions[:, 0].tolist() == [0.1, 0.1, -0.3]


def test_positions_are_in_the_robots_order(tmp_path: Path) -> None:
    session = load_session(write_folder(tmp_path, frames="frame,posture,elbow\n0,0,0.2\n1,2,0.3\n5,1,0.4\n"))
    assert session.robot.position_names == ("shoulder", "elbow")
    assert session.positions.tolist() == [[0.0, 0.2], [0.0, 0.3], [0.0, 0.4]]


def test_a_falling_clock_is_named(tmp_path: Path) -> None:
    session = load_session(write_folder(tmp_path, frames=replaced(FRAMES, "1,0,2.0", "1,0,-2.0")))
    assert any("time_s falls" in warning for warning in session.warnings)


def stored_sessions() -> list[Path]:
    return sorted(file.parent for file in DATA.glob("*/**/session.toml"))


@pytest.mark.skipif(not stored_sessions(), reason=f"the data is not there: {DATA}")
def test_loads_every_stored_session() -> None:
    folders = stored_sessions()
    assert len(folders) > 30
    for folder in folders:
        session = load_session(folder)
        # One of the first day's mistakes is a joint in degrees.
        assert all("are these degrees?" in warning for warning in session.warnings), folder
        assert not session.warnings or folder.parent.name == "first-day", folder
        rows = (
            sum(1 for _ in (folder / "detections.csv").open()) - 1
            if (folder / "detections.csv").exists()
            else 0
        )
        seen = session.mirror_view
        assert rows == seen.board_seen.sum() + seen.marker_seen.sum(), folder
        assert len(session.frames) == sum(1 for _ in (folder / "frames.csv").open()) - 1
