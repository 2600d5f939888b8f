"""ROS bags: version 1, version 2 (SQLite, MCAP) and bare MCAP files."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from .._core import MirrorPostureError
from ..arrays import Floats
from ..camera import Camera
from ..session.camera_formats import camera_of
from ..session.errors import choices
from .bounds import (
    MOST_POSITIONS,
    check_bag_folder,
    check_mcap,
    check_open_bag,
    checked_size,
    counted_pictures,
    decoded,
    opened,
)
from .recording import JointLog, Picture, Recording

STATES = ("sensor_msgs/msg/JointState", "sensor_msgs/JointState")
RAW = ("sensor_msgs/msg/Image", "sensor_msgs/Image")
COMPRESSED = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/CompressedImage")
INFO = ("sensor_msgs/msg/CameraInfo", "sensor_msgs/CameraInfo")
CHANNELS = {"bgr8": 3, "rgb8": 3, "bgra8": 4, "rgba8": 4, "mono8": 1, "8UC1": 1, "8UC3": 3}
INSTALL = "pip install 'mirror-posture[import]'"
Message = tuple[str, float, Any]
"""Topic, time of recording, s, message."""


def is_bag(source: Path) -> bool:
    """Whether a path is a bag."""
    return source.suffix in (".mcap", ".bag") or (source.is_dir() and (source / "metadata.yaml").is_file())


def read_bag(
    source: Path,
    *,
    joints_topic: str | None,
    commands_topic: str | None,
    image_topic: str | None,
    degrees: bool,
) -> Recording:
    """Joint states, pictures and the camera of a bag. Messages count by the time in their header, where it is set.

    Raises:
        MirrorPostureError: a missing package, a topic that is not there or that must be chosen, an unknown encoding.
    """
    with _own_words(source):
        return _read_bag(source, joints_topic, commands_topic, image_topic, degrees)


def _read_bag(
    source: Path, joints_topic: str | None, commands_topic: str | None, image_topic: str | None, degrees: bool
) -> Recording:
    if source.suffix == ".mcap":
        check_mcap(source)
    elif source.suffix != ".bag":
        check_bag_folder(source)
    else:
        with opened(source, "a ROS 1 bag"):
            pass
    topics = _topics(source)
    joints = _topic(source, topics, STATES, joints_topic, "--joints-topic", besides=commands_topic)
    image = _topic(source, topics, RAW + COMPRESSED, image_topic, "--image")
    infos = [name for name, kind in topics.items() if kind in INFO]
    # The camera_info of a picture's topic is a sibling topic.
    base = image.rsplit("/", 1)[0]
    beside = [name for name in infos if name.startswith((base + "/", base.rsplit("/", 1)[0] + "/"))] or infos
    camera: Camera | None = None
    states: list[tuple[float, dict[str, float]]] = []
    commands: list[tuple[float, dict[str, float]]] = []
    wanted = [joints, *([commands_topic] if commands_topic else []), *beside[:1]]
    held, uncalibrated = 0, False
    for topic, time, message in _messages(source, wanted):
        if topic in (joints, commands_topic):
            row = _positions(source, topic, message)
            held += len(row)
            if held > MOST_POSITIONS:
                raise MirrorPostureError(
                    f"{source}: holds more than {MOST_POSITIONS} positions; cut it into parts"
                )
            (states if topic == joints else commands).append((_stamp(message, time), row))
        elif camera is None:
            uncalibrated = _is_uncalibrated(message)
            if not uncalibrated:
                camera = _camera(message, f"{source}, topic {topic}")
    factor = np.pi / 180.0 if degrees else 1.0
    log = _log(source, joints, states, factor)
    if commands_topic:
        log = _with_commands(log, _log(source, commands_topic, commands, factor))
    start = log.time_s[0]
    log = replace(log, time_s=log.time_s - start)

    def pictures() -> Iterator[tuple[float, Picture]]:
        with _own_words(source):
            for _, time, message in _messages(source, [image]):
                yield _stamp(message, time) - start, _picture(source, message)

    warnings: tuple[str, ...] = ()
    if camera is None and uncalibrated:
        warnings = (
            f"{source}, topic {beside[0]}: the camera is not calibrated (K[0] is 0), its CameraInfo is left out and the session's "
            "camera file stays",
        )
    return Recording(log, lambda: counted_pictures(pictures(), str(source)), camera, str(source), warnings)


@contextmanager
def _own_words(source: Path) -> Iterator[None]:
    """Converts errors of the bags' libraries to one of this package that names the file: a bag's content is
    arbitrary, and so are the kinds of errors."""
    try:
        yield
    except MirrorPostureError:
        raise
    except ImportError:
        raise MirrorPostureError(f"{source}: bags need rosbags and mcap: {INSTALL}") from None
    except Exception as error:
        detail = " ".join(str(error).split())[:200]
        raise MirrorPostureError(
            f"{source}: cannot be read as a bag ({type(error).__name__}{': ' if detail else ''}{detail}); record or copy it again"
        ) from error


def _positions(source: Path, topic: str, message: Any) -> dict[str, float]:
    names = [str(name) for name in message.name]
    if len(set(names)) < len(names):
        raise MirrorPostureError(
            f"{source}, topic {topic}: a message names a joint twice ({', '.join(names)})"
        )
    return dict(zip(names, (float(v) for v in message.position), strict=False))


def _topics(source: Path) -> dict[str, str]:
    if source.suffix == ".mcap":
        from mcap.reader import make_reader

        with source.open("rb") as stream:
            summary = make_reader(stream).get_summary()
        if summary is None:
            raise MirrorPostureError(f"{source}: has no summary; repair it: mcap recover {source}")
        return {
            channel.topic: summary.schemas[channel.schema_id].name
            for channel in summary.channels.values()
            if channel.schema_id in summary.schemas
        }
    with _any_reader(source) as reader:
        check_open_bag(reader, source)
        return {connection.topic: connection.msgtype for connection in reader.connections}


def _messages(source: Path, topics: list[str]) -> Iterator[Message]:
    if source.suffix == ".mcap":
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory

        with source.open("rb") as stream:
            reader = make_reader(stream, decoder_factories=[DecoderFactory()])
            messages = iter(reader.iter_decoded_messages(topics=topics))
            while True:
                # The decoder prints what it cannot read, whatever a bag contains, and then raises it.
                with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                    decoded_message = next(messages, None)
                if decoded_message is None:
                    return
                _, channel, raw, message = decoded_message
                yield channel.topic, raw.log_time * 1e-9, message
    with _any_reader(source) as reader:
        connections = [connection for connection in reader.connections if connection.topic in topics]
        for connection, time, data in reader.messages(connections=connections):
            yield connection.topic, time * 1e-9, reader.deserialize(data, connection.msgtype)


def _any_reader(source: Path) -> Any:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    return AnyReader([source], default_typestore=get_typestore(Stores.ROS2_HUMBLE))


def _topic(
    source: Path,
    topics: dict[str, str],
    kinds: tuple[str, ...],
    asked: str | None,
    option: str,
    besides: str | None = None,
) -> str:
    fitting = [name for name, kind in topics.items() if kind in kinds and name != besides]
    if asked is not None:
        if asked not in fitting:
            raise MirrorPostureError(
                f"{source}, {option}: got {asked!r}, needed one of {', '.join(fitting) or 'none'}"
            )
        return asked
    if len(fitting) != 1:
        raise MirrorPostureError(
            f"{source}: has {len(fitting)} topics of {kinds[0]}: needed {option}, one of {', '.join(fitting) or 'none'}"
        )
    return fitting[0]


def _stamp(message: Any, recorded_s: float) -> float:
    """Time of a message: its header's, which drivers set when they measure, or that of its recording."""
    stamp = message.header.stamp
    nanoseconds = getattr(stamp, "nanosec", getattr(stamp, "nsec", 0))
    time = float(stamp.sec) + 1e-9 * float(nanoseconds)
    return time if time > 0.0 else recorded_s


