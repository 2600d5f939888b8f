"""How far a named model truly shrinks the gap: its pixels against the noise-free ones.

The named causes, with the values that the diagnosis claims, go into this package's own model. With r the RMS distance of its
marker pixels from the noise-free ones (each frame's mirror plane fitted anew), and σ the noise of a blob, a gap
with noise is √(r² + σ²), and

    closed = (√(r₀² + σ²) − √(r₁² + σ²)) / (√(r₀² + σ²) − σ)

for the nominal model (0) and the named one (1): what `gap.closed` of a diagnosis claims.
"""

from __future__ import annotations

import csv
import hashlib
import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import BlindError
from .hypotheses import Hypothesis, all_hypotheses
from .kinematics import Change
from .optics import Lens
from .reference import Reference, clean_pixels
from .robots import Robot, board_points, read_bodies
from .simulate import Case
from .truth import Commands

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib
from .whole_file import write_whole

Array = NDArray[np.float64]

PARAMETERS = {
    "joint_offset": ("offset_rad",),
    "gear_ratio": ("scale_error",),
    "gear_eccentricity": ("sin_rad", "cos_rad"),
    "drift": ("rate_rad_per_s",),
    "backlash": ("width_rad",),
    "stiction": ("deadband_rad", "droop_rad_per_nm"),
    "joint_compliance": ("compliance_rad_per_nm",),
    "axis_tilt": ("tilt_1_rad", "tilt_2_rad"),
    "joint_coupling": ("coupling",),
    "link_bending": ("compliance_rad_per_nm",),
    "link_length": ("dx_m", "dy_m", "dz_m"),
    "marker_mount": ("dx_m", "dy_m", "dz_m"),
    "camera_mount": ("rx_rad", "ry_rad", "rz_rad", "dx_m", "dy_m", "dz_m"),
    "camera_focal": ("scale_error",),
    "camera_center": ("du_px", "dv_px"),
    "lens_distortion": ("dk1",),
    "board_scale": ("scale_error",),
    "mirror_glass": ("thickness_m",),
    "mirror_curvature": ("curvature_per_m",),
}
"""The vocabulary's parameters in the order of a hypothesis'; one that is not told is 0 (stiction's droop may be told as a cause
of its own)."""
LEAST_OWN_CLOSED = 0.95
"""Where the true causes themselves close less than this in this package's own model (a play whose width depends on the load, a path
that MuJoCo's friction decides otherwise), it cannot judge what others close."""
PLANE_STEPS = 4


@dataclass(frozen=True)
class TruePixels:
    """A session's noise-free pixels and planes, as they lie beside its answer."""

    corners_px: Array
    blobs_px: Array
    planes_m: Array


def keep_pixels(case: Case, path: Path) -> str:
    """Write a case's noise-free pixels; returns the file's SHA-256, which goes into the sealed answer."""
    corners, blobs, planes = clean_pixels(case)
    path.parent.mkdir(parents=True, exist_ok=True)
    packed = io.BytesIO()
    np.savez_compressed(
        packed, corners_px=corners.astype(np.float32), blobs_px=blobs.astype(np.float32), planes_m=planes
    )
    write_whole(path, packed.getvalue())
    return hashlib.sha256(packed.getvalue()).hexdigest()


def load_pixels(path: Path, sha256: str) -> TruePixels:
    """Raises BlindError where the file is missing or is not the one whose hash the answer has."""
    if not path.is_file():
        raise BlindError(f"{path} is missing: the noise-free pixels belong to the answer")
    if hashlib.sha256(path.read_bytes()).hexdigest() != sha256:
        raise BlindError(f"{path} is not the file that the sealed answer names: it was changed afterwards")
    with np.load(path) as kept:
        return TruePixels(*(kept[k].astype(float) for k in ("corners_px", "blobs_px", "planes_m")))


