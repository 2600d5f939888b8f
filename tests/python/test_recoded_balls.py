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
from mirror_posture.detect.markers import nominal_camera
from mirror_posture.detect.reading import read_picture_file
from mirror_posture.detect.recoded import Codec, with_codec_errors
from mirror_posture.detect.types import Ellipse, MarkerView
from mirror_posture.session import load_session
from test_detect_markers import ball_picture

GLASS = Path(__file__).resolve().parents[3] / "shared" / "data" / "pictures" / "mitsuba-glass-a"
# Worst standard deviation of a mean of 50 normalised squares of which six are one picture's.
LARGEST_NORMALISED = 1.5


def stripes(rng: np.random.Generator) -> np.ndarray:
    """Colours that change within a block."""
    small = rng.integers(0, 255, (12, 16, 3), dtype=np.uint8)
    return cv2.resize(small, (256, 192), interpolation=cv2.INTER_CUBIC)


@pytest.mark.parametrize(("sampling", "shared"), [("4:2:0", (2, 2)), ("4:2:2", (2, 1)), ("4:4:4", (1, 1))])
def test_a_files_steps_and_sampling_are_read(tmp_path: Path, sampling: str, shared: tuple[int, int]) -> None:
    flags = [cv2.IMWRITE_JPEG_QUALITY, 50, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, SAMPLING[sampling]]
    cv2.imwrite(str(tmp_path / "a.jpg"), stripes(np.random.default_rng(0)), flags)
    codec = read_picture_file(tmp_path / "a.jpg").codec
    assert codec is not None and codec.sampling_px == shared
    # The tables of ITU-T T.81, annex K, are those of quality 50; rows first.
    assert codec.luma_steps[:9] == (16, 11, 10, 16, 24, 40, 51, 61, 12)
    assert codec.chroma_steps[:9] == (17, 18, 24, 47, 99, 99, 99, 99, 18)


def test_another_files_codec_is_not_known(tmp_path: Path) -> None:
    picture = stripes(np.random.default_rng(1))
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    cv2.imwrite(str(tmp_path / "grey.jpg"), picture[..., 0])
    content = io.BytesIO()
    Image.fromarray(picture).convert("CMYK").save(content, "JPEG")
    (tmp_path / "cmyk.jpg").write_bytes(content.getvalue())
    for name in ("a.png", "grey.jpg", "cmyk.jpg"):
        assert read_picture_file(tmp_path / name).codec is None


def view_at(center: tuple[float, float], radius: float, ok: bool = True) -> MarkerView:
    return MarkerView(
        "ball", ok, "", pixel_px=center, covariance_px2=0.01 * np.eye(2), outline=Ellipse(center, radius, radius, 0.0)
    )  # fmt: skip


def added_px2(
    steps: int,
    sampling: tuple[int, int],
    views: list[MarkerView],
    blurs_px: dict[tuple[float, float], float] | None = None,
) -> list[np.ndarray]:
    """What a codec of even steps adds to the covariances of views in a picture of two balls."""
    picture = ball_picture([(90.3, 80.6, 11.0), (200.2, 150.9, 11.0)])
    codec = Codec((steps,) * 64, (steps,) * 64, sampling)
    told = with_codec_errors(
        picture, views, codec, nominal_camera(picture.shape[1], picture.shape[0]), (2, 2), blurs_px
    )
    return [np.asarray(view.covariance_px2) - 0.01 * np.eye(2) for view in told]


@pytest.mark.parametrize("sampling", [(2, 2), (2, 1), (1, 1)])
def test_coarser_steps_add_more_to_a_claim(sampling: tuple[int, int]) -> None:
    views = [view_at((90.3, 80.6), 11.0), view_at((200.2, 150.9), 11.0)]
    fine, coarse = (added_px2(steps, sampling, views) for steps in (4, 40))
    for less, more in zip(fine, coarse, strict=True):
        assert 0.0 < np.trace(less) < 0.25 * np.trace(more)
        # A covariance: symmetrical, and no direction is without.
        assert np.linalg.eigvalsh(more).min() > 0.0
    assert np.sqrt(max(np.trace(more) for more in coarse)) < 1.5


def test_a_known_blur_adds_about_what_one_that_is_looked_for_does() -> None:
    centers = [(90.3, 80.6), (200.2, 150.9)]
    views = [view_at(center, 11.0) for center in centers]
    blurs = dict.fromkeys(centers, 1.1)
    # The variance of one ball is that of four samples, and scatters by twice: only the mean over several codecs says whether both ways agree.
    found, told = (
        sum(
            float(np.trace(more)) / steps**2
            for steps in (12, 20, 30, 40, 50)
            for more in added_px2(steps, (2, 2), views, given)
        )
        for given in (None, blurs)
    )
    assert 0.7 < told / found < 1.4


def test_a_claim_stays_where_no_ball_is_found_again_or_none_was() -> None:
    nothing, masked = added_px2(
        20, (2, 2), [view_at((30.0, 200.0), 11.0), view_at((90.3, 80.6), 11.0, ok=False)]
    )
    assert not nothing.any() and not masked.any()


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
