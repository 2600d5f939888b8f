"""Detection on pictures drawn anew: other geometry, light, lens, sensor and codecs than `ball_variants` has.

    python tests/python/fresh_pictures.py [--scenes 6] [--seed 1] [--only TEXT ...] [--worst] [--markers]

`fresh_scene.py` draws them, `fresh_looks.py` lists the variants; each draws from a seed of its own.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fresh_looks import COLUMNS, LOOKS, ROWS, SQUARE_M, Look
from fresh_scene import Scene, picture, views


@dataclass
class Score:
    """What a variant showed."""

    name: str
    balls: int = 0
    clear: int = 0
    clear_found: int = 0
    found: int = 0
    wrong: int = 0
    boards: int = 0
    boards_found: int = 0
    boards_wrong: int = 0
    errors_px: list[float] = field(default_factory=list)
    normalised: list[float] = field(default_factory=list)
    board_rms_px: list[float] = field(default_factory=list)
    worst: list[Any] = field(default_factory=list)


def seed_of(name: str, number: int, seed: int) -> list[int]:
    """Of a variant's scene."""
    return [seed, number, sum((i + 1) * ord(c) for i, c in enumerate(name))]


def known_of(scene: Scene) -> tuple[Any, Any, tuple[Any, ...]]:
    """What detection is told: camera, board, markers by colour and size."""
    from mirror_posture import Board, Camera, ColorRange, Marker

    camera = scene.camera
    markers = tuple(
        Marker(ball.name, diameter_m=2.0 * ball.radius_m, color=ColorRange(ball.hue_deg, 18.0, 0.4, 0.12))
        for ball in scene.balls
    )
    lens = Camera(scene.look.size_px, (camera[0, 0], camera[1, 1]), (camera[0, 2], camera[1, 2]))
    return lens, Board(COLUMNS, ROWS, SQUARE_M), markers


def stored(scene: Scene, place: str, name: str) -> Any:
    """The picture: a file where it is coded, else its pixels."""
    if scene.coded is None:
        return scene.bgr
    file = Path(place) / f"{name}.{'webp' if scene.coded[:4] == b'RIFF' else 'jpg'}"
    file.write_bytes(scene.coded)
    return file


def look_at(scene: Scene, rng: np.random.Generator) -> Any:
    """What detection says of a scene; the robot's model expects each ball some millimetres off."""
    from mirror_posture.detect import BoardPrediction, DetectionSetup, PicturePrediction, detect_picture

    camera, board, markers = known_of(scene)
    hints = {}
    for ball in scene.balls:
        real = ball.center_m + 2.0 * (scene.offset_m - ball.center_m @ scene.normal) * scene.normal
        hints[ball.name] = real + rng.normal(0.0, 0.004, 3)
    setup = DetectionSetup(board, markers, camera)
    told = PicturePrediction(
        BoardPrediction(camera_from_board=scene.camera_from_board), marker_in_camera_m=hints
    )
    with tempfile.TemporaryDirectory() as place:
        return detect_picture(stored(scene, place, "picture"), setup, told)


def score(name: str, scenes: int, seed: int) -> Score:
    result = Score(name)
    for number in range(scenes):
        start = seed_of(name, number, seed)
        scene = picture(LOOKS[name], start)
        found = look_at(scene, np.random.default_rng([*start, 1]))
        board = found.boards[0]
        result.boards += 1
        if board.ok:
            result.boards_found += 1
            off = (board.corners_px - scene.corners_px)[board.visible]
            rms = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
            result.board_rms_px.append(rms)
            result.boards_wrong += rms > 0.3 and rms > 4.0 * float(np.sqrt(np.mean(board.std_px**2)))
        views = {view.name: view for view in found.markers}
        for ball in scene.balls:
            view = views[ball.name]
            clear = ball.visible >= 0.8
            result.balls += 1
            result.clear += clear
            if not view.ok:
                if clear:
                    result.worst.append(
                        (
                            number,
                            ball.name,
                            round(ball.radius_px, 1),
                            round(ball.visible, 2),
                            view.reason[:110],
                        )
                    )
                continue
            result.found += 1
            result.clear_found += clear
            error = np.subtract(view.pixel_px, ball.centroid_px)
            away, std = float(np.hypot(*error)), float(view.std_px)
            squares = float(error @ np.linalg.solve(view.covariance_px2, error)) / 2.0
            result.errors_px.append(away)
            result.normalised.append(squares)
            wrong = away > 0.3 and away > 4.0 * std
            result.wrong += wrong
            if wrong or squares > 10:
                result.worst.append(
                    (
                        number,
                        ball.name,
                        round(ball.radius_px, 1),
                        round(ball.visible, 2),
                        f"off {away:.2f} px, claimed {std:.3f}{' WRONG' if wrong else ''}",
                    )
                )
    return result


TURNS_RAD = [(-0.05, -0.01), (0.05, 0.03)]
WRONG_MARKER_M = 0.002


