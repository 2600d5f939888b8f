"""The simulator's gap on held-out postures: each half of the posture space is diagnosed, the other half
simulated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mirror_posture import MirrorPostureError
from mirror_posture.arrays import Mask
from mirror_posture.counted import counted
from mirror_posture.diagnosis import diagnose
from mirror_posture.session import Session

from .gap import simulated_gap
from .staircase import with_causes


@dataclass(frozen=True)
class HeldOut:
    """RMS distances over all postures, each predicted with causes that were found, and fitted, on the other half.

    `causes` are those of either half, as `effect@place`.
    """

    before_px: float | None
    after_px: float | None
    before_m: float | None
    after_m: float | None
    postures: int
    causes: tuple[tuple[str, ...], ...]

    def to_tree(self) -> dict[str, Any]:
        """As JSON."""
        return {
            "before_px": self.before_px,
            "after_px": self.after_px,
            "before_m": self.before_m,
            "after_m": self.after_m,
            "postures": self.postures,
            "causes": [list(half) for half in self.causes],
        }


def held_out_gap(session: Session, model: Path | None = None) -> HeldOut:
    """The gap before and after, each half of the posture space predicted from the other.

    All commands are executed in both cases, because a posture depends on the joint's history. Only the
    observations of the held-out half are withheld from the diagnosis, its search included.

    Raises:
        MirrorPostureError: as `simulate`, and where half of the session is too small to diagnose.
    """
    first = first_half(session)
    _, _, nominal = with_causes(session, model, ())
    before, after, causes = [], [], []
    for fitted in (first, ~first):
        found = diagnose(_seen_in(session, fitted))
        if found.verdict == "insufficient":
            count = len(np.unique(session.frames.posture[fitted]))
            raise MirrorPostureError(
                f"held-out postures: got {counted(count, 'posture')} in one half of the session, too few to diagnose; needed a session "
                f"with more. {found.sentence}"
            )
        changed, _, rest = with_causes(session, model, found.causes)
        before.append(simulated_gap(session, nominal, ~fitted))
        after.append(simulated_gap(changed.session, rest, ~fitted))
        causes.append(tuple(f"{cause.effect}@{cause.at}" for cause in found.causes))
    return HeldOut(
        _together([(gap.rms_px, gap.pixels) for gap in before]),
        _together([(gap.rms_px, gap.pixels) for gap in after]),
        _together([(gap.rms_m, gap.measured) for gap in before]),
        _together([(gap.rms_m, gap.measured) for gap in after]),
        len(np.unique(session.frames.posture)),
        tuple(causes),
    )


def first_half(session: Session) -> Mask:
    """(F,): the frames on one side of the plane across the postures' widest direction, postures kept whole."""
    _, first, inverse = np.unique(session.frames.posture, return_index=True, return_inverse=True)
    postures = session.positions[first] - session.positions[first].mean(axis=0)
    widest = np.linalg.svd(postures, full_matrices=False)[2][0]
    along = postures @ widest
    return np.asarray((along < np.median(along))[inverse])


def _seen_in(session: Session, kept: Mask) -> Session:
    """The session with the observations of some frames only."""
    view = session.mirror_view
    seen = replace(
        view, board_seen=view.board_seen & kept[:, None], marker_seen=view.marker_seen & kept[:, None]
    )
    direct = session.direct_view
    direct = replace(
        direct, board_seen=direct.board_seen & kept[:, None], marker_seen=direct.marker_seen & kept[:, None]
    )
    return replace(session, mirror_view=seen, direct_view=direct)


def _together(parts: list[tuple[float | None, int]]) -> float | None:
    """RMS over all from the RMS of parts."""
    told = [(rms, count) for rms, count in parts if rms is not None]
    total = sum(count for _, count in told)
    return float(np.sqrt(sum(rms**2 * count for rms, count in told) / total)) if total else None
