"""Fuzz targets of recordings to import: the joints' CSV, MCAP, ROS 1 and ROS 2 bags, a LeRobot dataset's info.json."""

from __future__ import annotations

import atexit
import io
import json
import tempfile
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from fuzz_mutations import Target
from mirror_posture.importing import read_recording
from mirror_posture.importing.joint_csv import joint_csv

JOINTS = b"time_s,pan, lift ,measured:pan,measured:lift\n0,0.1,0.2,0.1,0.2\n0.5,0.1,0.2,0.1,0.2\n1,-0.1,0.3,-0.1,0.3\n"
INFO: dict[str, Any] = {
    "codebase_version": "v2.1", "fps": 10, "total_episodes": 1, "chunks_size": 1000,
    "features": {"observation.state": {"names": {"motors": ["pan.pos", "lift.pos"]}}, "action": {"names": ["pan", "lift"]},
                 "observation.images.front": {"dtype": "video"}},
    "data_path": "data-{episode_index:03d}.parquet", "video_path": "{video_key}.mp4",
}  # fmt: skip


@cache
def folder() -> Path:
    """A dataset without its info.json, and a place for files."""
    below = tempfile.TemporaryDirectory(prefix="fuzz-recordings-")
    atexit.register(below.cleanup)
    place = Path(below.name)
    (place / "dataset/meta").mkdir(parents=True)
    rows = [[0.1, 0.2], [0.1, 0.2]]
    table = pa.table(
        {"observation.state": rows, "action": rows, "timestamp": [0.0, 0.1], "episode_index": [0, 0]}
    )
    pyarrow.parquet.write_table(table, place / "dataset/data-000.parquet")
    (place / "dataset/observation.images.front.mp4").touch()
    return place


def joints(data: bytes) -> bool:
    file = folder() / "joints.csv"
    file.write_bytes(data)
    joint_csv(file, False)
    return True


def mcap(data: bytes) -> bool:
    file = folder() / "recording.mcap"
    file.write_bytes(data)
    for _, picture in read_recording(file).pictures():
        assert picture.ndim == 3 and picture.dtype == "uint8"
    return True


def info(data: bytes) -> bool:
    (folder() / "dataset/meta/info.json").write_bytes(data)
    read_recording(folder() / "dataset")
    return True


def _mcap(packed: bool) -> bytes:
    from mcap.writer import CompressionType
    from mcap_ros2.writer import Writer
    from PIL import Image

    header = "std_msgs/Header header\n"
    stamp = "================\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n================\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    stream, picture = io.BytesIO(), io.BytesIO()
    Image.new("RGB", (20, 16)).save(picture, "PNG")
    writer = Writer(stream, compression=CompressionType.LZ4 if packed else CompressionType.NONE)
    states = writer.register_msgdef(
        "sensor_msgs/msg/JointState",
        header + "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + stamp,
    )
    pictures = writer.register_msgdef(
        "sensor_msgs/msg/CompressedImage", header + "string format\nuint8[] data\n" + stamp
    )
    for k in range(2):
        head = {"stamp": {"sec": 5 + k, "nanosec": 0}, "frame_id": ""}
        body = {"header": head, "name": ["pan", "lift"], "position": [0.1, 0.2], "velocity": [], "effort": []}
        writer.write_message("/joints", states, body, log_time=k)
        writer.write_message(
            "/camera", pictures, {"header": head, "format": "png", "data": picture.getvalue()}, log_time=k
        )
    writer.finish()
    return stream.getvalue()


def bag(data: bytes) -> bool:
    file = folder() / "recording.bag"
    file.write_bytes(data)
    return _whole(file)


def database(data: bytes) -> bool:
    place = _ros_2_bag()
    next(place.glob("*.db3")).write_bytes(data)
    return _whole(place)


def metadata(data: bytes) -> bool:
    place = _metadata_bag()
    (place / "metadata.yaml").write_bytes(data)
    return _whole(place)


def _whole(source: Path) -> bool:
    for _, picture in read_recording(source).pictures():
        assert picture.ndim == 3 and picture.dtype == "uint8"
    return True


@cache
def _ros_2_bag() -> Path:
    return _written(folder() / "database", 2, "")


@cache
def _metadata_bag() -> Path:
    return _written(folder() / "metadata", 2, "")


def _written(place: Path, version: int, packed: str) -> Path:
    """A bag with two joint states and two pictures, written by rosbags."""
    import numpy as np
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    writer: Any = rosbag1.Writer(place) if version == 1 else rosbag2.Writer(place, version=9)
    if packed and version == 1:
        writer.set_compression(rosbag1.Writer.CompressionFormat[packed])
    elif packed:
        writer.set_compression(rosbag2.CompressionMode[packed], rosbag2.CompressionFormat.ZSTD)
    pack = store.serialize_ros1 if version == 1 else store.serialize_cdr
    states, pictures = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Image"
    with writer:
        topics = {
            kind: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in (("/joints", states), ("/camera/image", pictures))
        }
        for k in range(2):
            stamp = store.types["builtin_interfaces/msg/Time"](sec=5 + k, nanosec=0)
            more = {"seq": 0} if version == 1 else {}
            head = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **more)
            empty = np.zeros(0)
            state = store.types[states](
                header=head, name=["pan", "lift"], position=np.array([0.1, 0.2]), velocity=empty, effort=empty
            )
            picture = store.types[pictures](
                header=head,
                height=6,
                width=8,
                encoding="rgb8",
                is_bigendian=0,
                step=24,
                data=np.zeros(144, np.uint8),
            )
            for kind, message in ((states, state), (pictures, picture)):
                writer.write(topics[kind], (5 + k) * 10**9, pack(message, kind))
    return place


def _bags() -> tuple[bytes, ...]:
    return tuple(
        _written(folder() / f"seed{packed}.bag", 1, packed).read_bytes() for packed in ("", "LZ4", "BZ2")
    )


RECORDINGS = {
    "joints_csv": Target(joints, (JOINTS,)),
    "lerobot_info": Target(info, (json.dumps(INFO).encode(),), True),
}
if find_spec("mcap_ros2"):
    RECORDINGS["mcap"] = Target(mcap, (_mcap(False), _mcap(True)), lengths=True)
if find_spec("rosbags"):
    RECORDINGS["rosbag1"] = Target(bag, _bags(), lengths=True)
    RECORDINGS["rosbag2_sqlite"] = Target(
        database, (next(_written(folder() / "seed", 2, "").glob("*.db3")).read_bytes(),), lengths=True
    )
    RECORDINGS["rosbag2_metadata"] = Target(metadata, ((_metadata_bag() / "metadata.yaml").read_bytes(),))
