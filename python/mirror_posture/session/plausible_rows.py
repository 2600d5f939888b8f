"""Plausibility of the tables' rows: commands of a posture, encoders compared with commands, points compared
with the robot's reach."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..counted import counted
from .errors import SessionError

if TYPE_CHECKING:
    from ..robot import Robot
    from .types import Session

SAME_COMMAND = 1e-4
"""rad (m): commands of one posture that differ by more are of different postures; text of few digits rounds below it."""
FAR_POINT = 4.0
"""Points farther from where they are measured than this many times the robot's reach are in mm."""
NOISY_POINT = 0.1
"""Noise of points beyond this share of the robot's reach would hide any error."""
DEGREES, MILLI = (40.0, 80.0), (700.0, 1400.0)
"""Slopes of encoder over command, or of command over encoder, for which one of both is in degrees, or in
milliradians."""
LEAST_MOTION = 0.02
"""rad (m): joints that move less do not determine their encoders' unit."""
LEAST_ROWS = 5
FAR_ENCODER = 0.5
"""rad (m): an encoder that typically reads this far from its command has an unusual zero, and gives a
warning."""


def joints_between(robot: Robot, base: str, link: str) -> set[str]:
    """The joints whose commands move a link as another one sees it; of a joint that follows another one (mimic) that other one."""
    moved = {joint.name: joint.position for joint in robot.joints}
    chain = (moved[step.joint] for step in robot.chain(base, link))
    return {robot.position_names[position] for position in chain if position is not None}


def one_command_a_posture(session: Session) -> None:
    """Frames of one posture have one command of the joints that move what is measured, as the camera sees it.

    Legs that turn the whole robot before its mirror move only its feet: they may differ where no foot is ever seen.
    """
    frames, robot = session.frames, session.robot
    links = _measured_links(session)
    moving = {joint for link in links for joint in joints_between(robot, links[0], link)}
    columns = [i for i, name in enumerate(frames.joint_names) if name in moving]
    _, first, of = np.unique(frames.posture, return_index=True, return_inverse=True)
    other = np.abs(frames.commanded[:, columns] - frames.commanded[first[of]][:, columns]) > SAME_COMMAND
    rows = np.flatnonzero(other.any(axis=1))
    if len(rows):
        row = int(rows[0])
        column = columns[int(np.flatnonzero(other[row])[0])]
        before = int(first[of[row]])
        raise SessionError(
            "frames.csv" if not (session.folder / "frames.parquet").exists() else "frames.parquet",
            f"got {frames.commanded[row, column]:g} in posture {frames.posture[row]}, whose first row {before + 1} has "
            f"{frames.commanded[before, column]:g}; needed one command for all frames of a posture, or postures of their own "
            f"({counted(len(rows), 'row differs', 'rows differ')})",
            row=row + 1,
            column=frames.joint_names[column],
        )


def _measured_links(session: Session) -> list[str]:
    """The links that are measured, and from which; the first one is that from which the others are seen."""
    ends = [link for link in (session.camera_link, session.board and session.board.link) if link]
    if session.points is not None:
        ends.append(session.root_link)
    seen = session.mirror_view.marker_seen | session.direct_view.marker_seen
    if session.points is not None:
        seen = seen | session.points.seen
    # Before anything is looked for, every marker may be found in every picture.
    unknown = not session.detected and session.points is None
    markers = [marker.link for m, marker in enumerate(session.markers) if unknown or seen[:, m].any()]
    return [*(ends or [session.root_link]), *markers]


def encoders(session: Session) -> list[str]:
    """Encoders that read in another unit than the commands, or far from them."""
    frames = session.frames
    warnings = []
    for index, name in enumerate(frames.measured_names):
        if name not in frames.joint_names:
            continue
        command, measured = frames.commanded[:, frames.joint_names.index(name)], frames.measured[:, index]
        spread = np.array([np.std(command), np.std(measured)])
        column = f"measured:{name}"
        if spread.min() > 0.0 and spread.max() > LEAST_MOTION and len(command) >= LEAST_ROWS:
            steady = np.corrcoef(command, measured)[0, 1] > 0.9
            for (low, high), unit in ((DEGREES, "degrees"), (MILLI, "milliradians or mm")):
                for ratio, guilty in (
                    (spread[1] / spread[0], "the encoder"),
                    (spread[0] / spread[1], "the command"),
                ):
                    if steady and low < ratio < high:
                        raise SessionError(
                            "frames.csv",
                            f"got encoder and command that differ by a factor of {ratio:.3g}, needed both in rad (m): "
                            f"is {guilty} in {unit}?",
                            column=column,
                        )
        if len(command) and np.median(np.abs(measured - command)) > FAR_ENCODER:
            far = float(np.median(np.abs(measured - command)))
            warnings.append(
                f"frames.csv, column {column!r}: the encoder is typically {far:.3g} rad (m) from the command; is its zero another?"
            )
    return warnings


def points(session: Session, reach_m: float) -> None:
    """Points that no robot of this size could have put there."""
    points = session.points
    if points is None or not points.seen.any() or reach_m <= 0.0:
        return
    std_m = session.noise.point_std_m
    if std_m is not None and std_m > NOISY_POINT * reach_m:
        raise SessionError(
            "session.toml",
            f"noise.point_std: got {std_m:g} m, needed far less than the robot's reach of {reach_m:.3g} m, or nothing would be seen: "
            "is it in mm?",
        )
    at = points.point_m
    known = points.frame_link in session.robot.link_names
    for m, name in enumerate(session.marker_names):
        rows = np.flatnonzero(points.seen[:, m])
        if not len(rows):
            continue
        # In an unknown frame only the motion can be compared.
        origin = np.zeros(3) if known else np.median(at[rows, m], axis=0)
        distance = np.linalg.norm(at[rows, m] - origin, axis=1)
        # The typical distance: a single wild point is an outlier, which the estimate bears.
        if np.median(distance) > FAR_POINT * reach_m:
            raise SessionError(
                "points.csv",
                f"marker {name!r}: got points typically {np.median(distance):.4g} m from "
                f"{points.frame_link if known else 'their middle'}, of a robot that reaches {reach_m:.3g} m; needed m: are "
                "they in mm?",
                column="x",
            )
        wild = np.flatnonzero(distance > 1000.0 * max(reach_m, 1.0))
        if len(wild):
            raise SessionError(
                "points.csv",
                f"marker {name!r} of frame {session.frames.frame[rows[wild[0]]]}: got a point {distance[wild[0]]:.4g} m away, of a "
                f"robot that reaches {reach_m:.3g} m; mend the cells or leave out the row",
            )
