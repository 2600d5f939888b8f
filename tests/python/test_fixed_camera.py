"""A camera that stands beside an arm, or in its hand, and sees markers directly, without mirror or board: simulated here by plain trigonometry."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp

JOINTS = (
    ("turn", (0, 0, 1), (0, 0, 0.1)),
    ("lift", (0, 1, 0), (0, 0, 0.06)),
    ("bend", (0, 1, 0), (0, 0, 0.25)),
)
MARKERS = {"upper": (1, (0.03, 0.02, 0.14)), "wrist": (2, (0.0, 0.03, 0.2)), "tip": (2, (0.06, -0.02, 0.26))}
FOCAL_PX, CENTER_PX = 900.0, np.array([639.5, 479.5])
# Of a camera in the hand: markers on the base, in front of it.
ON_BASE = {
    "left": (-1, (1.0, 0.3, 0.45)),
    "right": (-1, (1.1, -0.25, 0.6)),
    "low": (-1, (0.9, 0.05, 0.2)),
    "far": (-1, (1.3, 0.0, 0.4)),
}
# The camera stands 1.1 m before the arm and looks back along x: its x axis is the base's y, its y axis points down.
CAMERA_FROM_BASE = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
CAMERA_AT = np.array([1.1, 0.0, 0.3])
# In the hand it looks along the hand's x axis, its x axis is the hand's -y.
CAMERA_FROM_HAND = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
CAMERA_IN_HAND = np.array([0.05, 0.0, 0.15])


def turned(axis: tuple[int, int, int], angle: float) -> np.ndarray:
    """Rodrigues' rotation."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=float)
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def seen(q: np.ndarray, in_hand: bool) -> dict[str, np.ndarray]:
    """Markers in the camera's frame, m."""
    rotation, place = np.eye(3), np.zeros(3)
    frames = []
    for (_, axis, at), angle in zip(JOINTS, q, strict=True):
        place = place + rotation @ np.array(at)
        rotation = rotation @ turned(axis, angle)
        frames.append((rotation, place))
    frames.append((np.eye(3), np.zeros(3)))
    points = {name: frames[k][1] + frames[k][0] @ np.array(at) for name, (k, at) in markers(in_hand).items()}
    if not in_hand:
        return {name: CAMERA_FROM_BASE @ (point - CAMERA_AT) for name, point in points.items()}
    at = place + rotation @ CAMERA_IN_HAND
    return {name: CAMERA_FROM_HAND @ rotation.T @ (point - at) for name, point in points.items()}


def markers(in_hand: bool) -> dict[str, tuple[int, tuple[float, float, float]]]:
    """Each marker's joint and its place on that joint's link; -1 is the base."""
    return ON_BASE if in_hand else MARKERS


def swept() -> np.ndarray:
    """Each joint forth and back by itself, 40 rows, at even steps."""
    middle = np.array([0.1, 0.2, 0.5])
    way = np.concatenate([np.linspace(-0.6, 0.6, 20), np.linspace(0.6, -0.6, 20)])
    return np.concatenate([middle + np.outer(way, np.eye(3)[k]) for k in range(3)])


