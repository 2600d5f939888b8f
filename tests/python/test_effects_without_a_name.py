"""Effects that the vocabulary lacks, where mounts or two causes of one joint suffice to absorb them: sessions of the blind check that were
explained so. What makes them shares nothing with the diagnosis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")

import mirror_posture as mp
from mirror_lab.blind.effects import VOCABULARY
from mirror_lab.blind.make import draw_causes
from mirror_lab.blind.simulate import Options, simulate
from mirror_lab.blind.write import write_session

OUTSIDE_ONLY = Options(causes=(0, 1), outside_share=1.0)


@pytest.mark.parametrize(
    ("seed", "kind"), [([7712501, 26], "rolling_shear"), ([7712501, 50], "second_harmonic")]
)
def test_what_pieces_could_absorb_is_unknown_at_its_place(seed: list[int], kind: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    robot = str(rng.choice(list(OUTSIDE_ONLY.robots)))
    case = simulate("case", robot, draw_causes(rng, OUTSIDE_ONLY, sorted(VOCABULARY)), rng, OUTSIDE_ONLY)
    (true,) = case.answer["causes"]
    assert true["kind"] == kind
    write_session(case, tmp_path / "case", rng)
    told = mp.diagnose(tmp_path / "case")
    assert told.verdict == "unknown" and not told.causes, told.sentence
    assert told.where[0].at == true["at"], told.where
