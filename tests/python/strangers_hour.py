"""A stranger's first hour, command by command: from a robot's URDF to its diagnosis, in a world that MuJoCo draws.

    python tests/python/strangers_hour.py OUT so101 folder
    python tests/python/strangers_hour.py OUT g1 folder
    python tests/python/strangers_hour.py OUT so101 mcap
    python tests/python/strangers_hour.py OUT so101 lerobot

Writes OUT/transcript.md, which docs/first-hour.md quotes. Needs an OpenGL (MUJOCO_GL=egl) and example-robot-data. The stranger runs
commands and writes no file by hand; the world (`stranger_world`) holds the postures, with faults that no file tells.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet

from stranger_world import World

HOLD_S, MOVE_S, FPS = 1.2, 0.4, 5
RECORDED_PLAN = ["--postures", "16"]
"""Of a recording: each posture is held and then left; few pictures, since each is drawn."""


@dataclass(frozen=True)
class Body:
    """A robot, where the stranger puts camera, board and balls, and what is wrong with it."""

    urdf: str
    words: list[str]
    plan: list[str]
    offset_rad: Mapping[str, float] = field(default_factory=dict)
    scale_error: Mapping[str, float] = field(default_factory=dict)
    swapped: tuple[str, str] | None = None

    def faults(self, commands: Mapping[str, float]) -> dict[str, float]:
        """Where the joints go."""
        told = dict(commands)
        if self.swapped is not None:
            a, b = self.swapped
            told[a], told[b] = commands[b], commands[a]
        return {
            n: v * (1.0 + self.scale_error.get(n, 0.0)) + self.offset_rad.get(n, 0.0) for n, v in told.items()
        }

    def truth(self) -> set[tuple[str, str]]:
        """The causes that a diagnosis should name."""
        found = {("joint_offset", f"joint:{name}") for name in self.offset_rad}
        found |= {("gear_ratio", f"joint:{name}") for name in self.scale_error}
        return found | (
            {("joints_swapped", f"joint:{self.swapped[0]}<->joint:{self.swapped[1]}")}
            if self.swapped
            else set()
        )


SO101_WORDS = [
    "--camera", "base_link", "--camera-at=-0.06,0.12,0.28", "--camera-looks", "1,0,-0.2", "--board", "base_link", "--board-at=-0.02,-0.2,0.1",
    "--marker", "hand=gripper_link@0.05,0,-0.03", "--marker", "jaw=gripper_link@-0.03,0.04,-0.02", "--marker", "forearm=lower_arm_link@-0.09,0,0.06",
    "--square-mm", "20", "--ball-mm", "25", "--glass-mm", "0",
]  # fmt: skip
G1_WORDS = [
    "--camera", "torso_link", "--camera-at", "0.085,0,0.42", "--camera-looks", "1,0,-0.1", "--board", "torso_link", "--board-at", "0.14,0,0.2",
    "--marker", "hand=right_wrist_yaw_link@0.11,-0.01,0.035", "--marker", "fist=right_wrist_yaw_link@0.06,-0.05,0",
    "--marker", "forearm=right_elbow_link@0.07,0,0.04", "--square-mm", "20", "--ball-mm", "30", "--glass-mm", "0",
]  # fmt: skip
SO101 = Body(
    "so_arm_description/urdf/so101.urdf", SO101_WORDS, [], {"elbow_flex": 0.05}, {"shoulder_lift": 0.04},
)  # fmt: skip
BODIES = {
    "so101": SO101,
    "so101-swapped": Body(SO101.urdf, SO101_WORDS, SO101.plan, {}, {"shoulder_lift": 0.04}, ("elbow_flex", "wrist_flex")),
    "g1": Body(
        "g1_description/urdf/g1_29dof_rev_1_0.urdf", G1_WORDS, ["--postures", "24"], {"right_elbow_joint": 0.04}, {"right_shoulder_roll_joint": 0.03},
    ),
    "g1-swapped": Body(
        "g1_description/urdf/g1_29dof_rev_1_0.urdf", G1_WORDS, ["--postures", "24"], {"right_elbow_joint": 0.04}, {},
        ("right_wrist_pitch_joint", "right_wrist_yaw_joint"),
    ),
}  # fmt: skip


def described() -> tuple[Path, dict[str, Path]]:
    """example-robot-data's folder of robots, and its ROS package."""
    from mirror_lab.blind.known_robots import description_file

    robots = description_file(SO101.urdf).parents[2]
    return robots, {"example-robot-data": robots.parent}


