"""Pictures of a board and balls in a mirror, drawn: geometry, light, lens and sensor. Nothing of detection is used.

A pinhole camera, a plane mirror, a chessboard by its homography, spheres by ray casting with a sun (hard shadow line, their own and a cast one), sky, gloss and uneven paint, limbs
behind and before them, all in linear light and supersampled; then lens (disc, Gauss, path of a shake), ghost, sensor (Bayer mosaic, photon and read noise), curve and codec
(Pillow's JPEG and WebP, chroma subsampling as in YUV video). The truth of an outline's centre is its conic's.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from fresh_looks import COLUMNS, ROWS, SQUARE_M, Array, Look

Bar = tuple[Array, Array, float]
"""Both ends of a bar with round ends, and half of its width, px."""


@dataclass
class Ball:
    name: str
    center_m: Array
    """In the mirror, before the camera."""
    radius_m: float
    rgb: Array
    hue_deg: float
    centroid_px: Array = field(default_factory=lambda: np.zeros(2))
    radius_px: float = 0.0
    visible: float = 1.0
    """Share of its disc that nothing hides."""


@dataclass
class Scene:
    """A picture's content and truth."""

    look: Look
    camera: Array
    normal: Array
    offset_m: float
    camera_from_board: Array
    corners_px: Array
    balls: list[Ball]
    rgb: Array
    sun: Array
    """Towards the sun, in the camera's frame."""
    coded: bytes | None = None
    bgr: Array = None


def conic_center(camera: Array, center: Array, radius: float) -> tuple[Array, float]:
    """Centre of the ellipse that a sphere shows, and its mean radius, px: rays x with (x·c)² = |x|² (|c|² − r²)."""
    dual = np.linalg.inv(camera)
    cone = np.outer(center, center) - (center @ center - radius**2) * np.eye(3)
    conic = dual.T @ cone @ dual
    middle = -np.linalg.solve(conic[:2, :2], conic[:2, 2])
    level = conic[2, 2] + conic[2, :2] @ middle
    axes = -level / np.linalg.eigvalsh(conic[:2, :2])
    return middle, float(np.sqrt(np.sqrt(abs(axes[0] * axes[1]))))


def seen_share(ball: Ball, bars: list[Bar]) -> float:
    """Share of a ball's disc that no bar covers."""
    at = ball.radius_px * ((np.arange(160) + 0.5) / 80.0 - 1.0)
    u, v = np.meshgrid(at, at)
    disc = u**2 + v**2 <= ball.radius_px**2
    seen = disc.copy()
    for start, end, width in bars:
        seen &= away_px(ball.centroid_px[0] + u, ball.centroid_px[1] + v, start, end) > width
    return float(seen.sum() / disc.sum())


def away_px(u: Array, v: Array, start: Array, end: Array) -> Array:
    """Distance of places from the line between two points, px."""
    along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
    u, v = u - start[0], v - start[1]
    t = np.clip(u * along[0] + v * along[1], 0.0, float(np.linalg.norm(end - start)))
    return np.sqrt((u - t * along[0]) ** 2 + (v - t * along[1]) ** 2)


def to_linear(levels: Array) -> Array:
    value = np.asarray(levels, dtype=float)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def noise_field(rng: np.random.Generator, width: int, height: int, octaves: int = 5) -> Array:
    total = np.zeros((height, width))
    for octave in range(octaves):
        side = 3 * 2**octave
        coarse = rng.uniform(-1.0, 1.0, (side, side))
        total += cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC) * 0.6**octave
    return total


