"""A URDF edited in place: single numbers of origins and axes change, every other character stays."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import numpy as np

from ..._core import MirrorPostureError
from ...arrays import Floats
from ...rotations import nearest_rpy, pose_of, rotation_of_rpy, rotation_of_vector, tilt_directions
from .xml_text import Element, XmlText

ZERO = (0.0, 0.0, 0.0)
UNCHANGED = 1e-10
"""rad or m: what differs by less is rounding, and stays as it was written."""
STAYED = 1e-12
"""rad or m: an origin that differs by less after a calculation was not moved."""
TURNING = ("revolute", "continuous")


class Urdf:
    """The text of a robot with its joints by name."""

    def __init__(self, text: str, file: str = "robot.urdf") -> None:
        self._text = text
        joints = [child for child in XmlText(text, file).root.children if child.tag == "joint"]
        self.joints = {joint.attributes.get("name", ""): joint for joint in joints}
        self.joint_of_child = {_link(joint, "child"): name for name, joint in self.joints.items()}
        self.links = {_link(joint, role) for joint in joints for role in ("parent", "child")}
        self._origins: dict[str, Floats] = {}
        self._axes: dict[str, Floats] = {}

    def text(self) -> str:
        """The edited file: what did not change stays identical."""
        document = XmlText(self._text)
        for name, axis in self._axes.items():
            self._write(document, name, "axis", {"xyz": (axis, self._read_axis(name))})
        for name, pose in self._origins.items():
            was = self._read_origin(name)
            # Another representation of the same rotation would be a change of numbers without a change.
            same = np.allclose(pose[:3, :3], was[:3, :3], rtol=0.0, atol=UNCHANGED)
            rpy_was = self._numbers_of(name, "origin", "rpy", ZERO)
            rpy = rpy_was if same else nearest_rpy(pose[:3, :3], rpy_was)
            xyz = (pose[:3, 3], was[:3, 3])
            self._write(document, name, "origin", {"xyz": xyz, "rpy": (rpy, rpy_was)})
        return document.text()

    def _write(
        self, document: XmlText, name: str, tag: str, values: dict[str, tuple[Floats, Floats]]
    ) -> None:
        joint = self.joint(name)
        element = joint.find(tag)
        changed = {
            key: _written(new, old, None if element is None else element.attributes.get(key))
            for key, (new, old) in values.items()
            if not np.allclose(new, old, rtol=0.0, atol=UNCHANGED)
        }
        if element is None:
            if changed:
                document.insert_in(joint, tag, changed)
            return
        for key, value in changed.items():
            document.set(element, key, value)

    def _numbers_of(self, name: str, tag: str, key: str, default: tuple[float, float, float]) -> Floats:
        element = self.joint(name).find(tag)
        return _numbers(None if element is None else element.attributes.get(key), default)

    def numbers(self, name: str) -> dict[str, Floats]:
        """The numbers of a joint as the file has them: `origin xyz`, `origin rpy`, `axis xyz`."""
        return {
            "origin xyz": self._numbers_of(name, "origin", "xyz", ZERO),
            "origin rpy": self._numbers_of(name, "origin", "rpy", ZERO),
            "axis xyz": self._read_axis(name),
        }

    def joint(self, name: str) -> Element:
        """A joint by name. Raises `MirrorPostureError` for one that the robot does not have."""
        if name not in self.joints:
            raise MirrorPostureError(
                f"the diagnosis names joint {name!r}, which this robot does not have; it has {', '.join(self.joints)}"
            )
        return self.joints[name]

    def kind(self, name: str) -> str:
        """The joint's type as the file has it."""
        return self.joint(name).attributes.get("type", "")

    def axis(self, name: str) -> Floats:
        """The joint's unit axis in its own frame; x where the file has none, or 0 0 0, as exporters write
        for fixed joints."""
        axis = self._axes[name] if name in self._axes else self._read_axis(name)
        length = float(np.linalg.norm(axis))
        unit: Floats = axis / length if length > 0.0 else np.array([1.0, 0.0, 0.0])
        return unit

    def _read_axis(self, name: str) -> Floats:
        return self._numbers_of(name, "axis", "xyz", (1.0, 0.0, 0.0))

    def set_axis(self, name: str, axis: Floats) -> None:
        """Gives the joint an axis."""
        self._axes[name] = np.array(axis, dtype=float)

    def origin(self, name: str) -> Floats:
        """`parent_from_joint`, (4, 4)."""
        return self._origins[name].copy() if name in self._origins else self._read_origin(name)

    def _read_origin(self, name: str) -> Floats:
        pose = np.eye(4)
        pose[:3, :3] = rotation_of_rpy(self._numbers_of(name, "origin", "rpy", ZERO))
        pose[:3, 3] = self._numbers_of(name, "origin", "xyz", ZERO)
        return pose

    def set_origin(self, name: str, parent_from_joint: Floats) -> None:
        """Gives the joint an origin, `parent_from_joint`."""
        self.joint(name)
        self._origins[name] = np.array(parent_from_joint, dtype=float)

    def add_offset(self, name: str, offset: float) -> list[str]:
        """`θ = q + a`: the origin is turned by a about the axis (moved along it, for a prismatic joint).

        Joints that follow this one (`<mimic>`) follow where it really is: `θ = m (q + a) + b`, so their origins are turned
        by m a. Returns the names of all joints that were changed.
        """
        factors = {name: 1.0} | self._followers(name)
        for joint, factor in factors.items():
            motion = np.eye(4)
            if self.kind(joint) in TURNING:
                motion[:3, :3] = rotation_of_vector(factor * offset * self.axis(joint))
            else:
                motion[:3, 3] = factor * offset * self.axis(joint)
            self.set_origin(joint, self.origin(joint) @ motion)
        return list(factors)

    def _followers(self, name: str) -> dict[str, float]:
        """The joints that follow a joint (`<mimic>`, in chains too), each with the factor of its position to that joint's."""
        mimics = {joint: element.find("mimic") for joint, element in self.joints.items()}
        found: dict[str, float] = {}
        leaders = {name: 1.0}
        while leaders:
            leaders = {
                joint: leaders[mimic.attributes["joint"]] * float(mimic.attributes.get("multiplier", 1.0))
                for joint, mimic in mimics.items()
                if mimic is not None and mimic.attributes.get("joint") in leaders and joint not in found
            }
            found |= leaders
        return found

    def tilt_axis(self, name: str, tilt_1_rad: float, tilt_2_rad: float) -> None:
        """The real axis is `unit(a + tan(tilt_1) u + tan(tilt_2) v)`, `u = unit(a × e)`, `v = a × u`."""
        a = self.axis(name)
        u, v = tilt_directions(a)
        real = a + math.tan(tilt_1_rad) * u + math.tan(tilt_2_rad) * v
        self.set_axis(name, real / np.linalg.norm(real))

    def turn_carried(self, link: str, twist_1_rad: float, twist_2_rad: float) -> str | None:
        """Turns the origin of the moving joint that a rigid body carries by `exp(twist_1 u + twist_2 v)`, u and v across its axis;
        returns its name, None where the body carries none or several."""
        carried = self._carried_by(link)
        if len(carried) != 1:
            return None
        (name,) = carried
        u, v = tilt_directions(self.axis(name))
        turn = pose_of(twist_1_rad * u + twist_2_rad * v, np.zeros(3))
        self.set_origin(name, self.origin(name) @ turn)
        return name

    def shift_carried(self, link: str, shift_in_link_m: Floats) -> list[str]:
        """Moves the origins of the moving joints that a rigid body carries; returns their names.

        The body is the link with all that is fixed to it; the shift is told in the link's frame.
        """
        carried = self._carried_by(link)
        for name, link_from_parent in carried.items():
            pose = self.origin(name)
            pose[:3, 3] += link_from_parent[:3, :3].T @ shift_in_link_m
            self.set_origin(name, pose)
        return list(carried)

    def _carried_by(self, link: str) -> dict[str, Floats]:
        """The moving joints that the rigid body of a link carries, with `link_from_parent` of each."""
        body = self._rigid_body(link)
        parents = {name: _link(joint, "parent") for name, joint in self.joints.items()}
        return {
            name: body[parent]
            for name, parent in parents.items()
            if self.kind(name) != "fixed" and parent in body
        }

    def shift_origin(self, name: str, shift_m: Floats) -> None:
        """Moves the origin of a joint, told in the frame of the moving link that carries it."""
        # Fixed joints between the joint and the moving link may turn the frame.
        carrier_from_parent = np.eye(3)
        above = self.joint_of_child.get(_link(self.joints[name], "parent"))
        while above is not None and self.kind(above) == "fixed":
            carrier_from_parent = self.origin(above)[:3, :3] @ carrier_from_parent
            above = self.joint_of_child.get(_link(self.joints[above], "parent"))
        pose = self.origin(name)
        pose[:3, 3] += carrier_from_parent.T @ shift_m
        self.set_origin(name, pose)

    def shift_mount(self, link: str, shift_m: Floats, staying: Collection[str] = ()) -> list[str] | None:
        """Moves a link on its fixed mount, told in the frame of the link that carries the mount; `staying` and result as of `move_mounts`."""
        name = self.joint_of_child.get(link)
        if name is None:
            return None
        parent_from_nominal = self.origin(name)
        return self.move_mounts(
            {link: pose_of(np.zeros(3), parent_from_nominal[:3, :3].T @ shift_m)}, staying
        )

    def move_mounts(
        self, nominal_from_real: Mapping[str, Floats], staying: Collection[str] = ()
    ) -> list[str] | None:
        """Moves links of one rigid body on their fixed mounts, each by a motion in its own nominal frame.

        Nothing else that counts moves: the links `staying`, and the moving joints that the body carries, are set back where a
        link that moves carries them. Returns the names of the joints whose origins were changed; None where a link has no fixed mount.
        """
        top = self._top(next(iter(nominal_from_real)))
        nominal = self._rigid_body(top)
        if any(link == top or link not in nominal for link in nominal_from_real):
            return None
        wanted = {
            self.joint_of_child[link]: pose @ nominal_from_real.get(link, np.eye(4))
            for link, pose in nominal.items()
            if link != top and (link in nominal_from_real or link in staying)
        }
        wanted |= {
            name: top_from_parent @ self.origin(name)
            for name, top_from_parent in self._carried_by(top).items()
        }
        changed = []
        # From the top down: what carries a link has its place when the link gets its own.
        for name, top_from_joint in wanted.items():
            parent = _link(self.joint(name), "parent")
            origin = np.linalg.inv(self._rigid_body(top)[parent]) @ top_from_joint
            if not np.allclose(origin, self.origin(name), rtol=0.0, atol=STAYED):
                self.set_origin(name, origin)
                changed.append(name)
        return changed

    def fixed_pose(self, link: str, other: str) -> Floats | None:
        """`link_from_other` of two links that fixed joints alone join; None of others."""
        return self._rigid_body(link).get(other)

    def _top(self, link: str) -> str:
        """The link of a rigid body that carries its others: a moving joint's child, or the robot's root."""
        above = self.joint_of_child.get(link)
        while above is not None and self.kind(above) == "fixed":
            link = _link(self.joints[above], "parent")
            above = self.joint_of_child.get(link)
        return link

    def _rigid_body(self, link: str) -> dict[str, Floats]:
        """`link_from_other` of all links that fixed joints join to a link."""
        body, todo = {link: np.eye(4)}, [link]
        while todo:
            at = todo.pop()
            for name, joint in self.joints.items():
                if self.kind(name) != "fixed":
                    continue
                parent, child = _link(joint, "parent"), _link(joint, "child")
                if parent == at and child not in body:
                    body[child] = body[at] @ self.origin(name)
                    todo.append(child)
                elif child == at and parent not in body:
                    body[parent] = body[at] @ np.linalg.inv(self.origin(name))
                    todo.append(parent)
        return body


def _link(joint: Element, role: str) -> str:
    entry = joint.find(role)
    return "" if entry is None else entry.attributes.get("link", "")


def _numbers(text: str | None, default: tuple[float, float, float]) -> Floats:
    return np.array(default if text is None else [float(part) for part in text.split()], dtype=float)


def _written(values: Floats, old: Floats, old_text: str | None) -> str:
    """The numbers as text; those that did not change as they were written."""
    parts = [None] * len(values) if old_text is None else old_text.split()
    # Adding 0 turns a negative zero into a plain one.
    return " ".join(
        part if part is not None and abs(new - before) <= UNCHANGED else f"{float(new) + 0.0:.12g}"
        for new, before, part in zip(values, old, parts, strict=True)
    )
