"""What must hold for any bytes at a border that Python reads: a value, or one line that says why not.

A target is a function of bytes that returns whether they were taken, and raises where something else happens. The borders of the core
(URDF, visuals, cameras, recordings) have theirs in `fuzz/`. `fuzz.py` runs them; a short run is a test.
"""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.csv
import pyarrow.parquet
from PIL import Image

from fuzz_mutations import Target
from fuzz_recordings import RECORDINGS
from mirror_posture import MirrorPostureError, Robot, _core, load_session
from session_folder import CAMERA, DETECTIONS, FILES, FRAMES, POINTS, SESSION, URDF, write_folder

SERVOS = """[bus]
port = "/dev/ttyUSB0"
baudrate = 1000000
speed_rad_per_s = 2.0
acceleration_rad_per_s2 = 20.0
{torque}
at_end = "hold"
end_with_parent = true

[joints.shoulder]
id = 1
zero_counts = 2048
direction = 1
upper_rad = 0.4

[joints.elbow]
id = 2
zero_counts = 2048
direction = -1
lower_rad = -1.0
upper_rad = 1.0
model = "XM430-W350"

[rest]
shoulder = 0.1
"""
STATES = "time_s,shoulder,elbow,measured:elbow\n" + "".join(
    f"{0.5 * k},{0.1},{0.2},{0.21}\n" for k in range(12)
)
ACCELEROMETER = """frame,posture,time_s,image,shoulder,elbow,accelerometer:base:x,accelerometer:base:y,accelerometer:base:z
0,0,0.0,,0.1,0.2,0.1,0.2,9.8
1,0,2.0,,0.1,0.2,,,
5,1,4.0,,-0.3,0.4,0.3,0.4,9.7
"""
HEADER = {
    "root_link": "base", "gravity_m_per_s2": [0, 0, -9.81],
    "camera": {"size_px": [800, 600], "focal_px": [693.0, 693.0], "center_px": [399.5, 299.5], "model": "plumb_bob",
               "distortion": [0.0, 0.0, 0.0, 0.0, 0.0]},
    "camera_link": "camera_optical", "board": {"link": "chest_board", "corners": [3, 2], "square_m": 0.014},
    "glass_thickness_m": 0.003, "refractive_index": 1.52,
    "markers": [{"name": "hand", "link": "hand_marker", "diameter_m": 0.0116, "mount_known": True, "tolerance_m": None},
                {"name": "elbow", "link": "elbow_marker", "diameter_m": 0.0, "mount_known": False, "tolerance_m": 0.01}],
    "points_frame": "unknown", "ordered": True, "timed": True, "pixel_std_px": 0.2, "point_std_m": 0.001,
    "joint_names": ["shoulder", "elbow"], "board_tolerance": [0.001, None], "camera_tolerance": [None, 0.01],
}  # fmt: skip
READING = {
    "posture": 0, "measured": [True], "point_in_board_m": [[0.1, 0.2, 0.3]], "covariance_m2": [np.eye(3).tolist()],
    "chi_squared": [1.5], "degrees_of_freedom": [3], "reasons": [None],
}  # fmt: skip
MOUNT = {"camera_from_board": np.eye(4).tolist(), "covariance": (1e-6 * np.eye(6)).tolist()}
CORPUS = Path(__file__).parents[2] / "fuzz" / "corpus"
"""Inputs that are kept, a folder each target: what once failed, and sound ones that are too long to stand here."""


@cache
def scratch() -> Path:
    """A folder of this process, in memory where there is one."""
    memory = Path("/dev/shm")
    holder = tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None)
    HOLDERS.append(holder)
    return Path(holder.name)


HOLDERS: list[Any] = []


@cache
def robot() -> Robot:
    return Robot.from_urdf_text(URDF)


@cache
def session() -> Any:
    return load_session(write_folder(scratch() / "sound"))


def written(name: str, data: bytes) -> Path:
    file = scratch() / name
    file.write_bytes(data)
    return file


