"""The shapes of a robot's links: triangles from its URDF, simplified copies of its meshes, bodies for
collisions and occlusion."""

from .of_links import keep_coarse_meshes, shapes_of_links
from .triangles import Triangles

__all__ = ["Triangles", "keep_coarse_meshes", "shapes_of_links"]