def _log(source: Path, topic: str, rows: list[tuple[float, dict[str, float]]], factor: float) -> JointLog:
    if not rows:
        raise MirrorPostureError(f"{source}, topic {topic}: holds no messages")
    # Some drivers publish arms and grippers alternately: only joints that all messages contain can be one
    # table.
    names = tuple(name for name in rows[0][1] if all(name in row for _, row in rows))
    if not names:
        raise MirrorPostureError(
            f"{source}, topic {topic}: its messages name no common joint; record one JointState for all"
        )
    rows = sorted(rows, key=lambda row: row[0])
    time = np.array([stamp for stamp, _ in rows])
    position = factor * np.array([[row[name] for name in names] for _, row in rows])
    fresh = np.concatenate([[True], np.diff(time) > 0.0])
    return JointLog(time[fresh], names, position[fresh], source=f"{source}, topic {topic}")


def _with_commands(measured: JointLog, commands: JointLog) -> JointLog:
    """The commands at the measurements' times: the last one before each."""
    names = tuple(name for name in measured.names if name in commands.names)
    if not names:
        raise MirrorPostureError(
            f"{commands.source}: commands none of the joints that {measured.source} has: got {choices(commands.names)}, needed one "
            f"or more of {choices(measured.names)}; give --commands-topic with those names, or leave it out"
        )
    inside = measured.time_s >= commands.time_s[0]
    if inside.sum() < 2:
        raise MirrorPostureError(
            f"{commands.source}: begins at {commands.time_s[0]:.10g} s, needed a command before the last two states of "
            f"{measured.source} ({measured.time_s[0]:.10g} to {measured.time_s[-1]:.10g} s): record both at the same time and by one "
            "clock, or leave out --commands-topic"
        )
    last = np.searchsorted(commands.time_s, measured.time_s[inside], side="right") - 1
    told = commands.position[last][:, [commands.names.index(name) for name in names]]
    read = measured.position[inside][:, [measured.names.index(name) for name in names]]
    return JointLog(measured.time_s[inside], names, told, read, commanded=True, source=measured.source)


