"""Balls in poor pictures: degrades a session's pictures in many ways and holds what detection finds against the truth.

    python tests/python/ball_variants.py SESSION [--pictures 6] [--seed 0] [--only TEXT ...] [--json FILE]

SESSION has pictures and truth.json (`mirror-posture demo`, `render_session`, or another renderer's). Light is mixed linearly, levels are sRGB's; what is
added (clutter, plates) is drawn by supersampling. Nothing of detection is used to make a picture. For each variant: balls that are at least 80 % visible
and how many of them are found, those found wrong (off by more than 0.3 px and more than 4 claimed deviations), RMS error in px, and the mean normalised squared error (1 is true).
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mirror_posture.detect import detect_picture, predictions_from_session, setup_from_session
from mirror_posture.session import load_session

Array = Any
SAMPLING = {
    "4:4:4": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    "4:2:2": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422,
    "4:2:0": cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
}


def linear(levels: Array) -> Array:
    value = levels / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def encoded(light: Array) -> Array:
    """Levels, not rounded, of single precision: thousandths of a level are enough, and pictures are large."""
    value = np.clip(light, 0.0, 1.0).astype(np.float32)
    curve = value ** np.float32(1 / 2.4)
    curve *= np.float32(1.055 * 255.0)
    curve -= np.float32(0.055 * 255.0)
    dark = value <= 0.0031308
    curve[dark] = np.float32(12.92 * 255.0) * value[dark]
    return curve


def levels(picture: Array) -> Array:
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


@dataclass
class Ball:
    """A ball's truth in the picture: outline's centroid and radius, px, the share that is seen, and its paint in linear light."""

    name: str
    center: Array
    radius: float
    visible: float
    paint: Array


@dataclass
class Scene:
    """A picture on its way through a variant: linear light (H, W, 3), its balls, and how pixels moved: new = matrix · old + shift."""

    light: Array
    balls: list[Ball]
    rng: np.random.Generator
    scale: float = 1.0
    notes: dict[str, Any] = field(default_factory=dict)


Step = Callable[[Scene], None]
Coder = Callable[[Array, np.random.Generator], "bytes | Array"]


def disc(scene: Scene, center: Array, radius: float, paint: Array, shaded: bool = True) -> None:
    """A matt ball of a paint, 6 × 6 samples a pixel."""
    fine, margin = 6, int(np.ceil(radius)) + 3
    left, top = int(center[0]) - margin, int(center[1]) - margin
    side = 2 * margin + 1
    at = (np.arange(side * fine) + 0.5) / fine - 0.5
    du, dv = (left + at[None] - center[0]) / radius, (top + at[:, None] - center[1]) / radius
    inside = (du**2 + dv**2 <= 1.0).astype(float)
    toward = np.sqrt(np.maximum(1.0 - du**2 - dv**2, 0.0))
    shade = (
        0.3 + 0.7 * np.maximum(-0.6 * dv + 0.2 * du + 0.77 * toward, 0.0) if shaded else np.ones_like(inside)
    )
    covered = inside.reshape(side, fine, side, fine).mean(axis=(1, 3))
    shade = (inside * shade).reshape(side, fine, side, fine).mean(axis=(1, 3))
    height, width = scene.light.shape[:2]
    rows, columns = np.arange(top, top + side), np.arange(left, left + side)
    keep_r, keep_c = (rows >= 0) & (rows < height), (columns >= 0) & (columns < width)
    part = np.ix_(rows[keep_r], columns[keep_c])
    mine = np.ix_(keep_r, keep_c)
    scene.light[part] = scene.light[part] * (1.0 - covered[mine][..., None]) + shade[mine][..., None] * paint


def clutter(distance: float, size: float) -> Step:
    """Beside each ball another of its paint: distance of the centres and size in the ball's radii."""

    def step(scene: Scene) -> None:
        for ball in scene.balls:
            turn = scene.rng.uniform(0.0, 2.0 * np.pi)
            away = np.array([np.cos(turn), np.sin(turn)]) * distance * ball.radius
            # It may not hide another ball.
            if all(
                np.hypot(*(ball.center + away - other.center)) > (size + 1.5) * other.radius or other is ball
                for other in scene.balls
            ):
                disc(scene, ball.center + away, size * ball.radius, ball.paint)

    return step


