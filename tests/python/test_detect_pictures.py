"""Whole pictures: bad input is an error that names file and fix, batches keep going, overlays show, nothing tracebacks."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from board_drawing import chessboard_picture, view
from mirror_posture import Board, Camera, ColorRange, Marker, MirrorPostureError, load_session
from mirror_posture._core import plain_png
from mirror_posture.detect import (
    DetectionError,
    DetectionSetup,
    detect_picture,
    detect_pictures,
    draw_overlay,
    list_pictures,
    predictions_from_session,
    read_picture,
    write_overlay,
)
from session_folder import URDF, replaced, write_folder

SETUP = DetectionSetup(
    Board(7, 4, 0.01), (Marker("hand", diameter_m=0.0116, color=ColorRange(0.0, 12.0, 0.5, 0.25)),)
)


def good_picture() -> np.ndarray:
    gray = chessboard_picture(7, 4, view(0.2, True))
    picture = cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR)
    cv2.circle(picture, (60, 300), 12, (30, 30, 200), -1, cv2.LINE_AA)
    return picture


def encoded(suffix: str) -> bytes:
    return cv2.imencode(suffix, good_picture())[1].tobytes()


def test_a_good_picture_from_array_and_file_gives_the_same(tmp_path: Path) -> None:
    file = tmp_path / "good.png"
    file.write_bytes(encoded(".png"))
    from_file, from_array = detect_picture(file, SETUP), detect_picture(good_picture(), SETUP)
    assert from_file.boards[0].ok and from_file.markers[0].ok
    np.testing.assert_array_equal(from_file.boards[0].corners_px, from_array.boards[0].corners_px)
    assert from_file.boards[0].via == "mirror" and from_file.boards[0].visible.sum() == 28
    assert [marker.name for marker in from_file.markers] == ["hand"]
    assert json.loads(json.dumps(from_file.to_json(), allow_nan=False))["boards"][0]["ok"] is True


@pytest.mark.parametrize(
    ("name", "content", "needed"),
    [
        ("missing.png", None, "is missing"),
        ("empty.png", b"", "is empty"),
        ("text.jpg", b"this is no picture", "is broken"),
        ("notes.txt", b"this is no picture", "no picture"),
        ("half.jpg", encoded(".jpg")[:4000], "is broken"),
        ("half.png", encoded(".png")[:4000], "is broken"),
        (
            "scratched.jpg",
            encoded(".jpg")[:3000] + b"\x07" * 300 + encoded(".jpg")[3300:],
            "is broken in part",
        ),
        ("tiny.png", cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes(), "is 4 × 4 px"),
    ],
)
def test_unreadable_pictures_are_errors_that_name_the_file(
    tmp_path: Path, name: str, content, needed: str
) -> None:
    file = tmp_path / name
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(DetectionError, match=needed) as caught:
        detect_picture(file, SETUP)
    assert name in str(caught.value)
    assert isinstance(caught.value, MirrorPostureError)


def test_decoders_do_not_write_to_the_users_terminal(tmp_path: Path) -> None:
    broken = encoded(".jpg")[:3000] + b"\x07" * 300 + encoded(".jpg")[3300:]
    (tmp_path / "scratched.jpg").write_bytes(broken)
    (tmp_path / "half.png").write_bytes(encoded(".png")[:4000])
    program = (
        "import sys; from mirror_posture.detect import read_picture, DetectionError\n"
        "for name in sys.argv[1:]:\n"
        "    try: read_picture(name)\n"
        "    except DetectionError: pass\n"
        "print('still here', file=sys.stderr)\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "scratched.jpg"), str(tmp_path / "half.png")],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        check=True,
    )
    assert ran.stderr.strip() == "still here"


def test_a_camera_file_of_another_size_names_both_sizes() -> None:
    camera = Camera.from_matrix(
        np.array([[500.0, 0, 400], [0, 500, 300], [0, 0, 1]]), np.zeros(5), (800, 600)
    )
    with pytest.raises(DetectionError, match="480 × 360 px, but the camera file is for 800 × 600 px"):
        detect_picture(good_picture(), DetectionSetup(SETUP.board, (), camera))


def test_an_empty_folder_and_a_file_for_a_folder_are_errors(tmp_path: Path) -> None:
    with pytest.raises(DetectionError, match="holds no pictures"):
        list_pictures(tmp_path)
    with pytest.raises(DetectionError, match="is no folder"):
        list_pictures(tmp_path / "nowhere")
    with pytest.raises(DetectionError, match="no pictures given"):
        detect_pictures([], SETUP)


def test_a_batch_keeps_its_order_goes_on_after_bad_ones_and_reports_progress(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(encoded(".png"))
    (tmp_path / "b.png").write_bytes(b"junk")
    blank = np.full((360, 480, 3), 90, np.uint8)
    seen: list[tuple[int, int]] = []
    found = detect_pictures(
        [tmp_path / "a.png", tmp_path / "b.png", blank],
        SETUP,
        progress=lambda done, total: seen.append((done, total)),
    )
    assert seen == [(1, 3), (2, 3), (3, 3)]
    assert [picture.ok for picture in found] == [True, False, True]
    assert found[0].boards[0].ok
    assert "b.png" in found[1].error and found[1].boards == ()
    assert not found[2].boards[0].ok and "no chessboard of 7 × 4 inner corners" in found[2].boards[0].reason
    json.dumps([picture.to_json() for picture in found], allow_nan=False)


def test_arrays_of_other_kinds_are_taken_or_refused() -> None:
    gray = chessboard_picture(7, 4, view(0.2, True))
    reference = detect_picture(gray, SETUP).boards[0].corners_px
    for same in (gray.astype(np.uint16) * 257, gray / 255.0, np.dstack([gray] * 4), gray[..., None]):
        np.testing.assert_allclose(detect_picture(same, SETUP).boards[0].corners_px, reference, atol=0.02)
    for bad, needed in (
        (gray.astype(np.int64), "has type int64"),
        (gray.astype(float), r"values in 0\.\.1"),
        (np.full((50, 50), np.nan), "not finite"),
        (np.zeros((3, 50, 50, 3), np.uint8), "has shape"),
        (np.zeros((0, 0, 3), np.uint8), "needed at least"),
    ):
        with pytest.raises(DetectionError, match=needed):
            detect_picture(bad, SETUP)


@pytest.mark.parametrize("size", [(480, 360), (3264, 1470)])
def test_overlays_show_what_was_found_and_keep_the_picture(tmp_path: Path, size: tuple[int, int]) -> None:
    picture = np.full((size[1], size[0], 3), 90, np.uint8)
    picture[:360, :480] = good_picture()
    found = detect_picture(picture, SETUP)
    drawn = draw_overlay(picture, found)
    factor = 2 if size[0] < 1400 else 1
    assert drawn.shape[1] == factor * size[0] and drawn.shape[0] > factor * size[1]
    assert (picture[:360, :480] == good_picture()).all(), "the picture itself must not be drawn on"
    u, v = found.boards[0].corners_px[0]
    near = drawn[int(factor * v) - 12 : int(factor * v) + 13, int(factor * u) - 12 : int(factor * u) + 13]
    assert (np.abs(near.astype(int) - (0, 230, 255)).sum(axis=2) < 90).any(), "corner 0 carries its ring"
    write_overlay(tmp_path / "overlay.png", picture, found)
    assert read_picture(tmp_path / "overlay.png").shape == drawn.shape
    with pytest.raises(MirrorPostureError, match=r"cannot be encoded as '\.xyz'"):
        write_overlay(tmp_path / "overlay.xyz", picture, found)


def only_our_errors(action) -> None:
    try:
        result = action()
    except MirrorPostureError as error:
        assert str(error)
        return
    for found in result if isinstance(result, tuple) else (result,):
        for one in (*found.boards, *found.markers):
            assert one.ok or one.reason, "what is masked says why"
        json.dumps(found.to_json(), allow_nan=False)


@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    hnp.arrays(
        st.sampled_from([np.uint8, np.uint16, np.float64, np.bool_]),
        hnp.array_shapes(min_dims=1, max_dims=4, min_side=0, max_side=40),
    )
)
def test_no_array_gives_anything_but_our_error(array: np.ndarray) -> None:
    only_our_errors(lambda: detect_picture(array, SETUP))


@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_mangled_pictures_give_masks_or_our_error(data: st.DataObject) -> None:
    picture = good_picture()
    random = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    for _ in range(data.draw(st.integers(1, 4))):
        kind = data.draw(st.sampled_from(["block", "noise", "crop", "roll", "gain", "blur", "shear"]))
        height, width = picture.shape[:2]
        if kind == "block":
            y, x = random.integers(0, height), random.integers(0, width)
            picture[y : y + random.integers(1, 200), x : x + random.integers(1, 200)] = random.integers(
                0, 256, 3
            )
        elif kind == "noise":
            noisy = picture + random.normal(0.0, random.uniform(1.0, 90.0), picture.shape)
            picture = np.clip(noisy, 0, 255).astype(np.uint8)
        elif kind == "crop":
            picture = picture[
                random.integers(0, height // 2) :, : random.integers(width // 2, width) + 1
            ].copy()
        elif kind == "roll":
            picture = np.roll(picture, tuple(random.integers(-150, 150, 2)), axis=(0, 1))
        elif kind == "gain":
            picture = np.clip(picture * random.uniform(0.0, 6.0), 0, 255).astype(np.uint8)
        elif kind == "blur":
            picture = cv2.GaussianBlur(picture, (0, 0), random.uniform(0.5, 9.0))
        else:
            warp = np.array([[1.0, random.uniform(-1, 1), 0.0], [random.uniform(-1, 1), 1.0, 0.0]])
            picture = cv2.warpAffine(picture, warp, (width, height))
    only_our_errors(lambda: detect_picture(picture, SETUP))
    found = detect_pictures([picture], SETUP)[0]
    if found.ok:
        draw_overlay(picture, found)


def test_a_plain_png_is_decoded_by_the_core_and_all_others_are_left_to_pillow(tmp_path: Path) -> None:
    content = encoded(".png")
    pixels = plain_png(content)
    assert pixels is not None and pixels.flags.c_contiguous
    np.testing.assert_array_equal(pixels, good_picture())
    turned = tmp_path / "turned.png"
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.open(io.BytesIO(content)).save(turned, exif=exif)
    assert plain_png(turned.read_bytes()) is None
    np.testing.assert_array_equal(read_picture(turned), good_picture())
    grey = cv2.imencode(".png", good_picture()[..., 0])[1].tobytes()
    middle = len(content) // 2
    wrong = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
    for other in (grey, wrong, content[:-20], content[:40], encoded(".jpg"), b""):
        assert plain_png(other) is None


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from([".png", ".jpg", ".bmp"]), st.data())
def test_mangled_files_give_pictures_or_our_error(tmp_path: Path, suffix: str, data: st.DataObject) -> None:
    content = bytearray(SMALL[suffix])
    for _ in range(data.draw(st.integers(1, 6))):
        where = data.draw(st.integers(0, len(content) - 1))
        content[where] = data.draw(st.integers(0, 255))
    content = content[: data.draw(st.integers(0, len(content)))]
    file = tmp_path / f"mangled{suffix}"
    file.write_bytes(content)
    try:
        assert read_picture(file).dtype == np.uint8
    except MirrorPostureError as error:
        assert file.name in str(error)


SMALL = {
    suffix: cv2.imencode(suffix, good_picture()[:80, :90])[1].tobytes() for suffix in (".png", ".jpg", ".bmp")
}


def test_a_column_of_a_mimic_joint_is_no_obstacle(tmp_path: Path) -> None:
    """Loading warns of such a column and leaves the joint to the one that drives it; so does detection."""
    mimic = '<joint name="elbow" type="continuous">\n    <mimic joint="shoulder" multiplier="2"/>'
    urdf = replaced(URDF, '<joint name="elbow" type="continuous">', mimic)
    session = load_session(write_folder(tmp_path, robot=urdf))
    assert "elbow" in session.frames.joint_names and "elbow" not in session.robot.position_names
    poses = predictions_from_session(session)
    # By hand: camera and board are both fixed to the base, at its origin.
    for pose in poses:
        assert pose is not None and pose.board is not None
        np.testing.assert_allclose(pose.board.camera_from_board, np.eye(4), atol=1e-12)