class Painter:
    """Draws one scene."""

    def __init__(self, look: Look, seed: list[int]) -> None:
        self.look, self.rng = look, np.random.default_rng(seed)
        self.width, self.height = look.size_px
        focal = self.width * self.rng.uniform(0.8, 1.3)
        center = [0.5 * self.width + self.rng.uniform(-9, 9), 0.5 * self.height + self.rng.uniform(-9, 9)]
        self.camera = np.array(
            [[focal, 0, center[0]], [0, focal * self.rng.uniform(0.99, 1.01), center[1]], [0, 0, 1.0]]
        )
        turn = cv2.Rodrigues(self.rng.uniform(-0.12, 0.12, 3))[0]
        self.board = np.eye(4)
        self.board[:3, :3], self.board[:3, 3] = (
            turn,
            self.rng.uniform([-0.02, 0.08, -0.02], [0.02, 0.12, 0.05]),
        )
        # The mirror stands so that the board's reflection lies in the lower middle of the picture.
        wanted = np.array(
            [self.rng.uniform(0.4, 0.6) * self.width, self.rng.uniform(0.7, 0.8) * self.height, 1.0]
        )
        ray = np.linalg.solve(self.camera, wanted)
        depth = (
            focal * SQUARE_M / self.rng.uniform(18.0, 26.0) * self.width / 800.0**1.0 * (800.0 / self.width)
        )
        image = ray * depth
        apart = image - self.board[:3, 3]
        self.normal = apart / np.linalg.norm(apart)
        self.offset = float(self.normal @ (0.5 * (image + self.board[:3, 3])))
        grid = np.stack(np.meshgrid(np.arange(COLUMNS), np.arange(ROWS)), axis=-1).reshape(-1, 2)
        self.plane = (grid - [(COLUMNS - 1) / 2, (ROWS - 1) / 2]) * SQUARE_M
        self.corners = self.project(self.reflect(self.on_board(self.plane)))
        self.sun = self.rng.normal(0, 1, 3) * [1, 1, 0.6] + [0, -0.8, -0.5]
        self.sun /= np.linalg.norm(self.sun)
        self.sun_share = self.rng.uniform(*look.sun)

    def on_board(self, plane: Array) -> Array:
        return np.column_stack([plane, np.zeros(len(plane))]) @ self.board[:3, :3].T + self.board[:3, 3]

    def reflect(self, points: Array) -> Array:
        return points + 2.0 * (self.offset - points @ self.normal)[:, None] * self.normal

    def project(self, points: Array) -> Array:
        image = points @ self.camera.T
        return image[:, :2] / image[:, 2:]

    def region(self, low: Array, high: Array, fine: int) -> tuple[tuple[slice, slice], Array, Array]:
        """A part of the picture and its samples' places, px: `fine` × `fine` a pixel."""
        left, top = max(int(np.floor(low[0])), 0), max(int(np.floor(low[1])), 0)
        right, bottom = (
            min(int(np.ceil(high[0])) + 1, self.width),
            min(int(np.ceil(high[1])) + 1, self.height),
        )
        right, bottom = max(right, left + 1), max(bottom, top + 1)
        u = left + (np.arange((right - left) * fine) + 0.5) / fine - 0.5
        v = top + (np.arange((bottom - top) * fine) + 0.5) / fine - 0.5
        return (slice(top, bottom), slice(left, right)), *np.meshgrid(u, v)

    @staticmethod
    def pooled(values: Array, fine: int) -> Array:
        """Means of `fine` × `fine` samples."""
        height, width = values.shape[0] // fine, values.shape[1] // fine
        return cv2.resize(values, (width, height), interpolation=cv2.INTER_AREA)

    def put(self, part: tuple[slice, slice], cover: Array, light: Array, fine: int, paint: Array) -> None:
        """Lays a paint in a light, (…) or (…, 3), over the picture where `cover` (0..1, by sample) is."""
        share = self.pooled(cover, fine)[..., None]
        lit = self.pooled(cover.reshape(*cover.shape, *[1] * (light.ndim - 2)) * light, fine)
        self.rgb[part] = self.rgb[part] * (1.0 - share) + lit.reshape(*share.shape[:2], -1) * paint

    def turn_mirror(self, yaw_rad: float, pitch_rad: float) -> None:
        """Turns the mirror about the point half-way between the board and its reflection."""
        middle = (
            self.normal * self.offset + self.board[:3, 3] - self.normal * (self.normal @ self.board[:3, 3])
        )
        self.normal = cv2.Rodrigues(np.array([pitch_rad, yaw_rad, 0.0]))[0] @ self.normal
        self.offset = float(self.normal @ middle)
        self.corners = self.project(self.reflect(self.on_board(self.plane)))

    def again(self, balls: list[Ball], real_m: Array) -> list[Ball]:
        """Balls of another view, at their real places (N, 3), in this mirror."""
        seen = []
        for ball, center in zip(balls, self.reflect(real_m), strict=True):
            one = Ball(ball.name, center, ball.radius_m, ball.rgb, ball.hue_deg)
            one.centroid_px, one.radius_px = conic_center(self.camera, center, ball.radius_m)
            seen.append(one)
        return seen

    def paint(self, given: tuple[list[Ball], Array] | None = None) -> Scene:
        look, rng = self.look, self.rng
        base = rng.uniform(0.08, 0.4) * rng.uniform(0.85, 1.15, 3)
        field_ = noise_field(rng, self.width, self.height)
        self.rgb = np.clip(base * (1.0 + 0.35 * field_[..., None]), 0.005, 0.9)
        self.rgb *= (
            1.0
            + look.texture
            * 0.5
            * rng.uniform(-1, 1, (self.height, self.width))[..., None]
            * (noise_field(rng, self.width, self.height) > 0)[..., None]
        )
        for _ in range(int(6 + 30 * look.texture)):
            middle = rng.uniform([0, 0], [self.width, self.height])
            shape = (middle + rng.normal(0, 45, (4, 2))).astype(np.float32)
            grey = rng.uniform(0.03, 0.6) * rng.uniform(0.93, 1.07, 3)
            cover = np.zeros((self.height, self.width), np.uint8)
            cv2.fillConvexPoly(
                cover, np.rint(cv2.convexHull(shape) * 16).astype(np.int32), 255, cv2.LINE_AA, 4
            )
            left, top, width, height = cv2.boundingRect(cover)
            part = slice(top, top + height), slice(left, left + width)
            share = cover[part][..., None] / 255.0
            self.rgb[part] = self.rgb[part] * (1 - share) + grey * share
        self.draw_board()
        balls = self.place_balls() if given is None else self.again(*given)
        for ball in balls:
            self.draw_limb(ball)
        for ball in balls:
            if look.clutter is not None:
                self.draw_clutter(ball, balls)
            self.draw_sphere(ball.center_m, ball.radius_m, ball.rgb)
        if look.hidden[1] > 0.0:
            bars = [self.hide(ball) for ball in balls]
            for ball in balls:
                ball.visible = seen_share(ball, bars)
        return Scene(
            look, self.camera, self.normal, self.offset, self.board, self.corners, balls, self.rgb, self.sun
        )

    def draw_board(self) -> None:
        def edge(columns: float, rows: float) -> Array:
            half = np.array([(columns) / 2 * SQUARE_M, rows / 2 * SQUARE_M])
            return half

        half = edge(COLUMNS + 2.0, ROWS + 2.0)
        outer = self.project(
            self.reflect(self.on_board(half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])))
        )
        part, u, v = self.region(outer.min(axis=0), outer.max(axis=0), 5)
        turn = self.board[:3, :3] - 2.0 * np.outer(self.normal, self.normal @ self.board[:3, :3])
        middle = self.reflect(self.board[None, :3, 3])[0]
        # What the samples' rays have along the board's three axes is linear in u and v.
        along = turn.T @ np.linalg.inv(self.camera)
        across, down, out = (a * u[:1] + b * v[:, :1] + c for a, b, c in along)
        far = (middle @ turn[:, 2]) / out
        x = (across * far - middle @ turn[:, 0]) / SQUARE_M
        y = (down * far - middle @ turn[:, 1]) / SQUARE_M
        column, row = np.floor(x + (COLUMNS + 1) / 2), np.floor(y + (ROWS + 1) / 2)
        inside = (column >= 0) & (column <= COLUMNS) & (row >= 0) & (row <= ROWS)
        # The square beyond corner (0, 0) is dark.
        dark = inside & ((column + row) % 2 == 0)
        paper = (np.abs(x) <= COLUMNS / 2 + 1.2) & (np.abs(y) <= ROWS / 2 + 1.2)
        light = self.rng.uniform(0.55, 0.8) * (1.0 + 0.02 * x - 0.03 * y)
        self.put(part, paper.astype(float), np.where(dark, 0.03, light), 5, np.ones(3))

    def place_balls(self) -> list[Ball]:
        look, rng = self.look, self.rng
        low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        taken: list[tuple[Array, float]] = [(0.5 * (low + high), 0.62 * float(np.linalg.norm(high - low)))]
        hue = rng.uniform(0, 60)
        far = float(np.linalg.norm(self.reflect(self.board[None, :3, 3])[0]))
        balls = []
        for index in range(6 if look.radius_px[1] < 34 else 3):
            for _ in range(60):
                radius_px = rng.uniform(*look.radius_px)
                pixel = rng.uniform(
                    [radius_px + 12] * 2, [self.width - radius_px - 12, self.height - radius_px - 12]
                )
                gap = 2.2 if look.clutter is None else 3.2
                if all(np.hypot(*(pixel - p)) > gap * radius_px + 1.2 * r + 6 for p, r in taken):
                    break
            else:
                continue
            taken.append((pixel, radius_px))
            ray = np.linalg.solve(self.camera, np.array([*pixel, 1.0]))
            center = ray * far * rng.uniform(0.8, 1.2)
            radius = radius_px * center[2] / self.camera[0, 0]
            paint_hue = (hue + 60.0 * index + rng.uniform(-6, 6)) % 360.0
            hsv = np.array([[[paint_hue, rng.uniform(0.75, 0.95), rng.uniform(0.6, 0.9)]]], np.float32)
            rgb = to_linear(cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB)[0, 0])
            ball = Ball(f"m{index}", center, radius, rgb, paint_hue)
            ball.centroid_px, ball.radius_px = conic_center(self.camera, center, radius)
            balls.append(ball)
        return balls

    def draw_sphere(self, center: Array, radius: float, paint: Array, cast: bool | None = None) -> None:
        look, rng = self.look, self.rng
        middle, size = conic_center(self.camera, center, radius)
        fine = 8 if size < 24 else 5
        part, u, v = self.region(middle - 1.15 * size - 3, middle + 1.15 * size + 3, fine)
        x, y, z = (a * u[:1] + b * v[:, :1] + c for a, b, c in np.linalg.inv(self.camera))
        length = np.sqrt(x**2 + y**2 + z**2)
        along = (x * center[0] + y * center[1] + z * center[2]) / length
        under = along**2 - (center @ center - radius**2)
        hit = under >= 0.0
        # From here on what hits the ball only, in a row.
        along, under, length = along[hit], under[hit], length[hit]
        rays = np.stack([part[hit] for part in (x, y, z)], axis=-1) / length[:, None]
        points = rays * (along - np.sqrt(under))[..., None]
        normal = (points - center) / radius
        lit = np.maximum(normal @ self.sun, 0.0)
        if look.cast_shadow if cast is None else cast:
            across = np.cross(self.sun, rng.normal(0, 1, 3))
            across /= np.linalg.norm(across)
            lit *= 1.0 / (
                1.0
                + np.exp(
                    -np.clip((normal @ across - rng.uniform(-0.6, 0.6)) / rng.uniform(0.01, 0.1), -50, 50)
                )
            )
        sky = 0.5 * (1.0 - normal[..., 1])
        ambient = (0.35 + 0.65 * sky)[..., None] * np.array([0.97, 1.0, 1.06])
        share = self.sun_share
        shade = (1.0 - share) * ambient + share * 1.3 * lit[..., None] + 0.015
        # Light that comes back from a floor of another colour.
        bounce = 0.06 * np.maximum(normal[..., 1], 0.0)[..., None] * np.array([1.0, 0.85, 0.7])
        uneven = cv2.GaussianBlur(rng.normal(0, 1, u.shape), (0, 0), 1.5 * fine)[hit]
        uneven = 1.0 + 0.03 * uneven[..., None] * 1.5 * fine
        colour = paint * (shade + bounce) * uneven
        if look.gloss > 0.0:
            half = self.sun - rays
            half /= np.linalg.norm(half, axis=-1, keepdims=True)
            colour = colour + look.gloss * np.maximum(np.sum(normal * half, axis=-1), 0.0)[..., None] ** 60
            # What a glossy ball mirrors of its surroundings towards its rim.
            facing = np.clip(-np.sum(normal * rays, axis=-1), 0.0, 1.0)[..., None]
            colour = colour + look.gloss * 0.08 * (1.0 - facing) ** 5
        light = np.zeros((*u.shape, 3))
        light[hit] = colour
        self.put(part, hit.astype(float), light, fine, np.ones(3))

    def capsule(self, start: Array, end: Array, width: float, colour: Array) -> Array:
        """A limb: a bar with round ends, lighter in its middle. Returns nothing; draws."""
        low, high = np.minimum(start, end) - width - 2, np.maximum(start, end) + width + 2
        if np.any(high < 1) or np.any(low > [self.width - 2, self.height - 2]):
            return
        part, u, v = self.region(low, high, 4)
        away = away_px(u, v, start, end)
        round_ = np.sqrt(np.clip(1.0 - (away / width) ** 2, 0.0, 1.0))
        self.put(part, (away <= width).astype(float), 0.35 + 0.65 * round_, 4, colour)

    def draw_limb(self, ball: Ball) -> None:
        turn = self.rng.uniform(0, 2 * np.pi)
        end = ball.centroid_px + 5.0 * ball.radius_px * np.array([np.cos(turn), np.sin(turn)])
        grey = self.rng.uniform(0.04, 0.55) * self.rng.uniform(0.92, 1.08, 3)
        self.capsule(ball.centroid_px, end, self.rng.uniform(0.45, 0.9) * ball.radius_px, grey)

    def draw_clutter(self, ball: Ball, balls: list[Ball]) -> None:
        assert self.look.clutter is not None
        for _ in range(self.rng.integers(1, 3)):
            size = self.rng.uniform(0.3, 1.5)
            away = self.rng.uniform(*self.look.clutter) * max(1.0, 0.5 + 0.5 * size)
            turn = self.rng.uniform(0, 2 * np.pi)
            pixel = ball.centroid_px + away * ball.radius_px * np.array([np.cos(turn), np.sin(turn)])
            if any(
                o is not ball
                and np.hypot(*(pixel - o.centroid_px)) < (size + 1.4) * max(o.radius_px, ball.radius_px)
                for o in balls
            ):
                continue
            if self.rng.random() < 0.5:
                ray = np.linalg.solve(self.camera, np.array([*pixel, 1.0]))
                self.draw_sphere(ray * ball.center_m[2], size * ball.radius_m, ball.rgb, False)
            else:
                other = pixel + self.rng.normal(0, 1.2 * ball.radius_px, 2)
                # A bar of its colour, that ends before the ball.
                self.capsule(pixel, other, 0.35 * size * ball.radius_px, 0.6 * ball.rgb)

    def hide(self, ball: Ball) -> Bar:
        """A bar with round ends before the ball covers a share of its disc; it may cover a part of another ball's too."""
        turn = self.rng.uniform(0, 2 * np.pi)
        out = np.array([np.cos(turn), np.sin(turn)])
        across = np.array([-out[1], out[0]])
        width = self.rng.uniform(0.7, 1.5) * ball.radius_px
        wanted = self.rng.uniform(*self.look.hidden)
        at = (np.arange(160) + 0.5) / 80.0 - 1.0
        u, v = np.meshgrid(at, at)
        disc = u**2 + v**2 <= 1.0
        # How far out the bar's axis must be for that share, by trying.
        places = np.linspace(0.0, 1.0 + width / ball.radius_px, 60)
        shares = [
            float((disc & (np.abs(u - place) <= width / ball.radius_px)).sum() / disc.sum())
            for place in places
        ]
        best = int(np.argmin(np.abs(np.array(shares) - wanted)))
        middle = ball.centroid_px + out * places[best] * ball.radius_px
        long = 2.5 * ball.radius_px * across
        grey = self.rng.uniform(0.03, 0.5) * self.rng.uniform(0.9, 1.1, 3)
        self.capsule(middle - long, middle + long, width, grey)
        return middle - long, middle + long, width


