"""Native calls with mutated arguments: each ends, and without a panic.

`python tests/python/native_calls.py --calls 100000` runs many; a short run is a test.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from mirror_posture import _core
from session_folder import URDF

Call = tuple[str, Callable[..., Any], list[Any], dict[str, Any]]
FRAMES, CORNERS, MARKERS = 6, 6, 2
ODD_NUMBERS = [0.0, -0.0, -1.0, 1e-308, 1e308, -1e300, float("nan"), float("inf"), float("-inf"), 1e16, 3]
ODD_WHOLE = [0, -1, 1, 2, 2**31, 2**63 - 1, -(2**63), 2**64, 10**30]
ODD_TEXTS = ["", "\0", "nan", "hand", "base", "elbow", "squared", "pose", "x" * 1000, "<", "{}", "[1]", "ü"]
LONGEST_S, MOST_BYTES = 20.0, 6_000_000_000
"""Of computing by one call, and of address space."""
MOST_NUMBERS = 10_000
"""Arrays that mutations made larger than this start anew: large calls test the memory, not the checks."""


def calls() -> list[Call]:
    """Valid calls, one of every kind."""
    rng = np.random.default_rng(0)
    camera = _core.Camera(
        (800, 600), (693.0, 694.0), (399.5, 299.5), "plumb_bob", [0.01, -0.02, 0.001, -0.001, 0.003]
    )
    robot = _core.Robot.from_urdf_str(URDF)
    q = rng.uniform(-1, 0.5, (FRAMES, 2))
    pose = np.eye(4)
    pose[:3, 3] = [0.0, 0.075, 0.0]
    views = rng.uniform([250.0, 200.0], [550.0, 400.0], (FRAMES, CORNERS, 2))
    x = np.array([[x, y] for y in (0.0, 60.0) for x in (0.0, 60.0, 120.0)])
    views = (
        300.0
        + x[None, ::1] * rng.uniform(0.9, 1.1, (FRAMES, 1, 2))
        + rng.normal(0, 0.1, (FRAMES, CORNERS, 2))
    )
    rig = _core.Rig(camera, (3, 2), 0.014, pose)
    mirrors = rig.estimate_mirrors(views)
    rows = np.tile(np.arange(3), (MARKERS, 1)).astype(np.int64)
    markers_px = rng.uniform(250, 400, (MARKERS, 3, 2))
    seen = np.ones((FRAMES, CORNERS), dtype=bool)
    marker_px, marker_seen = (
        rng.uniform(250, 400, (FRAMES, MARKERS, 2)),
        np.ones((FRAMES, MARKERS), dtype=bool),
    )
    header = {
        "root_link": "base", "gravity_m_per_s2": [0, 0, -9.81],
        "camera": {"size_px": [800, 600], "focal_px": [693.0, 693.0], "center_px": [399.5, 299.5], "model": "plumb_bob",
                   "distortion": [0.0] * 5},
        "camera_link": "camera_optical", "board": {"link": "chest_board", "corners": [3, 2], "square_m": 0.014},
        "glass_thickness_m": 0.003, "refractive_index": 1.52,
        "markers": [{"name": "hand", "link": "hand_marker", "diameter_m": 0.0116, "mount_known": True},
                    {"name": "elbow", "link": "elbow_marker", "diameter_m": 0.0, "mount_known": False}],
        "points_frame": "unknown", "ordered": True, "timed": True, "pixel_std_px": 0.2, "point_std_m": 0.001,
        "joint_names": ["shoulder", "elbow"],
    }  # fmt: skip
    mirror = SimpleNamespace(board_px=views, board_seen=seen, marker_px=marker_px, marker_seen=marker_seen)
    direct = SimpleNamespace(board_px=views, board_seen=~seen, marker_px=marker_px, marker_seen=~marker_seen)
    whole = np.arange(FRAMES, dtype=np.int64)
    recorded = [URDF, header, whole, whole, whole.astype(float), q, mirror, direct,
                rng.normal(0, 0.2, (FRAMES, MARKERS, 3)), marker_seen]  # fmt: skip
    given = [recorded[0], json.dumps(header), *recorded[2:]]
    recording = _core.GapRecording(*given)
    own = SimpleNamespace(name="mine", words="mine", parameters=[("p", 0.01, None)],
                          places=[("joint:elbow", np.ones((FRAMES, 1)))])  # fmt: skip
    corrector = {
        "camera_link": "camera_optical", "board_link": "chest_board", "markers": [("hand", "hand_marker")],
        "posture": q[0], "held": ["shoulder"], "start": q[1], "gain": 0.5, "largest_step_rad": 0.2, "mu_m_per_rad": None,
        "step_std_rad": 0.01, "jacobian": "reference", "tolerance_m": 0.001, "wrong_converged": 0.05, "looks": 10,
        "patience": 3, "least_progress": 0.1, "divergence": 2.0, "retries": 2, "largest_gap_m": 0.1, "play_m": 0.001,
        "largest_correction_rad": 0.5,
    }  # fmt: skip
    measure = {
        "camera": camera, "board_corners": (3, 2), "square_m": 0.014, "diameters_m": [0.0116, 0.0], "glass_thickness_m": 0.0,
        "refractive_index": 1.52, "posture": [0, 0, 0, 1, 1, 1], "camera_from_board": np.tile(pose, (FRAMES, 1, 1)),
        "board_px": views, "board_seen": seen, "marker_px": marker_px, "marker_seen": marker_seen,
        "direct_px": marker_px, "direct_seen": ~marker_seen,
    }  # fmt: skip
    drawn = {
        "size_px": (64, 48), "focal_px": (60.0, 60.0), "center_px": (31.5, 23.5), "distortion": [], "camera_link": "camera_optical",
        "board": ("chest_board", 3, 2, 0.014), "balls": [("hand", "hand_marker", 0.0116, [1.0, 0.0, 0.0])],
    }  # fmt: skip
    poses = robot.forward_kinematics(q)
    sketch = {
        "mirror_center_m": [0.0, 0.0, 0.4], "mirror_normal": [0.0, 0.1, -1.0], "glass_thickness_m": 0.003, "refractive_index": 1.52,
        "curvature_per_m": 0.0, "mirror_size_m": (0.5, 0.5), "ghosts": True, "floor_m": -0.3, "grid": 1, "edge_grid": 2,
        "motion_px": [0.0, 0.0], "blur_px": 0.5, "exposure": 1.0, "full_well_electrons": 8000.0, "read_noise_electrons": 5.0,
        "gamma": 2.2, "jpeg_quality": 90, "seed": 1,
    }  # fmt: skip
    points = rng.uniform([-0.1, -0.1, 0.3], [0.1, 0.1, 0.6], (FRAMES, 3))
    picture = rng.integers(0, 80, (48, 64, 3)).astype(np.uint8)
    v, u = np.mgrid[:48, :64]
    picture[(u - 30) ** 2 + (v - 22) ** 2 < 100] = (30, 30, 220)
    around = 2 * np.pi * np.arange(24) / 24
    circle = np.column_stack([30 + 10 * np.cos(around), 22 + 10 * np.sin(around)])
    errors = [
        ("shoulder", "offset", 0.01, None),
        ("elbow", "coupling", 0.02, "shoulder"),
        ("elbow", "play", 0.03, None),
    ]
    foot = np.tile([0.0, 0.0, 0.3], (FRAMES, 1))

    def made(
        made_by: Callable[..., Any], *then: tuple[str, list[Any], dict[str, Any]]
    ) -> Callable[..., None]:
        """The maker's call, and calls of what it made."""

        def call(*a: Any, **k: Any) -> None:
            thing = made_by(*a, **k)
            for name, args, kwargs in then:
                getattr(thing, name)(*args, **kwargs)

        return call

    def record(*args: Any) -> None:
        text = args[1] if isinstance(args[1], str) else json.dumps(args[1], default=str)
        made = _core.GapRecording(args[0], text, *args[2:])
        made.quantities()
        made.link_bends()

    def plan(*args: Any) -> None:
        made = _core.PlannedSession(recording)
        made.choose(*args)
        made.foresee()

    cov = np.tile(np.eye(3) * 1e-6, (1, 1, 1))
    return [
        ("Camera", _core.Camera, [(800, 600), (693.0, 694.0), (399.5, 299.5), "plumb_bob", [0.01] * 5], {}),
        ("project", camera.project, [points], {}),
        ("unproject", camera.unproject, [views[0]], {}),
        ("from_urdf_str", _core.Robot.from_urdf_str, [URDF], {}),
        ("forward_kinematics", robot.forward_kinematics, [q], {}),
        ("link_poses", robot.link_poses, [q, ["hand_marker"]], {}),
        ("joint_twists", robot.joint_twists, [q], {}),
        ("chain_joints", robot.chain_joints, ["base", "hand_marker"], {}),
        ("points", robot.points, [q, "base", "hand_marker", np.zeros(3)], {}),
        ("point_jacobians", robot.point_jacobians, [q, "base", "hand_marker", np.zeros(3)], {}),
        ("gravity_torques", robot.gravity_torques, [q, np.array([0, 0, -9.81]), "base"], {}),
        ("gravity_moments", robot.gravity_moments, [q, np.array([0, 0, -9.81]), "base"], {}),
        ("Rig", made(_core.Rig, ("estimate_mirrors", [views], {})), [camera, (3, 2), 0.014, pose, np.eye(6) * 1e-6, 0.003, 1.52], {}),
        ("estimate_mirrors", rig.estimate_mirrors, [views, "maximum_likelihood", 0.2, "squared"], {}),
        ("find_rests", _core.find_rests, [np.arange(40) * 0.05, np.repeat(rng.normal(0, 1, (4, 2)), 10, axis=0), 0.003, 0.2], {}),
        ("match_clocks", _core.match_clocks,
         [np.arange(40) * 0.05, np.repeat(rng.normal(0, 1, (4, 2)), 10, axis=0), np.arange(20) * 0.1, np.abs(rng.normal(0, 1, 20)), 0.5], {}),
        ("planar_poses", _core.planar_poses, [camera, (3, 2), 0.014, views, 0.2, "squared"], {}),
        ("virtual_rays", _core.virtual_rays, [mirrors, whole, views[:, 0], 0.2], {}),
        ("triangulate", _core.triangulate, [mirrors, rows, markers_px, 0.2, "maximum_likelihood", 0.01], {}),
        ("two_view_markers", _core.two_view_markers,
         [camera, np.array([0.0, 0.07, 0.0]), rng.uniform(-0.1, 0.6, (5, 2, 3)), rng.uniform(200, 500, (5, 2, 2)), 0.01], {}),
        ("see_in_mirror", _core.see_in_mirror, [camera, foot, points, 0.003, 1.52, 0.01], {}),
        ("ball_centroids", _core.ball_centroids, [camera, points, 0.0116], {}),
        ("ball_center_pixels", _core.ball_center_pixels, [camera, views[0], 0.0116, np.full(CORNERS, 0.4)], {}),
        ("correction_step", _core.correction_step,
         [rng.normal(0, 0.1, (3, 2)), np.full((1, 3), 0.01), cov, q[0], np.full(2, -2.0), np.full(2, 2.0), [True, True]],
         {"gain": 0.5, "largest_step_rad": 0.2, "mu_m_per_rad": None, "step_std_rad": 0.01}),
        ("Corrector", made(_core.Corrector, ("narrow", ["elbow", -1.0, 1.0], {}), ("observe", [
            [True], np.array([[0.1, 0.0, 0.1]]), cov, np.array([1.0]), [3]], {}), ("records", [], {})), [robot], corrector),
        ("observe", lambda *a: _core.Corrector(robot, **corrector).observe(*a),
         [[True], np.array([[0.1, 0.0, 0.1]]), cov, np.array([1.0]), [3]], {}),
        ("MeasureInput", made(_core.MeasureInput, ("ladder", ["maximum_likelihood"], {
            "marker_noise_px": 0.2, "least_parallax_rad": 0.01})), [], measure),
        ("ladder", _core.MeasureInput(**measure).ladder, ["point_pair"],
         {"corner_noise_px": 0.2, "marker_noise_px": 0.2, "least_parallax_rad": 0.01, "camera_from_board_covariance": np.eye(6)}),
        ("joint", _core.MeasureInput(**measure).joint, [],
         {"corner_noise_px": 0.2, "marker_noise_px": 0.2, "least_parallax_rad": 0.01, "camera_from_board_covariance": np.eye(6)}),
        ("check_views", _core.check_views,
         [camera, (3, 2), 0.014, np.tile(pose, (FRAMES, 1, 1)), views, marker_px, marker_seen, rng.uniform(-0.1, 0.2, (FRAMES, MARKERS, 3)),
          0.003, 1.52, 0.2, False], {}),
        ("calibrate_mirror_views", _core.calibrate_mirror_views,
         [camera, (3, 2), 0.014, views, 0.2, "squared", pose, np.eye(6) * 1e-4, 5.0, 0.003, 1.52], {}),
        ("calibrate_second_camera", _core.calibrate_second_camera,
         [camera, camera, (3, 2, 0.014), (3, 2, 0.014), views, views, views], {}),
        ("pattern_curve", _core.pattern_curve, [np.full((48, 64), 90, np.uint8), np.zeros((48, 64), np.float32), 20.0, 0.1, None], {}),
        ("measure_balls", _core.measure_balls, [picture, np.array([[30.0, 22.0, 10.0], [5.0, 40.0, 6.0]]), np.array([[4.0, 20.0]] * 2), camera, (1, 1), 0.0], {}),
        ("codec_covariances", _core.codec_covariances, [picture, np.array([[30.0, 22.0, 10.0], [5.0, 40.0, 6.0]]), np.array([[4.0, 20.0]] * 2), camera, (2, 2),
         [[9] * 64, [12] * 64], (2, 2), [1.2, None]], {}),
        ("chroma_step", _core.chroma_step, [picture], {}),
        ("color_regions", _core.color_regions, [picture, [[0.0, 12.0, 0.5, 0.25], [120.0, 20.0, 0.3, 0.2]], 20, 4], {}),
        ("fit_circle_by_consensus", _core.fit_circle_by_consensus, [circle, 3.0, 30.0, 1.0], {}),
        ("FeedForward", made(_core.FeedForward, ("commands", [q], {})), [robot, "base", np.array([0, 0, -9.81]), errors], {}),
        ("PictureMaker", _core.PictureMaker, [URDF], drawn),
        ("draw", _core.PictureMaker(URDF, **drawn).draw, [dict(zip(robot.link_names, poses[0], strict=True))], sketch),
        ("drawn", lambda poses, how, **k: _core.PictureMaker(URDF, **k).draw(poses, **how),
         [dict(zip(robot.link_names, poses[0], strict=True)), sketch], drawn),
        ("GapRecording", record, recorded, {}),
        ("GapRecording again", record, recorded, {}),
        ("PlannedSession", plan, [[[0], [1, 2]], [0, 0], [0, 1], [2]], {}),
        ("diagnose", recording.diagnose, [["pairing"], 1, [("other", recording, [])], [own], False], {}),
    ]  # fmt: skip


