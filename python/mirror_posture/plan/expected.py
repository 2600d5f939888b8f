"""A plan's postures as the core's planned session: with the pixels that the model predicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .._core import PlannedSession
from ..arrays import Floats, Integers, Mask
from ..diagnosis.recording import to_core
from ..mirror import IDEAL_MIRROR
from ..optics import see_in_mirror
from ..session.types import Frames, Views
from .options import MirrorPlace
from .setting import Setting
from .sight import scene_of


def planned_session(
    setting: Setting,
    positions: Floats,
    mirrors: Sequence[MirrorPlace],
    view: Integers,
    markers: Mask,
    seconds_a_frame: float,
    shown: Mask | None = None,
) -> PlannedSession:
    """Postures (F, nq), held one after the other in front of the mirrors (in the base's frame) `view` (F,), with visible balls (F, M).

    `shown` (F,): of which a picture is taken; of all by default.
    """
    nominal, count = setting.nominal, len(positions)
    scene = scene_of(setting, positions, all_corners=True)
    points = np.concatenate([scene.corners, scene.markers], axis=1)
    turn, origin = scene.camera_from_base[:, :3, :3], scene.camera_from_base[:, :3, 3]
    normal = np.einsum("nij,nj->ni", turn, np.stack([m.normal_in_root for m in mirrors])[view])
    center = np.einsum("nij,nj->ni", turn, np.stack([m.center_in_root_m for m in mirrors])[view]) + origin
    foot = np.einsum("ni,ni->n", normal, center)[:, None] * normal
    seen = see_in_mirror(
        setting.camera,
        np.repeat(foot, points.shape[1], axis=0),
        points.reshape(-1, 3),
        **(nominal.metadata.mirror or IDEAL_MIRROR).glass,
    )
    valid = seen.valid.reshape(count, -1) & (np.ones(count, dtype=bool) if shown is None else shown)[:, None]
    pixels = np.where(valid[..., None], seen.pixels_px.reshape(*points.shape[:2], 2), 0.0)
    corners = nominal.corner_count
    views = replace(
        Views.empty(count, corners, len(nominal.metadata.markers)),
        board_px=pixels[:, :corners],
        board_seen=valid[:, :corners],
        marker_px=pixels[:, corners:],
        marker_seen=valid[:, corners:] & markers,
    )
    frames = Frames(
        frame=np.arange(count),
        posture=np.arange(count),
        joint_names=nominal.robot.position_names,
        commanded=positions,
        time_s=np.arange(count) * np.float64(seconds_a_frame),
    )
    session = nominal.with_frames(frames, views, detected=True)
    noise = replace(session.noise, pixel_std_px=setting.noise_px)
    return PlannedSession(to_core(replace(session, noise=noise)))