def _matrix(message: Any) -> Floats:
    # ROS 1 spells the fields with capitals.
    return np.array(getattr(message, "k", getattr(message, "K", ())), dtype=float)


def _is_uncalibrated(message: Any) -> bool:
    """Whether a CameraInfo tells nothing: by its definition, K[0] is 0 then. Drivers publish it all the same."""
    matrix = _matrix(message)
    return not len(matrix) or bool(matrix[0] == 0.0)


def _camera(message: Any, source: str) -> Camera:
    matrix = _matrix(message)
    lens = [float(v) for v in getattr(message, "d", getattr(message, "D", ()))]
    model = str(message.distortion_model)
    size = (int(message.width), int(message.height))
    # An equidistant lens without coefficients is still no pinhole.
    if not any(lens) and model != "equidistant":
        model, lens = "none", []
    return camera_of(source, size, matrix.tolist(), model, lens)


def _picture(source: Path, message: Any) -> Picture:
    if hasattr(message, "format"):
        return decoded(bytes(message.data), f"{source} ({message.format})")
    encoding = str(message.encoding)
    if encoding not in CHANNELS:
        raise MirrorPostureError(
            f"{source}: got pictures of encoding {encoding!r}, needed one of {', '.join(CHANNELS)}"
        )
    channels, width, height = CHANNELS[encoding], int(message.width), int(message.height)
    checked_size(width, height, str(source))
    step, data = int(message.step), bytes(message.data)
    if step < width * channels or len(data) != step * height:
        raise MirrorPostureError(
            f"{source}: a picture of {width} × {height} px, {encoding}, has {len(data)} bytes in rows of {step}: it is damaged"
        )
    rows = np.frombuffer(data, dtype=np.uint8).reshape(height, step)
    pixels = np.ascontiguousarray(rows[:, : width * channels]).reshape(height, width, channels)
    if channels == 1:
        return cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR)
    return np.ascontiguousarray(pixels[..., [2, 1, 0]] if encoding.startswith("rgb") else pixels[..., :3])
