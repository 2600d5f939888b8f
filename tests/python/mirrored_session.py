"""A session seen in a mirror: pixels of board and balls of a body that is not as its model says.

Body and light are those of the simulated robots and of the blind check, which share nothing with the core.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from mirror_lab.robots.hidden import HiddenBody
from mirror_lab.robots.pixels import MirrorInRoot, exact_points, lens_of
from mirror_posture.robots import Nominal
from mirror_posture.viewpoint import View
from tracked_session import JOINTS

HEAD = ("head_yaw", "head_pitch")
NOISE_PX = 0.1
ENCODER_NOISE_RAD = 0.0005
TURNS_RAD = ((-0.06, 0.0), (0.06, 0.04))
"""Yaw and pitch of the mirror in the views of a posture."""


def write_mirrored(
    folder: Path,
    seed: int,
    actual: Callable[[dict[str, float]], dict[str, float]] = lambda q: q,
    postures: int = 40,
    encoders: bool = False,
    built: Callable[[str], str] = lambda urdf: urdf,
    head_rad: float = 0.0,
) -> Path:
    """Random postures of the embedded robot's right arm, each before two mirrors; `actual` gives the joints' real positions,
    `built` the URDF of the body that is seen, of which the session's model does not know. The head, which carries the camera,
    turns by up to `head_rad`.
    """
    nominal = Nominal.load()
    lens, rng = lens_of(nominal), np.random.default_rng(seed)
    body = HiddenBody(
        built(nominal.robot_file.read_text(encoding="utf-8")),
        nominal.metadata.root,
        nominal.metadata.gravity_m_per_s2,
        [],
    )
    limits = nominal.joint_limits
    joints = (*JOINTS, *HEAD) if head_rad else JOINTS
    most = {j: head_rad if j in HEAD else 1.2 for j in joints}
    low = np.array([max(limits[j].lower, -most[j]) for j in joints])
    high = np.array([min(limits[j].upper, most[j]) for j in joints])
    columns = [*joints, *(f"measured:{j}" for j in joints if encoders)]
    frames, rows = [f"frame,posture,time_s,{','.join(columns)}"], ["frame,target,index,u,v,via"]
    board = body.link_poses()["chest_board"][:3, 3]
    for number in range(postures):
        q = dict(zip(joints, map(float, rng.uniform(low, high)), strict=True))
        real = actual(q)
        body.move(real)
        for k, (yaw, pitch) in enumerate(TURNS_RAD):
            frame = len(TURNS_RAD) * number + k
            read = [real[j] + rng.normal(0.0, ENCODER_NOISE_RAD) for j in joints] if encoders else []
            frames.append(
                f"{frame},{number},{2.0 * frame},{','.join(repr(float(x)) for x in [*q.values(), *read])}"
            )
            view = View(yaw_rad=yaw + rng.normal(0.0, 0.01), pitch_rad=pitch + rng.normal(0.0, 0.01))
            normal = view.normal_in_root
            glass = nominal.metadata.mirror
            mirror = MirrorInRoot(
                normal,
                float(normal @ board) + view.distance_m,
                0.0 if glass is None else glass.glass_thickness_m,
                1.52 if glass is None else glass.refractive_index,
            )
            seen = exact_points(nominal, lens, body.link_poses(), mirror, NOISE_PX, rng)
            for i in np.flatnonzero(seen.board_seen):
                rows.append(f"{frame},board,{i},{seen.board_px[i, 0]:.4f},{seen.board_px[i, 1]:.4f},mirror")
            for i in np.flatnonzero(seen.marker_seen):
                name = nominal.marker_names[i]
                rows.append(f"{frame},{name},0,{seen.marker_px[i, 0]:.4f},{seen.marker_px[i, 1]:.4f},mirror")
    folder.mkdir()
    for name in ("robot.urdf", "camera.yaml", "session.toml"):
        (folder / name).write_bytes((nominal.folder / name).read_bytes())
    (folder / "frames.csv").write_text("\n".join(frames) + "\n", encoding="utf-8")
    (folder / "detections.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    return folder
