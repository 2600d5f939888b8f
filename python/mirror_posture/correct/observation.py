"""The markers of one posture, measured from its looks, as input of the corrector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Floats, Integers, Mask
from ..measurement import MeasureOptions, NothingMeasuredError, measure
from ..robots.protocol import Look
from ..short_repr import ShortRepr
from .options import MeasureChoice
from .target import Target

USUAL_NOISE_PX = 0.1
"""Of corners and ball centres, where neither detector nor session states it."""
MARKER_POINTS_STD_M = 0.0005
"""Of positions that something else measured without saying how well."""


@dataclass(frozen=True, eq=False, repr=False)
class Readings(ShortRepr):
    """The target's markers at one look, in the board's frame; rows with `measured` False hold 0."""

    measured: Mask
    """(M,)."""
    point_in_board_m: Floats
    """(M, 3)."""
    covariance_m2: Floats
    """(M, 3, 3)."""
    chi_squared: Floats
    degrees_of_freedom: Integers
    reasons: tuple[str | None, ...]

    @classmethod
    def nothing(cls, count: int, reason: str) -> Readings:
        """Nothing was measured."""
        return cls(
            np.zeros(count, dtype=bool),
            np.zeros((count, 3)),
            np.zeros((count, 3, 3)),
            np.zeros(count),
            np.zeros(count, dtype=np.int64),
            (reason,) * count,
        )


def read(target: Target, looks: Sequence[Look], posture: Sequence[int], choice: MeasureChoice) -> Readings:
    """Measures the last posture of these looks (one number each); `joint` uses all of them, the others that posture's."""
    last = posture[-1]
    mine = [look for look, number in zip(looks, posture, strict=True) if number == last]
    if any(look.marker_points is not None for look in mine):
        return _from_points(target, mine, choice)
    if choice.estimator != "joint":
        looks, posture = mine, [last] * len(mine)
    session = target.nominal.session(looks, posture)
    try:
        found = measure(
            session,
            MeasureOptions(
                choice.estimator,
                mount=choice.mount,
                mount_std_rad=choice.mount_std_rad,
                mount_std_m=choice.mount_std_m,
                # The corrector itself tests chi-squared, and looks again at what it rejects.
                judge_markers=False,
            ),
        ).markers
    except NothingMeasuredError as error:
        return Readings.nothing(len(target.markers), str(error))
    readings = Readings.nothing(len(target.markers), "not seen in two views")
    reasons = list(readings.reasons)
    row = int(np.flatnonzero(session.frames.posture == last)[0])
    robot = target.nominal.robot
    root = robot.link_index(target.nominal.metadata.root)
    poses = robot.forward_kinematics(session.positions[row : row + 1])[0]
    board_from_root = np.linalg.solve(poses[robot.link_index(target.board_link)], poses[root])
    for m, index in enumerate(target.marker_indices):
        hit = np.flatnonzero((found.posture == last) & (found.marker == index))
        if len(hit) == 0:
            continue
        k = int(hit[0])
        reasons[m] = found.reason[k]
        if not found.measured[k]:
            continue
        turn = board_from_root[:3, :3]
        readings.measured[m] = True
        readings.point_in_board_m[m] = turn @ found.point_in_root_m[k] + board_from_root[:3, 3]
        readings.covariance_m2[m] = turn @ found.covariance_in_root_m2[k] @ turn.T + (
            choice.unmodelled_std_m**2 * np.eye(3)
        )
        readings.chi_squared[m] = found.chi_squared[k]
        readings.degrees_of_freedom[m] = found.degrees_of_freedom[k]
    return replace(readings, reasons=tuple(reasons))


def _from_points(target: Target, looks: Sequence[Look], choice: MeasureChoice) -> Readings:
    """Positions from another measurement: the weighted mean of the looks, and their agreement."""
    count = len(target.markers)
    out = Readings.nothing(count, "not seen")
    reasons: list[str | None] = list(out.reasons)
    robot = target.nominal.robot
    for m, index in enumerate(target.marker_indices):
        rows = []
        for look in looks:
            points = look.marker_points
            if points is None or not points.seen[index]:
                continue
            q = robot.positions({name: [x] for name, x in look.commanded.items()})
            poses = robot.link_poses(q, [target.board_link, points.frame_link])[0]
            change = np.linalg.solve(poses[0], poses[1])
            given = points.covariance_m2
            covariance = np.eye(3) * MARKER_POINTS_STD_M**2 if given is None else given[index]
            turn = change[:3, :3]
            rows.append((turn @ points.point_m[index] + change[:3, 3], turn @ covariance @ turn.T))
        if not rows:
            continue
        weights = [np.linalg.inv(covariance) for _, covariance in rows]
        covariance = np.linalg.inv(sum(weights))
        mean = covariance @ sum(w @ point for w, (point, _) in zip(weights, rows, strict=True))
        out.measured[m], reasons[m] = True, None
        out.point_in_board_m[m] = mean
        out.covariance_m2[m] = covariance + choice.unmodelled_std_m**2 * np.eye(3)
        out.chi_squared[m] = sum(
            float((point - mean) @ w @ (point - mean)) for w, (point, _) in zip(weights, rows, strict=True)
        )
        out.degrees_of_freedom[m] = 3 * (len(rows) - 1)
    return replace(out, reasons=tuple(reasons))
