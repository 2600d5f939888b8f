"""A camera from pictures of the board: numbers against a projection written here, their claimed deviations, weak sets."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from mirror_posture import Board, MirrorPostureError, cli
from mirror_posture.camera_calibration import calibrate_camera
from mirror_posture.detect import DetectionSetup
from mirror_posture.detect.gate import board_residual
from mirror_posture.session import load_camera_info

SIZE, FOCAL, CENTRE, K1, K2 = (1280, 720), (905.0, 903.0), (652.0, 347.0), -0.21, 0.06
BOARD = Board(7, 4, 0.02)


def turned(axis: np.ndarray, angle: float) -> np.ndarray:
    k = np.cross(np.eye(3), axis / np.linalg.norm(axis))
    return np.eye(3) + np.sin(angle) * -k + (1 - np.cos(angle)) * k @ k


def project(points: np.ndarray) -> np.ndarray:
    """Brown's radial model, written out."""
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    r2 = x * x + y * y
    scale = 1 + K1 * r2 + K2 * r2 * r2
    return np.stack([FOCAL[0] * x * scale + CENTRE[0], FOCAL[1] * y * scale + CENTRE[1]], axis=1)


def pose(generator: np.random.Generator, tilt: float) -> tuple[np.ndarray, np.ndarray]:
    depth = generator.uniform(0.2, 0.35)
    angle = generator.uniform(0, 2 * np.pi)
    rotation = turned(np.array([np.cos(angle), np.sin(angle), 0.0]), tilt) @ np.diag([1.0, -1.0, -1.0])
    at = np.array([generator.uniform(-0.45, 0.45), generator.uniform(-0.2, 0.2), 1.0]) * depth
    return rotation, at


def views(seed: int, count: int, tilt_deg: tuple[float, float], noise_px: float = 0.1) -> list[np.ndarray]:
    generator = np.random.default_rng(seed)
    iy, ix = np.divmod(np.arange(28), 7)
    points = np.stack([(ix - 3) * 0.02, (iy - 1.5) * 0.02, 0 * ix], axis=1)
    made = []
    for _ in range(count):
        rotation, at = pose(generator, np.radians(generator.uniform(*tilt_deg)))
        made.append(project(points @ rotation.T + at) + generator.normal(0, noise_px, (28, 2)))
    return made


def test_numbers_lie_within_their_claimed_deviations() -> None:
    errors = []
    for seed in range(8):
        done = calibrate_camera(BOARD, views(seed, 15, (10, 45)), SIZE)
        got = np.array([*done.camera.focal_px, *done.camera.center_px])
        errors.append((got - np.array([*FOCAL, *CENTRE])) / np.array(done.std_px))
        assert done.rms_px == pytest.approx(0.1 * np.sqrt(2), rel=0.15)
        assert done.used.all() and done.largest_tilt_rad > np.radians(25)
    # 32 standardised errors (correlated within a run): their RMS is near 1, neither boasting nor shy.
    assert 0.6 < float(np.sqrt(np.mean(np.square(errors)))) < 1.5


def test_what_is_weak_is_said() -> None:
    good = calibrate_camera(BOARD, views(1, 30, (10, 45)), SIZE)
    assert good.weak == ()
    flat = calibrate_camera(BOARD, views(2, 5, (1, 6), 0.2), SIZE)
    assert any("5 views" in text for text in flat.weak) and any("tilt" in text for text in flat.weak)
    assert flat.std_px[0] > 5 * good.std_px[0]


