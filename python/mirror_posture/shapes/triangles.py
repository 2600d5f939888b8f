"""Triangle meshes: read from files, made of primitives, and coarsened."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Floats, Integers
from ..input_files import read_regular

STL_HEADER_BYTES = 84
STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
LARGEST_MESH = 1_000_000_000
"""Bytes of a mesh file at most."""
ROUND = 24
"""Corners of a circle."""
SKIN_M = 2e-4
"""Thickness of a piece of a surface."""


@dataclass(frozen=True, eq=False)
class Triangles:
    """A surface: `vertices_m` (N, 3), and `faces` (M, 3), whose rows are indices of vertices."""

    vertices_m: Floats
    faces: Integers

    def moved(self, rotation: Floats, translation_m: Floats) -> Triangles:
        """The same, turned (3, 3) and shifted (3,)."""
        return Triangles(self.vertices_m @ rotation.T + translation_m, self.faces)


def read_triangles(file: Path) -> Triangles | None:
    """The triangles of a mesh file in the file's own unit; None where it is broken, or of a kind that needs trimesh.

    Binary STL is read here, every other kind by trimesh, where that is installed.
    """
    try:
        # Whatever a robot's description names: bounded, also where trimesh opens it itself.
        data = read_regular(file, LARGEST_MESH)
        if file.suffix.lower() == ".stl":
            count = int.from_bytes(data[80:STL_HEADER_BYTES], "little")
            if len(data) == STL_HEADER_BYTES + count * STL_TRIANGLE.itemsize:
                corners = np.frombuffer(data, STL_TRIANGLE, offset=STL_HEADER_BYTES)["corners"]
                return _checked(
                    corners.reshape(-1, 3).astype(np.float64), np.arange(3 * count).reshape(-1, 3)
                )
        trimesh: Any = importlib.import_module("trimesh")
        mesh = trimesh.load(file, force="mesh")
        return _checked(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64))
    # A broken or foreign mesh is no reason to refuse a robot; what trimesh raises depends on the kind of file.
    except Exception:
        return None


def _checked(vertices: Floats, faces: Integers) -> Triangles | None:
    good = len(faces) > 0 and np.isfinite(vertices).all()
    return Triangles(vertices, faces) if good else None


def write_stl(mesh: Triangles, file: Path) -> None:
    """Writes a binary STL."""
    rows = np.zeros(len(mesh.faces), STL_TRIANGLE)
    rows["corners"] = mesh.vertices_m[mesh.faces]
    file.write_bytes(bytes(80) + len(rows).to_bytes(4, "little") + rows.tobytes())


def coarse(mesh: Triangles, cells: int) -> Triangles:
    """The mesh with one vertex for each cell of a grid, `cells` along its longest side.

    Of a cell's vertices the one farthest from the mesh's middle stays, so that the hull hardly shrinks. Faces that became
    lines or points fall away. (Vertex clustering: Rossignac and Borrel 1993.)
    """
    low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
    side = float((high - low).max()) / cells
    if not side > 0.0:
        return mesh
    cell = np.floor((mesh.vertices_m - low) / side).astype(np.int64)
    key = (cell[:, 0] * (cells + 2) + cell[:, 1]) * (cells + 2) + cell[:, 2]
    out = np.linalg.norm(mesh.vertices_m - 0.5 * (low + high), axis=1)
    order = np.lexsort((-out, key))
    _, first, inverse = np.unique(key[order], return_index=True, return_inverse=True)
    new = np.empty(len(key), dtype=np.int64)
    new[order] = inverse.ravel()
    faces = new[mesh.faces]
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces = faces[whole]
    # Of faces that fell onto each other one stays.
    _, one = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    if not len(one):
        return mesh
    return Triangles(mesh.vertices_m[order][first], faces[np.sort(one)])


def cut(mesh: Triangles, cells: int) -> list[Triangles]:
    """The mesh's surface in pieces: its faces by the cell of a grid, `cells` along its longest side, that their middle lies in.

    A convex hull around each piece follows a hollow surface, which one hull around the whole mesh fills. Each piece is
    `SKIN_M` thick, so that a flat one has a hull too.
    """
    corners = mesh.vertices_m[mesh.faces]
    low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
    side = float((high - low).max()) / cells
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    if not side > 0.0 or not (area > 0.0).any():
        return [mesh]
    corners, normal = corners[area > 0.0], normal[area > 0.0] / area[area > 0.0, None]
    cell = np.floor((corners.mean(axis=1) - low) / side).astype(np.int64)
    _, piece = np.unique(cell, axis=0, return_inverse=True)
    pieces = []
    for number in range(int(piece.max()) + 1):
        outer = corners[piece.ravel() == number]
        inner = outer - SKIN_M * normal[piece.ravel() == number][:, None]
        vertices = np.concatenate([outer, inner]).reshape(-1, 3)
        pieces.append(Triangles(vertices, np.arange(len(vertices)).reshape(-1, 3)))
    return pieces


def box(size_m: Floats) -> Triangles:
    """A box around the origin."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size_m / 2.0
    faces = [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
    ]  # fmt: skip
    return Triangles(corners, np.array(faces))


def turned(profile_m: Floats) -> Triangles:
    """The solid of a profile (N, 2), radius and height, turned about z: its ends are closed where their radius is 0."""
    angle = np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False)
    radius, height = profile_m.T
    rings = np.stack(
        [
            np.outer(radius, np.cos(angle)),
            np.outer(radius, np.sin(angle)),
            np.repeat(height[:, None], ROUND, axis=1),
        ],
        axis=-1,
    ).reshape(-1, 3)
    faces = []
    for ring in range(len(profile_m) - 1):
        for k in range(ROUND):
            a, b = ring * ROUND + k, ring * ROUND + (k + 1) % ROUND
            faces += [(a, b, b + ROUND), (a, b + ROUND, a + ROUND)]
    return Triangles(rings, np.array(faces))


def cylinder(radius_m: float, length_m: float) -> Triangles:
    """A cylinder about z around the origin."""
    h = 0.5 * length_m
    return turned(np.array([[0.0, -h], [radius_m, -h], [radius_m, h], [0.0, h]]))


def sphere(radius_m: float) -> Triangles:
    """A ball around the origin."""
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, ROUND // 2 + 1)
    return turned(radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1))
