"""The reach of each link's body in any direction, by a few points of it."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from ..arrays import Floats
from .of_links import shapes_of_links

DIRECTIONS = 100
"""In which the outermost point is kept: in between a link of 10 cm may reach 2 mm farther."""
CELL_M = 0.002
"""Of the vertices in a cell of this size one counts: a mesh has millions."""


def outermost_points(urdf: Path) -> dict[str, Floats]:
    """By link: the outermost points (N, 3) of its shapes in the link's frame, m. A link whose meshes are not found has none."""
    return _read(urdf.resolve(), urdf.stat().st_mtime_ns)


@lru_cache(maxsize=4)
def _read(urdf: Path, _changed_ns: int) -> dict[str, Floats]:
    shapes, _ = shapes_of_links(urdf)
    found = {}
    for link, parts in shapes.items():
        vertices = np.concatenate([part.vertices_m for part in parts])
        cell = np.floor((vertices - vertices.min(axis=0)) / CELL_M).astype(np.int64)
        wide = cell.max(axis=0) + 1
        _, one = np.unique((cell[:, 0] * wide[1] + cell[:, 1]) * wide[2] + cell[:, 2], return_index=True)
        vertices = vertices[one]
        outermost = np.unique(np.argmax(vertices @ _directions().T, axis=0))
        found[link] = vertices[outermost]
    return found


def _directions() -> Floats:
    """Unit vectors (DIRECTIONS, 3), evenly over the sphere: Fibonacci's lattice."""
    k = np.arange(DIRECTIONS) + 0.5
    height, turn = 1.0 - 2.0 * k / DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - height * height)
    out: Floats = np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
    return out
