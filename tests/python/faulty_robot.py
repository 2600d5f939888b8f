"""A robot around a robot that injects faults at random, and watches that nothing unsafe is sent; run it for docs/faults.md.

python tests/python/faulty_robot.py --runs 40
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType

import cv2
import numpy as np

from mirror_lab.robots import HiddenEffect
from mirror_lab.robots.mujoco import MujocoOptions, MujocoRobot
from mirror_posture.correct import CorrectOptions, Recorder, correct, make_target
from mirror_posture.robots import Arrival, Look, NoLookError, Nominal
from mirror_posture.viewpoint import View

POSTURE = {"r_shoulder_pitch": -0.26, "r_shoulder_roll": 1.2, "r_elbow": 0.3}
HAND = "r_hand"
TOLERANCE_M = 0.001


class Fault:
    """Nothing goes wrong; a fault changes one of these."""

    name = "none"

    def __init__(self, rng: np.random.Generator, robot: MujocoRobot) -> None:
        self.rng, self.robot = rng, robot
        self.hand = robot.nominal.marker_names.index(HAND)

    def command(self, positions: dict[str, float]) -> dict[str, float]:
        """What the robot really gets."""
        return positions

    def turn(self, view: View) -> View:
        """How the mirror really stands."""
        return view

    def look(self, take: Callable[[], Look]) -> Look:
        """What is seen."""
        return take()


def _moved(look: Look, marker: int, pixel: np.ndarray | None) -> Look:
    """The look with a marker elsewhere in the picture, or not at all."""
    points = look.points
    assert points is not None
    px, seen = points.marker_px.copy(), points.marker_seen.copy()
    px[marker], seen[marker] = (0.0, False) if pixel is None else (pixel, True)
    std = points.marker_std_px
    if std is not None:
        std = std.copy()
        std[marker] = 0.1 if pixel is not None else 0.0
    return replace(look, points=replace(points, marker_px=px, marker_seen=seen, marker_std_px=std))


class HiddenNowAndThen(Fault):
    name = "marker hidden in every third picture"

    def look(self, take: Callable[[], Look]) -> Look:
        look = take()
        return _moved(look, self.hand, None) if self.rng.random() < 0.35 else look


class HiddenForGood(Fault):
    name = "marker hidden from some picture on"

    def __init__(self, rng: np.random.Generator, robot: MujocoRobot) -> None:
        super().__init__(rng, robot)
        self.left = int(rng.integers(0, 6))

    def look(self, take: Callable[[], Look]) -> Look:
        self.left -= 1
        look = take()
        return _moved(look, self.hand, None) if self.left < 0 else look


class BoardHidden(Fault):
    name = "board hidden in every third picture"

    def look(self, take: Callable[[], Look]) -> Look:
        look = take()
        assert look.points is not None
        if self.rng.random() > 0.35:
            return look
        nothing = np.zeros_like(look.points.board_seen)
        return replace(look, points=replace(look.points, board_seen=nothing))


class NoPicture(Fault):
    name = "camera gives no picture, every third time"

    def look(self, take: Callable[[], Look]) -> Look:
        if self.rng.random() < 0.35:
            raise NoLookError("the camera gave no picture")
        return take()


class WrongBlobSometimes(Fault):
    name = "blob 3 to 200 px off in every fourth picture"

    def look(self, take: Callable[[], Look]) -> Look:
        look = take()
        assert look.points is not None
        if self.rng.random() > 0.25 or not look.points.marker_seen[self.hand]:
            return look
        angle, away = (
            self.rng.uniform(0.0, 2.0 * np.pi),
            math.exp(self.rng.uniform(math.log(3.0), math.log(200.0))),
        )
        off = away * np.array([np.cos(angle), np.sin(angle)])
        return _moved(look, self.hand, look.points.marker_px[self.hand] + off)


class WrongBall(Fault):
    name = "blob always on another ball"

    def __init__(self, rng: np.random.Generator, robot: MujocoRobot) -> None:
        super().__init__(rng, robot)
        others = [
            i for i, n in enumerate(robot.nominal.marker_names) if n in ("r_forearm", "l_hand", "l_forearm")
        ]
        self.other = int(rng.choice(others))

    def look(self, take: Callable[[], Look]) -> Look:
        look = take()
        assert look.points is not None
        seen = bool(look.points.marker_seen[self.other])
        return _moved(look, self.hand, look.points.marker_px[self.other] if seen else None)


class _Elsewhere(Fault):
    """The blob is a thing that is really there, seen in every picture where the mirror shows it."""

    def thing(self, poses: Mapping[str, np.ndarray]) -> np.ndarray:
        raise NotImplementedError

    def look(self, take: Callable[[], Look]) -> Look:
        link = self.robot.nominal.metadata.markers[self.hand].link
        real = type(self.robot).link_poses

        def poses() -> dict[str, np.ndarray]:
            found = real(self.robot)
            place = found[link].copy()
            place[:3, 3] = self.thing(found)
            return found | {link: place}

        self.robot.link_poses = poses  # type: ignore[method-assign]
        try:
            return take()
        finally:
            del self.robot.link_poses  # type: ignore[misc]


class SpotInTheRoom(_Elsewhere):
    name = "blob on a thing in the room, 10 to 45 mm from the ball"

    def __init__(self, rng: np.random.Generator, robot: MujocoRobot) -> None:
        super().__init__(rng, robot)
        way = rng.normal(size=3)
        q = robot.nominal.robot.positions(POSTURE)
        ball = robot.nominal.robot.points(q, robot.nominal.metadata.root, "r_hand_marker")[0]
        self.place = ball + way / np.linalg.norm(way) * rng.uniform(0.010, 0.045)

    def thing(self, poses: Mapping[str, np.ndarray]) -> np.ndarray:
        return self.place


class SpotOnTheArm(_Elsewhere):
    name = "blob on a spot of the same forearm, 10 to 45 mm from the ball"

    def __init__(self, rng: np.random.Generator, robot: MujocoRobot) -> None:
        super().__init__(rng, robot)
        way = rng.normal(size=3)
        self.shift = way / np.linalg.norm(way) * rng.uniform(0.010, 0.045)

    def thing(self, poses: Mapping[str, np.ndarray]) -> np.ndarray:
        hand = poses["r_hand_marker"]
        return hand[:3, 3] + hand[:3, :3] @ self.shift


class SpotOnTheArmWithWitness(SpotOnTheArm):
    name = "the same, with the forearm's own ball among the markers"


class MirrorBumped(Fault):
    name = "mirror bumped between the views, up to 6° and 20 mm"

    def turn(self, view: View) -> View:
        yaw, pitch = self.rng.uniform(-0.1, 0.1, 2)
        return View(
            view.yaw_rad + yaw, view.pitch_rad + pitch, view.distance_m + self.rng.uniform(-0.02, 0.02)
        )


class ArmBumped(Fault):
    name = "arm bumped between the views of a look, 1° to 6°"

    def look(self, take: Callable[[], Look]) -> Look:
        if self.rng.random() < 0.25:
            joint = str(self.rng.choice(list(POSTURE)))
            off = math.radians(self.rng.uniform(1.0, 6.0)) * self.rng.choice([-1.0, 1.0])
            told = dict(self.robot.commanded)
            limit = self.robot.limits[joint]
            # Not by command: somebody's hand.
            self.robot._move(told | {joint: min(max(told[joint] + off, limit.lower), limit.upper)})
            return replace(take(), commanded=told)
        return take()


class JointStuck(Fault):
    name = "a joint does not move from some step on"

    def __init__(self, rng: np.random.Generator, robot: MujocoRobot) -> None:
        super().__init__(rng, robot)
        self.joint, self.left = str(rng.choice(list(POSTURE))), int(rng.integers(1, 4))
        self.last = 0.0

    def command(self, positions: dict[str, float]) -> dict[str, float]:
        self.left -= 1
        if self.left >= 0:
            self.last = positions[self.joint]
        return positions | {self.joint: self.last}


class JointHalf(Fault):
    name = "a joint does half of each command after the first"

    def __init__(self, rng: np.random.Generator, robot: MujocoRobot) -> None:
        super().__init__(rng, robot)
        self.joint, self.first = str(rng.choice(list(POSTURE))), None

    def command(self, positions: dict[str, float]) -> dict[str, float]:
        if self.first is None:
            self.first = positions[self.joint]
        return positions | {self.joint: self.first + 0.5 * (positions[self.joint] - self.first)}


class Noisy(Fault):
    name = "pixels with ten times the noise that is claimed"

    def look(self, take: Callable[[], Look]) -> Look:
        look = take()
        assert look.points is not None
        p = look.points
        board = np.where(p.board_seen[:, None], p.board_px + self.rng.normal(0.0, 1.0, p.board_px.shape), 0.0)
        ball = np.where(
            p.marker_seen[:, None], p.marker_px + self.rng.normal(0.0, 1.0, p.marker_px.shape), 0.0
        )
        return replace(look, points=replace(p, board_px=board, marker_px=ball))


class Blurred(Fault):
    """For robots that take pictures."""

    name = "pictures blurred or smeared, at random up to 5 px"

    def look(self, take: Callable[[], Look]) -> Look:
        look = take()
        assert look.picture_bgr is not None
        picture = look.picture_bgr
        sigma, smear = self.rng.uniform(0.0, 5.0), int(self.rng.integers(1, 14))
        if self.rng.random() < 0.5:
            picture = cv2.GaussianBlur(picture, (0, 0), sigma + 0.01)
        else:
            kernel = np.zeros((15, 15), np.float32)
            angle = self.rng.uniform(0.0, np.pi)
            for t in np.linspace(-0.5, 0.5, 60):
                kernel[round(7 + smear * t * np.sin(angle)), round(7 + smear * t * np.cos(angle))] += 1.0
            picture = cv2.filter2D(picture, -1, kernel / kernel.sum())
        return replace(look, picture_bgr=np.asarray(picture, dtype=np.uint8))


PIXEL_FAULTS: tuple[type[Fault], ...] = (
    Fault,
    HiddenNowAndThen,
    HiddenForGood,
    BoardHidden,
    NoPicture,
    WrongBlobSometimes,
    WrongBall,
    SpotInTheRoom,
    SpotOnTheArm,
    SpotOnTheArmWithWitness,
    MirrorBumped,
    ArmBumped,
    JointStuck,
    JointHalf,
    Noisy,
)


class FaultyRobot:
    """A `CommandedRobot` that passes everything on to another one through a fault, and keeps what it was told."""

    def __init__(self, robot: MujocoRobot, fault: Fault) -> None:
        self.robot, self.fault = robot, fault
        self.commands: list[dict[str, float]] = []
        self.looks = 0
        self.name, self.nominal = f"faulty {robot.name}", robot.nominal
        self.joint_names, self.limits = robot.joint_names, robot.limits
        self.view = robot.view
        self._commanded = dict(robot.commanded)

    @property
    def commanded(self) -> dict[str, float]:
        return dict(self._commanded)

    def command(self, positions: Mapping[str, float]) -> Arrival:
        self._commanded |= positions
        self.commands.append(dict(self._commanded))
        told = self.fault.command(dict(self._commanded))
        arrival = self.robot.command(told)
        return replace(arrival, commanded=self.commanded)

    def look(self) -> Look:
        look = self.fault.look(self.robot.look)
        self.looks += 1
        return replace(look, commanded=self.commanded, view=self.view)

    def turn(self, view: View) -> None:
        self.view = view
        self.robot.turn(self.fault.turn(view))

    def rest(self) -> None:
        self.robot.rest()

    def close(self) -> None:
        self.robot.close()

    def __enter__(self) -> FaultyRobot:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.rest()
        self.close()


@dataclass(frozen=True)
class Trial:
    """One correction under a fault."""

    fault: str
    stop: str
    cause: str
    last_m: float
    looks: int
    unsafe: int
    """Commands beyond limits, or that turn a joint farther than the largest step (after the first)."""
    lost: int
    """Pictures taken that are not in the recording."""

    @property
    def wrong(self) -> bool:
        return self.stop == "converged" and self.last_m > TOLERANCE_M


def hidden_arm(rng: np.random.Generator) -> list[HiddenEffect]:
    """A body that stands a few millimetres wrong."""
    return [
        HiddenEffect(
            "joint_offset",
            f"joint:{joint}",
            {"offset_rad": float(rng.uniform(0.015, 0.05) * rng.choice([-1, 1]))},
        )
        for joint in rng.choice(list(POSTURE), 2, replace=False)
    ]


def trial(kind: type[Fault], seed: int, nominal: Nominal, way: str = "pixels") -> Trial:
    """One run, recorded."""
    rng = np.random.default_rng([seed, sum(kind.name.encode())])
    options = MujocoOptions(way=way, noise_px=0.1, stand_error_rad=0.02, seed=seed)  # type: ignore[arg-type]
    inner = MujocoRobot(hidden_arm(rng), options, nominal)
    choice = CorrectOptions()
    if kind is SpotOnTheArmWithWitness:
        choice = CorrectOptions(markers=(HAND, "r_forearm"))
    with tempfile.TemporaryDirectory() as folder, FaultyRobot(inner, kind(rng, inner)) as robot:
        recorder = Recorder.start(Path(folder) / "run", nominal, robot.joint_names)
        outcome = correct(robot, POSTURE, choice, recorder=recorder)
        file = Path(folder) / "run" / "frames.csv"
        kept = len(file.read_text().splitlines()) - 1 if file.exists() else 0
        lost = robot.looks - kept
        unsafe = sum(
            not robot.limits[joint].holds(position)
            for told in robot.commands
            for joint, position in told.items()
        )
        # The return to the best posture at the end may undo several steps at once; it was commanded before.
        earlier: list[dict[str, float]] = []
        for told in robot.commands:
            new = told not in earlier
            if earlier and new:
                farthest = max(abs(told[j] - earlier[-1][j]) for j in told)
                unsafe += farthest > choice.step.largest_step_rad + 1e-9
            earlier.append(told)
        target = make_target(nominal, POSTURE, choice)
        q = nominal.robot.positions(POSTURE)
        links = {m.name: m.link for m in nominal.metadata.markers}
        truth = inner.marker_truth_m()
        last = max(
            float(np.linalg.norm(truth[n] - nominal.robot.points(q, nominal.metadata.root, links[n])[0]))
            for n in target.markers
        )
    cause = str(outcome.stop.evidence.get("cause", ""))
    return Trial(kind.name, outcome.stop.kind, cause, last, len(outcome.looks), unsafe, lost)


def row(trials: list[Trial]) -> str:
    """A line of the table of docs/faults.md."""
    stops = Counter(t.stop + (f" ({t.cause})" if t.cause else "") for t in trials)
    told = ", ".join(f"{stop.replace('_', ' ')} {count}" for stop, count in stops.most_common())
    wrong, unsafe, lost = (sum(x) for x in zip(*[(t.wrong, t.unsafe, t.lost) for t in trials], strict=True))
    farthest = 1e3 * max((t.last_m for t in trials if t.stop == "converged"), default=0.0)
    worst = f"{farthest:.2f}" if farthest else "–"
    return f"| {trials[0].fault} | {len(trials)} | {told} | {worst} | {wrong} | {unsafe} | {lost} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--only", default="", help="part of a fault's name")
    given = parser.parse_args()
    nominal = Nominal.load()
    print(
        "| fault | runs | how they ended | farthest of the converged, mm | wrong “converged” | unsafe commands | pictures lost |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for kind in PIXEL_FAULTS:
        if given.only in kind.name:
            print(row([trial(kind, seed, nominal) for seed in range(given.runs)]), flush=True)
    if given.only in Blurred.name:
        bare = nominal.with_mirror(0.0)
        print(row([trial(Blurred, seed, bare, "rendered") for seed in range(max(1, given.runs // 4))]))


if __name__ == "__main__":
    main()