Run = Callable[[Path, tuple[str, ...]], tuple[int, str, str]]
"""Runs a command in a folder; returns its exit code, its words, and its errors."""


def by_process(folder: Path, words: tuple[str, ...]) -> tuple[int, str, str]:
    """Runs a command as a person does."""
    done = subprocess.run(
        [sys.executable, "-m", "mirror_posture", *words], cwd=folder, capture_output=True, text=True
    )
    return done.returncode, done.stdout, done.stderr


class Transcript:
    """Runs the stranger's commands in a folder, and keeps what was said."""

    def __init__(self, folder: Path, run: Run | None = None) -> None:
        self.folder, self.text, self.count, self._run = folder, "", 0, run or by_process

    def run(self, *words: str, hide: Mapping[str, str] | None = None) -> str:
        """Runs `mirror-posture WORDS`; raises where it fails."""
        self.count += 1
        shown = shlex.join(["mirror-posture", *words])
        code, stdout, stderr = self._run(self.folder, words)
        for path, name in (hide or {}).items():
            shown, stdout, stderr = (text.replace(path, name) for text in (shown, stdout, stderr))
        self.text += f"```\n$ {shown}\n{stderr}{stdout}```\n\n"
        (self.folder / "transcript.md").write_text(self.text)
        if code != 0:
            raise SystemExit(f"{shown}\n{stdout}{stderr}")
        return stdout


def hour(
    out: Path,
    body: Body,
    way: str,
    urdf: Path,
    packages: Mapping[str, Path],
    run: Run | None = None,
    short: bool = False,
) -> tuple[dict, Transcript]:
    """The whole hour, `short` without what is not needed on the way; returns the diagnosis' document and the transcript."""
    out.mkdir(parents=True)
    shutil.copy(urdf, out / urdf.name)
    told = Transcript(out, run)
    if not short:
        told.run("board", "board.pdf", "--square-mm", body.words[body.words.index("--square-mm") + 1])
    told.run("init", urdf.name, "session", *body.words, *(w for n, p in packages.items() for w in ("--package", f"{n}={p}")),
             hide={str(p): f"…/{n}" for n, p in packages.items()})  # fmt: skip
    told.run("plan", "session", *(body.plan if way == "folder" else RECORDED_PLAN))
    world = World(out / "session", packages, 1)
    if way == "folder":
        (out / "pictures").mkdir()
        for frame, _, picture in world.frames(body.faults):
            cv2.imwrite(str(out / "pictures" / f"{frame:04d}.png"), picture)
        told.run("capture", "session", "--source", "pictures")
    else:
        writer = {"mcap": write_mcap, "lerobot": write_lerobot}[way]
        told.run(
            "import",
            writer(out, list(recorded(world, body))),
            "session",
            *(["--degrees"] if way == "lerobot" else []),
        )
    world.close()
    if short:
        return json.loads(told.run("diagnose", "session", "--json")), told
    told.run("check", "session")
    told.run("diagnose", "session", "--out", "diagnosis")
    told.run("apply", "session", "diagnosis", "--out", "better", "--urdf", urdf.name)
    return json.loads((out / "diagnosis" / "diagnosis.json").read_text()), told


@dataclass(frozen=True)
class Moment:
    """A moment of a recording."""

    time_s: float
    commands: dict[str, float]
    picture: np.ndarray


def recorded(world: World, body: Body) -> Iterator[Moment]:
    """The plan as a film: each posture held, straight moves in between. Held pictures differ by their noise alone."""
    random = np.random.default_rng(2)
    time, before = 0.0, None
    for row, view in zip(world.rows, world.views, strict=True):
        here = {name: value for name, value in row.items() if name not in ("frame", "posture")}
        for step in range(round(MOVE_S * FPS) if before is not None else 0):
            share = (step + 1) / (MOVE_S * FPS + 1)
            between = {n: before[n] + share * (here[n] - before[n]) for n in here}
            yield Moment(time, between, world.picture(body.faults(between), view))
            time += 1.0 / FPS
        clean = world.picture(body.faults(here), view)
        for _ in range(round(HOLD_S * FPS)):
            noisy = clean + random.normal(0.0, 1.0, clean.shape)
            yield Moment(time, here, np.clip(noisy, 0, 255).astype(np.uint8))
            time += 1.0 / FPS
        before = here


