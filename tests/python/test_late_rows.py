"""A joint's log late by whole rows: the last rows' positions are in no row of it, and must not speak against the delay. And by half a row."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from lifting_column import rotation

NOISE_M = 0.0005
JOINTS = (("yaw", "0 0 0.1", "0 0 1"), ("shoulder", "0 0 0.1", "0 1 0"), ("elbow", "0 0 0.3", "0 1 0"))
LINKS = ("base", "turret", "upper", "fore")
MARKERS = {"on_upper": ("upper", (0.05, 0.02, 0.25)), "on_fore": ("fore", (0.2, 0.03, 0.05))}
URDF = "\n".join(
    [
        '<robot name="arm">',
        *(f'<link name="{name}"/>' for name in (*LINKS, *MARKERS)),
        *(
            f'<joint name="{name}" type="revolute"><parent link="{LINKS[i]}"/><child link="{LINKS[i + 1]}"/><origin xyz="{at}"/>'
            f'<axis xyz="{axis}"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
            for i, (name, at, axis) in enumerate(JOINTS)
        ),
        *(
            f'<joint name="{name}_fix" type="fixed"><parent link="{link}"/><child link="{name}"/>'
            f'<origin xyz="{at[0]} {at[1]} {at[2]}"/></joint>'
            for name, (link, at) in MARKERS.items()
        ),
        "</robot>",
    ]
)
SESSION = "\n".join(
    [
        'format = "mirror-posture/session"\nversion = 1\nrobot = "robot.urdf"\nroot = "base"\ngravity = [0.0, 0.0, -9.81]',
        *(f'[[markers]]\nname = "{name}"\nlink = "{name}"\ndiameter = 0.0' for name in MARKERS),
        f'[points]\nframe = "base"\n[noise]\npoint_std = {NOISE_M}\n',
    ]
)


def write_late(folder: Path, rows: int, late: float, seed: int = 3) -> Path:
    """The shoulder's column holds the position of so many rows ago; of a part of a row a blend of both rows, from the second on."""
    chance = np.random.default_rng(seed)
    true = chance.uniform([-1.2, -0.9, -1.4], [1.2, 0.9, 1.4], (rows, 3))
    logged = true.copy()
    ago = np.arange(rows) - late
    before, part = np.floor(ago).astype(int).clip(0), ago - np.floor(ago)
    blend = (1.0 - part) * true[before, 1] + part * true[np.ceil(ago).astype(int).clip(0), 1]
    logged[ago >= 0.0, 1] = blend[ago >= 0.0]
    folder.mkdir()
    (folder / "robot.urdf").write_text(URDF)
    (folder / "session.toml").write_text(SESSION)
    frames = ["frame,posture," + ",".join(name for name, _, _ in JOINTS)]
    points = ["frame,marker,x,y,z"]
    for frame, (actual, row) in enumerate(zip(true, logged, strict=True)):
        frames.append(f"{frame},{frame}," + ",".join(f"{q:.9f}" for q in row))
        turn, at = np.eye(3), np.zeros(3)
        for (_, origin, axis), link, q in zip(JOINTS, LINKS[1:], actual, strict=True):
            at = at + turn @ np.array(origin.split(), dtype=float)
            turn = turn @ rotation(q * np.array(axis.split(), dtype=float))
            for name, (carrier, place) in MARKERS.items():
                if carrier == link:
                    seen = at + turn @ np.array(place) + chance.normal(0.0, NOISE_M, 3)
                    points.append(f"{frame},{name}," + ",".join(f"{x:.7f}" for x in seen))
    (folder / "frames.csv").write_text("\n".join(frames) + "\n")
    (folder / "points.csv").write_text("\n".join(points) + "\n")
    return folder


@pytest.mark.parametrize(("rows", "late"), [(24, 1), (30, 2)])
def test_the_rows_that_a_delay_leaves_unknown_are_no_evidence_against_it(
    tmp_path: Path, rows: int, late: int
) -> None:
    found = mp.diagnose(write_late(tmp_path / "session", rows, late))
    assert [(cause.effect, cause.at) for cause in found.causes] == [("joint_late", "joint:shoulder")]
    assert found.causes[0].probability > 0.9 and found.verdict == "explained"
    assert abs(found.causes[0].parameters["delay_rows"].value - late) < 0.05
    # They are left out, with the reason.
    left = found.document["data"]["left_out"]
    assert {item["frame"] for item in left} == set(range(rows - late, rows))
    assert all("not known in this row" in item["why"] for item in left)


@pytest.mark.parametrize("seed", [4, 5])
def test_half_a_row_is_found_from_one_end_of_the_log(seed: int, tmp_path: Path) -> None:
    # An error at that end does not die out, and a delay a little longer is undone from the other end, where the position is unknown.
    found = mp.diagnose(write_late(tmp_path / "session", 50, 0.5, seed))
    assert [(cause.effect, cause.at) for cause in found.causes] == [("joint_late", "joint:shoulder")]
    assert found.causes[0].probability > 0.9 and found.verdict == "explained"
    assert abs(found.causes[0].parameters["delay_rows"].value - 0.5) < 1e-3
