"""Encoders as independent sensors: the readings of a second encoder, compared with the diagnosis'
prediction. No fit uses them.

A session's `measured:<joint>` columns take no part in a diagnosis. The nominal model says that a joint is
where it was commanded; the model with the named causes predicts its error:

    before = RMS(measured − q),    after = RMS(measured − q − Σ fitted error of the causes at the joint)

once as read, and once with the encoder's own zero estimated (an encoder without a calibrated zero shows
changes only).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..session import Session


def encoder_witness(session: Session, document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One entry for each joint with an encoder column, in rad (m for a prismatic joint): `joint`, `before`, `after`,
    `before_zero_free`, `after_zero_free`, and `named`, whether a cause is named there."""
    frames = session.frames
    row_of = {int(frame): row for row, frame in enumerate(frames.frame)}
    fitted: dict[str, dict[int, float]] = {}
    for signature in document.get("signatures", ()):
        place = str(signature["at"]).split("<-")[0]
        # What is unexplained there is no cause, and predicts nothing.
        if signature.get("cause") is None or not place.startswith("joint:"):
            continue
        at = fitted.setdefault(place.removeprefix("joint:"), {})
        for point in signature["points"]:
            row = row_of[int(point["frame"])]
            at[row] = at.get(row, 0.0) + float(point["fitted"])
    first_rows = np.unique(frames.posture, return_index=True)[1]
    out = []
    for k, joint in enumerate(frames.measured_names):
        rows = np.array(sorted(fitted[joint]) if joint in fitted else first_rows, dtype=int)
        q = frames.commanded[rows, frames.joint_names.index(joint)] if joint in frames.joint_names else 0.0
        error = frames.measured[rows, k] - q
        kept = np.isfinite(error)
        if not kept.any():
            continue
        predicted = np.array([fitted[joint][row] for row in rows]) if joint in fitted else np.zeros(len(rows))
        before, after = error[kept], (error - predicted)[kept]
        out.append(
            {
                "joint": joint,
                "named": joint in fitted,
                "before": _rms(before),
                "after": _rms(after),
                "before_zero_free": float(np.std(before)),
                "after_zero_free": float(np.std(after)),
            }
        )
    return out


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
