"""A plan judged by a second engine: pinocchio's reading of the URDF and kinematics, coal's collisions of the meshes' own triangles.

    python tests/python/plan_by_pinocchio.py SESSION [NAME=FOLDER of a ROS package ...]

Of the plan's files it reads only the tables of postures and of the mirror's places; of the product it uses nothing. It asks of each posture, and of the
straight way to it from the one before (collisions only): does the robot touch itself, a ball or the board? does any of it lie behind the glass? does the
camera see the board's corners and a ball in the mirror's frame, past the robot? is a real ball in the picture?
Pairs of links that touch with all joints at 0 are left out, and named.
"""

from __future__ import annotations

import csv
import json
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import coal
import cv2
import numpy as np
import pinocchio as pin
import yaml

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

WAY_STEPS = 12
RAY_RADIUS_M = 2e-4
NEAR_ENDS_M = 2e-3
"""A ray begins and ends this far off the camera, the glass and the board's face."""


@dataclass
class Judged:
    """What the second engine says of a plan."""

    postures: int = 0
    ways: int = 0
    pairs: int = 0
    left_out: list[str] = field(default_factory=list)
    collisions: list[tuple[int, float, str]] = field(default_factory=list)
    nearest: tuple[float, str] = (np.inf, "none")
    """Of a pair that the plan moves against each other, m."""
    glass_m: float = np.inf
    """From the glass to the nearest of the robot's vertices; negative behind it."""
    board_unseen: list[int] = field(default_factory=list)
    balls_seen: list[int] = field(default_factory=list)
    """How many balls each picture shows."""
    real_balls: list[int] = field(default_factory=list)


class Body:
    """The session's robot in pinocchio, with its balls and its board as shapes."""

    def __init__(self, folder: Path, packages: Mapping[str, Path]) -> None:
        self.told = tomllib.loads((folder / "session.toml").read_text())
        text = (folder / self.told["robot"]).read_text()
        for name, path in packages.items():
            text = text.replace(f"package://{name}/", f"{path}/")
        self.model = pin.buildModelFromXML(text)
        self.data = self.model.createData()
        shapes = pin.buildGeomFromUrdfString(self.model, text, pin.GeometryType.VISUAL)
        with (folder / "plan" / "postures.csv").open() as file:
            moved = set(next(csv.reader(file))) - {"frame", "posture"}
        self.moving = {self.model.getJointId(name) for name in moved}
        self.balls = [(m["name"], m["link"], 0.5 * m["diameter"]) for m in self.told["markers"]]
        for name, link, radius in self.balls:
            self._add(shapes, f"ball {name}", link, coal.Sphere(radius), np.zeros(3))
        board = self.told["board"]
        nx, ny = board["corners"]
        size = np.array([(nx + 1) * board["square"], (ny + 1) * board["square"], 0.002])
        self._add(shapes, "board", board["link"], coal.Box(*size), np.array([0.0, 0.0, -0.0015]))
        grid = [((x - (nx - 1) / 2), (y - (ny - 1) / 2), 0.0) for y in range(ny) for x in range(nx)]
        self.corners_in_board = np.array(grid) * board["square"]
        self.shapes = shapes
        self._vertices = [self._vertices_of(one) for one in shapes.geometryObjects]
        self._pair_up()

    def _add(self, shapes: pin.GeometryModel, name: str, link: str, shape: object, at: np.ndarray) -> None:
        frame = self.model.getFrameId(link)
        place = self.model.frames[frame].placement * pin.SE3(np.eye(3), at)
        joint = self.model.frames[frame].parentJoint
        shapes.addGeometryObject(pin.GeometryObject(name, joint, frame, place, shape))

    @staticmethod
    def _vertices_of(one: pin.GeometryObject) -> np.ndarray:
        shape = one.geometry
        if isinstance(shape, coal.BVHModelBase):
            return np.asarray(shape.vertices()) * np.asarray(one.meshScale)[None]
        if isinstance(shape, coal.Sphere):
            return np.vstack([np.eye(3), -np.eye(3)]) * shape.radius
        shape.computeLocalAABB()
        low, high = shape.aabb_local.min_, shape.aabb_local.max_
        return np.array(
            [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        )

    def _pair_up(self) -> None:
        """Compares what moves against each other, but for neighbours and what touches at home."""
        joints = [one.parentJoint for one in self.shapes.geometryObjects]
        parents = self.model.parents
        above = [set(self.model.supports[joint]) & self.moving for joint in range(self.model.njoints)]
        for a in range(len(joints)):
            for b in range(a):
                neighbours = parents[joints[a]] == joints[b] or parents[joints[b]] == joints[a]
                if above[joints[a]] != above[joints[b]] and not neighbours:
                    self.shapes.addCollisionPair(pin.CollisionPair(a, b))
        self.at_home = sorted(self.touching(pin.neutral(self.model)))
        names = {pair: number for number, pair in enumerate(map(self.named, self.shapes.collisionPairs))}
        for pair in sorted((names[pair] for pair in self.at_home), reverse=True):
            self.shapes.removeCollisionPair(self.shapes.collisionPairs[pair])

    def named(self, pair: pin.CollisionPair) -> str:
        shapes = self.shapes.geometryObjects
        return f"{shapes[pair.first].name} and {shapes[pair.second].name}"

    def touching(self, q: np.ndarray) -> list[str]:
        """The pairs of shapes that touch in a posture."""
        self.geometry = pin.GeometryData(self.shapes)
        pin.computeCollisions(self.model, self.data, self.shapes, self.geometry, q, False)
        return [
            self.named(pair)
            for pair, result in zip(self.shapes.collisionPairs, self.geometry.collisionResults, strict=True)
            if result.isCollision()
        ]

    def put(self, q: np.ndarray) -> None:
        pin.framesForwardKinematics(self.model, self.data, q)
        pin.updateGeometryPlacements(self.model, self.data, self.shapes, self.geometry)

    def pose(self, link: str) -> np.ndarray:
        return np.asarray(self.data.oMf[self.model.getFrameId(link)].homogeneous)

    def farthest(self, normal: np.ndarray) -> float:
        """How far any shape reaches along a direction of the world."""
        return max(
            float((vertices @ place.rotation.T @ normal).max() + place.translation @ normal)
            for vertices, place in zip(self._vertices, self.geometry.oMg, strict=True)
        )

    def blocked(self, start: np.ndarray, end: np.ndarray, besides: tuple[str, ...]) -> bool:
        """Whether a shape lies on the way between two points; shapes of the rigid bodies `besides` are passed over."""
        way = end - start
        length = float(np.linalg.norm(way)) - 2.0 * NEAR_ENDS_M
        joints = {self.model.frames[self.model.getFrameId(link)].parentJoint for link in besides}
        ray = coal.Capsule(RAY_RADIUS_M, length)
        turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), way / np.linalg.norm(way)).matrix()
        place = coal.Transform3s(turn, 0.5 * (start + end))
        for one, there in zip(self.shapes.geometryObjects, self.geometry.oMg, strict=True):
            if one.parentJoint in joints and one.name not in ("board",):
                continue
            at = coal.Transform3s(there.rotation, there.translation)
            if coal.collide(one.geometry, at, ray, place, coal.CollisionRequest(), coal.CollisionResult()):
                return True
        return False


