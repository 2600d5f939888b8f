"""Writes a simulated case as a session folder, exactly in the session format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .drawing import hue_tolerance_deg, marker_hue_deg
from .mistakes import told_truly
from .picture_files import write_pictures

if TYPE_CHECKING:
    from .simulate import Case


def write_session(case: Case, folder: Path, rng: np.random.Generator | None = None) -> Path:
    """session.toml, robot.urdf, camera.yaml, frames.csv, and detections.csv or images/ in `folder`; nothing of the answer. `rng` draws the
    pictures' noise."""
    folder.mkdir(parents=True, exist_ok=True)
    robot, plan = case.robot, case.plan
    told = case.told
    (folder / "robot.urdf").write_text(told.urdf if told else robot.urdf, encoding="utf-8")
    (folder / "session.toml").write_text(_metadata(case), encoding="utf-8")
    (folder / "camera.yaml").write_text(_camera(case), encoding="utf-8")
    joints = plan.commands.joints
    pictures: list[str] = []
    if case.view is not None and case.picture_of_frame is not None:
        clean = (case.clean_corners_px, case.clean_blobs_px)
        drawn = write_pictures(
            robot,
            case.lens,
            case.view,
            clean,
            folder / "images",
            rng or np.random.default_rng(0),
            case.renderer,
        )
        pictures = [f"images/{drawn[i]}," for i in case.picture_of_frame]
    rows = ["frame,posture,time_s," + ("image," if pictures else "") + ",".join(joints)]
    q_of_frame = (told or told_truly(case)).q
    posture_of_frame = _postures(plan.posture_of_frame, q_of_frame)
    for f, (p, t) in enumerate(zip(posture_of_frame, plan.time_of_frame_s, strict=True)):
        image = pictures[f] if pictures else ""
        rows.append(f"{f},{p},{t:.3f},{image}" + ",".join(f"{q:.6f}" for q in q_of_frame[f]))
    (folder / "frames.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    if pictures:
        return folder
    rows = ["frame,target,index,u,v"]
    for f in range(len(case.corners_px)):
        for target, px in [
            ("board", case.corners_px[f]),
            *((m, case.blobs_px[f, k : k + 1]) for k, m in enumerate(robot.markers)),
        ]:
            rows += [
                f"{f},{target},{i},{u:.4f},{v:.4f}"
                for i, (u, v) in enumerate(px)
                if np.isfinite(u) and np.isfinite(v)
            ]
    (folder / "detections.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder


def _postures(of: NDArray[np.int_], q: NDArray[np.float64]) -> NDArray[np.int_]:
    """The posture of each frame; a number of its own for each where rows of one posture tell different commands."""
    same = [bool((q[of == p] == q[of == p][0]).all()) for p in np.unique(of)]
    return of if all(same) else np.arange(len(of))


def _metadata(case: Case) -> str:
    robot, told = case.robot, case.told
    g = ", ".join(f"{v:.6f}" for v in (told.gravity if told else case.gravity))
    tolerances = case.mounting.tolerances() if case.mounting else {}
    stated = "".join(f"{name} = {value}\n" for name, value in tolerances.items())
    of_marker = f"tolerance_m = {tolerances['tolerance_m']}\n" if tolerances else ""
    text = (
        f'format = "mirror-posture/session"\nversion = 1\nrobot = "robot.urdf"\ncamera = "camera.yaml"\n'
        f'root = "{robot.root}"\ngravity = [{g}]\n\n[camera_mount]\nlink = "{robot.camera_link}"\n{stated}\n'
        f'[board]\nlink = "{robot.board_link}"\n'
        f"corners = [{robot.board_corners[0]}, {robot.board_corners[1]}]\n"
        f'square = {told.square_m if told else robot.board_square_m}\npattern = "chessboard"\n{stated}\n'
    )
    count = len(robot.markers)
    for k, m in enumerate(robot.markers):
        text += f'[[markers]]\nname = "{m}"\nlink = "{m}_marker"\ndiameter = {robot.marker_diameter_m}\n{of_marker}'
        if case.view is not None:
            text += (
                f"color = {{ hue = {marker_hue_deg(k, count):.1f}, hue_tolerance = {hue_tolerance_deg(count):.1f}, "
                "min_saturation = 0.5, min_value = 0.2 }\n"
            )
        text += "\n"
    text += "[mirror]\nglass_thickness = 0.0\nrefractive_index = 1.52\n"
    return (
        text
        if case.view is not None or not case.noise_told
        else text + f"\n[noise]\npixel_std = {case.pixel_std_told}\n"
    )


def _camera(case: Case) -> str:
    lens = case.nominal_lens
    factor, shift = (case.told.lens_factor, case.told.lens_shift_px) if case.told else (1.0, np.zeros(2))
    (fx, fy), (cx, cy) = factor * lens.focal_px, factor * lens.center_px + shift
    distortion = ", ".join(f"{k:.8f}" for k in lens.distortion)
    return (
        f"image_width: {lens.size_px[0]}\nimage_height: {lens.size_px[1]}\ncamera_name: head\n"
        f"camera_matrix:\n  rows: 3\n  cols: 3\n"
        f"  data: [{fx:.6f}, 0.0, {cx:.6f}, 0.0, {fy:.6f}, {cy:.6f}, 0.0, 0.0, 1.0]\n"
        f"distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n"
        f"  data: [{distortion}]\n"
        "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]\n"
        "projection_matrix:\n  rows: 3\n  cols: 4\n"
        f"  data: [{fx:.6f}, 0.0, {cx:.6f}, 0.0, 0.0, {fy:.6f}, {cy:.6f}, 0.0, 0.0, 0.0, 1.0, 0.0]\n"
    )
