"""A mirror from one picture of a board and its reflection, drawn here: the plane, its covariance, and refusals."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from board_drawing import chessboard_picture
from document_commands import alike, python_of
from fresh_looks import LOOKS, Look
from fresh_pictures import known_of, markers_of, wrong_marker
from fresh_scene import Scene, views
from mirror_posture import (
    Board,
    Camera,
    Marker,
    MirrorPostureError,
    cli,
    markers_from_views,
    mirror_from_picture,
    mirrors_from_pictures,
)
from mirror_posture.mirror import PlanarPoses
from mirror_posture.mirror_pictures import SeenMarkers, _joined
from mirror_posture.session.camera_info import dump_camera_info
from mirror_posture.triangulate import MarkerPositions

CAMERA = Camera((640, 480), (600.0, 600.0), (319.5, 239.5))
BOARD = Board(7, 4, 0.02)


def picture(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A board at the left, facing away from the camera's axis, before a mirror at the right; and the mirror's foot point, m."""
    rng = np.random.default_rng(seed)
    # y down in the camera frame, y up on the board; z out of the face towards the camera.
    a, b = rng.uniform(0.5, 0.65), rng.uniform(-0.1, 0.1)
    turn = np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])
    roll = np.array([[np.cos(b), -np.sin(b), 0], [np.sin(b), np.cos(b), 0], [0, 0, 1]])
    rotation = turn @ roll @ np.diag([1.0, -1.0, -1.0])
    place = np.array([-0.15, 0.02, 0.62])
    normal = np.array([0.72, rng.uniform(-0.05, 0.05), 0.69])
    normal /= np.linalg.norm(normal)
    offset = 0.50
    reflection = np.eye(3) - 2.0 * np.outer(normal, normal)
    k = CAMERA.matrix_px
    views = []
    for r, t in ((rotation, place), (reflection @ rotation, reflection @ place + 2.0 * offset * normal)):
        views.append(k @ np.column_stack([0.02 * r[:, 0], 0.02 * r[:, 1], t]))
    direct, mirrored = (
        chessboard_picture(7, 4, view, (640, 480), seed=seed + i) for i, view in enumerate(views)
    )
    middles = [view[0, 2] / view[2, 2] for view in views]
    both = np.where(np.arange(640) < np.mean(middles), direct, mirrored)
    return both, offset * normal


def test_the_plane_is_found_with_the_deviation_that_it_has(tmp_path: Path) -> None:
    normalised = []
    for seed in range(2):
        drawn, foot = picture(seed)
        found = mirror_from_picture(CAMERA, BOARD, drawn)
        assert found.valid[0], found.reasons
        error = found.foot_points_m[0] - foot
        assert np.linalg.norm(error) < 0.005
        normalised.append(error @ np.linalg.inv(found.covariances_m2[0]) @ error / 3.0)
    assert np.mean(normalised) < 4.0


def test_a_picture_that_leans_as_rolling_shutters_make_it_claims_less() -> None:
    drawn, foot = picture(0)
    leaning = cv2.warpAffine(
        drawn, np.array([[1.0, 6.0 / 480.0, -3.0], [0.0, 1.0, 0.0]]), (640, 480), flags=cv2.INTER_CUBIC
    )
    straight, found = mirrors_from_pictures(CAMERA, BOARD, [drawn, leaning])
    assert not isinstance(straight, MirrorPostureError) and not isinstance(found, MirrorPostureError)
    assert found.covariances_m2[0].trace() > 9.0 * straight.covariances_m2[0].trace()
    error = found.foot_points_m[0] - foot
    assert error @ np.linalg.inv(found.covariances_m2[0]) @ error / 3.0 < 5.0


def test_the_python_of_the_page_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    drawn, foot = picture(0)
    (tmp_path / "camera.yaml").write_text(dump_camera_info(CAMERA), encoding="utf-8")
    for name in ("picture.jpg", "left.jpg", "right.jpg"):
        cv2.imwrite(name, drawn, [cv2.IMWRITE_JPEG_QUALITY, 95])
    mirror, markers = python_of("docs/measuring.md")
    names: dict[str, Any] = {}
    exec(mirror, names)
    found = names["mirror"]
    assert np.linalg.norm(found.normals[0] * found.offsets_m[0] - foot) < 2e-3
    # No ball is in these pictures: none is told.
    exec(markers, names)
    assert not names["found"].positions.valid.any()


