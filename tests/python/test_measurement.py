"""Measuring sessions: against a reflection written out here, against renderers, and against its own covariance."""

from __future__ import annotations

import dataclasses
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from mirror_posture.detect import detect_session
from mirror_posture.measurement import ESTIMATORS, MeasureOptions, Mount, NothingMeasuredError
from mirror_posture.measurement.table import marker_table, summarise
from mirror_posture.measurement.used import used
from mirror_posture.render import DEMO_POSTURES, PictureOptions, View, render_session
from mirror_posture.session import Session, Views
from session_folder import DATA, SESSION, replaced, write_folder

MITSUBA = DATA / "pictures" / "mitsuba-glass-a"

URDF = """<robot name="bust"><link name="base"/><link name="camera_optical"/><link name="chest_board"/><link name="upper"/>
<link name="hand_marker"/><link name="elbow_marker"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0.05 -0.02 0.03"/>
<axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="h" type="fixed"><parent link="upper"/><child link="hand_marker"/><origin xyz="0.06 0.01 0.02"/></joint>
<joint name="e" type="fixed"><parent link="upper"/><child link="elbow_marker"/><origin xyz="0.0 0.02 0.0"/></joint>
<joint name="eye" type="fixed"><parent link="base"/><child link="camera_optical"/></joint>
<joint name="chest" type="fixed"><parent link="base"/><child link="chest_board"/><origin xyz="0 0.075 0.01" rpy="0 3.141592653589793 0"/></joint>
</robot>"""
CAMERA = """image_width: 1400
image_height: 1200
camera_matrix: {data: [693.0, 0, 699.5, 0, 693.0, 599.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {data: [0, 0, 0, 0, 0]}
"""
TEXT = replaced(
    replaced(SESSION, "corners = [3, 2]", "corners = [7, 5]"),
    "glass_thickness = 0.003",
    "glass_thickness = 0.0",
)
TEXT = replaced(TEXT, '[points]\nframe = "unknown"\n', "").replace("diameter = 0.0116", "diameter = 0.0")
YAWS_RAD, PITCHES_RAD = (0.0, 0.25, -0.2), (0.0, 0.05, 0.2)


def simulated(
    tmp_path: Path, noise_px: float = 0.2, postures: int = 60, seed: int = 5, offset_rad: float = 0.1
) -> Session:
    """A bust before flat mirrors: points are reflected as x + 2 (d − n·x) n and projected, both written out here.

    The shoulder stands `offset_rad` from its command. The camera is the base frame; markers at the command's place move with it.
    """
    rng = np.random.default_rng(seed)
    frames = ["frame,posture,shoulder"]
    detections = ["frame,target,index,u,v"]
    square, grid = 0.014, [(ix, iy) for iy in range(5) for ix in range(7)]
    # rpy = (0, π, 0): x and z turned about.
    board = np.array([[-(ix - 3) * square, 0.075 + (iy - 2) * square, 0.01] for ix, iy in grid])
    for posture in range(postures):
        command = rng.uniform(-0.6, 0.6)
        c, s = np.cos(command + offset_rad), np.sin(command + offset_rad)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        at = np.array([0.05, -0.02, 0.03])
        markers = {"hand": at + turn @ [0.06, 0.01, 0.02], "elbow_ball": at + turn @ [0.0, 0.02, 0.0]}
        for view, (yaw, pitch) in enumerate(zip(YAWS_RAD, PITCHES_RAD, strict=True)):
            number = posture * len(YAWS_RAD) + view
            frames.append(f"{number},{posture},{command}")
            n = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
            for target, points in (("board", board), *((k, v[None]) for k, v in markers.items())):
                reflected = points + 2 * (0.16 - points @ n)[:, None] * n
                pixels = 693.0 * reflected[:, :2] / reflected[:, 2:] + (699.5, 599.5)
                pixels += rng.normal(0.0, noise_px, pixels.shape)
                detections += [
                    f"{number},{target},{i},{u!r},{v!r}" for i, (u, v) in enumerate(pixels.tolist())
                ]
    text = replaced(TEXT, "pixel_std = 0.2", f"pixel_std = {max(noise_px, 1e-3)}")
    folder = write_folder(
        tmp_path,
        session=text,
        robot=URDF,
        camera=CAMERA,
        frames="\n".join(frames),
        detections="\n".join(detections),
        points=None,
    )
    return mp.load_session(folder)