@dataclass
class Mutator:
    """Changes one to three places in the arguments of a call."""

    chance: random.Random
    rng: np.random.Generator = field(init=False)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.chance.randrange(2**32))

    def arguments(self, args: list[Any], kwargs: dict[str, Any]) -> tuple[list[Any], dict[str, Any]]:
        args, kwargs = list(args), dict(kwargs)
        for _ in range(self.chance.choice([1, 1, 2, 3])):
            k = self.chance.randrange(len(args) + len(kwargs))
            if k < len(args):
                args[k] = self.value(args[k])
            else:
                name = list(kwargs)[k - len(args)]
                kwargs[name] = self.value(kwargs[name])
        return args, kwargs

    def value(self, value: Any) -> Any:
        chance = self.chance
        if chance.random() < 0.04:
            return chance.choice(
                [None, "x", 3, 1.5, [], {}, (), object(), np.zeros(0), b"x", True, float("nan"), 1j]
            )
        if isinstance(value, np.ndarray):
            try:
                return self.array(value)
            # Odd values of an earlier mutation that the new type does not hold.
            except (OverflowError, ValueError, TypeError):
                return value
        if isinstance(value, SimpleNamespace):
            name = chance.choice(list(vars(value)))
            return SimpleNamespace(**{**vars(value), name: self.value(getattr(value, name))})
        if isinstance(value, dict):
            if not value:
                return {"a": 1}
            name = chance.choice(list(value))
            if chance.random() < 0.05:
                return {k: v for k, v in value.items() if k != name}
            return {**value, name: self.value(value[name])}
        if isinstance(value, (list, tuple)):
            items = list(value)
            act = chance.randrange(4)
            if not items or act == 0:
                items = items * 2 + items[:1]
            elif act == 1:
                items.pop(chance.randrange(len(items)))
            else:
                k = chance.randrange(len(items))
                items[k] = self.value(items[k])
            return type(value)(items)
        if isinstance(value, bool):
            return not value
        if isinstance(value, int):
            return chance.choice(ODD_WHOLE)
        if isinstance(value, float):
            return chance.choice([*ODD_NUMBERS, value * 10, -value])
        if isinstance(value, str):
            if len(value) < 40:
                return chance.choice(ODD_TEXTS)
            start = chance.randrange(len(value))
            return value[:start] + chance.choice(ODD_TEXTS) + value[start + chance.randrange(30) :]
        return chance.choice([value, None, 0])

    def array(self, value: np.ndarray) -> Any:
        chance, rng = self.chance, self.rng
        if value.ndim == 0 or value.size == 0 or value.size > MOST_NUMBERS:
            return np.ones((1,) * chance.randrange(4))
        act = chance.randrange(12)
        if act == 0:
            return value[:0]
        if act == 1:
            axis = chance.randrange(value.ndim)
            return value.take(range(max(0, value.shape[axis] - 1)), axis=axis)
        if act == 2:
            return np.repeat(value, 2, axis=chance.randrange(value.ndim))
        if act == 3:
            return value[None]
        if act == 4:
            return value.reshape(-1)
        if act == 5:
            return value.astype(
                chance.choice([np.float32, np.int32, np.int8, bool, np.uint64, object, np.float16])
            )
        if act == 6:
            return value.tolist()
        if act == 7:
            return value[::-1].T
        if act == 8:
            return np.broadcast_to(value.reshape(-1)[:1], value.shape)
        out = value.copy()
        if out.size:
            where = rng.integers(out.size, size=chance.choice([1, 1, out.size]))
            if out.dtype == bool:
                out.flat[where] ^= True
            elif out.dtype == np.int64:
                out.flat[where] = chance.choice([k for k in ODD_WHOLE if abs(k) < 2**63])
            elif out.dtype.kind == "f":
                out.flat[where] = chance.choice(ODD_NUMBERS)
        return out