def plate(share: float) -> Step:
    """A grey plate with a straight edge hides a share of each ball's width."""

    def step(scene: Scene) -> None:
        height, width = scene.light.shape[:2]
        for ball in scene.balls:
            turn = scene.rng.uniform(0.0, 2.0 * np.pi)
            normal = np.array([np.cos(turn), np.sin(turn)])
            edge = ball.radius * (1.0 - 2.0 * share)
            reach = int(2.2 * ball.radius) + 3
            u0, v0 = (int(c) - reach for c in ball.center)
            fine = (np.arange((2 * reach + 1) * 4) + 0.5) / 4 - 0.5
            du, dv = u0 + fine[None] - ball.center[0], v0 + fine[:, None] - ball.center[1]
            along, across = du * normal[0] + dv * normal[1], dv * normal[0] - du * normal[1]
            hidden = (along > edge) & (along < 1.6 * ball.radius) & (np.abs(across) < 1.4 * ball.radius)
            side = 2 * reach + 1
            mask = hidden.reshape(side, 4, side, 4).mean(axis=(1, 3))
            rows, columns = np.arange(v0, v0 + side), np.arange(u0, u0 + side)
            keep_r, keep_c = (rows >= 0) & (rows < height), (columns >= 0) & (columns < width)
            part, mine = np.ix_(rows[keep_r], columns[keep_c]), np.ix_(keep_r, keep_c)
            grey = scene.rng.uniform(0.05, 0.4)
            scene.light[part] = (
                scene.light[part] * (1.0 - mask[mine][..., None]) + grey * mask[mine][..., None]
            )
            # Share of a disc's area beyond a chord.
            d = 1.0 - 2.0 * share
            ball.visible *= 1.0 - (np.arccos(d) - d * np.sqrt(1.0 - d * d)) / np.pi

    return step


def blur(sigma: float) -> Step:
    def step(scene: Scene) -> None:
        scene.light = cv2.GaussianBlur(scene.light, (0, 0), sigma * scene.scale)

    return step


def motion(length: float) -> Step:
    def step(scene: Scene) -> None:
        turn = scene.rng.uniform(0.0, np.pi)
        side = int(np.ceil(length)) + 3
        kernel = np.zeros((2 * side + 1, 2 * side + 1))
        for t in np.linspace(-0.5 * length, 0.5 * length, 401):
            u, v = side + t * np.cos(turn), side + t * np.sin(turn)
            i, j = int(u), int(v)
            for du, wu in ((0, 1 - (u - i)), (1, u - i)):
                for dv, wv in ((0, 1 - (v - j)), (1, v - j)):
                    kernel[j + dv, i + du] += wu * wv
        scene.light = cv2.filter2D(scene.light, -1, kernel / kernel.sum())

    return step


def gain(factor: float) -> Step:
    def step(scene: Scene) -> None:
        scene.light = scene.light * factor

    return step


def cast(red: float, blue: float) -> Step:
    def step(scene: Scene) -> None:
        scene.light = scene.light * np.array([blue, 1.0, red])

    return step


def vignette(loss: float) -> Step:
    def step(scene: Scene) -> None:
        height, width = scene.light.shape[:2]
        u = (np.arange(width) - 0.5 * width) / (0.5 * np.hypot(width, height))
        v = (np.arange(height) - 0.5 * height) / (0.5 * np.hypot(width, height))
        scene.light = scene.light * (1.0 - loss * (u[None] ** 2 + v[:, None] ** 2))[..., None]

    return step


