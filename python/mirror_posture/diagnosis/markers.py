"""A session with some of its markers only: those that are fitted, and those that are predicted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .._core import MirrorPostureError
from ..session import Session
from ..session.errors import choices
from ..session.types import Views

PLACE = "marker:"


def marker_of_place(session: Session, place: str) -> str:
    """The marker's name of a place `marker:NAME`, or of a bare name.

    Raises:
        MirrorPostureError: a marker that the session does not have; the message lists those that it has.
    """
    name = place.removeprefix(PLACE)
    if name not in session.marker_names:
        valid = choices((PLACE + known for known in session.marker_names), got=PLACE + name)
        raise MirrorPostureError(f"withhold: got {place!r}, needed one of {valid}")
    return name


def only_markers(session: Session, names: Sequence[str]) -> Session:
    """The session as if only these markers were on the robot; board, pictures and postures stay."""
    kept = np.array([i for i, name in enumerate(session.marker_names) if name in names], dtype=int)
    points = session.points
    return replace(
        session,
        markers=tuple(session.markers[i] for i in kept),
        mirror_view=_only(session.mirror_view, kept),
        direct_view=_only(session.direct_view, kept),
        points=None
        if points is None
        else replace(points, point_m=points.point_m[:, kept], seen=points.seen[:, kept]),
    )


def _only(view: Views, kept: np.ndarray) -> Views:
    return replace(
        view,
        marker_px=np.ascontiguousarray(view.marker_px[:, kept]),
        marker_seen=np.ascontiguousarray(view.marker_seen[:, kept]),
        marker_std_px=None if view.marker_std_px is None else view.marker_std_px[:, kept],
    )
