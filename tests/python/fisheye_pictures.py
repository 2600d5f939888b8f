"""Pictures of an equidistant (fisheye) camera before a mirror, drawn with NumPy alone: board, balls, and the truth of both.

    python tests/python/fisheye_pictures.py [--scenes 5] [--seed 1]

Each sample of a pixel is a ray, by the inverted polynomial of its angle (Kannala and Brandt 2006, as OpenCV has it); rays meet the board's and the balls' reflections. Nothing of
detection is used. Printed are the errors of corners, balls and markers of three views a scene.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

Array = Any
WIDTH, HEIGHT, FINE = 640, 480, 3
COLUMNS, ROWS, SQUARE_M = 7, 4, 0.02
VIEWS = 3


@dataclass
class Lens:
    focal: Array
    center: Array
    k: Array

    def project(self, points: Array) -> Array:
        """Pixels (…, 2) of points (…, 3)."""
        across = np.hypot(points[..., 0], points[..., 1])
        scale = self.shown(np.arctan2(across, points[..., 2])) / np.maximum(across, 1e-12)
        return self.focal * points[..., :2] * scale[..., None] + self.center

    def shown(self, angle: Array) -> Array:
        square = angle**2
        return angle * (1.0 + square * (self.k[0] + square * (self.k[1] + square * self.k[2])))

    def rays(self, u: Array, v: Array) -> Array:
        x, y = (u - self.center[0]) / self.focal[0], (v - self.center[1]) / self.focal[1]
        away = np.hypot(x, y)
        grid = np.linspace(0.0, 1.5, 6000)
        angle = np.interp(away, self.shown(grid), grid)
        scale = np.sin(angle) / np.maximum(away, 1e-12)
        return np.stack([x * scale, y * scale, np.cos(angle)], axis=-1)


@dataclass
class Ball:
    center_m: Array
    radius_m: float
    hue_deg: float


class Scene:
    """A lens, a board and balls, and mirrors (normal, offset) before the camera."""

    def __init__(self, seed: int) -> None:
        self.rng = rng = np.random.default_rng(seed)
        focal = rng.uniform(210, 270)
        center = np.array([WIDTH - 1, HEIGHT - 1]) / 2 + rng.uniform(-8, 8, 2)
        bent = rng.uniform([-0.03, -0.01, -0.003], [0.03, 0.01, 0.003])
        self.lens = Lens(np.array([focal, focal * rng.uniform(0.995, 1.005)]), center, bent)
        self.board = np.eye(4)
        self.board[:3, :3] = cv2.Rodrigues(rng.uniform(-0.12, 0.12, 3))[0]
        self.board[:3, 3] = rng.uniform([-0.02, 0.1, -0.02], [0.02, 0.14, 0.04])
        self.balls: list[Ball] = []
        while len(self.balls) < 5:
            place = rng.uniform([-0.28, -0.12, 0.0], [0.28, 0.16, 0.12])
            if (
                all(np.linalg.norm(place - other.center_m) > 0.09 for other in self.balls)
                and np.linalg.norm(place - self.board[:3, 3]) > 0.16
                and np.linalg.norm(place) > 0.09
            ):
                hue = (72.0 * len(self.balls) + rng.uniform(-5, 5)) % 360.0
                self.balls.append(Ball(place, rng.uniform(0.012, 0.018), hue))
        self.mirrors = []
        for _ in range(VIEWS):
            normal = np.array([rng.uniform(-0.12, 0.12), rng.uniform(-0.05, 0.2), 1.0])
            self.mirrors.append((normal / np.linalg.norm(normal), rng.uniform(0.18, 0.24)))
        sun = rng.normal(0, 1, 3) * [1, 1, 0.4] + [0, -0.8, 0.6]
        self.sun = sun / np.linalg.norm(sun)

    def corners_px(self, mirror: tuple[Array, float]) -> Array:
        grid = np.stack(np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), axis=-1).reshape(-1, 2)
        plane = (grid - [(COLUMNS - 1) / 2, (ROWS - 1) / 2]) * SQUARE_M
        points = np.column_stack([plane, np.zeros(len(plane))]) @ self.board[:3, :3].T + self.board[:3, 3]
        return self.lens.project(reflected(points, mirror))

    def centroid_px(self, ball: Ball, mirror: tuple[Array, float]) -> Array:
        """Centre of area of the outline: of the cone of tangents, projected."""
        middle = reflected(ball.center_m[None], mirror)[0]
        axis = middle / np.linalg.norm(middle)
        half = np.arcsin(ball.radius_m / np.linalg.norm(middle))
        side, other = np.linalg.svd(axis[None])[2][1:]
        turn = np.linspace(0.0, 2.0 * np.pi, 721)[:-1, None]
        ring = np.cos(half) * axis + np.sin(half) * (np.cos(turn) * side + np.sin(turn) * other)
        x, y = self.lens.project(ring).T
        cross = x * np.roll(y, -1) - np.roll(x, -1) * y
        return np.array([((p + np.roll(p, -1)) * cross).sum() for p in (x, y)]) / (3.0 * cross.sum())

    def picture(self, mirror: tuple[Array, float]) -> Array:
        """Levels (H, W, 3) uint8 BGR."""
        light = np.zeros((HEIGHT, WIDTH, 3))
        shades = self.rng.uniform(0.08, 0.35, (8, 10, 1)) * np.array([1.0, 0.96, 0.92])
        for top in range(0, HEIGHT, 40):
            u = (np.arange(WIDTH * FINE) + 0.5) / FINE - 0.5
            v = (top * FINE + np.arange(40 * FINE) + 0.5) / FINE - 0.5
            fine = self.light_along(*np.meshgrid(u, v), mirror, shades)
            light[top : top + 40] = fine.reshape(40, FINE, WIDTH, FINE, 3).mean(axis=(1, 3))
        light = cv2.GaussianBlur(light, (0, 0), 0.55)
        light = np.clip(self.rng.poisson(np.clip(light, 0, 1) * 6000) / 6000, 0, 1)
        curve = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
        return np.rint(255 * curve).astype(np.uint8)

    def light_along(self, u: Array, v: Array, mirror: tuple[Array, float], shades: Array) -> Array:
        rays = self.lens.rays(u, v)
        light = shades[
            np.clip((v / HEIGHT * 8).astype(int), 0, 7), np.clip((u / WIDTH * 10).astype(int), 0, 9)
        ]
        normal = mirror[0]
        middle = reflected(self.board[None, :3, 3], mirror)[0]
        axes = self.board[:3, :3].T - 2.0 * np.outer(self.board[:3, :3].T @ normal, normal)
        facing = rays @ axes[2]
        far = (middle @ axes[2]) / np.where(np.abs(facing) < 1e-9, 1e-9, facing)
        away = rays * far[..., None] - middle
        x, y = away @ axes[0] / SQUARE_M, away @ axes[1] / SQUARE_M
        paper = (far > 0) & (np.abs(x) < (COLUMNS + 2) / 2) & (np.abs(y) < (ROWS + 2) / 2)
        squares = paper & (np.abs(x) < (COLUMNS + 1) / 2) & (np.abs(y) < (ROWS + 1) / 2)
        column, row = np.floor(x + (COLUMNS + 1) / 2), np.floor(y + (ROWS + 1) / 2)
        light[paper] = 0.7
        light[squares & ((column + row) % 2 == 0)] = 0.03
        depth = np.where(paper, far, np.inf)
        sun = self.sun - 2.0 * (self.sun @ normal) * normal
        for ball in self.balls:
            center = reflected(ball.center_m[None], mirror)[0]
            along = rays @ center
            under = along**2 - (center @ center - ball.radius_m**2)
            distance = along - np.sqrt(np.maximum(under, 0.0))
            hit = (under > 0) & (distance > 0) & (distance < depth)
            normals = (rays[hit] * distance[hit][:, None] - center) / ball.radius_m
            levels = cv2.cvtColor(np.array([[[ball.hue_deg, 0.88, 0.8]]], np.float32), cv2.COLOR_HSV2BGR)
            paint = ((levels[0, 0] + 0.055) / 1.055) ** 2.4
            light[hit] = (0.3 + 0.6 * np.maximum(normals @ sun, 0.0))[:, None] * paint
            depth[hit] = distance[hit]
        return light


def reflected(points: Array, mirror: tuple[Array, float]) -> Array:
    normal, offset = mirror
    return points + 2.0 * (offset - points @ normal)[:, None] * normal


@dataclass
class Found:
    """RMS of each view's corners; of each ball in the picture error, px, and normalised square (nan where masked); of each marker error, m, and normalised square."""

    boards_px: list[float]
    balls: list[tuple[float, float]]
    markers: list[tuple[float, float]]


