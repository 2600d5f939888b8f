"""Sessions that grow in one direction, and what it costs to load, check and measure them: twice as much for twice the size.

`python tests/python/growing_sessions.py` measures 1, 2, 4 and 8 times; a smaller run is a test.
"""

from __future__ import annotations

import argparse
import gc
import tempfile
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from mirror_posture import Session, load_session, measure
from mirror_posture.diagnosis.recording import to_core
from mirror_posture.session.facts import facts
from mirror_posture.view_check import refuse_mistakes
from session_folder import SESSION, replaced, write_folder

DIRECTIONS = {"frames": 4000, "joints": 500, "markers": 120, "links": 600, "chain": 600, "yaml": 2400}
"""What grows, and its size at 1: frames, commanded joints, markers, fixed links side by side and one behind the other, values in camera.yaml."""
FEW = {"frames": 60, "joints": 1, "markers": 2, "links": 0, "chain": 0, "yaml": 0}
VIEWS = ((0.0, 0.0), (0.25, 0.05))
"""Yaw and pitch of the mirror in the two frames of a posture, rad."""


def write(folder: Path, direction: str, size: int) -> Path:
    """A camera and a board on a bust before a flat mirror, and an arm with balls; one of the sizes other than usual."""
    n = {**FEW, direction: size}
    links = ['<link name="base"/><link name="camera_optical"/><link name="chest_board"/><link name="upper"/>']
    joints = [
        _joint("shoulder", "revolute", "base", "upper", "0.05 -0.02 0.03"),
        _joint("eye", "fixed", "base", "camera_optical", "0 0 0"),
        _joint("chest", "fixed", "base", "chest_board", "0 0.075 0.01", "0 3.141592653589793 0"),
    ]

    def add(name: str, kind: str, parent: str, at: str = "0 0 0") -> None:
        links.append(f'<link name="{name}"/>')
        joints.append(_joint(f"{name}_joint", kind, parent, name, at))

    rng = np.random.default_rng(size)
    balls = rng.uniform([0.0, -0.03, -0.02], [0.06, 0.03, 0.02], (n["markers"], 3))
    for k, ball in enumerate(balls):
        add(f"ball_{k}", "fixed", "upper", " ".join(map(repr, ball.tolist())))
    for k in range(n["joints"] - 1):
        add(f"more_{k}", "revolute", "base")
    for k in range(n["links"]):
        add(f"beside_{k}", "fixed", "base")
    for k in range(n["chain"]):
        add(f"behind_{k}", "fixed", f"behind_{k - 1}" if k else "base")
    toml = replaced(SESSION, "corners = [3, 2]", "corners = [7, 5]").replace("0.003\n", "0.0\n")
    head, _, rest = toml.partition("[[markers]]")
    markers = "".join(
        f'[[markers]]\nname = "m{k}"\nlink = "ball_{k}"\ndiameter = 0.0\n\n' for k in range(len(balls))
    )
    rest = rest[rest.index("[mirror]") :].partition("[points]")[0]
    more = f"more: [{', '.join(map(str, range(n['yaml'])))}]\n"
    camera = (
        "image_width: 1400\nimage_height: 1200\ncamera_matrix: {data: [693.0, 0, 699.5, 0, 693.0, 599.5, 0, 0, 1]}\n"
        "distortion_model: plumb_bob\ndistortion_coefficients: {data: [0, 0, 0, 0, 0]}\n"
    )
    frames, detections = _seen(n["frames"], n["joints"], balls, rng)
    return write_folder(
        folder,
        session=head + markers + rest,
        robot=f'<robot name="bust">{"".join(links + joints)}</robot>',
        camera=camera + more,
        frames=frames,
        detections=detections,
        points=None,
    )


def _joint(name: str, kind: str, parent: str, child: str, at: str, turn: str = "0 0 0") -> str:
    limit = (
        '<axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/>'
        if kind == "revolute"
        else ""
    )
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}" rpy="{turn}"/>{limit}</joint>\n'
    )


def _seen(count: int, joints: int, balls: np.ndarray, rng: np.random.Generator) -> tuple[str, str]:
    """The tables of frames and of image points: reflected as x + 2 (d − n·x) n and projected."""
    names = ["shoulder", *(f"more_{k}_joint" for k in range(joints - 1))]
    frames, detections = [",".join(["frame", "posture", *names])], ["frame,target,index,u,v"]
    board = np.array([[-(i % 7 - 3) * 0.014, 0.075 + (i // 7 - 2) * 0.014, 0.01] for i in range(35)])
    for frame in range(count):
        if frame % 2 == 0:
            command = rng.uniform(-0.6, 0.6, joints)
        c, s = np.cos(command[0]), np.sin(command[0])
        arm = np.array([0.05, -0.02, 0.03]) + balls @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T
        frames.append(",".join([str(frame), str(frame // 2), *map(repr, command.tolist())]))
        yaw, pitch = VIEWS[frame % 2]
        normal = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
        points = np.concatenate([board, arm])
        points = points + 2 * (0.16 - points @ normal)[:, None] * normal
        pixels = 693.0 * points[:, :2] / points[:, 2:] + (699.5, 599.5) + rng.normal(0, 0.2, (len(points), 2))
        targets = [*(f"board,{i}" for i in range(35)), *(f"m{k},0" for k in range(len(balls)))]
        detections += [f"{frame},{t},{u!r},{v!r}" for t, (u, v) in zip(targets, pixels.tolist(), strict=True)]
    return "\n".join(frames) + "\n", "\n".join(detections) + "\n"


def check(session: Session) -> None:
    facts(session)
    refuse_mistakes(session)


STAGES: dict[str, Callable[[Session], object]] = {
    "check": check,
    "for diagnose": to_core,
    "measure": measure,
}


def cost_s(folder: Path, repeats: int) -> dict[str, float]:
    """Seconds of computing of each stage, the least of some."""
    least: dict[str, float] = {}

    def timed(name: str, work: Callable[[], object]) -> object:
        gc.collect()
        begun = time.process_time()
        result = work()
        least[name] = min(least.get(name, np.inf), time.process_time() - begun)
        return result

    for _ in range(repeats):
        session = timed("load", lambda: load_session(folder))
        assert isinstance(session, Session)
        for name, stage in STAGES.items():
            timed(name, partial(stage, session))
    return least


def growth(direction: str, sizes: list[int], below: Path, repeats: int = 3) -> list[dict[str, float]]:
    """The cost at each of some sizes of a direction."""
    return [cost_s(write(below / f"{direction}-{size}", direction, size), repeats) for size in sizes]


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("directions", nargs="*", help=f"Of {', '.join(DIRECTIONS)}; all without one.")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    factors = [1, 2, 4, 8]
    print("| grows | stage | " + " | ".join(f"{f} ×, s" for f in factors) + " | 8 × to 1 × |")
    print("| --- | --- |" + " --- |" * (len(factors) + 1))
    with tempfile.TemporaryDirectory() as below:
        for direction in options.directions or DIRECTIONS:
            sizes = [factor * DIRECTIONS[direction] for factor in factors]
            costs = growth(direction, sizes, Path(below), options.repeats)
            for stage in costs[0]:
                told = [cost[stage] for cost in costs]
                size = f"{direction}, from {DIRECTIONS[direction]}"
                print(
                    f"| {size} | {stage} | "
                    + " | ".join(f"{t:.3f}" for t in told)
                    + f" | {told[-1] / told[0]:.1f} |",
                    flush=True,
                )
