"""The shapes of a URDF as points to draw, where their files are found."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from ..diagnosis.applied.urdf import rotation_of_rpy

POINTS_PER_SHAPE = 400
Floats = npt.NDArray[np.float64]


def mesh_file(name: str, urdf: Path, packages: Mapping[str, Path]) -> Path | None:
    """The file that a URDF's `filename` means; None where it is not found.

    `package://NAME/REST` is looked for in `packages`, in the folders of ROS_PACKAGE_PATH, and in every folder above the
    URDF: where one is called NAME, or holds a folder NAME.
    """
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


def points_of_links(urdf: Path, packages: Mapping[str, Path]) -> tuple[dict[str, Floats], list[str]]:
    """Points on the visual shapes of each link, (N, 3) m in the link's frame; second, the files that were not found.

    Meshes need the package trimesh; without it they are left out and named.
    """
    load = _mesh_loader()
    found: dict[str, list[Floats]] = {}
    missing: list[str] = []
    for link in ElementTree.parse(urdf).getroot().findall("link"):
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            points: Floats | None
            if mesh is not None:
                name = mesh.get("filename", "")
                file = mesh_file(name, urdf, packages)
                if file is None or load is None:
                    missing.append(name)
                    continue
                try:
                    vertices = load(file)
                # A broken or foreign mesh is no reason to refuse a robot: it is only not drawn.
                except Exception:
                    missing.append(name)
                    continue
                step = max(1, len(vertices) // POINTS_PER_SHAPE)
                points = vertices[::step] * [float(v) for v in mesh.get("scale", "1 1 1").split()]
            else:
                points = _primitive(visual)
            if points is None or not len(points):
                continue
            origin = visual.find("origin")
            xyz, rpy = (
                np.array(
                    [float(v) for v in ("0 0 0" if origin is None else origin.get(key, "0 0 0")).split()]
                )
                for key in ("xyz", "rpy")
            )
            found.setdefault(link.get("name", ""), []).append(points @ rotation_of_rpy(rpy).T + xyz)
    return {name: np.concatenate(parts) for name, parts in found.items()}, missing


def _mesh_loader() -> Callable[[Path], Floats] | None:
    """A function from a mesh's file to its vertices, (N, 3); None where trimesh is not installed."""
    try:
        trimesh: Any = importlib.import_module("trimesh")
    except ImportError:
        return None
    return lambda file: np.array(trimesh.load(file, force="mesh").vertices, dtype=np.float64)


def _primitive(visual: ElementTree.Element) -> Floats | None:
    """Points on a box, a cylinder or a sphere."""
    box, cylinder, sphere = (visual.find(f"geometry/{kind}") for kind in ("box", "cylinder", "sphere"))
    turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    if box is not None:
        half = np.array([float(v) for v in box.get("size", "0 0 0").split()]) / 2.0
        grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 7)] * 3), axis=-1).reshape(-1, 3)
        return np.asarray(grid[np.abs(grid).max(axis=1) > 0.99] * half)
    if cylinder is not None:
        radius, length = float(cylinder.get("radius", 0)), float(cylinder.get("length", 0))
        ring = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros_like(turn)], axis=1)
        return np.concatenate(
            [ring + np.array([0.0, 0.0, z]) for z in np.linspace(-length / 2, length / 2, 9)]
        )
    if sphere is not None:
        radius = float(sphere.get("radius", 0))
        up = np.linspace(-1.0, 1.0, 9)
        rings = [
            np.stack(
                [np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), np.full_like(turn, z)],
                axis=1,
            )
            for z in up
        ]
        return radius * np.concatenate(rings)
    return None