def through_lens(scene: Scene, rng: np.random.Generator) -> Array:
    """Linear light after lens, glass and movement; the truth moves with a rolling shutter."""
    look, light = scene.look, scene.rgb
    height, width = light.shape[:2]
    strength = rng.uniform(*look.ghost)
    if strength > 0.0:
        shift = rng.uniform(2.0, 5.0) * np.array([np.cos(1.1), np.sin(1.1)])
        move = np.array([[1.0, 0, shift[0]], [0, 1.0, shift[1]]])
        again = cv2.warpAffine(
            light, move, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        light = (1 - strength) * light + strength * again
    if look.disc_px > 0.0:
        side = int(np.ceil(look.disc_px)) + 1
        fine = (np.arange((2 * side + 1) * 10) + 0.5) / 10 - 0.5 - side
        disc = (fine[None] ** 2 + fine[:, None] ** 2 <= look.disc_px**2).astype(float)
        kernel = disc.reshape(2 * side + 1, 10, 2 * side + 1, 10).mean(axis=(1, 3))
        light = cv2.filter2D(light, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE)
    if look.shake_px > 0.0:
        t = np.linspace(-0.5, 0.5, 301)
        turn, bend = rng.uniform(0, np.pi), rng.uniform(-0.3, 0.3)
        path = np.stack([t, bend * (t**2 - 1 / 12)], axis=1) * look.shake_px
        path = path @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        side = int(np.ceil(look.shake_px)) + 2
        kernel = np.zeros((2 * side + 1, 2 * side + 1))
        for u, v in path + side:
            i, j = int(u), int(v)
            a, b = u - i, v - j
            kernel[j : j + 2, i : i + 2] += np.outer([1 - b, b], [1 - a, a])
        # filter2D correlates: the path is symmetric enough only when turned round.
        light = cv2.filter2D(light, -1, kernel[::-1, ::-1] / kernel.sum(), borderType=cv2.BORDER_REPLICATE)
    light = cv2.GaussianBlur(light, (0, 0), rng.uniform(*look.blur_px), borderType=cv2.BORDER_REPLICATE)
    if look.rolling_px > 0.0:
        slope = look.rolling_px / height
        move = np.array([[1.0, slope, -0.5 * look.rolling_px], [0, 1.0, 0]])
        light = cv2.warpAffine(
            light, move, (width, height), flags=cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE
        )
        scene.corners_px = scene.corners_px @ move[:, :2].T + move[:, 2]
        for ball in scene.balls:
            ball.centroid_px = move[:, :2] @ ball.centroid_px + move[:, 2]
    u = (np.arange(width) - scene.camera[0, 2]) / scene.camera[0, 0]
    v = (np.arange(height) - scene.camera[1, 2]) / scene.camera[1, 1]
    fall = (1.0 + u[None] ** 2 + v[:, None] ** 2) ** -2
    corner = fall.min()
    fall = 1.0 - look.vignette * (1.0 - fall) / (1.0 - corner)
    return np.maximum(light, 0.0) * fall[..., None] * look.light * np.array(look.tint)


def on_sensor(light: Array, look: Look, rng: np.random.Generator) -> Array:
    """Levels (H, W, 3) uint8, RGB."""
    electrons = rng.poisson(np.clip(light, 0, 1.2) * look.photons) / look.photons
    electrons = electrons + rng.normal(0.0, look.read_levels / 255.0 * 0.3, light.shape)
    if look.bayer:
        raw = np.empty(light.shape[:2])
        raw[0::2, 0::2], raw[1::2, 1::2] = electrons[0::2, 0::2, 0], electrons[1::2, 1::2, 2]
        raw[0::2, 1::2], raw[1::2, 0::2] = electrons[0::2, 1::2, 1], electrons[1::2, 0::2, 1]
        sixteen = np.rint(np.clip(raw, 0, 1) * 60000).astype(np.uint16)
        # OpenCV names the pattern by its second row and column: BG is red at the corner.
        electrons = cv2.demosaicing(sixteen, cv2.COLOR_BayerBG2RGB_EA).astype(float) / 60000
    value = np.clip(electrons, 0.0, 1.0)
    curve = (
        value ** (1.0 / look.gamma)
        if look.gamma
        else np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    )
    if look.sharpen > 0.0:
        cross = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0.0]])
        curve = (
            curve
            + 0.25
            * look.sharpen
            * (4.0 * curve - cv2.filter2D(curve, -1, cross, borderType=cv2.BORDER_REPLICATE))
            * 0.5
        )
    return np.rint(255.0 * np.clip(curve, 0, 1)).astype(np.uint8)