def test_the_phones_pictures_of_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mirrors at a right angle by a phone, as the page prints them; a picture of both is refused with its reason."""
    folder = Path(__file__).resolve().parents[3] / "shared" / "data" / "pictures" / "lcma-two-mirrors"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    for file in folder.glob("Image*.jpg"):
        (tmp_path / file.name).symlink_to(file)
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[2] / "docs" / "measuring.md").read_text(encoding="utf-8")
    (camera,) = re.findall(r"```yaml\n(image_width: 3264\n.*?)```", page, re.DOTALL)
    Path("camera.yaml").write_text(camera, encoding="utf-8")
    ((words, printed),) = re.findall(r"\$ mirror-posture (mirror Image3[^\n]*)\n(.*?)```", page, re.DOTALL)
    ended = CliRunner().invoke(cli.app, shlex.split(words))
    assert alike(printed, ended.stdout), ended.stdout
    both = CliRunner().invoke(cli.app, shlex.split(words.replace("Image8", "Image1")))
    assert "Image1.jpg" in both.stderr and "3 boards found where 2 were expected" in both.stderr
    assert "Image7.jpg" in both.stdout


def test_a_picture_without_the_board_says_so_and_does_not_stop_the_others(tmp_path: Path) -> None:
    drawn, _ = picture(1)
    file = tmp_path / "empty.png"
    cv2.imwrite(str(file), np.full_like(drawn, 120))
    first, second = mirrors_from_pictures(CAMERA, BOARD, [file, drawn])
    assert isinstance(first, MirrorPostureError) and "empty.png" in str(first)
    assert not isinstance(second, MirrorPostureError) and second.valid[0]


def test_another_size_than_the_cameras_is_refused() -> None:
    with pytest.raises(MirrorPostureError, match="the camera file is for"):
        mirror_from_picture(CAMERA, BOARD, np.zeros((100, 100), np.uint8))


def small_views() -> tuple[list[Scene], np.ndarray]:
    """Small balls in two poses of the mirror, and where they are, m."""
    return views(Look(size_px=(640, 480), radius_px=(9.0, 14.0)), [3], [(-0.04, 0.0), (0.04, 0.02)])


def test_markers_of_views_are_where_they_are_with_deviations_that_are_true() -> None:
    """Balls drawn before a mirror that turns, taken as a camera, a board and balls alone."""
    scenes, real = small_views()
    first = scenes[0]
    camera, board, balls = known_of(first)

    def measured(pictures: list[np.ndarray]) -> SeenMarkers:
        return markers_from_views(camera, board, balls, pictures, camera_from_board=first.camera_from_board)

    found = measured([scene.bgr for scene in scenes])
    normalised = []
    for row, ball in enumerate(first.balls):
        if not found.positions.valid[row]:
            assert found.unseen[ball.name]
            continue
        error = found.positions.points_in_camera_m[row] - real[row]
        normalised.append(error @ np.linalg.solve(found.positions.covariances_m2[row], error) / 3.0)
    assert len(normalised) >= 3
    assert 0.05 < np.mean(normalised) < 3.0
    # The same pictures as drivers flip and turn them: named, not measured.
    for name, axes in (("mirrored left-right", 1), ("mirrored up-down", 0), ("turned by 180°", (0, 1))):
        with pytest.raises(MirrorPostureError, match=f"the pictures are {name}"):
            measured([np.ascontiguousarray(np.flip(scene.bgr, axes)) for scene in scenes])


@pytest.mark.parametrize("name", ["phone", "hidden 10 to 20 %"])
def test_no_marker_of_two_views_is_wrong(name: str) -> None:
    """`fresh_pictures.py --markers` asks all its variants; here two, of small pictures."""
    look = replace(LOOKS[name], size_px=(480, 360), radius_px=(7.0, 12.0))
    told, masked = markers_of(name, look, 0, 5)
    assert len(told) >= 3, (told, masked)
    assert not [one for one in told if wrong_marker(one[1], one[2])]
    # Deviations that are far too large would never be wrong.
    assert np.median([std for _, _, std, _ in told]) < 0.004


@pytest.mark.parametrize("number", [5, 8])
def test_two_views_that_agree_on_another_ball_of_the_colour_measure_nothing(number: int) -> None:
    """A second ball of its colour touches the marker: without a model both views show another thing, or one each, and
    the rays meet, 19 and 58 mm from the marker. Its size tells."""
    name = "same hue touching"
    told, masked = markers_of(name, LOOKS[name], number, 28113002)
    assert masked > 0
    assert not [one for one in told if wrong_marker(one[1], one[2])]


def test_a_marker_of_another_diameter_is_masked_with_its_reason_and_a_point_has_none() -> None:
    scenes, _ = small_views()
    first = scenes[0]
    camera, board, balls = known_of(first)

    def measured(times: float) -> MarkerPositions:
        sized = [replace(ball, diameter_m=times * ball.diameter_m) for ball in balls]
        pictures = [scene.bgr for scene in scenes]
        told = markers_from_views(camera, board, sized, pictures, camera_from_board=first.camera_from_board)
        return told.positions

    right, wrong, points = measured(1.0), measured(1.2), measured(0.0)
    assert right.valid.sum() >= 3 and not wrong.valid[right.valid].any()
    assert points.valid[right.valid].all()
    row = int(np.flatnonzero(right.valid)[0])
    assert "another diameter" in wrong.reasons[row]
    assert np.isnan(wrong.points_in_camera_m[row]).all() and np.isnan(wrong.covariances_m2[row]).all()


def test_markers_need_two_views() -> None:
    with pytest.raises(MirrorPostureError, match="needed two or more"):
        markers_from_views(CAMERA, BOARD, [Marker("hand")], [picture(0)[0]])


def test_a_board_seen_in_several_pictures_stands_where_the_surer_ones_say() -> None:
    def one(shift_m: float, std_m: float) -> PlanarPoses:
        pose = np.eye(4)
        pose[2, 3] = 0.5 + shift_m
        spread = np.diag([1e-3**2] * 3 + [std_m**2] * 3)
        nothing = np.zeros(1)
        return PlanarPoses(pose[None], spread[None], nothing, nothing, nothing, np.array([True]), {})

    pose, covariance = _joined([one(0.0, 1e-3), one(3e-3, 2e-3)])
    # Weighted by 1 / variance: four to one.
    assert pose[2, 3] == pytest.approx(0.5 + 3e-3 / 5.0, abs=1e-9)
    assert np.sqrt(covariance[5, 5]) == pytest.approx(1e-3 * 2.0 / np.sqrt(5.0))
    assert np.sqrt(covariance[0, 0]) == pytest.approx(1e-3 / np.sqrt(2.0))