def run(
    count: int,
    seed: int,
    seconds: float = float("inf"),
    told: Callable[[int, str], object] = lambda k, n: None,
) -> Counter[str]:
    """Runs mutated calls, no longer than some seconds; how each ended, by kind. A panic raises (its class is no `Exception`).

    Every call has a chance of its own, from the seed and its number; `told` hears of each before it is made.
    """
    end = time.monotonic() + seconds
    valid, ends = calls(), Counter[str]()
    for number in range(count):
        if time.monotonic() > end:
            break
        ends[one(valid, f"{seed}-{number}", lambda name, k=number: told(k, name))] += 1  # type: ignore[misc]
    return ends


def one(valid: list[Call], seed: str, told: Callable[[str], object] = lambda name: None) -> str:
    """One mutated call; how it ended."""
    chance = random.Random(seed)
    # Diagnoses take a hundred times as long as the others.
    weights = [0.02 if name in ("diagnose", "calibrate_second_camera") else 1.0 for name, *_ in valid]
    name, function, args, kwargs = chance.choices(valid, weights)[0]
    args, kwargs = Mutator(chance).arguments(args, kwargs)
    told(name)
    begun = time.process_time()
    try:
        with np.errstate(all="ignore"):
            function(*args, **kwargs)
        ended = "answer"
    except (
        _core.MirrorPostureError,
        TypeError,
        ValueError,
        OverflowError,
        KeyError,
        AttributeError,
    ) as error:
        ended = type(error).__name__
    except BaseException as error:
        raise AssertionError(
            f"{seed}: {name}({args!r}, {kwargs!r}): {type(error).__name__}: {error}"
        ) from error
    taken = time.process_time() - begun
    assert taken < LONGEST_S, f"{seed}: {name}({args!r}, {kwargs!r}) took {taken:.1f} s of computing"
    return ended