def tables(folder: Path) -> Iterator[tuple[dict[str, float], dict[str, float]]]:
    with (folder / "plan" / "postures.csv").open() as a, (folder / "plan" / "views.csv").open() as b:
        for row, view in zip(csv.DictReader(a), csv.DictReader(b), strict=True):
            yield {k: float(v) for k, v in row.items()}, {k: float(v) for k, v in view.items()}


@dataclass
class Camera:
    """A pinhole with a lens, by OpenCV."""

    matrix: np.ndarray
    lens: np.ndarray
    size: np.ndarray

    @classmethod
    def read(cls, file: Path) -> Camera:
        info = yaml.safe_load(file.read_text())
        matrix = np.array(info["camera_matrix"]["data"], dtype=float).reshape(3, 3)
        lens = np.array(info["distortion_coefficients"]["data"], dtype=float)
        return cls(matrix, lens, np.array([info["image_width"], info["image_height"]], dtype=float))

    def shows(self, point_in_camera: np.ndarray) -> bool:
        if point_in_camera[2] <= 0.0:
            return False
        still = np.zeros(3)
        at = cv2.projectPoints(point_in_camera[None], still, still, self.matrix, self.lens)[0].ravel()
        return bool(((at > 0) & (at < self.size - 1)).all())


class Sight:
    """What the camera sees in the mirror, with the robot where `body` was put."""

    def __init__(
        self, body: Body, camera: Camera, mirror: Mapping[str, Any], view: Mapping[str, float]
    ) -> None:
        self.body, self.camera = body, camera
        root = body.pose(body.told["root"])
        self.normal = root[:3, :3] @ [view[f"normal_{a}"] for a in "xyz"]
        self.center = root[:3, :3] @ [view[f"center_{a}_m"] for a in "xyz"] + root[:3, 3]
        self.up = root[:3, :3] @ mirror["views"][int(view["view"])]["up_in_root"]
        self.half = 0.5 * np.array([mirror["width_m"], mirror["height_m"]])
        self.link = body.told["camera_mount"]["link"]
        self.pose = body.pose(self.link)

    def glass_m(self) -> float:
        """From the glass to the nearest of the robot; negative behind it."""
        return float(self.center @ self.normal) - self.body.farthest(self.normal)

    def in_picture(self, point: np.ndarray) -> bool:
        return self.camera.shows(self.pose[:3, :3].T @ (point - self.pose[:3, 3]))

    def sees(self, point: np.ndarray, radius: float) -> bool:
        """Whether a point of the world, or a ball's middle, is seen in the mirror's frame and past the robot."""
        eye = self.pose[:3, 3]
        image = point + 2.0 * ((self.center - point) @ self.normal) * self.normal
        way = image - eye
        met = eye + way * (((self.center - eye) @ self.normal) / (way @ self.normal))
        across = np.array(
            [(met - self.center) @ np.cross(self.up, self.normal), (met - self.center) @ self.up]
        )
        if not self.in_picture(image) or (np.abs(across) > self.half).any():
            return False
        near = point + radius * (met - point) / np.linalg.norm(met - point)
        return not self.body.blocked(eye, met, (self.link,)) and not self.body.blocked(near, met, ())


