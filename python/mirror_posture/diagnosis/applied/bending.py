"""Where a link bends and along what it lies, as the diagnosis means `link_bending`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...arrays import Floats
from ...robot import Robot
from ...session import Session

SHORTEST_LINK_M = 1e-4
"""Ends nearer than this to a joint are at its place: no direction."""


def bend_of(session: Session, robot: Robot, link: str) -> tuple[Floats, list[Floats]]:
    """The place at which a link bends, in its frame, m, and the unit axes about which it does.

    The place is the middle of the line to the joint that the link carries next, or to the farthest marker on it; the axes are
    the two across that line. A link without length lies along the limb that follows; one without any direction bends about all three axes.
    """
    chain = _Chain(session, robot)
    tip = chain.tip(link)
    middle: Floats = np.zeros(3) if tip is None else 0.5 * tip
    along = next((end for end in chain.ends(link) if np.linalg.norm(end) > SHORTEST_LINK_M), None)
    if along is None:
        return middle, list(np.eye(3))
    along = along / np.linalg.norm(along)
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    first /= np.linalg.norm(first)
    return middle, [first, np.cross(along, first)]


class _Chain:
    """The robot at rest, with the moving joints between what observes and what is observed."""

    def __init__(self, session: Session, robot: Robot) -> None:
        rest = np.zeros((1, len(robot.position_names)))
        self._poses = dict(zip(robot.link_names, robot.forward_kinematics(rest)[0], strict=True))
        self._markers = {marker.link for marker in session.markers}
        self._bodies: dict[str, str] = {}
        """Of each link the moving joint's child that carries it, or the robot's root."""
        carriers: dict[str, frozenset[str]] = {robot.link_names[0]: frozenset()}
        for joint in robot.joints:
            parent = self._bodies.get(joint.parent_link, robot.link_names[0])
            moves = joint.kind != "fixed"
            self._bodies[joint.child_link] = joint.child_link if moves else parent
            if moves:
                carriers[joint.child_link] = carriers[parent] | {joint.child_link}
        observers = {session.camera_link} if session.camera_link else set()
        if session.points is not None:
            frame = session.points.frame_link
            observers.add(session.root_link if frame == "unknown" else frame)
        targets = self._markers | ({session.board.link} if session.board is not None else set())
        moved = [
            carriers[self._body(one)] ^ carriers[self._body(other)] for one in observers for other in targets
        ]
        relevant = frozenset().union(*moved)
        joints = [joint for joint in robot.joints if joint.child_link in relevant]
        self._next = {self._body(joint.parent_link): joint for joint in reversed(joints)}

    def _body(self, link: str) -> str:
        return self._bodies.get(link, link)

    def tip(self, link: str) -> Floats | None:
        """The end of a link, in its frame: the next joint, or the farthest marker on it; None where nothing is there."""
        return self._in(link, self._end(link))

    def ends(self, link: str) -> Iterator[Floats]:
        """The ends of a link and of those that it carries one after the other, in the link's frame."""
        at: str | None = link
        while at is not None:
            end = self._in(link, self._end(at))
            if end is not None:
                yield end
            following = self._next.get(self._body(at))
            at = None if following is None else following.child_link

    def _end(self, link: str) -> Floats | None:
        following = self._next.get(self._body(link))
        if following is not None:
            origin: Floats = (self._poses[following.parent_link] @ following.parent_from_joint)[:3, 3]
            return origin
        body, here = self._body(link), self._poses[link][:3, 3]
        places = [self._poses[marker][:3, 3] for marker in self._markers if self._body(marker) == body]
        return max(places, key=lambda place: float(np.linalg.norm(place - here)), default=None)

    def _in(self, link: str, place: Floats | None) -> Floats | None:
        if place is None:
            return None
        link_from_root = np.linalg.inv(self._poses[link])
        inside: Floats = link_from_root[:3, :3] @ place + link_from_root[:3, 3]
        return inside
