"""The limits of a diagnosis are true: a cause of twice its limit is told. `limits_check.py` counts it on many sessions."""

from __future__ import annotations

import pytest

pytest.importorskip("mujoco", reason="blind sessions need MuJoCo")

from limits_check import trials
from mirror_lab.blind.simulate import Options


def test_what_is_twice_its_limit_is_told() -> None:
    options = Options(robots=("small",), frames=(60, 61), plain_noise=True, simple_laws=True)
    (trial,) = trials(11002, options, multiples=(2.0,))
    assert trial.told, trial
