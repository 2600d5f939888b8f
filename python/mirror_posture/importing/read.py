"""Determines the kind of a recording, and its reader."""

from __future__ import annotations

from pathlib import Path

from .._core import MirrorPostureError
from .bags import is_bag, read_bag
from .films import FILMS, read_film, read_pictures
from .joint_csv import TIME
from .lerobot_dataset import is_dataset, read_dataset
from .recording import Recording

NEEDED = f".mcap, .bag, a ROS 2 bag's folder, a LeRobot dataset's folder, a film ({', '.join(FILMS)}) or a folder of pictures"


def read_recording(
    source: Path,
    *,
    joints_file: Path | None = None,
    joints_topic: str | None = None,
    commands_topic: str | None = None,
    image: str | None = None,
    episode: int | None = None,
    degrees: bool = False,
    time: str | None = None,
) -> Recording:
    """Reads a recording of any kind that is known.

    - a bag: `.mcap`, `.bag` (ROS 1), or a folder with metadata.yaml (ROS 2); `joints_topic`, `commands_topic`, `image` name topics;
    - a LeRobot dataset (v2.1, v3): the folder with meta/info.json; `image` names the camera, `episode` the episode (the first by default);
    - a film, or a folder of pictures, with `joints_file`: a CSV with a column for each joint and one of `time` (`stamp=ms`: in
      milliseconds; `time_s` by default).

    Raises:
        MirrorPostureError: an unknown kind, a missing package (with what to install), several topics to choose from, an option that
            another kind of recording has.
    """
    if not source.exists():
        raise MirrorPostureError(f"{source}: there is no such file or folder; needed {NEEDED}")
    topics = {"--joints-topic": joints_topic, "--commands-topic": commands_topic}
    beside = {"--joints": joints_file, "--time": time}
    if is_dataset(source):
        _refuse(source, "a LeRobot dataset", {**beside, **topics})
        return read_dataset(source, image=image, episode=episode or 0, degrees=degrees)
    if is_bag(source):
        _refuse(source, "a bag", {**beside, "--episode": episode})
        return read_bag(
            source,
            joints_topic=joints_topic,
            commands_topic=commands_topic,
            image_topic=image,
            degrees=degrees,
        )
    if source.is_dir() or source.suffix.lower() in FILMS:
        if joints_file is None:
            raise MirrorPostureError(
                f"{source}: pictures alone; add --joints FILE.csv with time_s and the joints"
            )
        _refuse(source, "pictures or a film", {"--image": image, "--episode": episode, **topics})
        reader = read_pictures if source.is_dir() else read_film
        return reader(source, joints_file, degrees, TIME if time is None else time)
    raise MirrorPostureError(f"{source}: got the ending {source.suffix!r}, needed {NEEDED}")


def _refuse(source: Path, kind: str, options: dict[str, object]) -> None:
    """Refuses options that would change nothing for this kind of recording."""
    for option, value in options.items():
        if value is not None:
            raise MirrorPostureError(
                f"{source} is {kind}: {option} is of another kind of recording; leave it out"
            )
