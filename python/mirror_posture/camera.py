"""The camera: pinhole with lens distortion; points to pixels and pixels to rays in batches.

`Camera(size_px, focal_px, center_px, distortion_model, distortion)`: optical frame with z forward, x right, y down; pixel
(0, 0) is the centre of the top-left pixel; `distortion_model` is `none`, `plumb_bob` (k1 k2 p1 p2 k3) or
`rational_polynomial` (k1 k2 p1 p2 k3 k4 k5 k6).
"""

from __future__ import annotations

from ._core import Camera
from .session.camera_info import CameraInfo

__all__ = ["Camera", "camera_from_info"]


def camera_from_info(info: CameraInfo) -> Camera:
    """The camera of a session's `camera.yaml`. Raises `MirrorPostureError` for numbers that make no camera."""
    return Camera(
        (info.width_px, info.height_px),
        (info.fx_px, info.fy_px),
        (info.cx_px, info.cy_px),
        info.distortion_model,
        list(info.distortion),
    )
