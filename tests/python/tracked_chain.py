"""An arm of seven joints that a tracker sees, with small errors everywhere: products of rotations and shifts in plain NumPy,
which shares nothing with the core."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Axes = tuple[tuple[int, int, int], ...]
AXES: Axes = ((0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1))
NO_ROLLS: Axes = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0))
"""Axes across the links, so that each link's length shows by itself."""
SHIFTS_M = (
    (0, 0, 0.2),
    (0.03, 0, 0.15),
    (0, 0.02, 0.2),
    (0.04, 0, 0.18),
    (-0.04, 0, 0.2),
    (0, 0.01, 0.15),
    (0.06, 0, 0.1),
)
MARKERS_M = {
    "elbow": (3, (0.05, 0.04, 0.03)),
    "wrist": (5, (0.03, -0.05, 0.04)),
    "tool": (7, (0.02, 0.03, 0.1)),
}
"""Each marker's link, counted from the base, and where it is there."""
LIMIT_RAD = 2.0
TURN = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])


def about(axis: Floats, angle_rad: float) -> Floats:
    """The rotation by an angle about an axis (Rodrigues)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross)


def urdf(axes: Axes) -> str:
    links = [f'<link name="l{i}"/>' for i in range(len(axes) + 1)]
    joints = [
        f'<joint name="a{i + 1}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="{" ".join(map(str, shift))}"/><axis xyz="{" ".join(map(str, axis))}"/>'
        f'<limit lower="-{LIMIT_RAD}" upper="{LIMIT_RAD}" effort="50" velocity="1"/></joint>'
        for i, (axis, shift) in enumerate(zip(axes, SHIFTS_M, strict=True))
    ]
    for name, (link, at) in MARKERS_M.items():
        links.append(f'<link name="{name}_marker"/>')
        joints.append(
            f'<joint name="{name}_mount" type="fixed"><parent link="l{link}"/><child link="{name}_marker"/>'
            f'<origin xyz="{" ".join(map(str, at))}"/></joint>'
        )
    return f'<robot name="chain">{"".join(links)}{"".join(joints)}</robot>\n'


def write_chain(
    folder: Path,
    seed: int,
    zeros_rad: dict[int, float],
    small: float = 1.0,
    scale: float = 1.0,
    model_axes: Axes = AXES,
    postures: int = 90,
    noise_m: float = 1e-4,
) -> Path:
    """Random postures; zeros by 1 mrad, axes by 0.6 mrad and links by 0.4 mm (one standard deviation, times `small`) beside the
    model, and further zeros of some joints by their numbers from 0. The tracker's lengths are true ones times `scale`."""
    rng = np.random.default_rng(seed)
    count = len(model_axes)
    zeros = small * rng.normal(0.0, 1e-3, count)
    for joint, more in zeros_rad.items():
        zeros[joint] += more
    axes = [np.array(axis, float) + small * rng.normal(0.0, 6e-4, 3) for axis in model_axes]
    shifts = [np.array(shift) + small * rng.normal(0.0, 4e-4, 3) for shift in SHIFTS_M]
    frames, points = [f"frame,posture,{','.join(f'a{i + 1}' for i in range(count))}"], ["frame,marker,x,y,z"]
    for number in range(postures):
        q = rng.uniform(-1.6, 1.6, count)
        frames.append(f"{number},{number},{','.join(map(repr, map(float, q)))}")
        turn, at = np.eye(3), np.zeros(3)
        where = {0: (turn, at)}
        for i in range(count):
            at = at + turn @ shifts[i]
            turn = turn @ about(axes[i], float(q[i] + zeros[i]))
            where[i + 1] = (turn, at)
        for name, (link, place) in MARKERS_M.items():
            turned, base = where[link]
            at_scale = scale * (base + turned @ np.array(place))
            seen = TURN @ at_scale + (0.5, -1.0, 0.3) + rng.normal(0.0, noise_m, 3)
            points.append(f"{number},{name},{','.join(map(repr, map(float, seen)))}")
    folder.mkdir()
    markers = "".join(
        f'\n[[markers]]\nname = "{name}"\nlink = "{name}_marker"\ndiameter = 0.0\nmount = "unknown"\n'
        for name in MARKERS_M
    )
    (folder / "session.toml").write_text(
        'format = "mirror-posture/session"\nversion = 1\nrobot = "robot.urdf"\nroot = "l0"\n'
        f'gravity = [0.0, 0.0, -9.81]\n{markers}\n[points]\nframe = "unknown"\n\n[noise]\npoint_std = {noise_m}\n',
        encoding="utf-8",
    )
    (folder / "robot.urdf").write_text(urdf(model_axes), encoding="utf-8")
    (folder / "frames.csv").write_text("\n".join(frames) + "\n", encoding="utf-8")
    (folder / "points.csv").write_text("\n".join(points) + "\n", encoding="utf-8")
    return folder