def session_toml(data: bytes) -> bool:
    from mirror_posture.session.metadata import load_metadata

    written("session.toml", data)
    found = load_metadata(scratch())
    assert np.isfinite(found.gravity_m_per_s2).all() and found.robot and found.root
    return True


def camera_file(data: bytes) -> bool:
    from mirror_posture.session.camera_info import dump_camera_info, load_camera_info

    found = load_camera_info(written("camera.yaml", data), "camera.yaml")
    assert found.fx_px > 0 and found.width_px > 0 and np.isfinite([*found.distortion, found.cx_px]).all()
    # What is written is what was read.
    again = load_camera_info(written("again.yaml", dump_camera_info(found).encode()), "again.yaml")
    assert again.fx_px == found.fx_px and len(again.distortion) in (5, 8)
    return True


def frames(name: str) -> Callable[[bytes], bool]:
    def check(data: bytes) -> bool:
        from mirror_posture.session.frames import read_frames
        from mirror_posture.session.tables import read_table

        found, _ = read_frames(read_table(written(name, data)), robot(), True)
        assert np.isfinite(found.commanded).all() and len(found.frame) == len(set(found.frame.tolist()))
        return True

    return check


def detections(name: str) -> Callable[[bytes], bool]:
    def check(data: bytes) -> bool:
        from mirror_posture.session.detections import read_detections
        from mirror_posture.session.tables import read_table

        whole = session()
        names = tuple(marker.name for marker in whole.markers)
        table = read_table(written(name, data))
        for views in read_detections(table, whole.frames, "frames.csv", whole.board, names, (800, 600)):
            assert np.isfinite(views.board_px).all() and np.isfinite(views.marker_px).all()
        return True

    return check


def points(name: str) -> Callable[[bytes], bool]:
    def check(data: bytes) -> bool:
        from mirror_posture.session.points import read_points
        from mirror_posture.session.tables import read_table

        whole = session()
        names = tuple(marker.name for marker in whole.markers)
        found = read_points(read_table(written(name, data)), whole.frames, "frames.csv", names, "unknown")
        assert np.isfinite(found.point_m).all()
        return True

    return check


def states(data: bytes) -> bool:
    from mirror_posture.session.states import read_states
    from mirror_posture.session.tables import read_table

    read_states(read_table(written("states.csv", data)), robot())
    return True


def whole_session(data: bytes) -> bool:
    """The first byte chooses the file, the others stand in it."""
    name = sorted(FILES)[data[0] % len(FILES)] if data else "session.toml"
    folder = write_folder(scratch() / "whole")
    (folder / name).write_bytes(data[1:])
    found = load_session(folder)
    for array in (found.frames.commanded, found.mirror_view.board_px, found.mirror_view.marker_px):
        assert np.isfinite(array).all()
    return True


def diagnosis(data: bytes) -> bool:
    from mirror_posture.diagnosis.formatting import tell_all
    from mirror_posture.diagnosis.next_step import next_step
    from mirror_posture.diagnosis.result import Diagnosis

    found = Diagnosis.load(written("diagnosis.json", data))
    next_step(found)
    for cause in found.causes:
        tell_all(cause)
    return True


def servos(make: str) -> Callable[[bytes], bool]:
    def check(data: bytes) -> bool:
        from mirror_posture.robots import Nominal
        from mirror_posture.robots.servo_config import load_config

        file = written("servos.toml", data)
        nominal = _nominal()
        assert isinstance(nominal, Nominal)
        config = load_config(file, nominal, make)  # type: ignore[arg-type]
        assert 0.0 < config.speed_rad_per_s < np.inf and config.at_end in ("off", "hold")
        for servo in config.servos:
            ends = [servo.counts(x) for x in (servo.limits.lower, servo.limits.upper)]
            assert min(ends) >= 0 and max(ends) < servo.counts_per_turn
        return True

    return check


@cache
def _nominal() -> Any:
    from mirror_posture.robots import Nominal

    return Nominal.load(write_folder(scratch() / "nominal"))


