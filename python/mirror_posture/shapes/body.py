"""A robot's body in space: which of its parts touch, how far it reaches, what it hides. MuJoCo does the
geometry.

Every link is a free body in a MuJoCo model, placed by the robot's kinematics (or a simulator). So mimic
joints, any root and bent links need no translation into MuJoCo's joints.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from .._core import MirrorPostureError
from ..arrays import Floats
from ..robots.nominal import Nominal
from .of_links import shapes_of_links
from .triangles import Triangles, box, cut, sphere

try:
    import mujoco
except ImportError:
    raise MirrorPostureError(
        "collisions and pictures with meshes need MuJoCo: pip install 'mirror-posture[mujoco]'"
    ) from None


SHEET_M = 0.003
"""Thickness of the board with its support."""
CUT_CELLS = 6
"""Along the longest side of a mesh that is cut into pieces: a hull around each follows the hollows of the whole."""
SAME_PLACE_M = 1e-4
"""Two points of a shape nearer than this count once."""
HOUSING = 1
"""MuJoCo's group of the shapes that move with the camera."""
ALL_BUT_HOUSING = np.array([group != HOUSING for group in range(6)], dtype=np.uint8)


def rigid_bodies(nominal: Nominal) -> dict[str, int]:
    """By link: the number of the rigid body that fixed joints make of it."""
    group: dict[str, int] = {nominal.robot.link_names[0]: 0}
    for joint in nominal.robot.joints:
        group[joint.child_link] = group[joint.parent_link] if joint.kind == "fixed" else len(group)
    return group


def body_name(link: str) -> str:
    """The name of a link's body: MuJoCo keeps `world`, a common name of a URDF's first link, for its own."""
    return "the link world" if link == "world" else link


def flat_spec(shapes: Mapping[str, Sequence[Triangles]], links: Iterable[str]) -> mujoco.MjSpec:
    """A MuJoCo specification in which each link is a free body (`body_name`) with its shapes."""
    spec = mujoco.MjSpec()
    for link in links:
        body = spec.worldbody.add_body(name=body_name(link))
        body.add_freejoint()
        body.mass, body.inertia, body.explicitinertial = 1.0, [1.0, 1.0, 1.0], True
        for number, shape in enumerate(shapes.get(link, ())):
            name = f"{link}:{number}"
            mesh = spec.add_mesh(
                name=name,
                uservert=np.ascontiguousarray(shape.vertices_m, dtype=np.float32).ravel(),
                userface=np.ascontiguousarray(shape.faces, dtype=np.int32).ravel(),
            )
            # What is flat or open has no volume; its surface always has an extent.
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, mass=0.0)
    return spec


def place(model: mujoco.MjModel, data: mujoco.MjData, links: Sequence[str], world_from_link: Floats) -> None:
    """Puts the free bodies of links at poses (L, 4, 4)."""
    quat = np.zeros(4)
    for link, pose in zip(links, world_from_link, strict=True):
        at = int(model.jnt_qposadr[model.body(body_name(link)).jntadr[0]])
        data.qpos[at : at + 3] = pose[:3, 3]
        mujoco.mju_mat2Quat(quat, np.ascontiguousarray(pose[:3, :3]).ravel())
        data.qpos[at + 3 : at + 7] = quat
    mujoco.mj_kinematics(model, data)