def measured(seed: int) -> Found:
    from mirror_posture import Board, Camera, ColorRange, Marker, markers_from_views
    from mirror_posture.detect import BoardPrediction, DetectionSetup, PicturePrediction, detect_picture

    scene = Scene(seed)
    lens, result = scene.lens, Found([], [], [])
    camera = Camera(
        (WIDTH, HEIGHT), tuple(lens.focal), tuple(lens.center), "equidistant", (*map(float, lens.k), 0.0)
    )
    board = Board(COLUMNS, ROWS, SQUARE_M)
    markers = tuple(
        Marker(f"m{i}", diameter_m=2 * ball.radius_m, color=ColorRange(ball.hue_deg, 16.0, 0.4, 0.12))
        for i, ball in enumerate(scene.balls)
    )
    pictures = [scene.picture(mirror) for mirror in scene.mirrors]
    for picture, mirror in zip(pictures, scene.mirrors, strict=True):
        model = {f"m{i}": ball.center_m + scene.rng.normal(0, 0.003, 3) for i, ball in enumerate(scene.balls)}
        told = PicturePrediction(BoardPrediction(camera_from_board=scene.board), marker_in_camera_m=model)
        found = detect_picture(picture, DetectionSetup(board, markers, camera), told)
        (view,) = found.boards
        if view.ok:
            off = (view.corners_px - scene.corners_px(mirror))[view.visible]
            result.boards_px.append(float(np.sqrt(np.mean(np.sum(off**2, axis=1)))))
        for ball, seen in zip(scene.balls, found.markers, strict=True):
            truth = scene.centroid_px(ball, mirror)
            if np.all((truth > 15) & (truth < [WIDTH - 15, HEIGHT - 15])):
                error = np.subtract(seen.pixel_px, truth) if seen.ok else np.full(2, np.nan)
                square = float(error @ np.linalg.solve(seen.covariance_px2, error)) / 2 if seen.ok else np.nan
                result.balls.append((float(np.hypot(*error)), square))
    points = markers_from_views(
        camera, board, list(markers), pictures, camera_from_board=scene.board
    ).positions
    for i, ball in enumerate(scene.balls):
        if points.valid[i]:
            error = points.points_in_camera_m[i] - ball.center_m
            square = float(error @ np.linalg.solve(points.covariances_m2[i], error)) / 3
            result.markers.append((float(np.linalg.norm(error)), square))
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    every = [measured(given.seed + i) for i in range(given.scenes)]
    boards = np.array([rms for one in every for rms in one.boards_px])
    balls = np.array([ball for one in every for ball in one.balls])
    markers = np.array([marker for one in every for marker in one.markers])
    seen = balls[np.isfinite(balls[:, 0])]
    print(f"boards: {len(boards)} of {VIEWS * len(every)}, {np.sqrt(np.mean(boards**2)):.3f} px RMS")
    print(
        f"balls: {len(seen)} of {len(balls)}, {np.sqrt(np.mean(seen[:, 0] ** 2)):.3f} px RMS, {seen[:, 0].max():.2f} at most, "
        f"normalised squared error {seen[:, 1].mean():.2f}"
    )
    print(
        f"markers: {len(markers)}, {1e3 * np.sqrt(np.mean(markers[:, 0] ** 2)):.2f} mm RMS, {1e3 * markers[:, 0].max():.2f} at most, {markers[:, 1].mean():.2f}"
    )


if __name__ == "__main__":
    main()