def guarded(count: int, seed: int, seconds: float) -> Counter[str]:
    """As `run`, in a process whose memory is bounded: one that dies is told by its last call."""
    with tempfile.TemporaryDirectory() as place:
        log, result = Path(place) / "log", Path(place) / "result"
        child = os.fork()
        if child == 0:
            try:
                resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
                with log.open("w") as stream:

                    def told(number: int, name: str) -> None:
                        stream.seek(0)
                        stream.write(f"{seed}-{number} {name:<30}")
                        stream.flush()

                    result.write_text(json.dumps(run(count, seed, seconds, told)))
                os._exit(0)
            except BaseException as error:
                print(str(error)[:3000], file=sys.stderr, flush=True)
                os._exit(1)
        status = os.waitpid(child, 0)[1]
        assert status == 0, f"ended with status {status} in call {log.read_text().strip()}"
        return Counter(json.loads(result.read_text()))


if __name__ == "__main__":
    import warnings

    warnings.simplefilter("ignore")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--only", help="One call by its seed and number, as an error names it: 1-4711.")
    options = parser.parse_args()
    if options.only:
        print(one(calls(), options.only, print))
    else:
        ends = guarded(options.calls, options.seed, options.seconds)
        print(f"{sum(ends.values())} calls: {dict(ends)}")