class Body:
    """The collision shapes of a session's robot, with its board and balls.

    Links of one rigid body, and rigid bodies that one joint joins, are never compared, because they touch
    by construction; nor are two of which none is among `moved`. `missing` are the meshes that were not
    found; `bare` says that no link has a shape at all.
    """

    def __init__(
        self,
        nominal: Nominal,
        packages: Mapping[str, Path] | None = None,
        clearance_m: float = 0.005,
        moved: Iterable[str] | None = None,
    ) -> None:
        self._moved = set(nominal.robot.link_names if moved is None else moved)
        self._nominal, self._robot = nominal, nominal.robot
        self._links = list(nominal.robot.link_names)
        # The visible shapes are the real ones: collision shapes are often smaller, for example a short
        # cylinder for a shoulder.
        shapes, self.missing = shapes_of_links(nominal.robot_file, packages, "visual")
        self.bare = not shapes
        metadata = nominal.metadata
        self._own: dict[str, str] = {}
        for marker in metadata.markers:
            if marker.diameter_m > 0.0:
                shapes.setdefault(marker.link, []).append(sphere(0.5 * marker.diameter_m))
        if metadata.board is not None:
            board = metadata.board
            sheet = box(
                np.array([(board.columns + 1) * board.square_m, (board.rows + 1) * board.square_m, SHEET_M])
            )
            # Its face is the frame's plane: the sheet lies behind it.
            back = sheet.moved(np.eye(3), np.array([0.0, 0.0, -0.5 * SHEET_M]))
            shapes.setdefault(board.link, []).append(back)
        self._points = {
            link: np.unique(np.round(np.concatenate([p.vertices_m for p in parts]) / SAME_PLACE_M), axis=0)
            * SAME_PLACE_M
            for link, parts in shapes.items()
            if link in self._links
        }
        self._shapes, self._clearance_m = shapes, clearance_m
        self._group = rigid_bodies(nominal)
        self._neighbours = {frozenset((group, group)) for group in self._group.values()}
        for joint in self._robot.joints:
            self._neighbours.add(frozenset((self._group[joint.parent_link], self._group[joint.child_link])))
        self.ignored: set[frozenset[str]] = set()
        self.nearest_m: dict[frozenset[str], float] = {}
        """Of pairs that may come nearer to each other than the clearance: how near."""
        self._compile(shapes)

    def _compile(self, shapes: Mapping[str, Sequence[Triangles]]) -> None:
        spec = flat_spec(shapes, self._links)
        camera = self._nominal.metadata.camera_link
        links = {body_name(link): link for link in self._links}
        for geom in spec.geoms:
            geom.margin = self._clearance_m
            if camera is not None and self._group[links[geom.parent.name]] == self._group[camera]:
                geom.group = HOUSING
        for a, b in combinations(self._links, 2):
            still = a not in self._moved and b not in self._moved
            if still or frozenset((self._group[a], self._group[b])) in self._neighbours:
                spec.add_exclude(bodyname1=body_name(a), bodyname2=body_name(b))
        spec.option.gravity = [0.0, 0.0, 0.0]
        try:
            self._model = spec.compile()
        except ValueError as error:
            raise MirrorPostureError(
                f"{self._nominal.robot_file}: MuJoCo refuses its shapes: {' '.join(str(error).split())}"
            ) from None
        self._data = mujoco.MjData(self._model)
        self._name = [links[self._model.body(int(b)).name] for b in self._model.geom_bodyid]

    def cut(self, links: Iterable[str]) -> None:
        """From now on these links are compared piece by piece: MuJoCo takes a mesh for its convex hull, which fills an armpit."""
        wanted = set(links)
        self._compile(
            {
                link: [piece for part in parts for piece in cut(part, CUT_CELLS)] if link in wanted else parts
                for link, parts in self._shapes.items()
            }
        )

    def put(self, positions: Floats) -> Floats:
        """Sets a posture (nq,), to which the following calls refer; returns `base_from_link` (L, 4, 4) of
        all links."""
        poses: Floats = self._robot.link_poses(positions[None], self._links)[0]
        self._poses = poses
        place(self._model, self._data, self._links, poses)
        return poses

    def distances_m(self) -> dict[frozenset[str], float]:
        """The pairs of links nearer to each other than the clearance, and how near, m (negative: one is in the other)."""
        mujoco.mj_collision(self._model, self._data)
        found: dict[frozenset[str], float] = {}
        for geom, distance in zip(self._data.contact.geom, self._data.contact.dist, strict=True):
            pair = frozenset((self._name[geom[0]], self._name[geom[1]]))
            found[pair] = min(float(distance), found.get(pair, np.inf))
        return found

    def touching(self) -> set[frozenset[str]]:
        """The pairs of links that are nearer to each other than allowed, except those that `ignored` names."""
        return {
            pair
            for pair, distance in self.distances_m().items()
            if pair not in self.ignored and distance < self.nearest_m.get(pair, np.inf)
        }

    def extent_m(self, direction: Floats, links: Iterable[str] | None = None) -> float:
        """How far the body reaches along a direction (3,) of the base's frame, m; −∞ where nothing has a shape."""
        most = -np.inf
        wanted = None if links is None else set(links)
        for link, pose in zip(self._links, self._poses, strict=True):
            points = self._points.get(link)
            if points is not None and (wanted is None or link in wanted):
                most = max(
                    most, float((points @ (pose[:3, :3].T @ direction)).max() + direction @ pose[:3, 3])
                )
        return most

    def hides(self, start_m: Floats, way: Floats, length_m: float, past_camera: bool = False) -> bool:
        """Whether the body blocks the straight path from a point (3,) along a unit vector (3,), both in the
        base's frame, up to a length.

        With `past_camera` the rigid body that carries the camera blocks nothing, because the camera is in
        its housing.
        """
        wanted = ALL_BUT_HOUSING if past_camera else None
        distance = mujoco.mj_ray(self._model, self._data, start_m, way, wanted, 1, -1, None)
        return bool(0.0 <= distance <= length_m)
