"""Recordings written by their own libraries become sessions: the rests, the right picture for each, the clocks' offset."""

from __future__ import annotations

import json
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from typer.testing import CliRunner

from init_once import initialised
from mirror_posture import MirrorPostureError, Robot, cli, load_session
from mirror_posture.importing import JointLog, Recording, find_rests, match_clocks
from mirror_posture.importing.lerobot_dataset import read_dataset
from mirror_posture.importing.rest import picture_motion
from mirror_posture.importing.write import check_limits, match_begins
from mirror_posture.session import load_camera_info

av = pytest.importorskip("av")
POSTURES = [(0.0, 0.0), (0.6, -0.3), (-0.5, 0.4), (0.2, 0.7), (-0.7, -0.6)]
HOLD_S, MOVE_S, RATE_HZ, FPS, OFFSET_S = 1.2, 0.6, 50, 20, 0.34
WIDTH, HEIGHT = 320, 240
PERIOD_S = HOLD_S + MOVE_S
LENGTH_S = PERIOD_S * len(POSTURES) - MOVE_S
OFFSET_ERROR = 0.2
"""Of the time between two pictures: by as much the clocks' offset may be off."""
INFO_K = [300.0, 0.0, 160.0, 0.0, 301.0, 120.0, 0.0, 0.0, 1.0]


def joints_at(time_s: float) -> np.ndarray:
    """The arm: rests, and straight moves in between."""
    index, phase = divmod(time_s, PERIOD_S)
    index = int(min(max(index, 0), len(POSTURES) - 1))
    here = np.array(POSTURES[index])
    if index == len(POSTURES) - 1 or phase <= HOLD_S:
        return here
    return here + (np.array(POSTURES[index + 1]) - here) * (phase - HOLD_S) / MOVE_S


def picture_at(time_s: float) -> np.ndarray:
    """A picture that tells both joints: where a disk is, on a ground with structure."""
    a, b = joints_at(time_s)
    picture = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    picture[::16] = 110
    cv2.circle(picture, (round(160 + 120 * a), round(120 + 100 * b)), 18, (20, 30, 240), -1)
    return picture


def told_by(picture: np.ndarray) -> np.ndarray:
    red = (picture[..., 2].astype(int) - picture[..., 0]) > 90
    v, u = np.nonzero(red)
    return np.array([(u.mean() - 160) / 120, (v.mean() - 120) / 100])


JOINT_S = np.arange(0, LENGTH_S, 1 / RATE_HZ)
PICTURE_S = np.arange(0.05, LENGTH_S - 0.05, 1 / FPS)
"""Of the joints' clock; the pictures' own clock is OFFSET_S later."""


def write_film(file: Path, times: np.ndarray, start_s: float = 0.0) -> None:
    with av.open(str(file), "w") as container:
        stream = container.add_stream("mpeg4", rate=FPS)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = WIDTH, HEIGHT, "yuv420p", 4_000_000
        stream.time_base = Fraction(1, FPS)
        for index, time in enumerate(times):
            picture = av.VideoFrame.from_ndarray(picture_at(time), format="bgr24")
            picture.pts, picture.time_base = index + round(start_s * FPS), Fraction(1, FPS)
            container.mux(stream.encode(picture))
        container.mux(stream.encode())


