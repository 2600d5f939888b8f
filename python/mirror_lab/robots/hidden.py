"""A body that differs from its model: kinematics with hidden effects, posture after posture.

Effects and parameters are named as in docs/effects.md. Plain NumPy on the blind check's own URDF reader: it
shares no formula with the compiled kinematics that corrects and diagnoses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mirror_posture._core import MirrorPostureError

from ..blind.robots import Body, read_bodies

Floats = npt.NDArray[np.float64]
Positions = Mapping[str, float]

SUBSTEPS = 8
"""Parts of a motion at which the load is checked: a load on the way can move a joint across its play."""
YIELDING_ROUNDS = 4
"""Iterations of load and deflection: each reduces the error to a few percent."""
DEFAULT_FRICTION_NM = 0.002
"""Smaller loads do not move a joint across its play: friction of a small servo's output bearing."""

JOINT_EFFECTS = (
    "joint_offset",
    "gear_ratio",
    "gear_eccentricity",
    "backlash",
    "stiction",
    "joint_compliance",
    "axis_tilt",
    "joint_coupling",
    "drift",
)
LINK_EFFECTS = ("link_bending", "link_length")
EFFECTS = (*JOINT_EFFECTS, *LINK_EFFECTS, "marker_mount", "camera_mount")
"""The hidden effects that a body can have, by their names in the vocabulary."""


@dataclass(frozen=True)
class HiddenEffect:
    """One effect at one place: `HiddenEffect("joint_offset", "joint:r_elbow", {"offset_rad": 0.03})`.

    `backlash` takes `friction_nm` as well, below which a load does not decide the side.
    """

    effect: str
    at: str
    parameters: Mapping[str, float]


def turned(axis: Floats, angle: float) -> Floats:
    """The rotation matrix of a turn about a unit axis (Rodrigues)."""
    x, y, z = axis
    s, c = np.sin(angle), np.cos(angle)
    v = 1.0 - c
    return np.array(
        [
            [c + x * x * v, x * y * v - z * s, x * z * v + y * s],
            [y * x * v + z * s, c + y * y * v, y * z * v - x * s],
            [z * x * v - y * s, z * y * v + x * s, c + z * z * v],
        ]
    )


def _pose(rotation: Floats, at: Floats) -> Floats:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, at
    return pose


def _exp(vector: Floats) -> Floats:
    angle = float(np.linalg.norm(vector))
    return np.eye(3) if angle == 0.0 else turned(vector / angle, angle)


def tilted_axis(axis: Floats, tilt_1_rad: float, tilt_2_rad: float) -> Floats:
    """`axis_tilt` of docs/effects.md: unit(a + tan(tilt_1) u + tan(tilt_2) v)."""
    helper = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.8 else np.array([0.0, 1.0, 0.0])
    u = np.cross(axis, helper)
    u /= np.linalg.norm(u)
    tilted = axis + np.tan(tilt_1_rad) * u + np.tan(tilt_2_rad) * np.cross(axis, u)
    result: Floats = tilted / np.linalg.norm(tilted)
    return result


