"""The shapes of a URDF's links, from its meshes and primitives, and simplified copies of the meshes."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree

import numpy as np

from ..file_names import file_name_of
from ..rotations import rotation_of_rpy
from .triangles import Triangles, box, coarse, cylinder, read_triangles, sphere, write_stl

Kind = Literal["visual", "collision"]

COARSE_FOLDER = "meshes"
COARSE_CELLS = 48
"""Cells along a mesh's longest side: a link of 30 cm keeps details larger than 6 mm."""


def mesh_file(name: str, urdf: Path, packages: Mapping[str, Path]) -> Path | None:
    """The file of a URDF's `filename`; None where it is not found.

    A simplified copy beside the URDF comes first. `package://NAME/REST` is searched for in `packages`, in
    the folders of ROS_PACKAGE_PATH, and in every folder above the URDF that is called NAME, or contains a
    folder NAME.
    """
    copy = urdf.parent / COARSE_FOLDER / coarse_name(name)
    if copy.is_file():
        return copy
    if not name.startswith("package://"):
        path = Path(name.removeprefix("file://"))
        path = path if path.is_absolute() else urdf.parent / path
        return path if path.is_file() else None
    package, _, rest = name.removeprefix("package://").partition("/")
    folders = [packages[package]] if package in packages else []
    folders += [
        Path(one) / package for one in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if one
    ]
    for above in urdf.resolve().parents:
        folders += [above] if above.name == package else [above / package]
    return next((folder / rest for folder in folders if (folder / rest).is_file()), None)


def coarse_name(name: str) -> str:
    """The file name of a mesh's coarse copy."""
    return file_name_of(name.split("://")[-1]) + ".coarse.stl"


def keep_coarse_meshes(
    source: Path, urdf: Path, packages: Mapping[str, Path], read: Mapping[str, Triangles] | None = None
) -> int:
    """Writes simplified copies of the meshes that a URDF names into the folder `meshes` beside `urdf`;
    returns how many.

    With them a session can be planned and drawn on another machine. `source` is the URDF beside which the
    meshes are; `read` are those that were read already, by their name in the URDF.
    """
    names = {mesh.get("filename", "") for mesh in ElementTree.parse(urdf).getroot().iter("mesh")}
    kept = 0
    for name in sorted(names):
        file = mesh_file(name, source, packages)
        mesh = (read or {}).get(name) or (None if file is None else read_triangles(file))
        if mesh is None:
            continue
        (urdf.parent / COARSE_FOLDER).mkdir(exist_ok=True)
        write_stl(coarse(mesh, COARSE_CELLS), urdf.parent / COARSE_FOLDER / coarse_name(name))
        kept += 1
    return kept


def shapes_of_links(
    urdf: Path, packages: Mapping[str, Path] | None = None, kind: Kind = "visual"
) -> tuple[dict[str, list[Triangles]], list[str]]:
    """The shapes of each link in the link's frame, m; and the meshes that were not found or cannot be read.

    A link without shapes of the requested kind gets those of the other kind.
    """
    found: dict[str, list[Triangles]] = {}
    missing: list[str] = []
    for link in ElementTree.parse(urdf).getroot().findall("link"):
        other = "collision" if kind == "visual" else "visual"
        for element in link.findall(kind) or link.findall(other):
            shape = _shape(element, urdf, packages or {}, missing)
            if shape is not None:
                origin = element.find("origin")
                xyz, rpy = (
                    np.array(
                        [float(v) for v in ("0 0 0" if origin is None else origin.get(key, "0 0 0")).split()]
                    )
                    for key in ("xyz", "rpy")
                )
                found.setdefault(link.get("name", ""), []).append(shape.moved(rotation_of_rpy(rpy), xyz))
    return found, list(dict.fromkeys(missing))


def _shape(
    element: ElementTree.Element, urdf: Path, packages: Mapping[str, Path], missing: list[str]
) -> Triangles | None:
    mesh, box_, round_, ball = (
        element.find(f"geometry/{kind}") for kind in ("mesh", "box", "cylinder", "sphere")
    )
    if mesh is not None:
        name = mesh.get("filename", "")
        file = mesh_file(name, urdf, packages)
        read = None if file is None else read_triangles(file)
        if read is None:
            missing.append(name)
            return None
        scale = [float(v) for v in mesh.get("scale", "1 1 1").split()]
        return Triangles(read.vertices_m * scale, read.faces)
    if box_ is not None:
        return box(np.array([float(v) for v in box_.get("size", "0 0 0").split()]))
    if round_ is not None:
        return cylinder(float(round_.get("radius", 0)), float(round_.get("length", 0)))
    if ball is not None:
        return sphere(float(ball.get("radius", 0)))
    return None
