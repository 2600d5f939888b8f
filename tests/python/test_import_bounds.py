"""Recordings that unfold, lead elsewhere or are damaged: one clear line, before anything of it is unfolded."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest

from mirror_posture import MirrorPostureError
from mirror_posture.importing import bounds, read_recording
from mirror_posture.importing.films import film_pictures
from mirror_posture.importing.joint_csv import joint_csv
from mirror_posture.session.tables import open_table

av = pytest.importorskip("av")
pytest.importorskip("rosbags")
pytest.importorskip("mcap_ros2")
STAMP = """std_msgs/Header header
{}================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
STATE = STAMP.format("string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n")
PICTURE = STAMP.format("string format\nuint8[] data\n")


def mcap(file: Path, compression: str, names: list[str], picture: bytes, bytes_more: int = 0) -> Path:
    from mcap.writer import CompressionType
    from mcap_ros2.writer import Writer

    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType[compression])
        states = writer.register_msgdef("sensor_msgs/msg/JointState", STATE)
        pictures = writer.register_msgdef("sensor_msgs/msg/CompressedImage", PICTURE)
        for k in range(4):
            header = {"stamp": {"sec": 10 + k, "nanosec": 0}, "frame_id": "0" * bytes_more}
            body: dict[str, Any] = {
                "header": header,
                "name": names,
                "position": [0.1] * len(names),
                "velocity": [],
                "effort": [],
            }
            writer.write_message("/joints", states, body, log_time=k)
            body = {"header": header, "format": "jpeg", "data": picture}
            writer.write_message("/camera", pictures, body, log_time=k)
        writer.finish()
    return file


def jpeg(turned: bool = False) -> bytes:
    from PIL import Image

    data, exif = io.BytesIO(), Image.Exif()
    exif[0x0112] = 6 if turned else 1
    Image.fromarray(np.tile(np.arange(64, dtype=np.uint8)[:, None, None], (1, 32, 3))).save(
        data, "JPEG", exif=exif
    )
    return data.getvalue()


def test_pictures_of_a_bag_stay_as_they_are_stored(tmp_path: Path) -> None:
    recording = read_recording(mcap(tmp_path / "a.mcap", "ZSTD", ["a"], jpeg(turned=True)))
    assert [picture.shape for _, picture in recording.pictures()] == [(64, 32, 3)] * 4


@pytest.mark.parametrize("compression", ["LZ4", "ZSTD", "NONE"])
def test_chunks_of_an_mcap_are_bounded(
    tmp_path: Path, compression: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bounds, "LARGEST_CHUNK", 100_000)
    read_recording(mcap(tmp_path / "small.mcap", compression, ["a"], jpeg(), 1000))
    with pytest.raises(MirrorPostureError, match=r"unfolds to more|RecordLengthLimitExceeded"):
        read_recording(mcap(tmp_path / "large.mcap", compression, ["a"], jpeg(), 100_000))


def test_a_chunk_that_does_not_tell_its_size_has_the_one_that_its_record_tells() -> None:
    zstandard = pytest.importorskip("zstandard")
    data = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(1000))
    assert zstandard.frame_content_size(data) < 0
    assert bounds._unfolded_size("zstd", data, 10**12) == 10**12
    # Of two sizes that are told the larger one.
    data = zstandard.ZstdCompressor().compress(bytes(1000))
    assert bounds._unfolded_size("zstd", data, 10) == 1000


@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
def test_chunks_of_a_ros_1_bag_are_bounded(
    tmp_path: Path, compression: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    bag_of_zeros = Writer(tmp_path / "b.bag")
    bag_of_zeros.set_compression(Writer.CompressionFormat[compression])
    with bag_of_zeros as bag:
        kind = "std_msgs/msg/String"
        connection = bag.add_connection("/text", kind, typestore=store)
        message = store.types[kind](data="0" * 300_000)
        bag.write(connection, 1, store.serialize_ros1(message, kind))
    monkeypatch.setattr(bounds, "LARGEST_CHUNK", 200_000)
    with pytest.raises(MirrorPostureError, match="unfolds to more"):
        read_recording(tmp_path / "b.bag")


def ros_2_bag(folder: Path, mode: str) -> Path:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    bag = Writer(folder, version=9)
    if mode:
        bag.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with bag:
        kind = "std_msgs/msg/String"
        connection = bag.add_connection("/text", kind, typestore=store)
        bag.write(connection, 1, store.serialize_cdr(store.types[kind](data="0" * 300_000), kind))
    return folder


def test_packed_ros_2_bags_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounds, "LARGEST_CHUNK", 200_000)
    monkeypatch.setattr(bounds, "LARGEST_PACKED", 200_000)
    for mode in ("FILE", "MESSAGE"):
        with pytest.raises(MirrorPostureError, match="unfolds to more"):
            read_recording(ros_2_bag(tmp_path / mode, mode))
    plain = ros_2_bag(tmp_path / "plain", "")
    with pytest.raises(MirrorPostureError, match="a chunk or message unfolds to more"):
        read_recording(plain)
    monkeypatch.setattr(bounds, "LARGEST_CHUNK", 400_000)
    with pytest.raises(MirrorPostureError, match="0 topics of sensor_msgs/msg/JointState"):
        read_recording(plain)
    metadata = plain / "metadata.yaml"
    text = metadata.read_text()
    metadata.write_text("a: &a [1]\nb: [*a, *a]\n" + text)
    with pytest.raises(MirrorPostureError, match="alias"):
        read_recording(plain)
    database = next(plain.glob("*.db3"))
    metadata.write_text(text)
    database.unlink()
    os.mkfifo(database)
    with pytest.raises(MirrorPostureError, match="no regular file"):
        read_recording(plain)


