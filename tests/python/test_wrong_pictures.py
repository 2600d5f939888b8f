"""Pictures that are not what the session says, by the command line: named with the fix by `detect`, and nothing is measured from their image points.

The pictures are drawn (`fresh_scene`), the robot is one link with a camera, a board and balls. `wrong_pictures.py` holds all mistakes against two rendered robots.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from fresh_looks import COLUMNS, ROWS, SQUARE_M, Look
from fresh_scene import views
from mirror_posture.detect import detect_session
from mirror_posture.diagnosis import diagnose
from mirror_posture.diagnosis.next_step import next_step
from mirror_posture.session import write_detections
from wrong_pictures import said

LINK = '<link name="{0}"/><joint name="{0}_fixed" type="fixed"><parent link="base"/><child link="{0}"/><origin xyz="{1}" rpy="{2}"/></joint>\n'


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of two views whose model is the truth."""
    folder = tmp_path_factory.mktemp("drawn")
    scenes, real_m = views(Look(size_px=(480, 360), radius_px=(7.0, 9.0)), [4], [(-0.03, 0.0), (0.03, 0.01)])
    first = scenes[0]

    def text(values: np.ndarray) -> str:
        return " ".join(f"{v:.12g}" for v in values)

    turn = first.camera_from_board[:3, :3]
    rpy = np.array(
        [np.arctan2(turn[2, 1], turn[2, 2]), -np.arcsin(turn[2, 0]), np.arctan2(turn[1, 0], turn[0, 0])]
    )
    links = [
        LINK.format("camera_optical", "0 0 0", "0 0 0"),
        LINK.format("board", text(first.camera_from_board[:3, 3]), text(rpy)),
    ]
    links += [LINK.format(ball.name, text(at), "0 0 0") for ball, at in zip(first.balls, real_m, strict=True)]
    arm = (
        '<link name="arm"/><joint name="wag" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    )
    (folder / "robot.urdf").write_text(
        f'<robot name="drawn"><link name="base"/>{arm}{"".join(links)}</robot>'
    )
    k = first.camera
    (folder / "camera.yaml").write_text(
        f"image_width: 480\nimage_height: 360\ncamera_name: drawn\ncamera_matrix: {{rows: 3, cols: 3, data: {k.ravel().tolist()}}}\n"
        "distortion_model: plumb_bob\ndistortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n"
    )
    markers = "".join(
        f'[[markers]]\nname = "{b.name}"\nlink = "{b.name}"\ndiameter = {2 * b.radius_m}\nmount = "known"\n'
        f"color = {{ hue = {b.hue_deg}, hue_tolerance = 18.0, min_saturation = 0.4, min_value = 0.12 }}\n"
        for b in first.balls
    )
    (folder / "session.toml").write_text(
        'format = "mirror-posture/session"\nversion = 1\nrobot = "robot.urdf"\ncamera = "camera.yaml"\nroot = "base"\ngravity = [0.0, 9.81, 0.0]\n'
        f'[camera_mount]\nlink = "camera_optical"\n[board]\nlink = "board"\ncorners = [{COLUMNS}, {ROWS}]\nsquare = {SQUARE_M}\npattern = "chessboard"\n{markers}'
    )
    rows = ["frame,posture,time_s,wag,image"]
    for number, scene in enumerate(scenes):
        cv2.imwrite(str(folder / f"{number}.png"), scene.bgr)
        rows.append(f"{number},0,{number},0,{number}.png")
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    return folder


CHANGES = {
    "as they are": (lambda p: p, ""),
    "mirrored up-down": (lambda p: p[::-1], "the pictures are mirrored up-down"),
    "turned by 180": (lambda p: p[::-1, ::-1], "the pictures are turned by 180°"),
    "cropped": (lambda p: p[10:-10, 10:-10], "cropped, or another camera's"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_each_is_named_and_none_is_measured(name: str, drawn: Path, tmp_path: Path) -> None:
    change, words = CHANGES[name]
    folder = tmp_path / "session"
    shutil.copytree(drawn, folder)
    for file in folder.glob("*.png"):
        cv2.imwrite(str(file), np.ascontiguousarray(change(cv2.imread(str(file)))))
    code, heard = said("detect", folder, "--no-overlays")
    if not words:
        assert code == 0, heard
        return
    assert code != 0 and words in heard
    (folder / "detections.csv").unlink(missing_ok=True)
    # Image points that somebody else has found in the same pictures.
    if name == "mirrored up-down":
        found = detect_session(folder, check=False).session
        write_detections(found, folder / "detections.csv")
        code, heard = said("measure", folder)
        assert code != 0 and words in heard


def _halved(drawn: Path, folder: Path, names: tuple[str, ...] = ("0", "1")) -> Path:
    shutil.copytree(drawn, folder)
    for name in names:
        file = folder / f"{name}.png"
        cv2.imwrite(str(file), cv2.resize(cv2.imread(str(file)), (240, 180), interpolation=cv2.INTER_AREA))
    return folder


SIZES = "240 × 180 px, but the camera file is for 480 × 360 px"
FIX = "give the camera file of this resolution"


@pytest.mark.parametrize("command", ["detect", "diagnose", "measure"])
def test_pictures_that_all_have_another_size_are_one_error(command: str, drawn: Path, tmp_path: Path) -> None:
    folder = _halved(drawn, tmp_path / "session")
    code, heard = said(command, folder)
    assert code == 1, heard
    assert heard.count(SIZES) == 1 and FIX in heard and "none of the 2 pictures" in heard
    # No empty table that a later command would take for what was found.
    assert not (folder / "detections.csv").exists()


def test_some_pictures_of_another_size_are_one_warning(drawn: Path, tmp_path: Path) -> None:
    folder = _halved(drawn, tmp_path / "session", ("1",))
    for number in (2, 3):
        shutil.copy(folder / "1.png", folder / f"{number}.png")
    table = folder / "frames.csv"
    table.write_text(table.read_text() + "2,0,2,0,2.png\n3,0,3,0,3.png\n")
    code, heard = said("detect", folder, "--no-overlays")
    assert code == 0, heard
    assert (
        heard.count(SIZES) == 1
        and "3 of 4 pictures cannot be used (frames 1, 2, 3)" in heard
        and FIX in heard
    )


def test_too_little_evidence_says_that_the_pictures_have_another_size(drawn: Path, tmp_path: Path) -> None:
    folder = _halved(drawn, tmp_path / "session")
    (folder / "detections.csv").write_text("frame,target,index,u,v,via,std_px\n")
    found = diagnose(folder)
    assert found.verdict == "insufficient"
    assert SIZES in found.sentence and FIX in found.sentence and "2 of 2 pictures" in found.sentence
    assert "camera file" in next_step(found)
    code, heard = said("measure", folder)
    assert code != 0 and SIZES in heard
    # Pictures of the right size in which nothing was found are another matter.
    for name in ("0", "1"):
        shutil.copy(drawn / f"{name}.png", folder / f"{name}.png")
    found = diagnose(folder)
    assert "camera file" not in found.sentence and next_step(found).startswith("Record more")
