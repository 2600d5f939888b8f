"""The shapes of an MJCF's bodies, as a URDF's `<visual>` and `<collision>`, with their meshes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arrays import Floats
from ..file_names import file_name_of
from ..rotations import rpy_of_rotation
from ..shapes.triangles import Triangles, sphere

SHOWN_GROUPS = 3
"""MuJoCo's viewer shows the groups below this one by default: MJCFs keep their visible shapes there."""


def origin_text(pose: Floats) -> str:
    """A URDF's `<origin …/>` of a pose, (4, 4)."""
    xyz = " ".join(f"{float(v) + 0.0:.12g}" for v in pose[:3, 3])
    rpy = " ".join(f"{float(v) + 0.0:.12g}" for v in rpy_of_rotation(pose[:3, :3]))
    return f'<origin xyz="{xyz}" rpy="{rpy}"/>'


@dataclass
class MjcfShapes:
    """Writes the geoms of a compiled MuJoCo model; `meshes` are those that were named, by file name."""

    model: Any
    meshes: dict[str, Triangles] = field(default_factory=dict)

    def of_body(self, body: int) -> str:
        """The elements of a link, one a line; planes and height fields, which are the room's, are left out."""
        model, lines = self.model, []
        for geom in range(
            int(model.body_geomadr[body]), int(model.body_geomadr[body] + model.body_geomnum[body])
        ):
            pose: Floats = np.eye(4)
            pose[:3, :3] = rotation_of_quaternion(model.geom_quat[geom])
            pose[:3, 3] = model.geom_pos[geom]
            kinds = ["visual"] if int(model.geom_group[geom]) < SHOWN_GROUPS else []
            kinds += ["collision"] if model.geom_contype[geom] or model.geom_conaffinity[geom] else []
            for shift_m, shape in self._geometries(geom):
                at = pose @ _along_z(shift_m)
                told = f"{origin_text(at)}<geometry>{shape}</geometry>"
                lines += [f"    <{kind}>{told}</{kind}>\n" for kind in kinds]
        return "".join(lines)

    def _geometries(self, geom: int) -> Iterator[tuple[float, str]]:
        """URDF's geometries of a geom, each with its place along the geom's z axis, m."""
        import mujoco

        model = self.model
        kind = mujoco.mjtGeom(int(model.geom_type[geom]))
        a, b, c = (float(v) for v in model.geom_size[geom])
        if kind == mujoco.mjtGeom.mjGEOM_BOX:
            yield 0.0, f'<box size="{2 * a:.9g} {2 * b:.9g} {2 * c:.9g}"/>'
        elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            yield 0.0, f'<sphere radius="{a:.9g}"/>'
        elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
            yield 0.0, f'<cylinder radius="{a:.9g}" length="{2 * b:.9g}"/>'
        elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
            # URDF has none: a cylinder with a ball at either end.
            yield 0.0, f'<cylinder radius="{a:.9g}" length="{2 * b:.9g}"/>'
            for end in (-b, b):
                yield end, f'<sphere radius="{a:.9g}"/>'
        elif kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            ball = sphere(1.0)
            yield 0.0, self._mesh(f"ellipsoid_{geom}", Triangles(ball.vertices_m * (a, b, c), ball.faces))
        elif kind == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = int(model.geom_dataid[geom])
            vertices = slice(
                int(model.mesh_vertadr[mesh]), int(model.mesh_vertadr[mesh] + model.mesh_vertnum[mesh])
            )
            faces = slice(
                int(model.mesh_faceadr[mesh]), int(model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
            )
            # In the frame of its inertia, as the compiled geom's pose is.
            found = Triangles(
                np.array(model.mesh_vert[vertices], dtype=np.float64),
                np.array(model.mesh_face[faces], dtype=np.int64),
            )
            yield 0.0, self._mesh(model.mesh(mesh).name or f"mesh_{mesh}", found)

    def _mesh(self, name: str, mesh: Triangles) -> str:
        file = file_name_of(name) + ".stl"
        self.meshes[file] = mesh
        return f'<mesh filename="{file}"/>'


def _along_z(shift_m: float) -> Floats:
    pose: Floats = np.eye(4)
    pose[2, 3] = shift_m
    return pose


def rotation_of_quaternion(quat: Any) -> Any:
    """MuJoCo's w, x, y, z as a matrix."""
    import mujoco

    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(quat, dtype=float))
    return matrix.reshape(3, 3)