COMPUTED = {
    "view": "DROP TABLE message_definitions; CREATE VIEW message_definitions AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) "
            "SELECT '' AS topic_type, '' AS encoding, '' AS encoded_message_definition, '' AS type_description_hash, x AS id FROM c",
    "column": "CREATE TABLE m(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB AS (zeroblob(900000000))); "
              "INSERT INTO m(id, topic_id, timestamp) SELECT id, topic_id, timestamp FROM messages; DROP TABLE messages; ALTER TABLE m RENAME TO messages",
}  # fmt: skip


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("kind", COMPUTED)
def test_databases_that_compute_while_they_are_read(kind: str, packed: bool, tmp_path: Path) -> None:
    """The first one never ended."""
    import sqlite3
    from contextlib import closing

    folder = ros_2_bag(tmp_path / "bag", "FILE" if packed else "")
    plain = folder / "bag.db3"
    if packed:
        import zstandard

        file = folder / "bag.db3.zstd"
        plain.write_bytes(zstandard.ZstdDecompressor().decompressobj().decompress(file.read_bytes()))
    with closing(sqlite3.connect(plain)) as database:
        database.executescript(COMPUTED[kind])
    if packed:
        file.write_bytes(zstandard.ZstdCompressor().compress(plain.read_bytes()))
        plain.unlink()
    with pytest.raises(MirrorPostureError, match="needed plain tables of messages"):
        read_recording(folder)


def test_damaged_bags_are_named(tmp_path: Path) -> None:
    for name in ("a.mcap", "a.bag"):
        (tmp_path / name).write_bytes(b"\x89MCAP0\r\n" + b"\xff" * 100)
        with pytest.raises(MirrorPostureError, match=rf"{name}: cannot be read as a bag"):
            read_recording(tmp_path / name)
        (tmp_path / name).unlink()
        os.mkfifo(tmp_path / name)
        with pytest.raises(MirrorPostureError, match="no regular file"):
            read_recording(tmp_path / name)


def test_messages_of_a_bag_that_cannot_be_meant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(MirrorPostureError, match="names a joint twice"):
        read_recording(mcap(tmp_path / "twice.mcap", "NONE", ["a", "a"], jpeg()))
    no_picture = read_recording(mcap(tmp_path / "none.mcap", "NONE", ["a"], b"none"))
    with pytest.raises(MirrorPostureError, match="cannot be read"):
        list(no_picture.pictures())
    # A header that tells of more pixels than there can be; nothing is decoded.
    data = bytearray(cv2.imencode(".png", np.zeros((8, 8, 3), np.uint8))[1].tobytes())
    data[16:24] = (100_000).to_bytes(4, "big") * 2
    data[29:33] = __import__("zlib").crc32(bytes(data[12:29])).to_bytes(4, "big")
    large = read_recording(mcap(tmp_path / "large.mcap", "NONE", ["a"], bytes(data)))
    with pytest.raises(MirrorPostureError, match="pixels"):
        list(large.pictures())
    monkeypatch.setattr(bounds, "MOST_PICTURES", 3)
    with pytest.raises(MirrorPostureError, match="more than 3 pictures"):
        list(read_recording(mcap(tmp_path / "many.mcap", "NONE", ["a"], jpeg())).pictures())
    monkeypatch.setattr("mirror_posture.importing.bags.MOST_POSITIONS", 3)
    with pytest.raises(MirrorPostureError, match="more than 3 positions"):
        read_recording(tmp_path / "many.mcap")


def test_films_are_bounded_before_they_are_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    film = tmp_path / "film.mp4"
    with av.open(str(film), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(3):
            container.mux(
                stream.encode(av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="bgr24"))
            )
        container.mux(stream.encode())
    assert len(list(film_pictures(film))) == 3
    monkeypatch.setattr(bounds, "MOST_PIXELS", 1000)
    with pytest.raises(MirrorPostureError, match="64 × 48 px"):
        list(film_pictures(film))
    # A list of places to read from, which the library would follow.
    for text in ("#EXTM3U\n#EXTINF:1,\nfilm.mp4\n#EXT-X-ENDLIST\n", "ffconcat version 1.0\nfile film.mp4\n"):
        (tmp_path / "list.mp4").write_text(text)
        with pytest.raises(MirrorPostureError, match="no film"):
            list(film_pictures(tmp_path / "list.mp4"))
    os.mkfifo(tmp_path / "pipe.mp4")
    with pytest.raises(MirrorPostureError, match="no regular file"):
        list(film_pictures(tmp_path / "pipe.mp4"))