def judge(folder: Path, packages: Mapping[str, Path] | None = None, nearest: bool = False) -> Judged:
    """Asks all of a session's plan; `nearest`: the smallest distance too, which takes minutes of large meshes."""
    body = Body(folder, packages or {})
    camera = Camera.read(folder / body.told["camera"])
    plan = json.loads((folder / "plan" / "plan.json").read_text())
    found = Judged(pairs=len(body.shapes.collisionPairs), left_out=body.at_home)
    before = pin.neutral(body.model)
    for row, view in tables(folder):
        there = pin.neutral(body.model)
        for name, value in row.items():
            if name not in ("frame", "posture"):
                there[body.model.joints[body.model.getJointId(name)].idx_q] = value
        assert (there >= body.model.lowerPositionLimit - 1e-9).all(), row
        assert (there <= body.model.upperPositionLimit + 1e-9).all(), row
        frame = int(row["frame"])
        for share in np.arange(1, WAY_STEPS + 1) / WAY_STEPS:
            for pair in body.touching(before + share * (there - before)):
                found.collisions.append((frame, round(float(share), 2), pair))
            found.ways += 1
        found.postures += 1
        before = there
        if nearest:
            pin.computeDistances(body.model, body.data, body.shapes, body.geometry, there)
            for pair, result in zip(body.shapes.collisionPairs, body.geometry.distanceResults, strict=True):
                found.nearest = min(found.nearest, (result.min_distance, body.named(pair)))
        body.put(there)
        view_of = Sight(body, camera, plan["mirror"], view)
        found.glass_m = min(found.glass_m, view_of.glass_m())
        board = body.pose(body.told["board"]["link"])
        corners = body.corners_in_board @ board[:3, :3].T + board[:3, 3]
        if not all(view_of.sees(corner, 0.0) for corner in corners):
            found.board_unseen.append(frame)
        balls = [(body.pose(link)[:3, 3], radius) for _, link, radius in body.balls]
        found.balls_seen.append(sum(view_of.sees(point, radius) for point, radius in balls))
        if any(view_of.in_picture(point) for point, _ in balls):
            found.real_balls.append(frame)
    return found


def main() -> None:
    """Prints what was found; exits with 1 where something touches or is not seen."""
    packages = dict(re.match(r"(.+?)=(.+)", word).groups() for word in sys.argv[2:])  # type: ignore[union-attr]
    found = judge(Path(sys.argv[1]), {name: Path(path) for name, path in packages.items()}, nearest=True)
    print(
        f"{found.postures} postures, {found.ways} places on the ways to them, {found.pairs} pairs of shapes each"
    )
    print(f"left out, since they touch at home: {'; '.join(found.left_out) or 'none'}")
    print(
        f"collisions: {len(found.collisions)} {found.collisions[:6]}; nearest in a posture: {1e3 * found.nearest[0]:.1f} mm, {found.nearest[1]}"
    )
    print(f"from the glass: {1e3 * found.glass_m:.1f} mm at least")
    print(f"board not seen in frames: {found.board_unseen or 'none'}; balls seen: {found.balls_seen}")
    print(f"a real ball in the picture: {found.real_balls or 'none'}")
    raise SystemExit(
        bool(
            found.collisions
            or found.board_unseen
            or found.real_balls
            or 0 in found.balls_seen
            or found.glass_m < 0
        )
    )


if __name__ == "__main__":
    main()