class HiddenBody:
    """A robot's true body: it moves from command to command; plays and friction depend on the motions before.

    The links hang below `root`, which stands still; gravity (3,), m/s², is in its frame. Before the first command all
    joints rest at 0, in the middle of their plays.
    """

    def __init__(
        self, urdf: str, root: str, gravity_m_per_s2: Floats, hidden: Sequence[HiddenEffect] = ()
    ) -> None:
        self.bodies: list[Body] = read_bodies(urdf, root)
        self.gravity = np.asarray(gravity_m_per_s2, dtype=float)
        self.hidden = tuple(hidden)
        self._body_of_link = {body.name: i for i, body in enumerate(self.bodies)}
        self._body_of_joint = {
            body.joint: i for i, body in enumerate(self.bodies) if body.joint_type != "fixed"
        }
        self._carried = self._carried_by_each()
        self._axis = [body.axis for body in self.bodies]
        self._origin = [body.xyz_m for body in self.bodies]
        self._after: dict[int, Floats] = {}
        """By body: the transform that a displaced mount adds to its pose."""
        self._bends: list[tuple[int, float, Floats, Floats]] = []
        """Body, compliance, pivot in its frame, its transverse projector (3, 3)."""
        for one in self.hidden:
            self._build(one)
        self._loose = any(one.effect in ("backlash", "stiction") for one in self.hidden)
        self._command = dict.fromkeys(self._body_of_joint, 0.0)
        self._stood: dict[int, float] = {}
        """By effect: the last position of the output within its play, rad; 0 before the first command."""
        self._theta = dict(self._command)
        self._poses = self._settle(self._command, 0.0)

    @property
    def theta(self) -> dict[str, float]:
        """The actual joint positions, rad (m)."""
        return dict(self._theta)

    def link_poses(self) -> dict[str, Floats]:
        """`root_from_link` (4, 4) of each link, as it really is."""
        return {body.name: pose for body, pose in zip(self.bodies, self._poses, strict=True)}

    def move(self, goal: Positions, time_s: float = 0.0) -> None:
        """Moves each joint in a straight line from its last command to the next; joints that are not named stay.

        Raises `MirrorPostureError` for a joint that the body does not have.
        """
        for joint in goal:
            if joint not in self._command:
                raise MirrorPostureError(
                    f"the body has no joint {joint!r} that moves; its joints: {', '.join(self._command)}"
                )
        start = dict(self._command)
        end = start | {joint: float(position) for joint, position in goal.items()}
        steps = SUBSTEPS if self._loose else 1
        for step in range(1, steps + 1):
            share = step / steps
            self._command = {joint: start[joint] + share * (end[joint] - start[joint]) for joint in end}
            rounds = YIELDING_ROUNDS if step == steps else 1
            self._poses = self._settle(self._command, time_s, rounds)
        self._command = end

    # How an effect changes the body.

    def _build(self, one: HiddenEffect) -> None:
        kind, _, place = one.at.partition(":")
        p = one.parameters
        try:
            if one.effect in JOINT_EFFECTS and kind == "joint":
                for joint in place.split("<-joint:"):
                    self._known(one, joint, self._body_of_joint)
                if one.effect == "axis_tilt":
                    body = self._body_of_joint[place]
                    self._axis[body] = tilted_axis(self._axis[body], p["tilt_1_rad"], p["tilt_2_rad"])
                else:
                    self._joint_error(one, place, dict.fromkeys(self._body_of_joint, 0.0), 0.0, {})
            elif one.effect in LINK_EFFECTS and kind == "link":
                self._known(one, place, self._body_of_link)
                self._build_link(one, self._body_of_link[place])
            elif one.effect == "marker_mount" and kind == "marker":
                link = f"{place}_marker" if f"{place}_marker" in self._body_of_link else place
                self._known(one, link, self._body_of_link)
                body = self._body_of_link[link]
                # Given in the frame of the link that carries the mount, as the mount's origin is.
                self._origin[body] = self._origin[body] + _shift(p)
            elif one.effect == "camera_mount":
                link = place or "camera_optical"
                self._known(one, link, self._body_of_link)
                turn = _exp(np.array([p["rx_rad"], p["ry_rad"], p["rz_rad"]]))
                self._after[self._body_of_link[link]] = _pose(turn, _shift(p))
            else:
                raise MirrorPostureError(
                    f"a body cannot hide {one.effect!r} at {one.at!r}; it can hide: {', '.join(EFFECTS)}, at joint:J, link:L, "
                    "marker:M or camera"
                )
        except KeyError as missing:
            raise MirrorPostureError(
                f"{one.effect} at {one.at}: the parameter {missing} is missing"
            ) from None

    def _known(self, one: HiddenEffect, name: str, names: Mapping[str, int]) -> None:
        if name not in names:
            raise MirrorPostureError(
                f"{one.effect} at {one.at}: the robot has no {name!r}; it has {', '.join(names)}"
            )

    def _build_link(self, one: HiddenEffect, body: int) -> None:
        following = self._next_joints(body)
        if one.effect == "link_length":
            if not following:
                raise MirrorPostureError(f"link_length at {one.at}: this link carries no joint")
            # Beyond a fixed child, that child leads to the joint.
            for i in {path[0] for path in following}:
                self._origin[i] = self._origin[i] + _shift(one.parameters)
            return
        paths = following or [[i] for i in self._carried[body][1:] if self.bodies[i].parent == body]
        ends = [self._end_of(path) for path in paths]
        tip = np.mean(ends, axis=0) if ends else 2.0 * self.bodies[body].com_m
        length = float(np.linalg.norm(tip))
        if length < 1e-6:
            raise MirrorPostureError(f"link_bending at {one.at}: this link has no length")
        along = tip / length
        across = np.eye(3) - np.outer(along, along)
        self._bends.append((body, one.parameters["compliance_rad_per_nm"], 0.5 * tip, across))

    def _next_joints(self, body: int) -> list[list[int]]:
        """By joint that a link carries, directly or through fixed links: the bodies from the link's child to the joint's."""
        paths = []
        for i in self._carried[body][1:]:
            path = [i]
            while (parent := self.bodies[path[0]].parent) != body:
                path.insert(0, parent)
            if [self.bodies[k].joint_type == "fixed" for k in path] == [True] * (len(path) - 1) + [False]:
                paths.append(path)
        return paths

    def _end_of(self, path: Sequence[int]) -> Floats:
        """The origin of the last body of a path of fixed ones, in the frame of the link that carries the first."""
        end = np.zeros(3)
        for i in reversed(path):
            end = self.bodies[i].xyz_m + self.bodies[i].rotation @ end
        return end

    def _carried_by_each(self) -> list[list[int]]:
        carried: list[list[int]] = [[] for _ in self.bodies]
        for i in range(len(self.bodies)):
            above = i
            while above >= 0:
                carried[above].append(i)
                above = self.bodies[above].parent
        return carried

    # The body at rest.

    def _settle(self, command: Positions, time_s: float, rounds: int = YIELDING_ROUNDS) -> list[Floats]:
        theta = dict(self._theta)
        bend: dict[int, Floats] = {}
        poses = self._chain(theta, bend)
        loaded = [o for o in self.hidden if o.effect in ("backlash", "stiction", "joint_compliance")]
        stood = dict(self._stood)
        for _ in range(rounds if loaded or self._bends else 1):
            load = {
                o.at.partition(":")[2]: self._torque(poses, self._body_of_joint[o.at.partition(":")[2]])
                for o in loaded
            }
            theta, stood = self._drive(command, time_s, load)
            bend = {}
            for body, compliance, pivot, across in self._bends:
                moment = self._moment(poses, body, pivot)
                bend[body] = bend.get(body, np.zeros(3)) + compliance * (across @ moment)
            poses = self._chain(theta, bend)
        self._theta, self._stood = theta, stood
        return poses

    def _drive(
        self, command: Positions, time_s: float, load: Mapping[str, float]
    ) -> tuple[dict[str, float], dict[int, float]]:
        theta, stood = dict(command), {}
        for index, one in enumerate(self.hidden):
            kind, _, place = one.at.partition(":")
            if kind != "joint" or one.effect == "axis_tilt":
                continue
            joint = place.split("<-joint:")[0]
            if one.effect in ("backlash", "stiction"):
                stood[index] = _held(one, command[joint], self._stood.get(index, 0.0), load[joint])
                theta[joint] += stood[index] - command[joint]
            else:
                theta[joint] += self._joint_error(one, place, command, time_s, load)
        return theta, stood

    def _joint_error(
        self, one: HiddenEffect, place: str, q: Positions, time_s: float, load: Mapping[str, float]
    ) -> float:
        p = one.parameters
        joint, _, other = place.partition("<-joint:")
        if one.effect == "joint_offset":
            return p["offset_rad"]
        if one.effect == "gear_ratio":
            return p["scale_error"] * q[joint]
        if one.effect == "gear_eccentricity":
            s, c = p["sin_rad"], p["cos_rad"]
            return float(s * np.sin(q[joint]) + c * np.cos(q[joint]) - c)
        if one.effect == "joint_compliance":
            return p["compliance_rad_per_nm"] * load.get(joint, 0.0)
        if one.effect == "joint_coupling":
            return p["coupling"] * q[other]
        if one.effect == "drift":
            return p["rate_rad_per_s"] * time_s
        # Plays: only their width is given.
        return 0.0 * p["width_rad" if one.effect == "backlash" else "deadband_rad"]

    def _chain(self, theta: Positions, bend: Mapping[int, Floats]) -> list[Floats]:
        poses: list[Floats] = []
        for i, body in enumerate(self.bodies):
            if body.parent < 0:
                poses.append(np.eye(4))
                continue
            pose = poses[body.parent] @ _pose(body.rotation, self._origin[i])
            if body.joint_type == "hinge":
                pose[:3, :3] = pose[:3, :3] @ turned(self._axis[i], theta[body.joint])
            elif body.joint_type == "slide":
                pose[:3, 3] += pose[:3, :3] @ self._axis[i] * theta[body.joint]
            if i in bend:
                pivot = next(b[2] for b in self._bends if b[0] == i)
                turn = _exp(bend[i])
                pose = pose @ _pose(turn, pivot - turn @ pivot)
            if i in self._after:
                pose = pose @ self._after[i]
            poses.append(pose)
        return poses

    def _moment(self, poses: Sequence[Floats], body: int, pivot_m: Floats) -> Floats:
        """Moment of gravity on a body and all that it carries about a point of it, N m, in its frame."""
        about = poses[body][:3, :3] @ pivot_m + poses[body][:3, 3]
        moment = np.zeros(3)
        for i in self._carried[body]:
            carried = self.bodies[i]
            if carried.mass_kg > 0.0:
                at = poses[i][:3, :3] @ carried.com_m + poses[i][:3, 3]
                moment += np.cross(at - about, carried.mass_kg * self.gravity)
        result: Floats = poses[body][:3, :3].T @ moment
        return result

    def _torque(self, poses: Sequence[Floats], body: int) -> float:
        if self.bodies[body].joint_type == "slide":
            mass = sum(self.bodies[i].mass_kg for i in self._carried[body])
            return float(poses[body][:3, :3] @ self._axis[body] @ (mass * self.gravity))
        return float(self._moment(poses, body, np.zeros(3)) @ self._axis[body])


def _held(one: HiddenEffect, driven: float, before: float, load: float) -> float:
    """The position of an output within its play: at the side to which its load pushes it, or held by friction."""
    p = one.parameters
    if one.effect == "stiction":
        return float(np.clip(before, driven - p["deadband_rad"], driven + p["deadband_rad"]))
    half = 0.5 * p["width_rad"]
    if abs(load) > p.get("friction_nm", DEFAULT_FRICTION_NM):
        return driven + float(np.sign(load)) * half
    return float(np.clip(before, driven - half, driven + half))


def _shift(p: Mapping[str, float]) -> Floats:
    return np.array([p["dx_m"], p["dy_m"], p["dz_m"]])
