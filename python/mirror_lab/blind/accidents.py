"""Accidents of a log and of names, for which the vocabulary has no word, or only several words.

As in `mistakes`, the machine and the light are unchanged, and the written data are corrupted. Where there
is no word the answer's cause is called `unknown` at its place: an abstention at that place is right, and
every cause that is named with confidence is wrong, except those that are `tolerated`.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .errors import NoPlaceError
from .mistakes import Cause, Mistake, Told, column_of, moved_joints, pick, pictures_of_rows, run_of_rows

if TYPE_CHECKING:
    from .simulate import Case

Array = NDArray[np.float64]


def _joint(rng: np.random.Generator, case: Case, least_range_rad: float = 0.3) -> tuple[str, int]:
    name = pick(rng, moved_joints(case, least_range_rad), "a spoilt column")
    return name, column_of(case, name)


def _wordless(joint: str, *tolerated: str) -> list[Cause]:
    at = f"joint:{joint}"
    return [{"effect": "unknown", "at": at, "tolerated": [{"effect": e, "at": at} for e in tolerated]}]


def _of_postures(case: Case, draw: Callable[[int], Array]) -> Array:
    """(F,) one draw a posture."""
    of = case.plan.posture_of_frame
    return draw(int(of.max()) + 1)[of]


def column_shuffled(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """The values of one column are permuted, as in a table that was sorted by one of its columns."""
    joint, k = _joint(rng, case)
    told.q[:, k] = _of_postures(case, lambda n: rng.permutation(_first_of_posture(case, told.q[:, k], n)))
    return _wordless(joint)


def _first_of_posture(case: Case, column: Array, postures: int) -> Array:
    of = case.plan.posture_of_frame
    # A posture that lost all of its frames has no row: it gives a value that stands for none.
    return np.array([column[of == p][0] if (of == p).any() else np.mean(column) for p in range(postures)])


def column_copied(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """The column is a copy of another joint's."""
    joint, k = _joint(rng, case)
    other = pick(rng, [j for j in moved_joints(case) if j != joint], "a copied column")
    told.q[:, k] = told.q[:, column_of(case, other)]
    return _wordless(joint)


def column_zero(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """Nothing was logged of a joint that moves."""
    joint, k = _joint(rng, case)
    told.q[:, k] = 0.0
    return _wordless(joint, "joint_frozen")


def column_clipped(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """The log is clipped at a limit that the joint does not have."""
    joint, k = _joint(rng, case, 0.6)
    low, high = np.quantile(told.q[:, k], [0.3, 0.7])
    side = rng.random()
    told.q[:, k] = np.clip(told.q[:, k], low if side > 0.3 else -np.inf, high if side < 0.7 else np.inf)
    return _wordless(joint)


def column_unsigned(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """The sign was lost."""
    joints = moved_joints(case, 0.6)
    crossing = [
        j
        for j in joints
        if np.mean(case.plan.commands.of(j) < -0.05) > 0.2 and np.max(case.plan.commands.of(j)) > 0.2
    ]
    joint = pick(rng, crossing, "a lost sign")
    k = column_of(case, joint)
    told.q[:, k] = np.abs(told.q[:, k])
    return _wordless(joint)


def column_noisy(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """An encoder's error that is drawn anew in each posture."""
    joint, k = _joint(rng, case)
    std_rad = float(rng.uniform(0.03, 0.12))
    told.q[:, k] += _of_postures(case, lambda n: rng.normal(0, std_rad, n))
    return _wordless(joint)


def column_rounded(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """Written with one digit."""
    joint, k = _joint(rng, case)
    step_rad = float(rng.choice([0.1, 0.2, np.deg2rad(10)]))
    told.q[:, k] = np.round(told.q[:, k] / step_rad) * step_rad
    return _wordless(joint)


def log_rounded(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """All joints in whole degrees, or with two digits."""
    step_rad = float(rng.choice([0.01, np.deg2rad(1), np.deg2rad(2)]))
    told.q[:] = np.round(told.q / step_rad) * step_rad
    # All joints are affected: each is a true place.
    return [
        {"effect": "unknown", "at": "<->".join(["robot", *(f"joint:{j}" for j in case.plan.commands.joints)])}
    ]


def zero_lost(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """From a row on the joint has another zero: it was homed again."""
    joint, k = _joint(rng, case)
    frames = len(told.q)
    first = int(rng.integers(frames // 4, 3 * frames // 4))
    told.q[first:, k] += float(rng.choice([-1, 1]) * rng.uniform(0.05, 0.5))
    return _wordless(joint)


def columns_moved(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """All columns are shifted by one place; the last becomes the first."""
    joints = case.plan.commands.joints
    if len(joints) < 3 or len(moved_joints(case)) < 3:
        raise NoPlaceError("this robot has too few columns")
    told.q = np.roll(told.q, int(rng.choice([-1, 1])), axis=1)
    return _exchanges("joints_swapped", [f"joint:{j}" for j in joints])


def markers_circle(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """The names of three markers in a circle."""
    names = case.robot.markers
    if len(names) < 3:
        raise NoPlaceError("this robot has fewer than three markers")
    three = [int(i) for i in rng.permutation(len(names))[:3]]
    case.blobs_px[:, three] = case.blobs_px[:, np.roll(three, 1)]
    return _exchanges("markers_swapped", [f"marker:{names[i]}" for i in three])


def _exchanges(effect: str, places: list[str]) -> list[Cause]:
    """A circle of n places is n - 1 exchanges, of whichever pairs."""
    pairs = [f"{a}<->{b}" for i, a in enumerate(places) for b in places[:i]]
    tolerated = [{"effect": effect, "at": at} for at in pairs]
    return [{"effect": effect, "at": f"{a}<->{b}", "tolerated": tolerated} for a, b in pairwise(places)]


def picture_hung(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """Over a run of rows the camera repeats one picture."""
    first, last = run_of_rows(rng, len(told.q))
    source = np.arange(len(told.q))
    source[first : last + 1] = first
    return [pictures_of_rows(case, source)]


def rows_lost(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """From a row on to the end the pictures are those of later rows."""
    frames = len(told.q)
    first, shift = int(rng.integers(frames // 4, 3 * frames // 4)), int(rng.integers(1, 4))
    source = np.minimum(np.arange(frames) + shift * (np.arange(frames) >= first), frames - 1)
    return [pictures_of_rows(case, source)]


def thing_in_the_background(rng: np.random.Generator, case: Case, told: Told) -> list[Cause]:
    """A stationary object of a marker's colour is detected in its place, in some frames or in all."""
    m = int(rng.integers(len(case.robot.markers)))
    share = 1.0 if rng.random() < 0.3 else float(rng.uniform(0.1, 0.6))
    hit = np.flatnonzero(rng.random(len(case.blobs_px)) < share)
    width, height = case.robot.image_size
    place = rng.uniform([0.1 * width, 0.1 * height], [0.9 * width, 0.9 * height])
    case.blobs_px[hit, m] = place + rng.normal(0, 0.2, (len(hit), *case.blobs_px.shape[2:]))
    # Nothing is wrong with the robot: the left-out detections are reported, and `none` is right.
    return [{"effect": "unknown", "at": f"marker:{case.robot.markers[m]}", "identifiable": False}]


ACCIDENTS: dict[str, Mistake] = {
    f.__name__: f
    for f in (
        column_shuffled,
        column_copied,
        column_zero,
        column_clipped,
        column_unsigned,
        column_noisy,
        column_rounded,
        log_rounded,
        zero_lost,
        columns_moved,
        markers_circle,
        picture_hung,
        rows_lost,
        thing_in_the_background,
    )
}