def test_a_view_that_does_not_fit_is_left_out_and_named() -> None:
    made = views(3, 15, (10, 45))
    made[4] = made[4] + np.random.default_rng(0).normal(0, 5, made[4].shape)
    done = calibrate_camera(BOARD, made, SIZE)
    assert np.flatnonzero(~done.used).tolist() == [4] and any(
        "1 view does not fit" in text for text in done.weak
    )
    assert done.camera.focal_px[0] == pytest.approx(FOCAL[0], rel=0.01)
    made[5][:25] = np.nan
    assert not calibrate_camera(BOARD, made, SIZE).used[5]
    # A view of too few corners before the one that does not fit: both are left out, and no other.
    made[5], made[1] = made[6], made[1].copy()
    made[1][:25] = np.nan
    assert np.flatnonzero(~calibrate_camera(BOARD, made, SIZE).used).tolist() == [1, 4]
    with pytest.raises(MirrorPostureError, match="needed 4"):
        calibrate_camera(BOARD, made[:3], SIZE)
    with pytest.raises(MirrorPostureError, match="7 x 4"):
        calibrate_camera(BOARD, [np.zeros((5, 2))] * 5, SIZE)


def pictures(seed: int, count: int) -> list[np.ndarray]:
    """A flat drawing of the board, warped by a pinhole camera's homography: 8 x 5 squares with a white border."""
    scale, border = 60, 60
    drawn = np.full((5 * scale + 2 * border, 8 * scale + 2 * border), 255, np.uint8)
    for row in range(5):
        for column in range(8):
            if (row + column) % 2 == 0:
                top, left = border + row * scale, border + column * scale
                drawn[top : top + scale, left : left + scale] = 0
    metres_from_drawn = np.array(
        [[0.02 / scale, 0, -0.02 * 4 - 0.02 * (border - 0.5) / scale], [0, -0.02 / scale, 0.02 * 2.5 + 0.02 * (border - 0.5) / scale], [0, 0, 1.0]]
    )  # fmt: skip
    matrix = np.array([[900.0, 0, 639.5], [0, 900.0, 359.5], [0, 0, 1]])
    generator = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        rotation, at = pose(generator, np.radians(generator.uniform(15, 40)))
        at = at * [0.6, 0.6, 1.0] + [0, 0, 0.08]
        homography = matrix @ np.column_stack([rotation[:, 0], rotation[:, 1], at]) @ metres_from_drawn
        made.append(cv2.warpPerspective(drawn, homography, SIZE, flags=cv2.INTER_AREA, borderValue=190))
    return made


def test_the_command_reads_pictures_and_writes_camera_info(tmp_path: Path) -> None:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for index, picture in enumerate(pictures(5, 12)):
        cv2.imwrite(str(folder / f"{index:02d}.png"), picture)
    cv2.imwrite(str(folder / "empty.png"), np.full((720, 1280), 128, np.uint8))
    # One that was half copied costs itself only: before, the whole run.
    (folder / "cut.png").write_bytes((folder / "00.png").read_bytes()[:2000])
    words = ["calibrate-camera", str(folder), "--out", str(tmp_path / "camera.yaml"), "--json"]
    run = CliRunner().invoke(cli.app, words)
    assert run.exit_code == 0, run.output
    document = json.loads(run.stdout)
    refused = {entry["picture"]: entry["reason"] for entry in document["refused"]}
    assert set(refused) == {"cut.png", "empty.png"} and "broken" in refused["cut.png"]
    assert "cut.png: not used (the picture is broken" in run.stderr
    camera = load_camera_info(tmp_path / "camera.yaml")
    assert camera.size_px == SIZE and camera.focal_px[0] == pytest.approx(900.0, rel=0.01)
    assert document["rms_px"] < 0.3 and len(document["views"]) >= 10
    assert "--overwrite" in CliRunner().invoke(cli.app, words).stderr


def test_pictures_of_which_none_can_be_used_are_told(tmp_path: Path) -> None:
    folder, out = tmp_path / "pictures", tmp_path / "camera.yaml"
    folder.mkdir()
    (folder / "00.png").write_bytes(b"no picture")
    words = ["calibrate-camera", str(folder), "--out", str(out)]
    told = " ".join(CliRunner().invoke(cli.app, words).stderr.split())
    assert "00.png: the picture is broken" in told and "can be read" in told and not out.exists()
    for name, width in (("01.png", 64), ("02.png", 80)):
        cv2.imwrite(str(folder / name), np.full((48, width), 128, np.uint8))
    run = CliRunner().invoke(cli.app, words)
    assert run.exit_code == 1 and "is 80 x 48, the first picture is 64 x 48" in " ".join(run.stderr.split())