def write_mcap(path: Path, matrix: list[float] = INFO_K, model: str = "plumb_bob") -> list[str]:
    writer_module = pytest.importorskip("mcap_ros2.writer")
    header = "std_msgs/Header header\n"
    stamp = "================\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n================\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    file = path / "recording.mcap"
    with file.open("wb") as stream:
        writer = writer_module.Writer(stream)
        joint = writer.register_msgdef(
            "sensor_msgs/msg/JointState",
            header + "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + stamp,
        )
        image = writer.register_msgdef(
            "sensor_msgs/msg/CompressedImage", header + "string format\nuint8[] data\n" + stamp
        )
        info = writer.register_msgdef(
            "sensor_msgs/msg/CameraInfo",
            header
            + "uint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\nfloat64[9] r\nfloat64[12] p\n"
            + stamp,
        )

        def at(time: float) -> dict[str, object]:
            total = 1000.0 + time
            return {"stamp": {"sec": int(total), "nanosec": round((total % 1) * 1e9)}, "frame_id": ""}

        for time in JOINT_S:
            body = {
                "header": at(time),
                "name": ["theirs", "b", "wheel"],
                "position": [*joints_at(time), 0.0],
                "velocity": [],
                "effort": [],
            }
            writer.write_message("/joint_states", joint, body, log_time=round((2000 + time) * 1e9))
        for time in PICTURE_S:
            data = cv2.imencode(".jpg", picture_at(time))[1].tobytes()
            body = {"header": at(time + OFFSET_S), "format": "jpeg", "data": data}
            writer.write_message(
                "/cam/image_raw/compressed", image, body, log_time=round((2000 + time) * 1e9)
            )
        told = {
            "header": at(0),
            "height": HEIGHT,
            "width": WIDTH,
            "distortion_model": model,
            "d": [0.1, 0.0, 0.0, 0.0, 0.0] if model else [],
            "k": matrix,
            "r": [0.0] * 9,
            "p": [0.0] * 12,
        }
        writer.write_message("/cam/camera_info", info, told, log_time=round(2000 * 1e9))
        writer.finish()
    return [str(file), "--joint", "theirs=a"]


def write_bag(path: Path, version: int) -> list[str]:
    pytest.importorskip("rosbags")
    from rosbags.typesys import Stores, get_typestore

    if version == 1:
        from rosbags.rosbag1 import Writer

        store = get_typestore(Stores.ROS1_NOETIC)
        file = path / "recording.bag"
        bag = Writer(file)
    else:
        from rosbags.rosbag2 import Writer as Writer2

        store = get_typestore(Stores.ROS2_HUMBLE)
        file = path / "recording"
        bag = Writer2(file, version=9)
    types = store.types
    header, stamp = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]

    def at(time: float):
        total = 1000.0 + time
        told = stamp(sec=int(total), nanosec=round((total % 1) * 1e9))
        return header(seq=0, stamp=told, frame_id="") if version == 1 else header(stamp=told, frame_id="")

    empty = np.zeros(0)
    with bag:

        def connect(topic: str, kind: str):
            return bag.add_connection(topic, kind, typestore=store)

        def write(connection, kind: str, time: float, message) -> None:
            data = store.serialize_ros1(message, kind) if version == 1 else store.serialize_cdr(message, kind)
            bag.write(connection, round((1000 + time) * 1e9), data)

        joint_kind, image_kind = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Image"
        joints, images = connect("/joint_states", joint_kind), connect("/camera/image_raw", image_kind)
        for time in JOINT_S:
            message = types[joint_kind](
                header=at(time), name=["a", "b"], position=joints_at(time), velocity=empty, effort=empty
            )
            write(joints, joint_kind, time, message)
        for time in PICTURE_S:
            pixels = picture_at(time)[..., ::-1]
            message = types[image_kind](
                header=at(time + OFFSET_S),
                height=HEIGHT,
                width=WIDTH,
                encoding="rgb8",
                is_bigendian=0,
                step=3 * WIDTH,
                data=np.ascontiguousarray(pixels).ravel(),
            )
            write(images, image_kind, time, message)
    return [str(file)]