def test_the_joints_csv_is_bounded(tmp_path: Path) -> None:
    file = tmp_path / "joints.csv"
    file.write_text("time_s, a ,a\n0,1,2\n")
    with pytest.raises(MirrorPostureError, match="twice"):
        joint_csv(file, False)
    file.write_text("time_s," + ",".join(f"j{k}" for k in range(6000)) + "\n")
    with pytest.raises(MirrorPostureError, match="6001 columns"):
        joint_csv(file, False)
    file.write_text("time_s,a\n0,1\n1,nan\n")
    with pytest.raises(MirrorPostureError, match=r"row 2.*finite"):
        joint_csv(file, False)
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(MirrorPostureError, match="no regular file"):
        joint_csv(file, False)


def test_parquet_that_unfolds_by_its_dictionary(tmp_path: Path) -> None:
    """A few kilobytes that would be 10 GB of text: each row a number of the same long name."""
    file = tmp_path / "frames.parquet"
    names = pa.DictionaryArray.from_arrays(pa.array(np.zeros(100_000, np.int32)), pa.array(["x" * 100_000]))
    pyarrow.parquet.write_table(pa.table({"frame": np.arange(100_000), "image": names}), file)
    assert file.stat().st_size < 1_000_000
    with pytest.raises(MirrorPostureError, match="unfolds to 10000000000 bytes of text"):
        open_table(file)
    assert list(open_table(file, only=("frame",)).columns) == ["frame"]
    pyarrow.parquet.write_table(pa.table({"n": [["x"], ["y"]], "i": [1, 2]}), file)
    with pytest.raises(MirrorPostureError, match="nested"):
        open_table(file)
    pyarrow.parquet.write_table(
        pa.table({"f": pa.array([b"x" * 1000] * 2, pa.binary(1000)), "i": [1, 2]}), file
    )
    with pytest.raises(MirrorPostureError, match="long or nested"):
        open_table(file)


def dataset(folder: Path, **changes: object) -> Path:
    info = {
        "codebase_version": "v2.1", "fps": 10, "total_episodes": 1,
        "features": {"observation.state": {"names": ["a", "b"]}, "film": {"dtype": "video"}},
        "data_path": "data.parquet", "video_path": "film.mp4",
    } | changes  # fmt: skip
    (folder / "meta").mkdir(parents=True, exist_ok=True)
    (folder / "meta/info.json").write_text(json.dumps(info))
    (folder / "film.mp4").touch()
    return folder


def test_datasets_stay_in_their_folder(tmp_path: Path) -> None:
    rows = pa.table({"observation.state": [[0.1, 0.2], [0.3]], "timestamp": [0.0, 0.1]})
    pyarrow.parquet.write_table(rows, tmp_path / "outside.parquet")
    place = tmp_path / "d"
    for pattern, needed in (
        ("../outside.parquet", "not in the dataset's folder"),
        ("/etc/passwd", "not in the dataset's folder"),
        ("{episode_index.__class__}", "needed one such as"),
        ("{episode_index:09999999999d}", "needed one such as"),
        (7, "are not as LeRobot"),
    ):
        with pytest.raises(MirrorPostureError, match=needed):
            read_recording(dataset(place, data_path=pattern))
    dataset(place)
    (place / "data.parquet").symlink_to(tmp_path / "outside.parquet")
    with pytest.raises(MirrorPostureError, match="by a link"):
        read_recording(place)
    (place / "data.parquet").unlink()
    (tmp_path / "outside.parquet").rename(place / "data.parquet")
    with pytest.raises(MirrorPostureError, match="needed 2 numbers in every row"):
        read_recording(place)
    for changes in ({"features": []}, {"total_episodes": "x"}, {"fps": 0}, {"features": {"film": 3}}):
        with pytest.raises(MirrorPostureError):
            read_recording(dataset(place, **changes))


def test_nothing_of_a_bag_is_printed(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The decoder prints definitions that it cannot read, control characters and all."""
    file = mcap(tmp_path / "a.mcap", "NONE", ["a"], jpeg())
    data = file.read_bytes()
    for text in (b"string format", b"float64[] effort"):
        bad = b"\x1b]0;x\x07".ljust(len(text), b"x")
        file.write_bytes(data.replace(text, bad))
        with pytest.raises(MirrorPostureError, match="cannot be read as a bag"):
            list(read_recording(file).pictures())
    assert capfd.readouterr() == ("", "")
