"""Chooses the candidates that are most informative together, and their order, in which every joint arrives
from both sides on a free path."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from ..arrays import Floats
from .candidates import Candidates
from .expected import planned_session
from .options import MirrorPlace
from .room import Room
from .setting import Setting
from .telling import SECONDS_A_FRAME

ARRIVAL = 0.1
"""How far before a candidate each joint is thought to have been, rad (m): more than any play."""

TRIES = 12
"""Successors whose path is checked before a posture is left out."""


def choose(
    setting: Setting,
    candidates: Candidates,
    mirrors: Sequence[MirrorPlace],
    blocks: Sequence[int],
    same: bool,
    random: np.random.Generator,
) -> list[list[int]]:
    """For each block (a view and how many postures it gets) the indices of the candidates that add most information.

    `same`: the blocks are views of the same postures, which must be seen in all of them.
    """
    count = len(candidates.view)
    # The sides of arrival are not decided yet; any are accepted that are not all the same: before each candidate the
    # robot stands a little to that side of it.
    side = random.choice([-1.0, 1.0], size=candidates.positions.shape)
    before = candidates.positions - ARRIVAL * side * (setting.high > setting.low)
    session = planned_session(
        setting,
        np.stack([before, candidates.positions], axis=1).reshape(2 * count, -1),
        mirrors,
        np.repeat(candidates.view, 2),
        np.repeat(candidates.markers, 2, axis=0),
        # Spread over the time that the plan will take.
        SECONDS_A_FRAME * sum(blocks) / (2 * count),
        np.tile([False, True], count),
    )
    _, posture = np.unique(candidates.positions, axis=0, return_inverse=True)
    posture = posture.reshape(-1)
    if same:
        rows = [np.flatnonzero(posture == number) for number in range(posture.max() + 1)]
        items = [row for row in rows if len(set(candidates.view[row].tolist())) == len(blocks)]
        block, most = [0] * len(items), [max(blocks)]
    else:
        items = list(np.arange(count)[:, None])
        block, most = candidates.view.tolist(), list(blocks)
    numbers = [int(posture[item[0]]) for item in items]
    frames = [(2 * item + 1).tolist() for item in items]
    chosen: list[list[int]] = [[] for _ in blocks]
    for index in session.choose(frames, block, numbers, most):
        for row in items[index].tolist():
            chosen[int(candidates.view[row])].append(row)
    return chosen


def order(
    setting: Setting,
    room: Room,
    mirror: MirrorPlace,
    positions: Floats,
    start: Floats,
    tally: Floats,
    torque: Floats,
    after: MirrorPlace | None = None,
) -> tuple[list[int], Counter[str]]:
    """The order in which these postures (N, nq) are taken from `start`: free paths, each joint from both
    sides.

    `tally` (3, nq) is changed: the sums of the sides, and of the sides times load and times position, which
    must stay near 0, so that play, gravity and gear do not look alike. Postures that no free path reaches
    are left out, with the reason. The last one is clear of `after` too, the mirror's next
    view, where one of them is.
    """
    here, found = start, []
    trouble: Counter[str] = Counter()
    scale = np.maximum(np.abs(torque).max(axis=0), 1e-9)
    span = np.maximum(setting.high - setting.low, 1e-9)
    middle = 0.5 * (setting.high + setting.low)
    # A posture without a free path home may be a dead end: it is placed between two others, or left out.
    ways_home = [path_blocked(setting, room, mirror, row, setting.home) is None for row in positions]
    left = [row for row, free in enumerate(ways_home) if free]
    aside = [row for row, free in enumerate(ways_home) if not free]
    why = ""
    while left:
        options = []
        for row in left:
            side = np.sign(np.where(np.abs(positions[row] - here) > 1e-6, positions[row] - here, 0.0))
            added = np.stack(
                [side, side * torque[row] / scale, 2.0 * side * (positions[row] - middle) / span]
            )
            options.append((float(((tally + added) ** 2).sum()), row, added))
        options.sort(key=lambda option: option[:2])
        for _, row, added in options[:TRIES]:
            blocked = path_blocked(setting, room, mirror, here, positions[row])
            if blocked is None:
                found.append(row)
                left.remove(row)
                tally += added
                here = positions[row]
                break
            why = blocked
        else:
            break
    ends = ways_home
    if after is not None:
        # The robot stands at the last one while the mirror is turned.
        clear = [free and stands_clear(room, after, row) for free, row in zip(ends, positions, strict=True)]
        if any(clear[row] for row in found):
            ends = clear
            while not ends[found[-1]]:
                left.append(found.pop())
    left = _between(setting, room, mirror, positions, start, found, left + aside, ends)
    if left:
        words = f"on the way there it {why}" if why else "no free way leads there from another posture and on"
        trouble[words] += len(left)
    return found, trouble


def _between(
    setting: Setting,
    room: Room,
    mirror: MirrorPlace,
    positions: Floats,
    start: Floats,
    found: list[int],
    left: list[int],
    ends: Sequence[bool],
) -> list[int]:
    """Puts postures that the order so far does not lead to into it, where both ways are free (`ends`: or last); returns those that stay left."""
    free: dict[tuple[int, int], bool] = {}

    def is_free(a: int, b: int) -> bool:
        if (a, b) not in free:
            begin = start if a < 0 else positions[a]
            free[a, b] = path_blocked(setting, room, mirror, begin, positions[b]) is None
        return free[a, b]

    more = True
    while more:
        more = False
        for row in list(left):
            for place in range(len(found), -1, -1):
                onward = ends[row] if place == len(found) else is_free(row, found[place])
                if onward and is_free(found[place - 1] if place else -1, row):
                    found.insert(place, row)
                    left.remove(row)
                    more = True
                    break
    return left


def stands_clear(room: Room, mirror: MirrorPlace, posture: Floats) -> bool:
    """Whether the mirror can be turned there while the robot stands in a posture (nq,)."""
    room.take(posture)
    return room.glass_free(mirror)


def path_blocked(
    setting: Setting, room: Room, mirror: MirrorPlace | None, start: Floats, end: Floats
) -> str | None:
    """What the straight way between two postures runs into; None where it is free. The ends are not checked again."""
    for posture in between(room.steps, start, end):
        room.take(posture)
        trouble = room.collision()
        if trouble is not None:
            return trouble
        if mirror is not None and not room.glass_free(mirror):
            return "comes too near to the glass"
    return None


def between(steps: Floats, start: Floats, end: Floats) -> Iterator[Floats]:
    """Postures on the straight way between two, no joint farther apart than its step; the ends are not among them."""
    count = max(2, int(np.ceil((np.abs(end - start) / steps).max())))
    for share in np.linspace(0.0, 1.0, count + 1)[1:-1]:
        yield start + share * (end - start)