def picture(look: Look, seed: list[int]) -> Scene:
    """A whole picture with its truth: `coded` bytes of a file, or `bgr` pixels."""
    painter = Painter(look, seed)
    scene = painter.paint()
    rgb = on_sensor(through_lens(scene, painter.rng), look, painter.rng)
    made = look.code(rgb) if look.code else np.ascontiguousarray(rgb[..., ::-1])
    if isinstance(made, bytes):
        scene.coded = made
    else:
        scene.bgr = made
    return scene


def views(look: Look, seed: list[int], turns_rad: list[tuple[float, float]]) -> tuple[list[Scene], Array]:
    """The same camera, board and balls before a mirror that turns (yaw, pitch): a scene each, and the balls' real places (N, 3) in the camera frame, m."""
    made: list[Scene] = []
    given = None
    for turn in turns_rad:
        painter = Painter(look, seed)
        painter.turn_mirror(*turn)
        scene = painter.paint(given)
        if given is None:
            given = (scene.balls, painter.reflect(np.array([ball.center_m for ball in scene.balls])))
        rgb = on_sensor(through_lens(scene, painter.rng), look, painter.rng)
        shown = look.code(rgb) if look.code else np.ascontiguousarray(rgb[..., ::-1])
        scene.coded, scene.bgr = (shown, None) if isinstance(shown, bytes) else (None, shown)
        made.append(scene)
    assert given is not None
    return made, given[1]
