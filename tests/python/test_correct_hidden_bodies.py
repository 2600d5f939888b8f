"""Random hidden bodies in MuJoCo: ten of those that `hidden_bodies.py` draws; docs/faults.md has the figures of two hundred."""

from __future__ import annotations

import pytest

pytest.importorskip("mujoco")

from hidden_bodies import draw, run, summary
from mirror_posture.robots import Nominal


def test_the_loop_corrects_bodies_that_it_knows_nothing_of() -> None:
    nominal = Nominal.load()
    results = [run(draw(number, nominal), nominal) for number in range(10)]
    figures = summary(results)
    assert figures["reachable"] == figures["within_1_mm"] == 10
    assert figures["looks_median"] <= 6  # type: ignore[operator]
    assert figures["wrong_converged"] == figures["beyond_limits"] == 0
    assert max(r.first_m for r in results) > 0.003, "they did stand wrong"


def test_a_target_out_of_reach_is_called_so() -> None:
    nominal = Nominal.load()
    one = run(draw(39, nominal), nominal)
    assert not one.reachable
    assert one.says_unreachable and one.stop != "converged"
    assert one.beyond_limits == 0