def markers_of(
    name: str, look: Look, number: int, seed: int
) -> tuple[list[tuple[str, float, float, float]], int]:
    """Markers triangulated from two views of a look: name, distance from the truth (m), its claimed deviation (root of the covariance's trace, m), normalised
    squared error; and how many were masked. Nothing but camera, board, colours and sizes is given."""
    from mirror_posture import MirrorPostureError, markers_from_views

    start = [*seed_of(name, number, seed), 2]
    scenes, real = views(look, start, TURNS_RAD)
    first = scenes[0]
    camera, board, markers = known_of(first)
    with tempfile.TemporaryDirectory() as place:
        pictures = [stored(scene, place, str(index)) for index, scene in enumerate(scenes)]
        try:
            found = markers_from_views(
                camera,
                board,
                list(markers),
                pictures,
                camera_from_board=first.camera_from_board,
            )
        except MirrorPostureError:
            return [], len(markers)
    told = []
    for row, ball in enumerate(first.balls):
        if found.positions.valid[row]:
            error = found.positions.points_in_camera_m[row] - real[row]
            covariance = found.positions.covariances_m2[row]
            squares = float(error @ np.linalg.solve(covariance, error)) / 3.0
            told.append(
                (ball.name, float(np.linalg.norm(error)), float(np.sqrt(np.trace(covariance))), squares)
            )
    return told, len(first.balls) - len(told)


def wrong_marker(off_m: float, std_m: float) -> bool:
    return off_m > WRONG_MARKER_M and off_m > 4.0 * std_m


def score_markers(names: list[str], scenes: int, seed: int) -> None:
    print("| variant | markers, masked | wrong | RMS mm | NSE |\n| --- | --- | --- | --- | --- |")
    everything: list[tuple[str, float, float, float]] = []
    for name in names:
        told: list[tuple[str, float, float, float]] = []
        masked = 0
        for number in range(scenes):
            some, less = markers_of(name, LOOKS[name], number, seed)
            told, masked = told + some, masked + less
        everything += told
        wrong = sum(wrong_marker(off, std) for _, off, std, _ in told)
        rms = 1000.0 * np.sqrt(np.mean([off**2 for _, off, _, _ in told])) if told else np.nan
        nse = np.mean([squares for *_, squares in told]) if told else np.nan
        print(f"| {name} | {len(told)}, {masked} | {wrong} | {rms:.2f} | {nse:.2f} |", flush=True)
    wrong = sum(wrong_marker(off, std) for _, off, std, _ in everything)
    print(
        f"\n{len(names)} variants, {len(everything)} markers, {wrong} wrong ({100 * wrong / max(len(everything), 1):.2f} %)"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--markers", action="store_true", help="markers triangulated from two views of each variant"
    )
    parser.add_argument("--scenes", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[""])
    parser.add_argument("--worst", action="store_true")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--save", type=Path)
    given = parser.parse_args()
    names = [name for name in LOOKS if any(text in name for text in given.only)]
    if given.markers:
        score_markers(names, given.scenes, given.seed)
        return
    print(
        "| variant | balls found, recall of ≥ 80 % visible | wrong | RMS px | NSE | boards found, wrong, RMS px |\n| --- | --- | --- | --- | --- | --- |"
    )
    scores = []
    for name in names:
        one = score(name, given.scenes, given.seed)
        scores.append(one)
        rms = np.sqrt(np.mean(np.square(one.errors_px))) if one.errors_px else np.nan
        nse = np.mean(one.normalised) if one.normalised else np.nan
        board = np.sqrt(np.mean(np.square(one.board_rms_px))) if one.board_rms_px else np.nan
        print(
            f"| {name} | {one.found}, {100 * one.clear_found / max(one.clear, 1):.0f} % | {one.wrong} | {rms:.3f} | {nse:.2f} | "
            f"{one.boards_found} of {one.boards}, {one.boards_wrong}, {board:.3f} |",
            flush=True,
        )
        if given.worst:
            for item in one.worst:
                print("   ", *item)
        if given.save:
            given.save.mkdir(parents=True, exist_ok=True)
            scene = picture(LOOKS[name], seed_of(name, 0, given.seed))
            file = given.save / name.replace(" ", "_").replace(":", "").replace(",", "")
            if scene.coded is None:
                cv2.imwrite(f"{file}.png", scene.bgr)
            else:
                Path(f"{file}.jpg").write_bytes(scene.coded)
    found, wrong = sum(s.found for s in scores), sum(s.wrong for s in scores)
    boards, bad = sum(s.boards_found for s in scores), sum(s.boards_wrong for s in scores)
    print(
        f"\n{len(names)} variants, {found} balls found, {wrong} wrong ({100 * wrong / max(found, 1):.2f} %); {boards} boards found, {bad} wrong"
    )
    if given.json:
        given.json.write_text(json.dumps([vars(s) for s in scores], default=str))


if __name__ == "__main__":
    main()
