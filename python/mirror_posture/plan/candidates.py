"""Candidate postures, filtered by visibility, body and room."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Floats, Integers, Mask
from .hiding import unhidden
from .options import MirrorPlace, PlanOptions
from .room import Room
from .setting import Setting
from .sight import look, scene_of


@dataclass(frozen=True, eq=False)
class Candidates:
    """C pairs of a posture and a view in which it may be held, and why others were not taken."""

    positions: Floats
    """(C, nq)."""
    view: Integers
    """(C,)."""
    markers: Mask
    """(C, M): the balls that are seen."""
    reasons: dict[str, int] = field(default_factory=dict)
    """How many drawn postures each test took away."""
    drawn: int = 0


def sift(
    setting: Setting,
    mirrors: Sequence[MirrorPlace],
    room: Room,
    options: PlanOptions,
    postures: Floats,
    most: int,
    random: np.random.Generator,
) -> Candidates:
    """The pairs of these postures (N, nq) and mirrors (in the base's frame) that can be taken, at most `most` postures."""
    reasons: Counter[str] = Counter()
    scene = scene_of(setting, postures)
    sights = [look(setting, scene, mirror) for mirror in mirrors]
    wanted = np.zeros((len(postures), len(mirrors)), dtype=bool)
    board = np.stack([sight.board for sight in sights], axis=1)
    some = np.stack([sight.markers.any(axis=1) for sight in sights], axis=1)
    real = sights[0].real & (not options.real_balls_allowed)
    wanted = board & some & ~real[:, None]
    reasons["a real ball is in the picture beside its reflection"] = int(real.sum())
    reasons["the board is not to be seen in the mirror"] = int((~real & ~board.any(axis=1)).sum())
    reasons["no ball is to be seen in the mirror"] = int(
        (~real & board.any(axis=1) & ~(board & some).any(axis=1)).sum()
    )
    rows = np.flatnonzero(wanted.any(axis=1))
    random.shuffle(rows)
    taken, views, seen = [], [], []
    kept = 0
    for row in rows:
        if kept >= most:
            break
        room.take(postures[row])
        trouble = room.collision()
        if trouble is not None:
            reasons[f"it {trouble}"] += 1
            continue
        found = False
        for number in np.flatnonzero(wanted[row]).tolist():
            mirror, sight = mirrors[number], sights[number]
            if not room.glass_free(mirror):
                reasons["it comes too near to the glass"] += 1
                continue
            balls = unhidden(setting, room.body, scene, sight, mirror, int(row))
            if balls is None:
                reasons["the robot hides the board from the mirror"] += 1
                continue
            if not balls.any():
                reasons["the robot hides its balls from the mirror"] += 1
                continue
            taken.append(postures[row])
            views.append(int(number))
            seen.append(balls)
            found = True
        kept += found
    markers = len(setting.nominal.metadata.markers)
    return Candidates(
        np.array(taken).reshape(-1, postures.shape[1]),
        np.array(views, dtype=np.int64),
        np.array(seen, dtype=bool).reshape(-1, markers),
        {reason: count for reason, count in reasons.items() if count},
        len(postures),
    )