def posture(suffix: str) -> Callable[[bytes], bool]:
    def check(data: bytes) -> bool:
        from mirror_posture.cli.commands._robots import read_posture

        assert np.isfinite(list(read_posture(written("posture" + suffix, data)).values())).all()
        return True

    return check


def mount(data: bytes) -> bool:
    from mirror_posture.cli.commands.measure import _read_mount

    found = _read_mount(written("mount.json", data))
    assert np.isfinite(found.covariance).all()
    return True


def recording(data: bytes) -> bool:
    """A correction's files: its header and what its looks measured."""
    from mirror_posture.correct.recorded import HEADER as HEADER_FILE
    from mirror_posture.correct.recorded import READINGS, read_header, read_readings

    head, _, readings = data.partition(b"\0")
    written(HEADER_FILE, head)
    header = read_header(scratch())
    assert all(isinstance(name, str) for name in header["joints"])
    for past in read_readings(written(READINGS, readings)):
        assert np.isfinite(past.readings.point_in_board_m).all()
    return True


def bindings(data: bytes) -> bool:
    """The recording as the native module takes it: everything that is no array is JSON."""
    count, corners, markers = 3, 6, 2
    seen = np.ones((count, corners), dtype=bool), np.ones((count, markers), dtype=bool)
    view = SimpleNamespace(
        board_px=np.full((count, corners, 2), 300.0), board_seen=seen[0],
        marker_px=np.full((count, markers, 2), 310.0), marker_seen=seen[1],
    )  # fmt: skip
    whole = np.arange(count, dtype=np.int64)
    made = _core.GapRecording(
        URDF, data.decode("utf-8"), whole, whole, whole.astype(float), np.zeros((count, 2)), view, view,
        np.zeros((count, markers, 3)), seen[1],
    )  # fmt: skip
    made.quantities()
    return True


PLAN = b"frame,posture,shoulder,elbow\n0,0,0.1,0.2\n1,0,0.1,0.2\n2,1,-0.3,0.4\n"
CAPTURED = (
    b"frame,posture,time_s,image,shoulder,elbow,measured:elbow\n"
    b"0,0,0,images/0000.png,0.1,0.2,0.2\n2,1,3.5,images/0002.png,-0.3,0.4,0.41\n"
)


def plan(data: bytes) -> bool:
    from mirror_posture.plan import read_plan

    read_plan(written("postures.csv", data), robot())
    return True


def captured(data: bytes) -> bool:
    """A capture that is gone on with."""
    from mirror_posture.capture.recorder import Recorder
    from mirror_posture.plan import read_plan

    folder = scratch() / "captured"
    (folder / "images").mkdir(parents=True, exist_ok=True)
    for name in ("0000", "0002"):
        (folder / f"images/{name}.png").touch()
    (folder / "frames.csv").write_bytes(data)
    assert Recorder(folder, read_plan(written("captured-plan.csv", PLAN), robot())).taken.keys() <= {0, 1, 2}
    return True


def picture(data: bytes) -> bool:
    from mirror_posture.detect import read_picture

    pixels = read_picture(written("picture.png", data))
    assert pixels.ndim == 3 and pixels.shape[2] == 3 and pixels.dtype == np.uint8
    return True


def _pictures() -> Iterator[bytes]:
    values = np.random.default_rng(0).integers(0, 255, (24, 32, 3), dtype=np.uint8)
    kinds: list[tuple[str, str, dict[str, Any]]] = [
        ("PNG", "RGB", {}), ("PNG", "L", {}), ("PNG", "1", {}), ("PNG", "P", {}), ("PNG", "I;16", {}), ("JPEG", "RGB", {}),
        ("JPEG", "L", {}), ("JPEG", "RGB", {"progressive": True}), ("JPEG", "CMYK", {}), ("BMP", "RGB", {}), ("TIFF", "RGB", {}),
        ("TIFF", "RGB", {"compression": "tiff_lzw"}), ("TIFF", "F", {}), ("WEBP", "RGB", {}), ("PPM", "RGB", {}), ("PPM", "L", {}),
    ]  # fmt: skip
    for kind, mode, options in kinds:
        if mode == "I;16":
            image = Image.fromarray(values[..., 0].astype(np.uint16) * 257)
        else:
            image = Image.fromarray(values).convert("L" if mode == "F" else mode)
            image = image.convert(mode)
        if kind == "JPEG" and mode == "RGB":
            exif = Image.Exif()
            exif[0x0112] = 6
            options = {**options, "exif": exif}
        stream = io.BytesIO()
        image.save(stream, kind, **options)
        yield stream.getvalue()


