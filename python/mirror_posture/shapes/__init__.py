"""The shapes of a robot's links: triangles from its URDF, coarse copies of its meshes, bodies that collide and hide."""

from .of_links import keep_coarse_meshes, shapes_of_links
from .triangles import Triangles

__all__ = ["Triangles", "keep_coarse_meshes", "shapes_of_links"]