def true_points(session: Session, markers: mp.measurement.Markers, offset_rad: float = 0.1) -> np.ndarray:
    """Where the simulated markers are, in the camera's frame (the base's)."""
    out = []
    for posture, marker in zip(markers.posture, markers.marker, strict=True):
        angle = session.frames.commanded[posture * len(YAWS_RAD), 0] + offset_rad
        c, s = np.cos(angle), np.sin(angle)
        arm = ([0.06, 0.01, 0.02], [0.0, 0.02, 0.0])[marker]
        out.append(np.array([0.05, -0.02, 0.03]) + np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ arm)
    return np.array(out)


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_without_noise_every_estimator_finds_the_markers(estimator: str, tmp_path: Path) -> None:
    session = simulated(tmp_path, noise_px=0.0, postures=4)
    found = mp.measure(session, MeasureOptions(estimator))
    assert found.mirrors.measured.all() and found.markers.measured.all()
    np.testing.assert_allclose(
        found.markers.point_in_camera_m, true_points(session, found.markers), atol=2e-7
    )
    np.testing.assert_allclose(found.mirrors.distance_m, 0.16, atol=1e-7)
    np.testing.assert_allclose(found.mirrors.normal[0], [0, 0, 1], atol=1e-6)


@pytest.mark.parametrize("estimator", ["point-pair", "maximum-likelihood", "joint"])
def test_covariances_are_what_the_errors_are(estimator: str, tmp_path: Path) -> None:
    session = simulated(tmp_path, postures=150)
    # Exactly mounted, and said so: the joint estimator's prior then must not be a guess.
    options = MeasureOptions(estimator, mount_std_rad=1e-6, mount_std_m=1e-7)
    found = mp.measure(session, options).markers
    error = found.point_in_camera_m - true_points(session, found)
    chi_squared = np.einsum("ki,kij,kj->k", error, np.linalg.inv(found.covariance_m2), error)
    # Mean of 300 values of 3 degrees of freedom: 3 ± 0.14 (hand and elbow of a posture share their mirrors: ± 0.2).
    assert chi_squared.mean() == pytest.approx(3.0, abs=0.5)
    assert (chi_squared < 7.815).mean() == pytest.approx(0.95, abs=0.03)


def test_the_ladder_is_ordered(tmp_path: Path) -> None:
    session = simulated(tmp_path)
    rms = {}
    for found in mp.measure_all(
        session, tuple(MeasureOptions(name, mount_std_m=1e-6) for name in ESTIMATORS)
    ):
        error = found.markers.point_in_camera_m - true_points(session, found.markers)
        rms[found.estimator] = float(np.sqrt((error**2).sum(axis=1).mean()))
    assert rms["pose"] > rms["pose-snapped"] > 2 * rms["point-pair"]
    assert (
        rms["maximum-likelihood"] < 1.05 * rms["point-pair"]
        and rms["joint"] < 1.02 * rms["maximum-likelihood"]
    )


def test_the_model_is_where_the_urdf_says(tmp_path: Path) -> None:
    session = simulated(tmp_path, noise_px=0.0, postures=3)
    found = mp.measure(session).markers
    np.testing.assert_allclose(found.model_in_root_m, true_points(session, found, offset_rad=0.0), atol=1e-12)
    hand = summarise(mp.measure(session))[0]
    assert hand.marker == "hand" and hand.measured == 3
    assert hand.distance_rms_m == pytest.approx(2 * np.sin(0.05) * np.hypot(0.06, 0.01), abs=1e-6)