def write_lerobot(path: Path, version: int) -> list[str]:
    """Two episodes by the rules of LeRobot's format pages; the second is the one that is read."""
    root = path / "dataset"
    key = "observation.images.front"
    times = np.arange(0, LENGTH_S - 0.05, 1 / FPS)
    degrees = np.degrees([joints_at(time) for time in times])
    info = {
        "codebase_version": "v2.1" if version == 2 else "v3.0", "fps": FPS, "total_episodes": 2, "chunks_size": 1000,
        "features": {
            name: {"dtype": "float32", "shape": [2], "names": ["a.pos", "b.pos"] if version == 3 else {"motors": ["a", "b"]}}
            for name in ("action", "observation.state")
        } | {key: {"dtype": "video", "shape": [HEIGHT, WIDTH, 3]}},
    }  # fmt: skip

    def table(episode: int) -> pa.Table:
        rows = degrees if episode == 1 else degrees * 0
        return pa.table(
            {
                "action": pa.array(rows.astype(np.float32).tolist()),
                "observation.state": pa.array((rows + 0.1).astype(np.float32).tolist()),
                "timestamp": pa.array(times.astype(np.float32)),
                "episode_index": np.full(len(times), episode),
            }
        )

    if version == 2:
        info |= {
            "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
            "video_path": "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
        }
        (root / "data/chunk-000").mkdir(parents=True)
        (root / f"videos/chunk-000/{key}").mkdir(parents=True)
        for episode in (0, 1):
            pa.parquet.write_table(table(episode), root / f"data/chunk-000/episode_{episode:06d}.parquet")
        write_film(root / f"videos/chunk-000/{key}/episode_000001.mp4", times)
    else:
        info |= {
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
        }
        for folder in ("data/chunk-000", f"videos/{key}/chunk-000", "meta/episodes/chunk-000"):
            (root / folder).mkdir(parents=True)
        pa.parquet.write_table(
            pa.concat_tables([table(0), table(1)]), root / "data/chunk-000/file-000.parquet"
        )
        length = len(times) / FPS
        write_film(
            root / f"videos/{key}/chunk-000/file-000.mp4", np.concatenate([np.zeros(len(times)), times])
        )
        rows = [
            {
                "episode_index": episode,
                "data/chunk_index": 0,
                "data/file_index": 0,
                f"videos/{key}/chunk_index": 0,
                f"videos/{key}/file_index": 0,
                f"videos/{key}/from_timestamp": episode * length,
                f"videos/{key}/to_timestamp": (episode + 1) * length,
            }
            for episode in (0, 1)
        ]
        pa.parquet.write_table(pa.Table.from_pylist(rows), root / "meta/episodes/chunk-000/file-000.parquet")
    (root / "meta").mkdir(exist_ok=True)
    (root / "meta/info.json").write_text(json.dumps(info))
    return [str(root), "--episode", "1", "--degrees"]


def write_joint_csv(path: Path) -> Path:
    values = np.array([joints_at(time) for time in JOINT_S])
    file = path / "joints.csv"
    pyarrow.csv.write_csv(pa.table({"time_s": JOINT_S, "a": values[:, 0], "b": values[:, 1]}), file)
    return file


def write_film_and_csv(path: Path) -> list[str]:
    # The film begins late: its own zero is the first picture.
    write_film(path / "film.mp4", PICTURE_S)
    return [str(path / "film.mp4"), "--joints", str(write_joint_csv(path))]


def write_pictures(path: Path) -> list[str]:
    folder = path / "pictures"
    folder.mkdir()
    for time in PICTURE_S:
        cv2.imwrite(str(folder / f"{time + OFFSET_S:.3f}.png"), picture_at(time))
    return [str(folder), "--joints", str(write_joint_csv(path))]


URDF = '<robot name="r"><link name="base"/><link name="l"/><link name="m"/>' + "".join(
    f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><axis xyz="0 1 0"/>'
    '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
    for name, parent, child in (("a", "base", "l"), ("b", "l", "m"))
) + "</robot>"  # fmt: skip


@pytest.fixture
def session(tmp_path: Path) -> Path:
    (tmp_path / "arm.urdf").write_text(URDF)
    words = [
        "--camera",
        "base",
        "--camera-at",
        "0,0,0.3",
        "--board",
        "base",
        "--board-at",
        "0,0,0.1",
        "--marker",
        "hand=m@0.1,0,0",
    ]
    words += ["--picture", f"{WIDTH}x{HEIGHT}"]
    return initialised(tmp_path / "arm.urdf", tmp_path / "session", *words)


