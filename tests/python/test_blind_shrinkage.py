"""True shrinkage: what named causes close, computed from the noise-free pixels that lie with the answer."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")

from mirror_lab.blind import BlindError
from mirror_lab.blind.make import make_cases
from mirror_lab.blind.reference import Reference
from mirror_lab.blind.shrinkage import (
    TruePixels,
    frictions_of,
    is_judge,
    load_pixels,
    reference_of_folder,
    true_closed,
)
from mirror_lab.blind.simulate import Options

PLAN = [("pair", "small", ("camera_focal", "joint_offset"))]


def _named(cause: dict[str, Any], share: float = 1.0) -> dict[str, Any]:
    values = {k: {"value": share * v} for k, v in cause.items() if isinstance(v, float)}
    return {"effect": cause["effect"], "at": cause["at"], "parameters": values}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], Reference, TruePixels]:
    out = tmp_path_factory.mktemp("shrinkage")
    make_cases(out, 1, 8, Options(frames=(80, 81), simple_laws=True), PLAN)
    answer = json.loads((out / "answers" / "pair.json").read_text(encoding="utf-8"))
    pixels = load_pixels(out / "answers" / "pair.npz", answer["pixels_sha256"])
    return out, answer, reference_of_folder(out / "pair", pixels, answer), pixels


def test_the_truth_closes_all_nothing_closes_none_and_one_of_two_a_part(made: Any) -> None:
    _, answer, ref, pixels = made
    focal, offset = answer["causes"]
    whole = true_closed(ref, pixels.planes_m, [_named(focal), _named(offset)])
    assert whole == pytest.approx(1.0, abs=2e-3)
    assert true_closed(ref, pixels.planes_m, []) == pytest.approx(0.0, abs=1e-12)
    shares = [true_closed(ref, pixels.planes_m, [_named(c)]) for c in (focal, offset)]
    assert all(s is not None and -0.05 < s < 0.999 for s in shares) and max(s or 0 for s in shares) > 0.05
    half = true_closed(ref, pixels.planes_m, [_named(focal, 0.5), _named(offset, 0.5)])
    assert half is not None and 0.2 < half < 0.8
    wrong = true_closed(ref, pixels.planes_m, [_named(offset, -1.0)])
    assert wrong is not None and wrong < 0, "the wrong sign opens the gap"


def test_what_cannot_be_applied_is_not_known(made: Any) -> None:
    _, _, ref, pixels = made
    geometry = {"effect": "geometry", "at": "robot", "parameters": {"spread_m": {"value": 1e-4}}}
    assert true_closed(ref, pixels.planes_m, [geometry]) is None


@pytest.mark.parametrize(("seed", "loaded"), [(1, True), (3, False)])
def test_a_play_is_judged_only_where_the_judge_follows_it(tmp_path: Path, seed: int, loaded: bool) -> None:
    # At a wrist on which hardly any gravity acts, the other joints' motion throws the play about: no law of rest tells where.
    make_cases(
        tmp_path, 1, seed, Options(frames=(80, 81), simple_laws=True), [("play", "small", ("backlash",))]
    )
    answer = json.loads((tmp_path / "answers" / "play.json").read_text(encoding="utf-8"))
    pixels = load_pixels(tmp_path / "answers" / "play.npz", answer["pixels_sha256"])
    ref = reference_of_folder(tmp_path / "play", pixels, answer)
    (play,) = answer["causes"]
    own = true_closed(ref, pixels.planes_m, [_named(play)], frictions_of([play]))
    assert own is not None and (own > 0.99 if loaded else own < 0.9)
    assert is_judge(ref, pixels.planes_m, [play]) is loaded
    assert not is_judge(ref, pixels.planes_m, [{**play, "width_rad": 0.3 * play["width_rad"]}])


def test_changed_pixels_are_refused(made: Any, tmp_path: Path) -> None:
    out, answer, _, pixels = made
    other = tmp_path / "other.npz"
    np.savez(other, corners_px=pixels.corners_px, blobs_px=pixels.blobs_px + 1, planes_m=pixels.planes_m)
    with pytest.raises(BlindError, match="changed afterwards"):
        load_pixels(other, answer["pixels_sha256"])
    with pytest.raises(BlindError, match="missing"):
        load_pixels(out / "answers" / "none.npz", answer["pixels_sha256"])
