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

from mirror_posture import load_session
from mirror_posture.session import write_session
from session_folder import (
    DATA,
    DETECTIONS,
    FRAMES,
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


@pytest.mark.parametrize("tables", ["csv", "parquet"])
def test_the_order_of_the_columns_in_the_file_is_kept(tables: str, tmp_path: Path) -> None:
    # Shifted columns are searched for in this order, which need not be the robot's.
    folder = write_folder(tmp_path)
    table = pyarrow.csv.read_csv(folder / "frames.csv")
    names = [*(n for n in table.column_names if n not in ("shoulder", "elbow")), "elbow", "shoulder"]
    (folder / "frames.csv").unlink()
    if tables == "csv":
        pyarrow.csv.write_csv(table.select(names), folder / "frames.csv")
    else:
        pyarrow.parquet.write_table(table.select(names), folder / "frames.parquet")
    session = load_session(folder)
    assert session.frames.joint_names == ("elbow", "shoulder")
    assert session.frames.commanded[2].tolist() == [0.4, -0.3]


def test_points_are_read_as_the_document_says(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "formats.md").read_text(encoding="utf-8")
    (lines,) = [block for block in re.findall(r"```toml\n(.*?)```", page, re.DOTALL) if "[points]" in block]
    without = replaced(SESSION, '[points]\nframe = "unknown"\n', "")
    points = load_session(write_folder(tmp_path / "unknown", session=without + lines)).points
    assert points is not None and points.frame_link == "unknown"
    of_a_link = without + replaced(lines, "unknown", "base")
    points = load_session(write_folder(tmp_path / "link", session=of_a_link)).points
    assert points is not None and points.frame_link == "base"


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