def _parquet(text: str) -> bytes:
    stream = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.csv.read_csv(io.BytesIO(text.encode())), stream)
    return stream.getvalue()


def _json(tree: Any) -> bytes:
    return json.dumps(tree).encode()


def _whole_seeds() -> tuple[bytes, ...]:
    return tuple(bytes([k]) + FILES[name].encode() for k, name in enumerate(sorted(FILES)))


CAMERAS = (
    CAMERA,
    CAMERA.replace("plumb_bob", "rational_polynomial").replace(
        "cols: 5, data: [0.01, -0.02, 0.001, -0.001, 0.003]", "cols: 8, data: [0.1, -0.2, 0, 0, 0.1, 0, 0, 0]"
    ),
)

TARGETS: dict[str, Target] = {
    "session_toml": Target(session_toml, (SESSION.encode(),)),
    "camera_yaml": Target(camera_file, tuple(text.encode() for text in CAMERAS)),
    "frames_csv": Target(frames("frames.csv"), (FRAMES.encode(), ACCELEROMETER.encode())),
    "detections_csv": Target(detections("detections.csv"), (DETECTIONS.encode(),)),
    "points_csv": Target(points("points.csv"), (POINTS.encode(),)),
    "states_csv": Target(states, (STATES.encode(),)),
    "frames_parquet": Target(frames("frames.parquet"), (_parquet(FRAMES), _parquet(ACCELEROMETER))),
    "detections_parquet": Target(detections("detections.parquet"), (_parquet(DETECTIONS),)),
    "points_parquet": Target(points("points.parquet"), (_parquet(POINTS),)),
    "session": Target(whole_session, _whole_seeds()),
    "diagnosis_json": Target(diagnosis, ((CORPUS / "diagnosis_json" / "explained.json").read_bytes(),), True),
    "servos_dynamixel": Target(servos("dynamixel"), (SERVOS.format(torque="current_a = 0.3").encode(),)),
    "servos_feetech": Target(
        servos("feetech"),
        (SERVOS.format(torque="torque_share = 0.4").replace('model = "XM430-W350"\n', "").encode(),),
    ),
    "posture_toml": Target(posture(".toml"), (b"[joints]\nshoulder = 0.1\nelbow = -0.3\n", b"elbow = 1\n")),
    "posture_json": Target(posture(".json"), (_json({"joints": {"shoulder": 0.1, "elbow": 1}}),), True),
    "mount_json": Target(mount, (_json(MOUNT),), True),
    "recording": Target(
        recording,
        (_json({"joints": ["shoulder", "elbow"], "seed": 1}) + b"\0" + (_json(READING) + b"\n") * 2,),
    ),
    "bindings": Target(bindings, (_json(HEADER),), True, (MirrorPostureError, UnicodeDecodeError)),
    "plan_csv": Target(plan, (PLAN,)),
    "captured_csv": Target(captured, (CAPTURED,)),
    "pictures": Target(picture, tuple(_pictures())),
    **RECORDINGS,
}


def run(target: Target, data: bytes) -> bool:
    """Whether the bytes were taken; raises `AssertionError` for anything but a value or one clear line."""
    try:
        return target.check(data)
    except target.raises as error:
        text = str(error)
        assert text and len(text) < 20_000, text[:200]
        # The core names what it got, which may hold ends of lines; sessions' errors are lines of `check`.
        assert "\n" not in text or target.check is bindings, text[:300]
        return False
    except AssertionError:
        raise
    except BaseException as error:
        raise AssertionError(f"{type(error).__name__}: {str(error)[:300]}") from error