def write_mcap(out: Path, moments: list[Moment]) -> str:
    """A bag by the package mcap-ros2-support: joint states and compressed pictures."""
    from mcap_ros2.writer import Writer

    stamp = "================\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n================\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
    header = "std_msgs/Header header\n"
    with (out / "recording.mcap").open("wb") as stream:
        writer = Writer(stream)
        joint = writer.register_msgdef(
            "sensor_msgs/msg/JointState",
            header + "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + stamp,
        )
        image = writer.register_msgdef(
            "sensor_msgs/msg/CompressedImage", header + "string format\nuint8[] data\n" + stamp
        )
        for moment in moments:
            total = 1000.0 + moment.time_s
            at = {"stamp": {"sec": int(total), "nanosec": round((total % 1) * 1e9)}, "frame_id": ""}
            log = round(total * 1e9)
            state = {
                "header": at,
                "name": list(moment.commands),
                "position": list(moment.commands.values()),
                "velocity": [],
                "effort": [],
            }
            writer.write_message("/joint_states", joint, state, log_time=log)
            data = cv2.imencode(".jpg", moment.picture, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
            writer.write_message(
                "/camera/image_raw/compressed",
                image,
                {"header": at, "format": "jpeg", "data": data},
                log_time=log,
            )
        writer.finish()
    return "recording.mcap"


def write_lerobot(out: Path, moments: list[Moment]) -> str:
    """A dataset by the rules of LeRobot's format v3.0, with the packages that LeRobot writes it with: pyarrow and av."""
    import av

    root, key = out / "dataset", "observation.images.head"
    for folder in ("data/chunk-000", f"videos/{key}/chunk-000", "meta/episodes/chunk-000"):
        (root / folder).mkdir(parents=True)
    names = list(moments[0].commands)
    degrees = np.degrees([[moment.commands[name] for name in names] for moment in moments]).astype(np.float32)
    times = np.array([moment.time_s for moment in moments])
    height, width = moments[0].picture.shape[:2]
    pa.parquet.write_table(
        pa.table({"action": pa.array(degrees.tolist()), "observation.state": pa.array(degrees.tolist()),
                  "timestamp": pa.array(times.astype(np.float32)), "episode_index": np.zeros(len(moments), dtype=np.int64)}),
        root / "data/chunk-000/file-000.parquet",
    )  # fmt: skip
    with av.open(str(root / f"videos/{key}/chunk-000/file-000.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=FPS, options={"crf": "10"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.time_base = Fraction(1, FPS)
        for index, moment in enumerate(moments):
            picture = av.VideoFrame.from_ndarray(moment.picture, format="bgr24")
            picture.pts, picture.time_base = index, Fraction(1, FPS)
            container.mux(stream.encode(picture))
        container.mux(stream.encode())
    row = {"episode_index": 0, "data/chunk_index": 0, "data/file_index": 0, f"videos/{key}/chunk_index": 0, f"videos/{key}/file_index": 0,
           f"videos/{key}/from_timestamp": 0.0, f"videos/{key}/to_timestamp": len(moments) / FPS}  # fmt: skip
    pa.parquet.write_table(pa.Table.from_pylist([row]), root / "meta/episodes/chunk-000/file-000.parquet")
    info = {
        "codebase_version": "v3.0", "fps": FPS, "total_episodes": 1,
        "features": {name: {"dtype": "float32", "shape": [len(names)], "names": [f"{n}.pos" for n in names]} for name in ("action", "observation.state")}
        | {key: {"dtype": "video", "shape": [height, width, 3]}},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
    }  # fmt: skip
    (root / "meta/info.json").write_text(json.dumps(info))
    return "dataset"


def main() -> None:
    """One hour; prints what was found beside what was hidden."""
    out, name, way = Path(sys.argv[1]).resolve(), sys.argv[2], sys.argv[3]
    os.environ.setdefault("MUJOCO_GL", "egl")
    body = BODIES[name]
    robots, packages = described()
    document, told = hour(out, body, way, robots / body.urdf, packages)
    named = {(cause["effect"], cause["at"]) for cause in document["causes"]}
    print(f"{told.count} commands; found: {sorted(named & body.truth())}")
    print(f"missed: {sorted(body.truth() - named)}; beside: {sorted(named - body.truth())}")


if __name__ == "__main__":
    main()