def reference_of_folder(session: Path, pixels: TruePixels, answer: dict[str, Any]) -> Reference:
    """The reference of a session on disk."""
    with (session / "session.toml").open("rb") as file:
        meta = tomllib.load(file)
    urdf = (session / meta["robot"]).read_text(encoding="utf-8")
    with (session / "frames.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    joints = [c for c in rows[0] if c not in ("frame", "posture", "time_s", "image")]
    of_frame = np.array([int(r["posture"]) for r in rows])
    postures = int(of_frame.max()) + 1
    q, time = np.zeros((postures, len(joints))), np.zeros(postures)
    for row, p in zip(reversed(rows), of_frame[::-1], strict=True):
        q[p], time[p] = [float(row[j]) for j in joints], float(row["time_s"])
    robot = Robot(
        "",
        urdf,
        meta["root"],
        read_bodies(urdf, meta["root"]),
        joints,
        {},
        [m["name"] for m in meta["markers"]],
        float(meta["markers"][0]["diameter"]),
        (int(meta["board"]["corners"][0]), int(meta["board"]["corners"][1])),
        float(meta["board"]["square"]),
        (0.0, 0.0),
        (0, 0),
        (0.0, 0.0),
        0.0,
        board_link=meta["board"]["link"],
    )
    return Reference(
        robot,
        np.array(meta["gravity"], dtype=float),
        Commands(joints, q, time),
        of_frame,
        _lens(session / meta["camera"]),
        board_points(robot),
        pixels.corners_px,
        pixels.blobs_px,
        float(answer["pixel_std_corner"]),
        float(answer["pixel_std_blob"]),
    )


def _lens(path: Path) -> Lens:
    """The nominal lens from the few lines that `write_session` wrote."""
    numbers: dict[str, list[float]] = {}
    section = ""
    for line in path.read_text(encoding="utf-8").splitlines():
        key, _, value = line.strip().partition(":")
        if not line.startswith(" "):
            section = key
        text = value.strip().strip("[]")
        try:
            numbers[f"{section}.{key}"] = [float(x) for x in text.split(",")] if text else []
        except ValueError:
            continue
    k = numbers["camera_matrix.data"]
    size = (int(numbers["image_width.image_width"][0]), int(numbers["image_height.image_height"][0]))
    distortion = np.array(numbers["distortion_coefficients.data"])
    return Lens(np.array([k[0], k[4]]), np.array([k[2], k[5]]), distortion, size)


def is_judge(ref: Reference, planes: Array, truths: Sequence[dict[str, Any]]) -> bool:
    """Whether this package's own model, given the true causes, closes the gap of its simulator's body; true where a true cause has no law
    that can be applied."""
    named = [
        {**t, "parameters": {n: {"value": t[n]} for n in PARAMETERS.get(t["effect"], ()) if n in t}}
        for t in truths
    ]
    own = true_closed(ref, planes, named, frictions_of(truths))
    return own is None or own >= LEAST_OWN_CLOSED


def frictions_of(truths: Sequence[dict[str, Any]]) -> dict[str, float]:
    """The true friction, N m, at each joint with play."""
    return {
        str(t["at"]).removeprefix("joint:"): float(t["friction_nm"]) for t in truths if "friction_nm" in t
    }


def true_closed(
    ref: Reference,
    planes: Array,
    causes: Sequence[dict[str, Any]],
    friction_nm: dict[str, float] | None = None,
) -> float | None:
    """What the named causes truly close; None where one of them is no law that can be applied (`geometry`,
    `pairing`), or where there is no gap to close. `friction_nm` is the true friction of joints with play."""
    places = {str(c["at"]).removeprefix("joint:") for c in causes}
    options: list[list[Hypothesis]] = []
    if causes:
        everything = all_hypotheses(ref.robot, ref.commands, ref.gravity, friction_nm, only=places)
        for c in causes:
            fitting = [h for h in everything if h.effect == c["effect"] and h.at == c["at"]]
            if not fitting or c["effect"] not in PARAMETERS:
                return None
            options.append(fitting)
    parameters = [_values(c) for c in causes]
    sigma = ref.blob_std_px
    before = _rms_px(ref, planes, Change())
    whole = float(np.hypot(before, sigma))
    if whole - sigma <= 1e-3 * sigma:
        return None
    best = before if not causes else np.inf
    # A diagnosis does not report which friction it assumed at a loose joint: the best one is used.
    for chosen in product(*options) if causes else ():
        change = Change()
        for h, p in zip(chosen, parameters, strict=True):
            h.apply(change, p)
        best = min(best, _rms_px(ref, planes, change))
    return float((whole - np.hypot(best, sigma)) / (whole - sigma))


def _values(cause: dict[str, Any]) -> Array:
    told = cause.get("parameters", {})
    return np.array(
        [float(told[n]["value"]) if n in told else 0.0 for n in PARAMETERS.get(cause["effect"], ())]
    )


def _rms_px(ref: Reference, planes: Array, change: Change) -> float:
    """RMS distance in u or v of the markers' pixels from the noise-free ones, planes fitted to all that is seen."""
    points = ref.points(change)
    planes = planes.copy()
    for _ in range(PLANE_STEPS):
        r = ref.residual(points, planes, change)
        jacobian, _ = ref.plane_basis(points, planes, change, r)
        normal = np.einsum("fki,fkj->fij", jacobian, jacobian) + 1e-12 * np.eye(3)
        planes -= np.linalg.solve(normal, np.einsum("fki,fk->fi", jacobian, r)[..., None])[..., 0]
    left = ref.residual(points, planes, change).reshape(len(points), -1, 2)[:, ref.count :] * ref.blob_std_px
    seen = ref.seen[:, ref.count :]
    return float(np.sqrt(np.mean(left[seen] ** 2)))
