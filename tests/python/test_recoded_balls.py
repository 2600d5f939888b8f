"""Balls in coarse JPEGs: what the codec's rounding does to their centres is in the claims, though the edges' scatter does not show it."""

from __future__ import annotations

import io
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from ball_variants import SAMPLING, balls_of
from mirror_posture.detect import detect_picture, predictions_from_session, setup_from_session
from mirror_posture.detect.ball import OutlineFit, Start
from mirror_posture.detect.reading import read_picture_file
from mirror_posture.detect.recoded import SHIFTS, with_recoded
from mirror_posture.detect.types import Ellipse, MarkerView
from mirror_posture.session import load_session

GLASS = Path(__file__).resolve().parents[3] / "shared" / "data" / "pictures" / "mitsuba-glass-a"
# Worst standard deviation of a mean of 50 normalised squares of which six are one picture's.
LARGEST_NORMALISED = 1.5


def stripes(rng: np.random.Generator) -> np.ndarray:
    """Colours that change within a block."""
    small = rng.integers(0, 255, (12, 16, 3), dtype=np.uint8)
    return cv2.resize(small, (256, 192), interpolation=cv2.INTER_CUBIC)


@pytest.mark.parametrize("sampling", ["4:2:0", "4:2:2", "4:4:4"])
@pytest.mark.parametrize("quality", [30, 75])
def test_a_picture_coded_again_on_its_own_grid_is_hardly_changed(
    tmp_path: Path, sampling: str, quality: int
) -> None:
    picture = stripes(np.random.default_rng(quality))
    flags = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, SAMPLING[sampling]]
    cv2.imwrite(str(tmp_path / "a.jpg"), picture, flags)
    file = read_picture_file(tmp_path / "a.jpg")
    assert file.codec is not None

    def change(left: int, top: int) -> float:
        part = file.pixels[top:, left:].astype(float)
        again = file.codec.again(np.ascontiguousarray(file.pixels[top:, left:])).astype(float)
        return float(np.sqrt(np.mean((again - part) ** 2)))

    # Colour at half of the resolution is interpolated when it is decoded, and averaged when it is coded: that is not undone exactly.
    assert change(0, 0) < 0.35 * change(4, 6)


def test_another_files_codec_is_not_known(tmp_path: Path) -> None:
    picture = stripes(np.random.default_rng(1))
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    cv2.imwrite(str(tmp_path / "grey.jpg"), picture[..., 0])
    content = io.BytesIO()
    Image.fromarray(picture).convert("CMYK").save(content, "JPEG")
    (tmp_path / "cmyk.jpg").write_bytes(content.getvalue())
    for name in ("a.png", "grey.jpg", "cmyk.jpg"):
        assert read_picture_file(tmp_path / name).codec is None


def view_at(center: tuple[float, float], radius: float) -> MarkerView:
    return MarkerView(
        "ball", True, "", pixel_px=center, covariance_px2=0.01 * np.eye(2), outline=Ellipse(center, radius, radius, 0.0)
    )  # fmt: skip


def fit_at(center: np.ndarray, radius: float) -> OutlineFit:
    return OutlineFit(
        center, 0.01 * np.eye(2), center, Ellipse((0.0, 0.0), radius, radius, 0.0), np.zeros((3, 2)), radius, 1.0, 0.1, 1.0, 1.0, 1.0
    )  # fmt: skip


def test_what_moves_with_the_codecs_blocks_is_added_to_the_claim(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.jpg"), stripes(np.random.default_rng(2)), [cv2.IMWRITE_JPEG_QUALITY, 40])
    file = read_picture_file(tmp_path / "a.jpg")
    assert file.codec is not None
    seen: list[np.ndarray] = []

    def moved(picture: np.ndarray, starts: list[Start]) -> list[OutlineFit | None]:
        seen.append(picture)
        # The first picture is the one as it is; in the others the ball lies to the right or the left.
        off = 0.0 if len(seen) == 1 else 0.2 * (-1.0) ** len(seen)
        return [fit_at(one.circle.center_px + np.array([off, 0.0]), 10.0) for one in starts]

    (view,) = with_recoded(file.pixels, [view_at((100.0, 90.0), 10.0)], file.codec, moved)
    assert len(seen) == 1 + len(SHIFTS)
    more = np.asarray(view.covariance_px2) - 0.01 * np.eye(2)
    # A mean square of 0.04 px² along u, of which a part is taken for round; a half of it shows in the scatter already.
    assert 0.3 * 0.04 < np.trace(more) < 0.6 * 0.04
    assert more[0, 0] > 2.0 * more[1, 1] > 0.0
    # Only the ball's surroundings are coded again.
    for picture in seen[1:]:
        assert (picture != seen[0])[60:120, 70:130].any()
        assert np.array_equal(picture[:20], seen[0][:20])

    def never(picture: np.ndarray, starts: list[Start]) -> list[OutlineFit | None]:
        return [None for _ in starts]

    (lost,) = with_recoded(file.pixels, [view_at((100.0, 90.0), 10.0)], file.codec, never)
    assert np.array_equal(lost.covariance_px2, 0.01 * np.eye(2))


@pytest.mark.skipif(not GLASS.is_dir(), reason="the shared pictures are not here")
@pytest.mark.parametrize("quality", [75, 60, 40])
def test_no_ball_of_coarse_jpegs_is_wrong(tmp_path: Path, quality: int) -> None:
    session = load_session(GLASS)
    setup, predictions = setup_from_session(session), predictions_from_session(session)
    truth = json.loads((GLASS / "truth.json").read_text())["frames"]
    colours = {marker.name: np.zeros(3) for marker in setup.markers}
    rng = np.random.default_rng(quality)
    normalised = []
    for frame in range(0, 20, 2):
        picture = cv2.imread(str(session.image_files[frame])).astype(float)
        noisy = np.clip(np.rint(picture + rng.normal(0.0, 1.0, picture.shape)), 0, 255).astype(np.uint8)
        flags = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, SAMPLING["4:2:0"]]
        cv2.imwrite(str(tmp_path / "a.jpg"), noisy, flags)
        found = {v.name: v for v in detect_picture(tmp_path / "a.jpg", setup, predictions[frame]).markers}
        for ball in balls_of(truth[frame], colours):
            view = found[ball.name]
            if not view.ok:
                continue
            error = np.subtract(view.pixel_px, ball.center)
            assert np.hypot(*error) < max(0.3, 4.0 * view.std_px), (frame, ball.name, error, view.std_px)
            normalised.append(float(error @ np.linalg.solve(view.covariance_px2, error)) / 2.0)
    assert len(normalised) > 50
    assert 0.5 < np.mean(normalised) < LARGEST_NORMALISED