def test_the_same_pictures_give_the_same_camera() -> None:
    # A weak set, in which rounding shows early.
    made = views(2, 8, (1, 6), 0.2)
    found = [calibrate_camera(BOARD, made, SIZE).camera for _ in range(5)]
    assert found == found[:1] * 5


def test_a_film_is_calibrated_by_what_is_held_still_in_it(tmp_path: Path) -> None:
    """Each place is held for a second at 5 pictures a second, the third twice; in between the board is gone."""
    shown = pictures(5, 6)
    film = cv2.VideoWriter(str(tmp_path / "film.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 5, SIZE)
    for picture in [*shown[:3], shown[2], *shown[3:]]:
        for frame in [np.full_like(shown[0], 190)] * 2 + [picture] * 5:
            film.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    film.release()
    words = [
        "calibrate-camera",
        str(tmp_path / "taken"),
        "--source",
        str(tmp_path / "film.avi"),
        "--most",
        "5",
    ]
    run = CliRunner().invoke(cli.app, [*words, "--out", str(tmp_path / "camera.yaml")])
    assert run.exit_code == 0, run.output
    said = " ".join(run.output.split())
    assert "the board was there before" in said and "picture 5:" in said and "more at least" in said
    assert len(list((tmp_path / "taken").iterdir())) == 5, "the place that was held twice is taken once"
    assert load_camera_info(tmp_path / "camera.yaml").focal_px[0] == pytest.approx(900.0, rel=0.05)
    again = CliRunner().invoke(cli.app, [*words, "--out", str(tmp_path / "b.yaml")])
    assert "needed a new folder" in " ".join(again.stderr.split())


def test_where_the_board_was_not_yet_is_said() -> None:
    left = [np.where(view > 0, view * [0.4, 1.0], view) for view in views(4, 12, (20, 40))]
    said = " ".join(calibrate_camera(BOARD, left, SIZE).weak)
    assert "corners and edges too, the" in said and "right first" in said


def test_several_views_that_do_not_fit_do_not_hide_each_other() -> None:
    made = views(6, 15, (10, 45))
    noise = np.random.default_rng(1)
    for view in (2, 5, 9, 11, 13):
        made[view] = made[view] + noise.normal(0, 1.0, made[view].shape)
    done = calibrate_camera(BOARD, made, SIZE)
    assert np.flatnonzero(~done.used).tolist() == [2, 5, 9, 11, 13]


@pytest.mark.parametrize(
    ("shown", "used"),
    [
        # Indices of 7 columns x 4 rows: a row, a row and one corner, after it or before; then what is enough.
        (range(7), False),
        ([*range(7, 14), 24], False),
        ([24, *range(7, 14)], False),
        ([*range(7), 7, 8], True),
        ([*range(7), 14, 15], True),
        ([*range(7), 9, 23], True),
        ([0, 7, 14, 21, 1, 15], True),
        ([*range(21, 28), 3, 10], True),
    ],
)
def test_a_view_whose_corners_lie_in_one_line_costs_itself_only(shown: list[int], used: bool) -> None:
    """Before, OpenCV gave up the whole calibration: "matH0.size() == Size(3, 3)"."""
    made = views(3, 15, (10, 45))
    part = np.full((28, 2), np.nan)
    part[list(shown)] = made[4][list(shown)]
    made[4] = part
    done = calibrate_camera(BOARD, made, SIZE)
    assert bool(done.used[4]) is used and done.used.sum() == 14 + used
    assert set(done.reasons) == (set() if used else {4})
    assert used or "in one line" in done.reasons[4]
    # It says nothing of a view that would not fit the others.
    assert not any("not fit" in text for text in done.weak)
    assert done.camera.focal_px[0] == pytest.approx(FOCAL[0], rel=0.01)
    seen = np.isfinite(part).all(axis=1)
    gate = board_residual(np.nan_to_num(part), BOARD, None, visible=seen)
    # (What the lens bends is no homography's, so that a good view may be above the limit here.)
    assert np.isfinite(gate.rms_px) == used and (gate.no_fit == "") is used
    assert used or ("in one line" in gate.reason and "wrong grid" not in gate.reason)


def test_a_view_in_one_column_and_too_few_others_are_told() -> None:
    board = Board(4, 7, 0.02)
    made = [np.full((28, 2), np.nan) for _ in range(4)]
    for view, full in zip(made, views(3, 4, (10, 45)), strict=True):
        view[::4] = full[:7]
    with pytest.raises(MirrorPostureError, match="got 0 views with 6 corners or more that are not in one"):
        calibrate_camera(board, made, SIZE)


def test_boards_of_any_size_are_calibrated_with(tmp_path: Path) -> None:
    """Before, squares of 100 mm were refused: "does not fit on a3", for a board that had been made."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for index, picture in enumerate(pictures(5, 6)):
        cv2.imwrite(str(folder / f"{index:02d}.png"), picture)
    words = ["calibrate-camera", str(folder), "--corners", "7x4", "--square-mm", "100"]
    run = CliRunner().invoke(cli.app, [*words, "--out", str(tmp_path / "camera.yaml")])
    assert run.exit_code == 0, run.output
    assert load_camera_info(tmp_path / "camera.yaml").focal_px[0] == pytest.approx(900.0, rel=0.05)


@pytest.mark.parametrize(
    ("words", "marker_m"),
    [
        (["--charuco", "DICT_4X4_50"], 0.0375),
        (["--charuco", "DICT_4X4_50", "--marker-mm", "37"], 0.037),
        (["--charuco", "DICT_4X4_50", "--marker-mm", "30", "--corners", "9x7"], 0.03),
        ([], None),
    ],
)
def test_the_board_is_the_one_that_was_told(
    words: list[str], marker_m: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "00.png").write_bytes(b"")
    boards: list[Board] = []

    def stop(files: object, setup: DetectionSetup, **_: object) -> None:
        boards.append(setup.board)
        raise MirrorPostureError("enough")

    monkeypatch.setattr("mirror_posture.detect.detect_pictures", stop)
    corners = [] if "--corners" in words else ["--corners", "9x6"]
    out = ["--out", str(tmp_path / "c.yaml")]
    run = CliRunner().invoke(
        cli.app, ["calibrate-camera", str(tmp_path), "--square-mm", "50", *corners, *words, *out]
    )
    assert "enough" in run.stderr, run.output
    (board,) = boards
    assert board.square_m == pytest.approx(0.05) and board.columns == 9
    assert board.marker_size_m == (None if marker_m is None else pytest.approx(marker_m))
    assert board.dictionary == ("DICT_4X4_50" if words else None)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--corners", "9x7"], "one odd and one even"),
        (["--marker-mm", "10"], "needed --charuco"),
        (["--charuco", "DICT_4X4_50", "--marker-mm", "0"], "marker_size = 0"),
        (["--charuco", "DICT_4X4_50", "--marker-mm", "20"], "marker_size = 0.02"),
        (["--charuco", "DICT_9"], "DICT_4X4_50"),
    ],
)
def test_a_board_that_no_picture_could_show_is_refused(words: list[str], told: str, tmp_path: Path) -> None:
    out = ["--out", str(tmp_path / "c.yaml")]
    run = CliRunner().invoke(cli.app, ["calibrate-camera", str(tmp_path), *words, *out])
    assert run.exit_code == 1 and told in " ".join(run.stderr.split()), run.output
