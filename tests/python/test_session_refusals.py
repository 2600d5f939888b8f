"""Sessions that are refused: each names file, row or key, what was got, and the fix."""

from __future__ import annotations

import re
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest

from mirror_posture import MirrorPostureError, SessionError, load_session
from session_folder import (
    CAMERA,
    DETECTIONS,
    FRAMES,
    POINTS,
    SESSION,
    URDF,
    replaced,
    with_accelerometer,
    write_folder,
)

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
    "semicolons": (
        {"frames": FRAMES.replace(",", ";")},
        "frames.csv",
        None,
        "separated by semicolons; needed commas",
    ),
    "decimal commas": (
        {"detections": DETECTIONS.replace(",", ";").replace(".", ",")},
        "detections.csv",
        None,
        "points in numbers",
    ),
    "tabs": ({"points": POINTS.replace(",", "\t")}, "points.csv", None, "separated by tabs"),
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
        "'accelerometer:lower:y': got an empty cell with other cells",
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
    # An impossible unit.
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
        'no [points]; add the two lines `[points]` and `frame = "LINK"`',
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


def test_blank_lines_are_no_rows_and_count_as_lines(tmp_path: Path) -> None:
    """Before, the line was that of the row without them."""
    lines = FRAMES.splitlines()
    blank = "\n".join([lines[0], "", "", lines[1], "", replaced(lines[2], "0.1", "1x"), lines[3]]) + "\n"
    with pytest.raises(
        SessionError, match=r"frames\.csv, row 2 \(line 6\), column 'shoulder': got '1x'"
    ) as told:
        load_session(write_folder(tmp_path / "cell", frames=blank))
    assert (told.value.row, told.value.line) == (2, 6)
    ragged = "\n".join([lines[0], "", lines[1], "", "", lines[2] + ",9", lines[3]]) + "\n"
    with pytest.raises(SessionError, match=r"frames\.csv, row 2 \(line 6\): got 7 cells"):
        load_session(write_folder(tmp_path / "ragged", frames=ragged))
    # A cell of two lines above; problems of two files, each by its own lines.
    two = (
        DETECTIONS.replace("via\n", "via,note\n")
        .replace("mirror\n", 'mirror,"a\nb"\n', 1)
        .replace("mirror\n", "mirror,\n")
    )
    two = two.replace("direct\n", "direct,\n")
    with pytest.raises(SessionError) as several:
        load_session(
            write_folder(
                tmp_path / "two",
                detections=replaced(two, "301.5", "x"),
                points=POINTS.replace("\n0,hand", "\n\n\n0,hand").replace("0.2", "y"),
            )
        )
    assert [(p.file.name, p.row, p.line) for p in several.value.problems] == [
        ("detections.csv", 4, 6),
        ("points.csv", 1, 4),
    ]
    assert "row 4 (line 6)" in str(several.value)