def run(*arguments: object, code: int = 0):
    result = CliRunner().invoke(cli.app, [str(argument) for argument in arguments])
    assert result.exit_code == code, f"{result.exit_code}: {result.output}\n{result.exception!r}"
    return result


WRITERS: dict[str, tuple[Callable[[Path], list[str]], float | None]] = {
    "mcap": (write_mcap, OFFSET_S),
    "rosbag1": (lambda path: write_bag(path, 1), OFFSET_S),
    "rosbag2": (lambda path: write_bag(path, 2), OFFSET_S),
    "lerobot-v2.1": (lambda path: write_lerobot(path, 2), 0.0),
    "lerobot-v3": (lambda path: write_lerobot(path, 3), 0.0),
    "film": (write_film_and_csv, -0.05),
    "pictures": (write_pictures, OFFSET_S),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_rests_become_frames_with_their_own_pictures(kind: str, session: Path, tmp_path: Path) -> None:
    write, offset = WRITERS[kind]
    words = write(tmp_path)
    document = json.loads(run("import", *words[:1], session, *words[1:], "--json").stdout)
    assert document["frames"] == document["rests"] == len(POSTURES)
    assert document["offset_s"] == pytest.approx(offset, abs=OFFSET_ERROR / FPS)
    assert document["clock_correlation"] > 0.7
    loaded = load_session(session)
    assert loaded.frames.joint_names == ("a", "b")
    np.testing.assert_allclose(loaded.frames.commanded, POSTURES, atol=1e-6)
    for row, file in enumerate(loaded.image_files):
        assert file is not None
        np.testing.assert_allclose(told_by(cv2.imread(str(file))), POSTURES[row], atol=0.02)
    if kind.startswith("lerobot"):
        np.testing.assert_allclose(
            loaded.frames.measured - loaded.frames.commanded, np.radians(0.1), atol=1e-6
        )
    if kind == "mcap":
        camera = load_camera_info(session / "camera.yaml")
        assert camera.focal_px == (300.0, 301.0) and camera.distortion[0] == 0.1
        assert "wheel" in document["warnings"][0]
    assert "--overwrite" in run("import", *words[:1], session, *words[1:], code=1).stderr


def test_rests_are_the_held_moments_and_nothing_else() -> None:
    log = JointLog(JOINT_S, ("a", "b"), np.array([joints_at(time) for time in JOINT_S]))
    rests = find_rests(log)
    assert len(rests) == len(POSTURES)
    for index, rest in enumerate(rests):
        assert rest.start_s == pytest.approx(index * PERIOD_S, abs=0.03)
        assert rest.end_s == pytest.approx(index * PERIOD_S + HOLD_S, abs=0.03)
    # A slow creep is no rest, however slow from row to row.
    creep = JointLog(JOINT_S, ("a",), (0.01 * JOINT_S)[:, None])
    assert find_rests(creep) == []
    # Noise below the tolerance does not end a rest.
    noise = np.random.default_rng(1).normal(0.0, 2e-4, (len(JOINT_S), 2))
    assert len(find_rests(JointLog(JOINT_S, ("a", "b"), log.position + noise))) == len(POSTURES)


def test_pictures_that_show_no_movement_say_nothing_of_the_clock() -> None:
    log = JointLog(JOINT_S, ("a", "b"), np.array([joints_at(time) for time in JOINT_S]))
    noise = np.random.default_rng(2).uniform(0.9, 1.1, len(PICTURE_S))
    assert not match_clocks(log, PICTURE_S, noise).trusted
    assert not match_clocks(log, PICTURE_S, np.zeros(len(PICTURE_S))).trusted


def test_an_episode_begins_with_its_own_picture_however_its_time_is_rounded(tmp_path: Path) -> None:
    """The film's stamps are whole multiples of a frame, the table's are floating-point numbers."""
    root = Path(write_lerobot(tmp_path, 3)[0])
    file = root / "meta/episodes/chunk-000/file-000.parquet"
    rows = pa.parquet.read_table(file).to_pylist()
    for row in rows:
        row["videos/observation.images.front/from_timestamp"] += 1e-4
    pa.parquet.write_table(pa.Table.from_pylist(rows), file)
    pictures = list(read_dataset(root, image=None, episode=1, degrees=True).pictures())
    assert len(pictures) == len(np.arange(0, LENGTH_S - 0.05, 1 / FPS))
    assert pictures[0][0] == pytest.approx(0.0, abs=2e-4)


def test_actions_of_other_names_are_no_commands(tmp_path: Path) -> None:
    root = Path(write_lerobot(tmp_path, 3)[0])
    file = root / "meta/info.json"
    info = json.loads(file.read_text())
    info["features"]["action"]["names"] = ["b.pos", "a.pos"]
    file.write_text(json.dumps(info))
    log = read_dataset(root, image=None, episode=1, degrees=True).joints
    assert log.names == ("a", "b") and log.measured is None and not log.commanded


def test_clocks_that_have_nothing_in_common_are_matched_from_their_beginnings() -> None:
    since_1970 = 1.7e9 + JOINT_S
    log = JointLog(since_1970, ("a", "b"), np.array([joints_at(time) for time in JOINT_S]))
    motion = picture_motion((time, picture_at(time)) for time in PICTURE_S)[1]
    # The film began 7.3 s after the log.
    found = match_begins(log, PICTURE_S - 7.3, motion)
    assert found.trusted
    assert found.offset_s == pytest.approx(-7.3 - 1.7e9, abs=OFFSET_ERROR / FPS)


def test_positions_in_another_unit_are_refused(session: Path) -> None:
    robot = Robot.from_urdf(session / "robot.urdf")

    def recorded(factor: float) -> Recording:
        log = JointLog(JOINT_S, ("a", "b"), factor * np.array([joints_at(time) for time in JOINT_S]))
        return Recording(log, lambda: iter(()), None, "a log")

    kept = [(0, "a"), (1, "b")]
    assert check_limits(recorded(1.0), robot, kept) == []
    with pytest.raises(MirrorPostureError, match=r"a goes from .* degrees"):
        check_limits(recorded(180.0 / np.pi), robot, kept)
    high = next(joint.upper for joint in robot.joints if joint.name == "a")
    slightly = (high + 0.2) / max(posture[0] for posture in POSTURES)
    assert "a goes from" in check_limits(recorded(slightly), robot, kept)[0]


def test_what_cannot_be_meant_is_refused(session: Path, tmp_path: Path) -> None:
    words = write_pictures(tmp_path)
    assert "--joints" in run("import", words[0], session, code=1).stderr
    assert "THEIRS=OURS" in run("import", *words[:1], session, *words[1:], "--joint", "a", code=1).stderr
    # Before, the column was left out, and the joint taken to stand at 0.
    told = run("import", *words[:1], session, *words[1:], "--joint", "b=elbow", code=1).stderr
    assert "--joint: got 'b=elbow', needed THEIRS=OURS with OURS one of the robot's joints: a, b" in told
    told = run("import", *words[:1], session, *words[1:], "--offset-s", "nan", code=1).stderr
    assert "--offset-s: got nan, needed a finite number of seconds" in told
    assert (
        "has no joint 'x'" in run("import", *words[:1], session, *words[1:], "--joint", "x=a", code=1).stderr
    )
    assert (
        "no moment of 9 s" in run("import", *words[:1], session, *words[1:], "--rest-s", "9", code=1).stderr
    )
    assert (
        "no picture lies" in run("import", *words[:1], session, *words[1:], "--offset-s", "99", code=1).stderr
    )
    assert "needed .mcap" in run("import", session / "session.toml", session, code=1).stderr
    # Options of another kind of recording, which changed nothing before.
    for option in (("--episode", "3"), ("--image", "left"), ("--joints-topic", "/joint_states")):
        told = run("import", *words[:1], session, *words[1:], *option, code=1).stderr
        assert f"{option[0]} is of another kind of recording" in told
    assert not (session / "frames.csv").exists()
    with pytest.raises(MirrorPostureError, match="not later"):
        JointLog(np.array([0.0, 0.0]), ("a",), np.zeros((2, 1)))


def test_a_column_that_is_a_joint_but_for_capitals_is_refused(session: Path, tmp_path: Path) -> None:
    """Before: left out with a warning, and the joint was taken to stand at 0."""
    words = write_pictures(tmp_path)
    log = Path(words[2])
    log.write_text(log.read_text().replace('"b"', '"B"'))
    told = run("import", words[0], session, *words[1:], code=1).stderr
    assert "joints.csv, column 'B': the robot has no joint 'B', but 'b'" in told and "--joint B=b" in told
    assert not (session / "frames.csv").exists()
    run("import", words[0], session, *words[1:], "--joint", "B=b")
    np.testing.assert_allclose(load_session(session).frames.commanded, POSTURES, atol=1e-6)


def test_pictures_beyond_the_log_are_told(session: Path, tmp_path: Path) -> None:
    words = write_pictures(tmp_path)
    assert "outside of the log" not in run("import", words[0], session, *words[1:]).stderr
    log = Path(words[2])
    rows = log.read_text().splitlines(keepends=True)
    until = 3 * PERIOD_S
    log.write_text("".join(rows[: 1 + round(until * RATE_HZ)]))
    document = json.loads(run("import", words[0], session, *words[1:], "--overwrite", "--json").stdout)
    [told] = [text for text in document["warnings"] if "outside of the log" in text]
    last = until - 1 / RATE_HZ + document["offset_s"]
    beyond = int((np.round(PICTURE_S + OFFSET_S, 3) > last).sum())
    assert told.startswith(f"{beyond} of {len(PICTURE_S)} pictures lie outside of the log's times")
    assert "joints.csv" in told and f" to {last:.10g} s of the pictures' clock" in told


def test_a_log_in_radians_that_is_taken_for_degrees_is_told(session: Path, tmp_path: Path) -> None:
    words = write_pictures(tmp_path)
    arguments = ("import", words[0], session, *words[1:], "--degrees", "--tolerance", "0.0001", "--overwrite")
    assert "joints.csv: with --degrees no joint turns by 3° or more" in run(*arguments).stderr
    log = Path(words[2])
    values = np.degrees([joints_at(time) for time in JOINT_S])
    pyarrow.csv.write_csv(pa.table({"time_s": JOINT_S, "a": values[:, 0], "b": values[:, 1]}), log)
    assert "with --degrees no joint" not in run(*arguments).stderr


@pytest.mark.parametrize("per_s", [4, 10, 20, 30])
def test_the_clocks_offset_is_found_to_a_fraction_of_a_picture(per_s: int) -> None:
    log = JointLog(JOINT_S, ("a", "b"), np.array([joints_at(time) for time in JOINT_S]))
    picture_s = np.arange(0.0, JOINT_S[-1], 1 / per_s)
    # Less than half of the beat in which the arm moves, and at several places between two pictures.
    for offset in (-0.713, -0.05, 0.0, 0.0125, 0.4, 0.627):
        motion = picture_motion((time, picture_at(time - offset)) for time in picture_s)[1]
        for noise in (0.1, 2.8):
            found = match_clocks(log, picture_s, np.hypot(motion, noise))
            assert found.trusted, (offset, noise)
            assert abs(found.offset_s - offset) < OFFSET_ERROR / per_s, (offset, noise, found)
