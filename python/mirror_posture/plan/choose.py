"""Chooses the candidates that are most informative together, and their order, in which every joint arrives
from both sides on a free path.

The set is D-optimal over the parameters of all effects of the body. (Fedorov's exchange is not needed:
there are many candidates, and a greedy choice comes near; Atkinson, Donev and Tobias 2007, ch. 12.)
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from ..arrays import Floats
from .candidates import Candidates
from .causes import Moment
from .options import MirrorPlace
from .room import Room
from .sensitivity import Sensitivity
from .setting import Setting

TRIES = 12
"""Successors whose path is checked before a posture is left out."""


def information_roots(
    setting: Setting,
    sensitivity: Sensitivity,
    candidates: Candidates,
    mirrors: Sequence[MirrorPlace],
    random: np.random.Generator,
) -> list[Floats]:
    """The rows (R, columns) of each candidate, scaled so that every parameter counts by the size at which it matters."""
    typical = np.concatenate([cause.typical for cause in sensitivity.causes])
    torque = sensitivity.torques(candidates.positions)
    found = []
    for row, view in enumerate(candidates.view):
        # The sides of arrival are not decided yet; any are accepted that are not all the same.
        side = random.choice([-1.0, 1.0], size=candidates.positions.shape[1])
        moment = Moment(candidates.positions[row], side, torque[row], float(random.random()))
        rows = sensitivity.jacobian(moment, mirrors[view], candidates.markers[row])
        found.append(rows * typical)
    return found


def choose(
    roots: Sequence[Floats], candidates: Candidates, prior: Floats, blocks: Sequence[int], same: bool
) -> list[list[int]]:
    """For each block (a view and how many postures it gets) the indices of the candidates that add most information.

    `same`: the blocks are views of the same postures, which must be seen in all of them.
    """
    width = roots[0].shape[1]
    inverse = np.diag(1.0 / np.maximum(prior, 1e-4))
    chosen: list[list[int]] = [[] for _ in blocks]
    views = sorted(set(candidates.view.tolist()))
    if same:
        groups: dict[bytes, dict[int, int]] = {}
        for row, view in enumerate(candidates.view):
            groups.setdefault(candidates.positions[row].tobytes(), {})[int(view)] = row
        whole = [group for group in groups.values() if all(view in group for view in views)]
        pool = [[group[view] for view in views] for group in whole]
    else:
        pool = [[row] for row in range(len(roots))]
    stacked = [np.concatenate([roots[row] for row in rows]) for rows in pool]
    left = set(range(len(pool)))
    rounds = max(blocks)
    for _ in range(rounds if same else sum(blocks)):
        best, most = -1, -np.inf
        for number in left:
            rows = pool[number]
            if (
                not same
                and len(chosen[views.index(int(candidates.view[rows[0]]))])
                >= blocks[views.index(int(candidates.view[rows[0]]))]
            ):
                continue
            j = stacked[number]
            gain = float(np.linalg.slogdet(np.eye(len(j)) + j @ inverse @ j.T)[1])
            if gain > most:
                best, most = number, gain
        if best < 0:
            break
        left.discard(best)
        if not same:
            # The same posture is not taken again in another view, because another posture is more
            # informative.
            mine = candidates.positions[pool[best][0]]
            left -= {n for n in left if np.array_equal(candidates.positions[pool[n][0]], mine)}
        for row in pool[best]:
            chosen[views.index(int(candidates.view[row]))].append(row)
        j = stacked[best]
        gain_matrix = inverse @ j.T @ np.linalg.inv(np.eye(len(j)) + j @ inverse @ j.T)
        inverse = inverse - gain_matrix @ (j @ inverse)
        inverse = 0.5 * (inverse + inverse.T)
    assert width == inverse.shape[0]
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
