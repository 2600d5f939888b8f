"""Writes a session in motion as a folder, exactly in the session format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..blind.optics import Lens
    from ..blind.robots import Robot
    from .make import Seen, Shutter

Array = NDArray[np.float64]


def write_session(
    folder: Path,
    robot: Robot,
    gravity: Array,
    lens: Lens,
    pixel_std: float,
    shutter: Shutter,
    joints: list[str],
    log: tuple[Array, Array, Array],
    seen: Seen,
) -> None:
    """session.toml, robot.urdf, camera.yaml, frames.csv (times only), states.csv and detections.csv. `log` is times, commands and readings."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(robot.urdf, encoding="utf-8")
    g = ", ".join(f"{v:.6f}" for v in gravity)
    text = (
        f'format = "mirror-posture/session"\nversion = 1\nrobot = "robot.urdf"\ncamera = "camera.yaml"\n'
        f'root = "{robot.root}"\ngravity = [{g}]\n\n[camera_mount]\nlink = "{robot.camera_link}"\n\n'
        f'[board]\nlink = "{robot.board_link}"\ncorners = [{robot.board_corners[0]}, {robot.board_corners[1]}]\n'
        f'square = {robot.board_square_m}\npattern = "chessboard"\n\n'
    )
    for m in robot.markers:
        text += f'[[markers]]\nname = "{m}"\nlink = "{m}_marker"\ndiameter = {robot.marker_diameter_m}\n\n'
    text += (
        f"[mirror]\nglass_thickness = 0.0\nrefractive_index = 1.52\n\n[noise]\npixel_std = {pixel_std}\n\n"
        f"[shutter]\nexposure_s = {shutter.exposure_s:.6f}\nreadout_s = {shutter.readout_s:.6f}\n"
    )
    (folder / "session.toml").write_text(text, encoding="utf-8")
    (fx, fy), (cx, cy) = lens.focal_px, lens.center_px
    k = ", ".join(f"{v:.8f}" for v in lens.distortion)
    (folder / "camera.yaml").write_text(
        f"image_width: {lens.size_px[0]}\nimage_height: {lens.size_px[1]}\ncamera_name: head\n"
        f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: [{fx:.6f}, 0.0, {cx:.6f}, 0.0, {fy:.6f}, {cy:.6f}, 0.0, 0.0, 1.0]\n"
        f"distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [{k}]\n"
        "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n"
        "projection_matrix:\n  rows: 3\n  cols: 4\n"
        f"  data: [{fx:.6f}, 0.0, {cx:.6f}, 0.0, 0.0, {fy:.6f}, {cy:.6f}, 0.0, 0.0, 0.0, 1.0, 0.0]\n",
        encoding="utf-8",
    )
    rows = ["frame,posture,time_s", *(f"{f},{f},{t:.6f}" for f, t in enumerate(seen.stamp_s))]
    (folder / "frames.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    times, commands, readings = log
    rows = ["time_s," + ",".join([*joints, *(f"measured:{name}" for name in joints)])]
    rows += [
        f"{t:.4f}," + ",".join(f"{q:.6f}" for q in (*told, *read))
        for t, told, read in zip(times, commands, readings, strict=True)
    ]
    (folder / "states.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    rows = ["frame,target,index,u,v"]
    for f in range(len(seen.stamp_s)):
        targets = [
            ("board", seen.corners_px[f]),
            *((m, seen.blobs_px[f, i : i + 1]) for i, m in enumerate(robot.markers)),
        ]
        for target, px in targets:
            rows += [
                f"{f},{target},{i},{u:.4f},{v:.4f}"
                for i, (u, v) in enumerate(px)
                if np.isfinite(u) and np.isfinite(v)
            ]
    (folder / "detections.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