def written(
    folder: Path,
    focal_error: float = 0.0,
    center_px: tuple[float, float] = (0.0, 0.0),
    in_hand: bool = False,
    lift_offset: float = 0.0,
    sweeps: bool = False,
    slipped: range = range(0),
    by: int = 0,
) -> Path:
    """A session of random postures, or of joints that move one after the other; the rows `slipped` hold the measurement of `by` rows later."""
    folder.mkdir()
    placed = markers(in_hand)
    links = [
        f'<link name="{name}"/>' for name in ("base", "camera", *(j[0] + "_link" for j in JOINTS), *placed)
    ]
    parents = ["base", *(j[0] + "_link" for j in JOINTS)]
    joints = [
        f'<joint name="{name}" type="revolute"><parent link="{parents[k]}"/><child link="{name}_link"/><axis xyz="{" ".join(map(str, axis))}"/>'
        f'<origin xyz="{" ".join(map(str, at))}"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        for k, (name, axis, at) in enumerate(JOINTS)
    ]
    joints += [
        f'<joint name="{name}_mount" type="fixed"><parent link="{parents[k + 1]}"/><child link="{name}"/><origin xyz="{" ".join(map(str, at))}"/></joint>'
        for name, (k, at) in placed.items()
    ]
    # Fixed-axis angles whose matrix is base_from_camera: first -90° about x, then 90° about z.
    parent, at, turn = (parents[-1], CAMERA_IN_HAND, -1) if in_hand else ("base", CAMERA_AT, 1)
    joints.append(
        f'<joint name="eye" type="fixed"><parent link="{parent}"/><child link="camera"/>'
        f'<origin xyz="{" ".join(map(str, at))}" rpy="{-np.pi / 2} 0 {turn * np.pi / 2}"/></joint>'
    )
    (folder / "robot.urdf").write_text(f'<robot name="arm">{"".join(links + joints)}</robot>')
    sections = "".join(
        f'[[markers]]\nname = "{name}"\nlink = "{name}"\ndiameter = 0.0\nmount = "known"\n' for name in placed
    )
    (folder / "session.toml").write_text(
        'format = "mirror-posture/session"\nversion = 1\nrobot = "robot.urdf"\ncamera = "camera.yaml"\nroot = "base"\ngravity = [0.0, 0.0, -9.81]\n'
        f'[camera_mount]\nlink = "camera"\n{sections}[noise]\npixel_std = 0.2\n'
    )
    (folder / "camera.yaml").write_text(
        f"image_width: 1280\nimage_height: 960\ncamera_matrix: {{rows: 3, cols: 3, data: [{FOCAL_PX}, 0, {CENTER_PX[0]}, 0, {FOCAL_PX}, {CENTER_PX[1]}, 0, 0, 1]}}\n"
        "distortion_model: plumb_bob\ndistortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n"
    )
    rng = np.random.default_rng(7)
    positions = swept() if sweeps else rng.uniform(-0.8, 0.8, (60, 3)) * (0.25 if in_hand else 1.0)
    rows, sights = ["frame,posture," + ",".join(j[0] for j in JOINTS)], ["frame,target,index,u,v,via"]
    for frame, q in enumerate(positions):
        rows.append(f"{frame},{frame}," + ",".join(f"{x:.6f}" for x in q))
        at = positions[frame + by] if frame in slipped else q
        for name, point in seen(at + np.array([0.0, lift_offset, 0.0]), in_hand).items():
            pixel = FOCAL_PX * (1.0 + focal_error) * point[:2] / point[2] + CENTER_PX + center_px
            u, v = pixel + rng.normal(0.0, 0.2, 2)
            if not (0.0 < u < 1279.0 and 0.0 < v < 959.0):
                continue
            sights.append(f"{frame},{name},0,{u:.4f},{v:.4f},direct")
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    (folder / "detections.csv").write_text("\n".join(sights) + "\n")
    return folder


@pytest.mark.parametrize("in_hand", [False, True])
def test_nothing_is_wrong(in_hand: bool, tmp_path: Path) -> None:
    found = mp.diagnose(mp.load_session(written(tmp_path / "session", in_hand=in_hand)))
    assert found.verdict == "none", found.sentence


def test_a_zero_beyond_which_only_the_camera_moves_is_told(tmp_path: Path) -> None:
    found = mp.diagnose(mp.load_session(written(tmp_path / "session", in_hand=True, lift_offset=0.01)))
    assert found.verdict == "explained", found.sentence
    (cause,) = found.causes
    assert (cause.effect, cause.at) == ("joint_offset", "joint:lift"), cause
    told = cause.parameters["offset_rad"]
    assert abs(told.value - 0.01) < 4.0 * told.std


@pytest.mark.parametrize(
    ("effect", "error", "parameter", "value"),
    [
        ("camera_focal", {"focal_error": 0.012}, "scale_error", 0.012),
        ("camera_center", {"center_px": (9.0, -6.0)}, "du_px", 9.0),
    ],
)
def test_the_cameras_error_is_told_and_no_joint_is_blamed(
    effect: str, error: dict[str, float], parameter: str, value: float, tmp_path: Path
) -> None:
    found = mp.diagnose(mp.load_session(written(tmp_path / "session", **error)))
    assert found.verdict == "explained", found.sentence
    (cause,) = found.causes
    assert (cause.effect, cause.at) == (effect, "camera"), cause
    told = cause.parameters[parameter]
    assert abs(told.value - value) < 4.0 * told.std
    focal = next(
        limit for limit in found.limits if limit.effect == "lens_distortion" and limit.at == "camera"
    )
    assert all(limit is not None for limit in focal.parameters.values())


@pytest.mark.parametrize("by", [-1, 2])
def test_slipped_rows_of_a_sweep_are_no_slips_of_the_markers(by: int, tmp_path: Path) -> None:
    """While one joint moves evenly, rows that hold another row's measurement look like a marker that slipped and came back."""
    found = mp.diagnose(
        mp.load_session(written(tmp_path / "session", sweeps=True, slipped=range(30, 58), by=by))
    )
    assert [(c.effect, c.at) for c in found.causes] == [("pairing", "data")], found.trace
    told = found.causes[0].parameters
    assert told["shift_rows"].value == by
    assert abs(told["first_frame"].value - 30) <= 2 and abs(told["last_frame"].value - 57) <= 2