def test_the_legend_covers_no_title(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from matplotlib.figure import Figure

    from mirror_posture.measurement.figures import plot_measured_against_model

    drawn: list[Figure] = []
    save = Figure.savefig

    def kept(figure: Figure, *args: object, **options: object) -> None:
        save(figure, *args, **options)  # type: ignore[arg-type]
        drawn.append(figure)

    monkeypatch.setattr(Figure, "savefig", kept)
    session = simulated(tmp_path, postures=6)
    plot_measured_against_model(mp.measure(session, MeasureOptions()), tmp_path / "figure.png")
    [figure] = drawn
    title, [legend] = figure._suptitle, figure.legends  # type: ignore[attr-defined]
    boxes = [box.get_window_extent() for box in (title, legend)]
    assert not boxes[0].overlaps(boxes[1])
    assert not any(
        legend.get_window_extent().overlaps(ax.get_tightbbox()) for ax in figure.axes if ax.get_visible()
    )


def test_a_camera_that_sits_elsewhere_is_found_by_joint_and_by_calibration(tmp_path: Path) -> None:
    session = simulated(tmp_path, noise_px=0.02, offset_rad=0.0)
    # The model believes the camera (and what hangs on it) 2 mm beside and a degree turned.
    wrong = URDF.replace(
        '<child link="camera_optical"/>',
        '<child link="camera_optical"/><origin xyz="0.002 0 0" rpy="0 0.0174533 0"/>',
    )
    (tmp_path / "robot.urdf").write_text(wrong)
    believed = mp.load_session(session.folder)
    trusting = mp.measure(believed).markers.distance_m
    joint = mp.measure(believed, MeasureOptions("joint")).markers.distance_m
    assert np.median(trusting) > 1e-3 and np.median(joint) < 0.2 * np.median(trusting)
    right = mp.measure(session)
    corrected = mp.measure(
        believed,
        MeasureOptions(
            mount=Mount(
                np.array([[-1.0, 0, 0, 0], [0, 1, 0, 0.075], [0, 0, -1, 0.01], [0, 0, 0, 1]]),
                np.eye(6) * 1e-18,
            )
        ),
    )
    np.testing.assert_allclose(
        corrected.markers.point_in_camera_m, right.markers.point_in_camera_m, atol=1e-9
    )
    np.testing.assert_allclose(corrected.markers.point_in_root_m, right.markers.point_in_root_m, atol=1e-9)


def test_what_is_missing_is_masked_with_its_reason(tmp_path: Path) -> None:
    session = simulated(tmp_path, postures=3)
    view = session.mirror_view
    view.board_seen[0] = False
    view.board_seen[1, 3:] = False
    view.marker_seen[3:5, 0] = False
    found = mp.measure(session)
    assert found.mirrors.measured.tolist() == [False, False] + [True] * 7
    assert "not seen" in str(found.mirrors.reason[0]) and "needed at least 4" in str(found.mirrors.reason[1])
    assert not found.markers.measured[:2].any() and not found.markers.measured[2]
    assert "needed 2" in str(found.markers.reason[0])
    counts = used(session, found)
    assert (counts.frames_given, counts.frames_used, counts.postures_given, counts.postures_used) == (
        9,
        7,
        3,
        2,
    )
    # Two markers in three frames of three postures, less the two that were taken away: of the first posture one view is left, of
    # the second one marker has one.
    assert (counts.points_given, counts.points_used) == (16, 9)
    assert (counts.markers_given, counts.markers_used) == (len(found.markers), found.markers.measured.sum())
    assert len(counts.left_out) == 2 + 16 - 9
    assert {(left.frame, left.target) for left in counts.left_out} >= {
        (0, "board"),
        (1, "board"),
        (5, "hand"),
    }
    assert all(left.why for left in counts.left_out)
    table = marker_table(found)
    assert found.to_arrow().equals(table)
    assert table["x_m"][0].as_py() is None and table["reason"][0].as_py()
    for array in (
        found.markers.point_in_root_m,
        found.markers.covariance_m2,
        found.mirrors.normal,
        found.markers.std_m,
    ):
        assert np.isfinite(array).all()


def test_two_views_of_one_mirror_are_too_little_parallax(tmp_path: Path) -> None:
    session = simulated(tmp_path, postures=2)
    seen = session.mirror_view
    seen.marker_seen[[1, 2, 4, 5]] = False
    for array in (seen.board_px, seen.board_seen, seen.marker_px, seen.marker_seen):
        array[1], array[4] = array[0], array[3]
    found = mp.measure(session)
    assert not found.markers.measured.any()
    assert all("parallax" in str(reason) for reason in found.markers.reason)


def test_nothing_to_measure_is_an_error(tmp_path: Path) -> None:
    session = simulated(tmp_path, postures=1)
    blind = dataclasses.replace(session, mirror_view=Views.empty(3, 35, 2))
    with pytest.raises(NothingMeasuredError, match="no frame shows the board"):
        mp.measure(blind)
    with pytest.raises(mp.MirrorPostureError, match="needed one of pose"):
        mp.measure(session, MeasureOptions("eq2"))  # type: ignore[arg-type]
    with pytest.raises(mp.MirrorPostureError, match="no camera"):
        mp.measure(dataclasses.replace(session, camera=None))


def test_a_head_that_moves_between_the_views_is_refused(tmp_path: Path) -> None:
    text = URDF.replace('name="eye" type="fixed"', 'name="eye" type="continuous"')
    session = simulated(tmp_path, postures=2)
    (tmp_path / "robot.urdf").write_text(text)
    lines = (tmp_path / "frames.csv").read_text().splitlines()
    turned = [lines[0] + ",eye", *(f"{line},{0.01 * i}" for i, line in enumerate(lines[1:]))]
    (tmp_path / "frames.csv").write_text("\n".join(turned))
    with pytest.raises(mp.MirrorPostureError, match="posture 0"):
        mp.measure(mp.load_session(session.folder))


@cache
def mitsuba() -> tuple[Session, dict]:
    session = detect_session(mp.load_session(MITSUBA)).session
    return session, json.loads((MITSUBA / "truth.json").read_text())


@pytest.mark.skipif(not MITSUBA.is_dir(), reason=f"the data is not there: {MITSUBA}")
@pytest.mark.parametrize(
    ("estimator", "most_rms_m", "least", "most"),
    # The RMS error is 0.12, 0.11 and 0.13 mm, the squared error over the claimed variance 2.0, 1.0 and 0.5: both with a fifth and more to spare.
    [
        ("point-pair", 0.14e-3, 1.4, 2.9),
        ("maximum-likelihood", 0.13e-3, 0.7, 1.5),
        ("joint", 0.16e-3, 0.3, 0.7),
    ],
)
def test_markers_in_pictures_by_another_renderer(
    estimator: str, most_rms_m: float, least: float, most: float
) -> None:
    session, truth = mitsuba()
    found = mp.measure(session, MeasureOptions(estimator)).markers
    names, first = (
        session.marker_names,
        {int(p): i for i, p in reversed(list(enumerate(session.frames.posture)))},
    )
    good = np.flatnonzero(found.measured)
    assert len(good) >= 55
    error = np.array(
        [
            found.point_in_camera_m[k]
            - truth["frames"][first[int(found.posture[k])]]["markers"][names[found.marker[k]]]["camera_m"]
            for k in good
        ]
    )
    assert np.sqrt((error**2).sum(axis=1).mean()) < most_rms_m
    chi_squared = np.einsum("ki,kij,kj->k", error, np.linalg.inv(found.covariance_m2[good]), error)
    assert least < chi_squared.mean() / 3.0 < most


def test_markers_in_traced_pictures_from_two_views(tmp_path: Path) -> None:
    views = (View(yaw_rad=-0.1), View(yaw_rad=0.16))
    folder = render_session(
        tmp_path / "session",
        DEMO_POSTURES[1:3],
        views,
        offsets_rad={"r_shoulder_roll": 0.04},
        # Without ghosts: with them pictures and exact pixels are compared in test_robot_twin.
        options=PictureOptions(samples=1, edge_samples=2, ghosts=False),
        seed=3,
    )
    session = detect_session(mp.load_session(folder)).session
    truth = json.loads((folder / "truth.json").read_text())
    found = mp.measure(session).markers
    good = np.flatnonzero(found.measured)
    assert len(good) >= 4
    error = np.array(
        [
            found.point_in_root_m[k]
            - truth["frames"][2 * int(found.posture[k])]["markers"][session.marker_names[found.marker[k]]][
                "root_m"
            ]
            for k in good
        ]
    )
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.0005
    right = found.marker[good] == session.marker_names.index("r_hand")
    assert found.distance_m[good][right].min() > 0.002, "the hidden offset of the shoulder must be seen"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("corner_noise_px", value) for value in (-1.0, 0.0, np.nan, "1")),
        *(("marker_noise_px", value) for value in (-1.0, np.inf)),
        *(("mount_std_m", value) for value in (-0.01, np.nan)),
        *(("mount_std_rad", value) for value in (-0.01, np.nan)),
        *(("least_parallax_rad", value) for value in (-1.0, 0.0, 2.0, np.nan, None)),
    ],
)
def test_numbers_that_nothing_can_be_measured_with_are_refused(name: str, value: object) -> None:
    """Before, every marker was masked, or measured with a deviation that is no number."""
    with pytest.raises(mp.MirrorPostureError, match=f"{name}: got {value!r}, needed"):
        MeasureOptions(**{name: value})  # type: ignore[arg-type]
    MeasureOptions(corner_noise_px=np.float32(0.1), mount_std_m=0, least_parallax_rad=1e-3)
