"""benches/side_by_side.py runs to its end, and its peers find what the product finds."""

from __future__ import annotations

import re
import runpy
import sys
from functools import partial
from pathlib import Path

import pytest

from mirror_posture.render import PictureOptions, render_session

SCRIPT = Path(__file__).resolve().parents[2] / "benches" / "side_by_side.py"


def test_a_small_run_ends_with_the_diagnosis(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco")
    small = ["--markers", "200", "--views", "20", "--postures", "50", "--frames", "130"]
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), *small])
    monkeypatch.setenv("COLUMNS", "250")
    # What is found in the picture is asked for, not its look.
    quick = PictureOptions(samples=1, edge_samples=2, ghosts=False)
    monkeypatch.setattr("mirror_posture.render.render_session", partial(render_session, options=quick))
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(SCRIPT), run_name="__main__")
    said = capsys.readouterr().out
    assert ended.value.code == 0, said
    titles = (
        "two-view markers",
        "mirrors from 35 corners",
        "One picture",
        "One damped step",
        "A session of 130",
    )
    for title in titles:
        assert title in said, title
    hidden = re.search(r"one cause hidden: (\S+)", said)
    assert hidden is not None
    # The product and SciPy's fit of each single cause name the cause that was hidden.
    assert f"mirror_posture.diagnose: {hidden[1]}" in said
    assert f"SciPy least_squares of each offset and gear: {hidden[1]}" in said
    step = re.search(r"NumPy +│ +[\d.]+ │ +[\d.]+ │ +(\S+) rad", said)
    assert step is not None and float(step[1]) < 1e-12