def ghost(strength: float, shift: float) -> Step:
    """The front face's reflection: the whole picture again, fainter, shifted."""

    def step(scene: Scene) -> None:
        move = np.array([[1.0, 0.0, 0.8 * shift], [0.0, 1.0, 0.6 * shift]])
        again = cv2.warpAffine(
            scene.light,
            move,
            scene.light.shape[1::-1],
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        scene.light = (1.0 - strength) * scene.light + strength * again

    return step


def rolling(shear_px: float) -> Step:
    """Rows are read one after the other while the camera turns: from top to bottom the picture moves by so many px."""

    def step(scene: Scene) -> None:
        height, width = scene.light.shape[:2]
        slope = shear_px / height
        move = np.array([[1.0, slope, -0.5 * shear_px], [0.0, 1.0, 0.0]])
        scene.light = cv2.warpAffine(
            scene.light, move, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        for ball in scene.balls:
            ball.center = move[:, :2] @ ball.center + move[:, 2]

    return step


def size(scale: float) -> Step:
    """The picture of another resolution, averaged or interpolated."""

    def step(scene: Scene) -> None:
        height, width = scene.light.shape[:2]
        wanted = (round(width * scale), round(height * scale))
        way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
        scene.light = np.clip(cv2.resize(scene.light, wanted, interpolation=way), 0.0, None)
        scene.scale = wanted[0] / width
        for ball in scene.balls:
            ball.center = (ball.center + 0.5) * scene.scale - 0.5
            ball.radius *= scene.scale

    return step


def plain(picture: Array, rng: np.random.Generator) -> Array:
    return levels(picture)


def noise(std: float) -> Coder:
    return lambda picture, rng: levels(picture + rng.normal(0.0, std, picture.shape))


def sharpened(amount: float, radius: float = 1.0, then: Coder = plain) -> Coder:
    def code(picture: Array, rng: np.random.Generator) -> Any:
        return then(
            np.clip(picture + amount * (picture - cv2.GaussianBlur(picture, (0, 0), radius)), 0, 255), rng
        )

    return code


def jpeg(quality: int, sampling: str = "4:2:0", noise_levels: float = 1.0) -> Coder:
    def code(picture: Array, rng: np.random.Generator) -> bytes:
        noisy = levels(picture + rng.normal(0.0, noise_levels, picture.shape))
        flags = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, SAMPLING[sampling]]
        return cv2.imencode(".jpg", noisy, flags)[1].tobytes()

    return code


def graded(power: float) -> Coder:
    return lambda picture, rng: levels(255.0 * (picture / 255.0) ** power)


VARIANTS: dict[str, tuple[list[Step], Coder]] = {
    "clean": ([], plain),
    **{f"blur {s} px": ([blur(s)], noise(1.0)) for s in (0.7, 1.2, 2.0, 3.0)},
    **{f"motion {m} px": ([motion(m)], noise(1.0)) for m in (3, 6, 10)},
    **{f"JPEG 4:4:4 q{q}": ([], jpeg(q, "4:4:4")) for q in (98, 92, 80, 60, 40, 30, 20)},
    **{f"JPEG 4:2:2 q{q}": ([], jpeg(q, "4:2:2")) for q in (92, 75)},
    **{f"JPEG 4:2:0 q{q}": ([], jpeg(q)) for q in (98, 92, 85, 75, 60, 50, 40, 30, 20)},
    **{f"noise {n} levels": ([], noise(n)) for n in (2, 5, 10, 15, 20)},
    **{f"light × {g}": ([gain(g)], noise(2.0)) for g in (1.8, 1.4, 0.5, 0.25, 0.12, 0.06)},
    "warm light": ([cast(1.25, 0.75)], noise(1.0)),
    "cold light": ([cast(0.75, 1.25)], noise(1.0)),
    "grey curve 0.8": ([], graded(0.8)),
    "grey curve 1.3": ([], graded(1.3)),
    "sharpened": ([], sharpened(0.8)),
    "sharpened strongly": ([], sharpened(2.0)),
    "sharpened, JPEG 4:2:0 q92": ([], sharpened(1.0, then=jpeg(92))),
    "ghost 4 % at 3 px": ([ghost(0.04, 3.0)], noise(1.0)),
    "ghost 8 % at 5 px": ([ghost(0.08, 5.0)], noise(1.0)),
    "ghost 15 % at 4 px": ([ghost(0.15, 4.0)], noise(1.0)),
    "same hue far, larger": ([clutter(5.0, 1.6)], noise(1.0)),
    "same hue near, as large": ([clutter(2.8, 1.0)], noise(1.0)),
    "same hue near, smaller": ([clutter(2.2, 0.7)], noise(1.0)),
    "same hue touching": ([clutter(1.95, 0.95)], noise(1.0)),
    "same hue touching, small": ([clutter(1.3, 0.35)], noise(1.0)),
    "same hue near, JPEG 4:2:0 q92": ([clutter(2.4, 0.8)], jpeg(92)),
    **{f"hidden {round(100 * s)} %": ([plate(s)], noise(1.0)) for s in (0.1, 0.2, 0.3, 0.35, 0.5)},
    **{f"hidden {round(100 * s)} %, JPEG 4:2:0 q92": ([plate(s)], jpeg(92)) for s in (0.1, 0.2, 0.35)},
    "vignette 30 %": ([vignette(0.3)], noise(1.0)),
    "vignette 70 %": ([vignette(0.7)], noise(1.0)),
    "rolling shutter 4 px": ([rolling(4.0)], noise(1.0)),
    "rolling shutter 12 px": ([rolling(12.0)], noise(1.0)),
    **{f"size × {s}": ([size(s)], noise(1.0)) for s in (0.4, 0.6, 1.6, 3.0, 5.0)},
    "size × 0.6, JPEG 4:2:0 q92": ([size(0.6)], jpeg(92)),
    "phone": ([blur(0.6)], sharpened(0.8, 1.2, jpeg(92, noise_levels=2.0))),
    "webcam": ([gain(0.6), blur(0.9)], jpeg(75, noise_levels=4.0)),
}


@dataclass
class Score:
    """What one variant showed."""

    name: str
    balls: int = 0
    seen: int = 0
    seen_found: int = 0
    wrong: int = 0
    boards: int = 0
    errors: list[float] = field(default_factory=list)
    normalised: list[float] = field(default_factory=list)
    worst: list[tuple[float, ...]] = field(default_factory=list)

    def row(self) -> dict[str, Any]:
        squares = np.square(self.errors)
        return {
            "variant": self.name,
            "boards": self.boards,
            "found": len(self.errors),
            "recall": self.seen_found / max(self.seen, 1),
            "wrong": self.wrong,
            "rms_px": float(np.sqrt(squares.mean())) if len(squares) else None,
            "nse": float(np.mean(self.normalised)) if self.normalised else None,
        }


def balls_of(frame: dict[str, Any], colours: dict[str, Array]) -> list[Ball]:
    found = []
    for name, told in frame["markers"].items():
        seen = told.get("mirror", told)
        area = (seen or {}).get("outline_area_px2", (seen or {}).get("outline_area_px"))
        if seen and area and seen.get("outline_centroid_px"):
            radius = float(np.sqrt(area / np.pi))
            found.append(
                Ball(
                    name,
                    np.array(seen["outline_centroid_px"]),
                    radius,
                    seen["visible_fraction"],
                    colours[name],
                )
            )
    return found


def score(folder: Path, names: list[str], pictures: int, seed: int = 0, first: int = 0) -> list[Score]:
    """Runs variants over every so many of a session's pictures."""
    session = load_session(folder)
    truth = json.loads((folder / "truth.json").read_text())["frames"]
    setup, predictions = setup_from_session(session), predictions_from_session(session)
    colours = {}
    for marker in setup.markers:
        assert marker.color is not None
        pure = np.array([[[marker.color.hue_deg, 0.9, 0.8]]], np.float32)
        colours[marker.name] = linear(255.0 * cv2.cvtColor(pure, cv2.COLOR_HSV2BGR)[0, 0])
    chosen = range(first, len(truth), max(1, len(truth) // pictures))
    light = {
        f: linear(cv2.imread(str(session.image_files[f])).astype(float)).astype(np.float32) for f in chosen
    }
    scores = []
    for name in names:
        steps, coder = VARIANTS[name]
        result = Score(name)
        for frame in chosen:
            rng = np.random.default_rng([seed, frame, sum(map(ord, name))])
            scene = Scene(light[frame].copy(), balls_of(truth[frame], colours), rng)
            for step in steps:
                step(scene)
            coded = coder(encoded(scene.light), rng)
            camera = setup.camera
            assert camera is not None
            if scene.scale != 1.0:
                camera = replace(
                    camera,
                    size_px=(scene.light.shape[1], scene.light.shape[0]),
                    focal_px=(camera.fx_px * scene.scale, camera.fy_px * scene.scale),
                    center_px=tuple((c + 0.5) * scene.scale - 0.5 for c in camera.center_px),
                )
            with tempfile.TemporaryDirectory() as place:
                picture: Any = coded
                if isinstance(coded, bytes):
                    picture = Path(place) / "picture.jpg"
                    picture.write_bytes(coded)
                found = detect_picture(picture, replace(setup, camera=camera), predictions[frame])
            result.boards += any(view.ok for view in found.boards)
            views = {view.name: view for view in found.markers}
            for ball in scene.balls:
                view = views[ball.name]
                result.balls += 1
                result.seen += ball.visible >= 0.8
                if not view.ok:
                    continue
                result.seen_found += ball.visible >= 0.8
                error = np.subtract(view.pixel_px, ball.center)
                away, std = float(np.hypot(*error)), float(view.std_px or 0.0)
                result.errors.append(away)
                result.normalised.append(float(error @ np.linalg.solve(view.covariance_px2, error)) / 2.0)
                if away > 0.3 and away > 4.0 * std:
                    result.wrong += 1
                    result.worst.append(
                        (frame, ball.name, round(away, 2), round(std, 2), round(ball.visible, 2))
                    )
        scores.append(result)
    return scores


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("session", type=Path)
    parser.add_argument("--pictures", type=int, default=6)
    parser.add_argument("--only", nargs="*", default=[""])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--worst", action="store_true")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    names = [name for name in VARIANTS if any(text in name for text in given.only)]
    print(
        "| variant | found, recall of ≥ 80 % visible | wrong | RMS px | NSE |\n| --- | --- | --- | --- | --- |"
    )
    rows, found, wrong = [], 0, 0
    for name in names:
        (one,) = score(given.session, [name], given.pictures, given.seed, given.first)
        row = one.row()
        rows.append(row)
        found, wrong = found + row["found"], wrong + row["wrong"]
        numbers = "–, –" if row["rms_px"] is None else f"{row['rms_px']:.3f} | {row['nse']:.2f}"
        print(
            f"| {name} | {row['found']}, {100 * row['recall']:.0f} % | {row['wrong']} | {numbers} |",
            flush=True,
        )
        if given.worst:
            for item in one.worst:
                print("   ", item)
    print(
        f"\n{len(names)} variants, {found} balls found, {wrong} wrong ({100 * wrong / max(found, 1):.2f} %)"
    )
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
