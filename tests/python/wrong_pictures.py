"""Pictures that are not what the session says: each usual mistake made with rendered pictures of a robot, then `check`, `detect` and `measure` by the command line.

    python tests/python/wrong_pictures.py [--robot embedded arm] [--only TEXT ...] [--keep FOLDER]

For each mistake: what `detect` says and its exit code, and what `check` and `measure` say of image points that somebody else has detected in the same pictures (detection with its
check off). A mistake is named where a command ends with an error that says what it is and what to do; `measured` is the fault that must not be.
"""

from __future__ import annotations

import argparse
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import yaml
from PIL import Image
from typer.testing import CliRunner

from mirror_posture import MirrorPostureError, cli
from mirror_posture.detect import detect_session
from mirror_posture.render import DEMO_POSTURES, DEMO_VIEWS, PictureOptions, render_session
from mirror_posture.session import write_detections


def pictures(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        for file in sorted((folder / "images").glob("*.png")):
            cv2.imwrite(str(file), np.ascontiguousarray(change(cv2.imread(str(file)))))

    return apply


def exif(orientation: int, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    """As a phone writes it that was held turned: pixels as the sensor has them, a tag that says how to show them."""

    def apply(folder: Path) -> None:
        for file in sorted((folder / "images").glob("*.png")):
            turned = Image.fromarray(np.ascontiguousarray(change(cv2.imread(str(file)))[..., ::-1]))
            tag = Image.Exif()
            tag[0x0112] = orientation
            turned.save(file, exif=tag)

    return apply


def text(name: str, pattern: str, change: Callable[[re.Match[str]], str]) -> Callable[[Path], None]:
    def apply(folder: Path) -> None:
        file = folder / name
        before = file.read_text(encoding="utf-8")
        after = re.sub(pattern, change, before, count=1)
        assert after != before, (name, pattern)
        file.write_text(after, encoding="utf-8")

    return apply


def camera(factors: list[float]) -> Callable[[Path], None]:
    """Another camera's file: the camera matrix's numbers times factors."""

    def apply(folder: Path) -> None:
        file = folder / "camera.yaml"
        tree = yaml.safe_load(file.read_text(encoding="utf-8"))
        numbers = tree["camera_matrix"]["data"]
        tree["camera_matrix"]["data"] = [float(n * f) for n, f in zip(numbers, factors, strict=True)]
        file.write_text(yaml.safe_dump(tree), encoding="utf-8")

    return apply


def board_turned(folder: Path) -> None:
    """The board's link, where it is mounted, turned by 180° about its z axis."""
    board = re.search(r"\[board\][^\[]*?link = \"([^\"]+)\"", (folder / "session.toml").read_text())
    assert board is not None

    def turned(match: re.Match[str]) -> str:
        roll, pitch, yaw = (float(n) for n in match[2].split())
        z = cv2.Rodrigues(np.array([0, 0, yaw]))[0] @ cv2.Rodrigues(np.array([0, pitch, 0]))[0]
        turn = z @ cv2.Rodrigues(np.array([roll, 0, 0.0]))[0] @ np.diag([-1.0, -1.0, 1.0])
        pitch = -np.arcsin(np.clip(turn[2, 0], -1, 1))
        roll, yaw = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
        return f"{match[1]}{roll:.17g} {pitch:.17g} {yaw:.17g}{match[3]}"

    robot = folder / "robot.urdf"
    before = robot.read_text(encoding="utf-8")
    joints = re.split(r"(?=<joint )", before)
    for i, joint in enumerate(joints):
        if re.search(rf"<child link=\"{board[1]}\"", joint):
            if 'rpy="' not in joint.split("</joint>")[0]:
                joints[i] = joint.replace("<origin ", '<origin rpy="0 0 0" ', 1)
            joints[i] = re.sub(r"(rpy=\")([^\"]*)(\")", turned, joints[i], count=1)
    after = "".join(joints)
    assert after != before
    robot.write_text(after, encoding="utf-8")


def zoomed(picture: np.ndarray) -> np.ndarray:
    height, width = picture.shape[:2]
    part = picture[height // 16 : height - height // 16, width // 16 : width - width // 16]
    return cv2.resize(part, (width, height), interpolation=cv2.INTER_CUBIC)


@dataclass
class Mistake:
    name: str
    make: Callable[[Path], None]
    words: str
    """What the message must say (a pattern)."""


MISTAKES = [
    Mistake("none", lambda folder: None, ""),
    Mistake("mirrored left-right", pictures(lambda p: p[:, ::-1]), "mirrored left-right"),
    Mistake("mirrored up-down", pictures(lambda p: p[::-1]), "mirrored up-down"),
    Mistake("turned by 180°", pictures(lambda p: p[::-1, ::-1]), "turned by 180°"),
    Mistake("turned by 90°", pictures(lambda p: np.rot90(p, -1)), "turned by 90°"),
    Mistake("turned by 270°", pictures(lambda p: np.rot90(p, 1)), "turned by 90°"),
    Mistake("EXIF says 180°, pixels turned", exif(3, lambda p: p[::-1, ::-1]), "turned by 180°"),
    Mistake("EXIF says 90°, pixels turned", exif(6, lambda p: np.rot90(p, 1)), "turned by 90°"),
    Mistake("EXIF says mirrored, pixels mirrored", exif(2, lambda p: p[:, ::-1]), "mirrored left-right"),
    Mistake("cropped", pictures(lambda p: p[40:-40, 60:-60]), "cropped"),
    Mistake("cropped and enlarged", pictures(zoomed), "cropped or zoomed|another resolution"),
    Mistake("half the resolution", pictures(lambda p: cv2.resize(p, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)), "resized|resolution"),
    Mistake("board mounted turned by 180°", board_turned, "turned by 180°"),
    Mistake("board of larger squares", text("session.toml", r"(square = )([0-9.]+)()", lambda m: f"{m[1]}{1.25 * float(m[2]):.5f}"), "squares measure"),
    Mistake("another board: corners exchanged", text("session.toml", r"corners = \[\s*(\d+),\s*(\d+),?\s*\]", lambda m: f"corners = [{m[2]}, {m[1]}]"), "turned by 90°|counted|corners"),
    Mistake("another camera's file: other lens", camera([1.3, 1, 1, 1, 1.3, 1, 1, 1, 1]), "another camera's"),
    Mistake("camera file of half the resolution", camera([0.5, 1, 0.5, 1, 0.5, 0.5, 1, 1, 1]), "another camera's|resolution"),
]  # fmt: skip


def embedded(folder: Path) -> Path:
    return render_session(
        folder, DEMO_POSTURES[:2], DEMO_VIEWS[:2], options=PictureOptions(glass_thickness_m=0.003)
    )


def arm(folder: Path) -> Path:
    """Another robot, drawn by MuJoCo."""
    from small_arm import run, setup

    folder.parent.mkdir(parents=True, exist_ok=True)
    session = setup(folder.parent)
    run(
        "render", folder, "--template", session, "--meshes", "--joint", "pan=10", "--joint", "lift=40", "--joint", "elbow=-60",
        "--yaw=-8", "--yaw=0", "--yaw=9", "--distance", "450",
    )  # fmt: skip
    return folder


ROBOTS = {"embedded": embedded, "arm": arm}


def said(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(cli.app, [str(a) for a in arguments], env={"COLUMNS": "1000"})
    return result.exit_code, " ".join((result.stderr or result.output).split())


@dataclass
class Outcome:
    """What each command said: named (an error with the right words), refused (another error), nothing, or measured."""

    robot: str
    mistake: str
    detect: str
    check: str
    measure: str
    words: str


def outcomes(robot: str, only: list[str], place: Path) -> Iterator[Outcome]:
    clean = ROBOTS[robot](place / robot / "clean")
    for mistake in MISTAKES:
        if not any(part in mistake.name for part in only):
            continue
        folder = place / robot / re.sub(r"\W+", "-", mistake.name)
        shutil.copytree(clean, folder)
        mistake.make(folder)

        def verdict(code: int, words: str, quiet: str, mistake: Mistake = mistake) -> str:
            if code == 0:
                return quiet
            return "named" if mistake.words and re.search(mistake.words, words) else "refused"

        code, heard = said("detect", folder, "--no-overlays")
        detect = verdict(code, heard, "passed")
        (folder / "detections.csv").unlink(missing_ok=True)
        # Image points that somebody else has found in the same pictures.
        try:
            found = detect_session(folder, check=False)
            some = found.session.mirror_view.board_seen.any()
            errors = " ".join(p.error or "" for p in found.pictures.values())
        except MirrorPostureError as error:
            some, errors = False, str(error)
        if some:
            write_detections(found.session, folder / "detections.csv")
        code, of_check = said("check", folder)
        check = verdict(code, of_check, "passed")
        code, of_measure = said("measure", folder)
        measure = verdict(code, of_measure, "measured")
        yield Outcome(
            robot, mistake.name, detect, check, measure, heard + " " + errors[:200] + " | " + of_check[-200:]
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", nargs="*", default=list(ROBOTS))
    parser.add_argument("--only", nargs="*", default=[""])
    parser.add_argument("--words", action="store_true")
    given = parser.parse_args()
    print("| robot | mistake | detect | check | measure |\n| --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as place:
        for robot in given.robot:
            for one in outcomes(robot, given.only, Path(place)):
                print(
                    f"| {one.robot} | {one.mistake} | {one.detect} | {one.check} | {one.measure} |",
                    flush=True,
                )
                if given.words:
                    print("   ", one.words[:600])


if __name__ == "__main__":
    main()
