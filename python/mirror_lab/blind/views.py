"""The robot's postures in order, one to three views of each, and the planes of the mirror."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .errors import BlindError
from .optics import Lens, Mirror
from .robots import Robot
from .truth import Commands

Array = NDArray[np.float64]

SECONDS_PER_FRAME = 2.0
MARGIN_PX = 8.0
MOST_TRIES = 200


@dataclass
class Plan:
    """Postures (P), frames (F) and which posture each frame shows."""

    commands: Commands
    posture_of_frame: NDArray[np.int_]
    time_of_frame_s: Array


def plan_postures(
    robot: Robot, rng: np.random.Generator, frames: tuple[int, int] = (120, 310), least: int = 45
) -> Plan:
    """Postures spread over the joints' ranges, in random order: independent ones, or a walk with rests.

    The number of frames is drawn below the larger one, as it always was: a seed keeps its sessions.
    """
    views = int(rng.choice([1, 2, 3], p=[0.15, 0.45, 0.40]))
    wanted = int(rng.integers(frames[0], max(frames[1], frames[0] + 1)))
    postures = max(least, wanted // views)
    low = np.array([robot.ranges[j][0] for j in robot.commanded])
    high = np.array([robot.ranges[j][1] for j in robot.commanded])
    style = rng.choice(["free", "stratified", "walk"], p=[0.5, 0.3, 0.2])
    if style == "walk":
        share = np.empty((postures, len(low)))
        share[0] = rng.random(len(low))
        for p in range(1, postures):
            share[p] = share[p - 1] + rng.normal(0, 0.3, len(low))
            share[p] = 1 - np.abs(1 - np.abs(share[p]) % 2)
    elif style == "stratified":
        share = np.stack([(rng.permutation(postures) + rng.random(postures)) / postures for _ in low], axis=1)
    else:
        share = rng.random((postures, len(low)))
    of_frame = np.repeat(np.arange(postures), views)
    time = SECONDS_PER_FRAME * np.arange(len(of_frame), dtype=np.float64)
    q = np.round(low + share * (high - low), 6)
    return Plan(Commands(list(robot.commanded), q, time[::views].copy()), of_frame, time)


def place_mirrors(
    robot: Robot, rng: np.random.Generator, lens: Lens, corners_m: Array, arms_m: Array
) -> tuple[Mirror, NDArray[np.bool_]]:
    """A plane for each frame in which the whole board is seen: `corners_m` (F, C, 3), `arms_m` (F, M, 3) in
    the camera.

    The plane is the one that brings a drawn point of the body onto a drawn ray at a drawn length of path.
    Returns the mirrors and which frames found one.
    """
    frames = len(corners_m)
    width, height = lens.size_px
    normal, distance, found = np.zeros((frames, 3)), np.zeros(frames), np.zeros(frames, dtype=bool)
    board = corners_m.mean(axis=1)
    middle = np.nanmean(arms_m, axis=1)
    for _ in range(MOST_TRIES):
        todo = np.flatnonzero(~found)
        if len(todo) == 0:
            break
        weight = rng.uniform(0.2, 0.8, (len(todo), 1))
        point = weight * board[todo] + (1 - weight) * middle[todo]
        px = np.stack(
            [rng.uniform(0.3, 0.7, len(todo)) * width, rng.uniform(0.35, 0.65, len(todo)) * height], axis=1
        )
        ray = np.column_stack([(px - lens.center_px) / lens.focal_px, np.ones(len(todo))])
        ray /= np.linalg.norm(ray, axis=1)[:, None]
        image = ray * rng.uniform(*robot.path_length_m, len(todo))[:, None]
        n = image - point
        n /= np.linalg.norm(n, axis=1)[:, None]
        d = np.einsum("ni,ni->n", n, image + point) / 2
        seen = (
            corners_m[todo]
            + 2 * (d[:, None] - np.einsum("ni,nci->nc", n, corners_m[todo]))[..., None] * n[:, None]
        )
        uv = lens.image(seen)
        inside = np.all((uv > MARGIN_PX) & (uv < np.array([width, height]) - MARGIN_PX), axis=(1, 2))
        in_front = (d[:, None] - np.einsum("ni,nci->nc", n, corners_m[todo])).min(axis=1) > 0.1 * d
        arm_gap = (d[:, None] - np.einsum("ni,nci->nc", n, arms_m[todo])).min(axis=1) > 0
        ok = inside & in_front & arm_gap & (d > 0)
        normal[todo[ok]], distance[todo[ok]], found[todo[ok]] = n[ok], d[ok], True
    if found.mean() < 0.5:
        raise BlindError(
            f"robot {robot.kind!r}: fewer than half of the postures can be seen in a mirror; check the mounts"
        )
    return Mirror(normal, distance), found
