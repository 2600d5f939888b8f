"""Facts about a session, each with its usual range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .plausibility import robot_reach_m
from .types import Session

USUAL_GRAVITY = (9.3, 10.3)
USUAL_REACH_M = (0.1, 3.0)
USUAL_VIEW_DEG = (25.0, 120.0)
USUAL_OFF_CENTRE = 0.1
"""Of the principal point, as a share of the picture's width."""
USUAL_SEEN = 0.8
"""Share of the frames in which the board is seen."""
LEAST_POSTURES = 30
LEAST_VIEWS = 5
"""Of a marker."""
MOVES = 1e-3
"""rad (m): a joint whose command differs by less does not move."""
USUAL_ENCODER = 0.05
"""rad (m): an encoder's typical distance from its command."""


@dataclass(frozen=True)
class Fact:
    """A fact about a session: its value, the usual range, and whether it is plausible."""

    what: str
    got: str
    usual: str
    plausible: bool


def facts(session: Session) -> list[Fact]:
    """All facts of a session that was read without an error; an implausible one need not be wrong."""
    found = [
        _within("length of gravity, m/s²", float(np.linalg.norm(session.gravity_m_per_s2)), USUAL_GRAVITY),
        _within("reach of the robot, m", robot_reach_m(session.robot), USUAL_REACH_M),
    ]
    found += _of_camera(session)
    frames = session.frames
    postures = len(set(frames.posture.tolist()))
    found.append(
        Fact("postures", str(postures), f"{LEAST_POSTURES} or more to diagnose", postures >= LEAST_POSTURES)
    )
    if session.detected:
        found += _of_views(session)
    found += _of_motion(session)
    return found


def _within(what: str, value: float, usual: tuple[float, float]) -> Fact:
    return Fact(what, f"{value:.3g}", f"{usual[0]:g} to {usual[1]:g}", usual[0] <= value <= usual[1])


def _of_camera(session: Session) -> list[Fact]:
    camera = session.camera
    if camera is None:
        return []
    view = float(np.degrees(2.0 * np.arctan(0.5 * camera.width_px / camera.fx_px)))
    off = float(np.hypot(camera.cx_px - (camera.width_px - 1) / 2, camera.cy_px - (camera.height_px - 1) / 2))
    share = off / camera.width_px
    return [
        _within("camera's angle of view, °", view, USUAL_VIEW_DEG),
        Fact(
            "principal point from the picture's centre",
            f"{100.0 * share:.1f} % of the width",
            f"up to {100.0 * USUAL_OFF_CENTRE:.0f} %",
            share <= USUAL_OFF_CENTRE,
        ),
    ]


def _of_views(session: Session) -> list[Fact]:
    view, frames = session.mirror_view, len(session.frames)
    found = []
    if session.board is not None and frames:
        seen = int(view.board_seen.any(axis=1).sum())
        found.append(
            Fact(
                "frames in which the board is seen in the mirror",
                f"{seen} of {frames}",
                f"{100.0 * USUAL_SEEN:.0f} % or more",
                seen >= USUAL_SEEN * frames,
            )
        )
    for index, name in enumerate(session.marker_names):
        count = int(view.marker_seen[:, index].sum())
        if session.points is not None:
            count += int(session.points.seen[:, index].sum())
        found.append(
            Fact(
                f"frames in which {name} is seen",
                f"{count} of {frames}",
                f"{LEAST_VIEWS} or more",
                count >= LEAST_VIEWS,
            )
        )
    return found


def _of_motion(session: Session) -> list[Fact]:
    frames = session.frames
    still = [
        name
        for name, column in zip(frames.joint_names, frames.commanded.T, strict=True)
        if np.ptp(column) < MOVES
    ]
    found = [Fact("joints that never move", ", ".join(still) or "none", "none", not still)]
    if frames.ordered:
        one_sided = []
        for name, column in zip(frames.joint_names, frames.commanded.T, strict=True):
            steps = np.diff(column, prepend=0.0)
            moved = steps[np.abs(steps) > MOVES]
            if len(moved) > 1 and (np.all(moved > 0.0) or np.all(moved < 0.0)):
                one_sided.append(name)
        found.append(
            Fact(
                "joints that arrive from one side only", ", ".join(one_sided) or "none", "none", not one_sided
            )
        )
    for index, name in enumerate(frames.measured_names):
        if name in frames.joint_names:
            command = frames.commanded[:, frames.joint_names.index(name)]
            far = float(np.median(np.abs(frames.measured[:, index] - command))) if len(command) else 0.0
            found.append(
                Fact(
                    f"encoder of {name} from its command, rad (m)",
                    f"{far:.3g}",
                    f"up to {USUAL_ENCODER:g}",
                    far <= USUAL_ENCODER,
                )
            )
    return found
