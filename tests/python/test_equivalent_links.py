"""What no posture can separate is told as that, or as the simplest of it: a link before and one behind a joint that only slides, a joint that another one follows, a column
that nothing shows.

Plain NumPy that shares nothing with the core. Resampled postures cannot separate them either, and the search on a resample ends at either of them by chance: one of
them stood at 0.98, the other at 0.01.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mirror_posture as mp
from lifting_column import Floats, rotation

NOISE_M = 2.5e-4
HEAD = 'format = "mirror-posture/session"\nversion = 1\nrobot = "robot.urdf"\nroot = "base"\ngravity = [0.0, 0.0, -9.81]\n'
Z = np.array([0.0, 0.0, 1.0])


def joint(name: str, kind: str, parent: str, child: str, at: tuple[float, ...], more: str = "") -> str:
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at[0]} {at[1]} {at[2]}"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="9"/>{more}</joint>'
    )


def write(folder: Path, joints: str, names: list[str], rows_rad: Floats, markers: dict[str, Floats]) -> Path:
    """A session of markers on links of their own name, seen by a tracker in its own frame; `markers`: places in the root, row by row."""
    rng = np.random.default_rng(7)
    turn, at_m = rotation(np.array([0.4, -0.2, 1.1])), np.array([1.5, -0.4, 0.2])
    frames, points = [f"frame,posture,{','.join(names)}"], ["frame,marker,x,y,z"]
    for row, q in enumerate(rows_rad):
        frames.append(f"{row},{row},{','.join(f'{v:.5f}' for v in q)}")
        for name, places in markers.items():
            x, y, z = turn @ places[row] + at_m + rng.normal(0.0, NOISE_M, 3)
            points.append(f"{row},{name},{x:.7f},{y:.7f},{z:.7f}")
    folder.mkdir(parents=True)
    told = "".join(f'[[markers]]\nname = "{m}"\nlink = "{m}"\ndiameter = 0.0\n' for m in markers)
    noise = f'[points]\nframe = "unknown"\n[noise]\npoint_std = {NOISE_M}\n'
    (folder / "session.toml").write_text(f"{HEAD}{told}{noise}", encoding="utf-8")
    (folder / "robot.urdf").write_text(
        f'<robot name="r"><link name="base"/>{joints}</robot>', encoding="utf-8"
    )
    (folder / "frames.csv").write_text("\n".join(frames) + "\n", encoding="utf-8")
    (folder / "points.csv").write_text("\n".join(points) + "\n", encoding="utf-8")
    return folder


def fixed(name: str, link: str, at: tuple[float, ...]) -> str:
    return (
        f'<link name="{name}"/><joint name="{name}_on" type="fixed"><parent link="{link}"/><child link="{name}"/>'
        f'<origin xyz="{at[0]} {at[1]} {at[2]}"/></joint>'
    )


def scara(folder: Path, seed: int, off_m: Floats, *, exchanged: bool = False) -> Path:
    """Two turning joints, a quill that slides, a tool that turns; the quill is mounted off. With a head of two joints, which nothing shows,
    before it in the log; `exchanged`: the columns of the neck and of the first joint have changed places."""
    rng = np.random.default_rng(seed)
    q = np.round(rng.uniform([-1.7, -2.0, -0.13, -2.5], [1.7, 2.0, 0.04, 2.5], (50, 4)), 5)
    upper, fore, tool, tool_2 = (
        (0.2, 0.02, 0.06),
        (0.15, -0.03, 0.07),
        (0.06, 0.0, -0.03),
        (-0.02, 0.05, -0.01),
    )
    joints = joint("j1", "revolute", "base", "l1", (0.12, 0.0, 0.35)) + joint(
        "j2", "revolute", "l1", "l2", (0.22, 0.0, 0.03)
    )
    joints += joint("quill", "prismatic", "l2", "l3", (0.18, 0.0, 0.0)) + joint(
        "j4", "revolute", "l3", "l4", (0.0, 0.0, -0.1)
    )
    joints += (
        fixed("upper", "l1", upper)
        + fixed("fore", "l2", fore)
        + fixed("tool", "l4", tool)
        + fixed("tool_2", "l4", tool_2)
    )
    seen: dict[str, list[Floats]] = {name: [] for name in ("upper", "fore", "tool", "tool_2")}
    for first, second, down_m, last in q:
        one, two = rotation(first * Z), rotation((first + second) * Z)
        shoulder = np.array([0.12, 0.0, 0.35])
        elbow = shoulder + one @ np.array([0.22, 0.0, 0.03])
        flange = elbow + two @ (np.array([0.18, 0.0, -0.1]) + off_m) + down_m * Z
        hand = two @ rotation(last * Z)
        seen["upper"].append(shoulder + one @ np.array(upper))
        seen["fore"].append(elbow + two @ np.array(fore))
        seen["tool"].append(flange + hand @ np.array(tool))
        seen["tool_2"].append(flange + hand @ np.array(tool_2))
    joints += joint("neck", "revolute", "base", "head", (0.0, 0.0, 0.5)) + joint(
        "nod", "revolute", "head", "face", (0.0, 0.0, 0.1)
    )
    log = np.hstack([np.round(rng.uniform(-0.4, 0.4, (50, 2)), 5), q])
    names = ["neck", "nod", "j1", "j2", "quill", "j4"]
    if exchanged:
        log[:, [0, 2]] = log[:, [2, 0]]
    return write(folder, joints, names, log, {k: np.array(v) for k, v in seen.items()})


def fingers(folder: Path, seed: int, coupling: float) -> Path:
    """An arm that turns with two fingers, of which one follows the other by a mimic joint; the arm turns with the fingers."""
    rng = np.random.default_rng(seed)
    q = np.round(rng.uniform([-1.4, 0.0], [1.4, 0.8], (40, 2)), 5)
    on: tuple[float, ...] = (0.06, 0.0, 0.01)
    joints = joint("arm", "revolute", "base", "hand", (0.1, 0.0, 0.1)) + joint(
        "finger", "revolute", "hand", "f1", (0.2, 0.02, 0.0)
    )
    joints += joint(
        "other", "revolute", "hand", "f2", (0.2, -0.02, 0.0), '<mimic joint="finger" multiplier="-1"/>'
    )
    joints += (
        fixed("wrist", "hand", (0.1, 0.05, 0.03))
        + fixed("one", "f1", on)
        + fixed("two", "f2", on)
        + fixed("foot", "base", (0.3, 0.4, 0.0))
    )
    seen: dict[str, list[Floats]] = {name: [] for name in ("wrist", "one", "two", "foot")}
    for arm, finger in q:
        turn = rotation((arm + coupling * finger) * Z)
        at = np.array([0.1, 0.0, 0.1])
        seen["wrist"].append(at + turn @ np.array([0.1, 0.05, 0.03]))
        seen["one"].append(at + turn @ (np.array([0.2, 0.02, 0.0]) + rotation(finger * Z) @ np.array(on)))
        seen["two"].append(at + turn @ (np.array([0.2, -0.02, 0.0]) + rotation(-finger * Z) @ np.array(on)))
        seen["foot"].append(np.array([0.3, 0.4, 0.0]))
    return write(folder, joints, ["arm", "finger"], q, {k: np.array(v) for k, v in seen.items()})


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_links_on_both_sides_of_a_quill_are_equally_probable(seed: int, tmp_path: Path) -> None:
    off_m = np.random.default_rng(seed).normal(0.0, 0.004, 3)
    found = mp.diagnose(scara(tmp_path / "scara", seed, off_m))
    (cause,) = found.causes
    (other,) = cause.alternatives
    assert {(cause.effect, cause.at), (other.effect, other.at)} == {
        ("link_length", "link:l2"),
        ("link_length", "link:l3"),
    }
    assert found.verdict == "explained" and cause.probability == pytest.approx(other.probability, abs=0.05)
    told = [cause.parameters[name].value for name in ("dx_m", "dy_m", "dz_m")]
    assert told == pytest.approx(off_m, abs=5e-4)


def test_a_joint_that_follows_another_drives_nothing(tmp_path: Path) -> None:
    found = mp.diagnose(fingers(tmp_path / "fingers", 0, 0.07))
    (cause,) = found.causes
    assert (cause.effect, cause.at) == ("joint_coupling", "joint:arm<-joint:finger")
    assert not cause.alternatives and cause.parameters["coupling"].value == pytest.approx(0.07, abs=0.002)


def test_an_exchange_with_a_column_that_nothing_shows_is_one(tmp_path: Path) -> None:
    found = mp.diagnose(scara(tmp_path / "exchanged", 0, np.zeros(3), exchanged=True))
    (cause,) = found.causes
    assert (cause.effect, cause.at) == ("joints_swapped", "joint:j1<->joint:neck")
    assert found.verdict == "explained"
