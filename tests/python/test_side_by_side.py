"""benches/side_by_side.py runs to its end, and its peers find what the product finds."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "benches" / "side_by_side.py"


def test_a_small_run_ends_with_the_diagnosis() -> None:
    pytest.importorskip("mujoco")
    small = ["--markers", "200", "--views", "20", "--postures", "50", "--frames", "130"]
    done = subprocess.run(
        [sys.executable, str(SCRIPT), *small],
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": "250"},
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    titles = (
        "two-view markers",
        "mirrors from 35 corners",
        "One picture",
        "One damped step",
        "A session of 130",
    )
    for title in titles:
        assert title in done.stdout, title
    hidden = re.search(r"one cause hidden: (\S+)", done.stdout)
    assert hidden is not None
    # The product and SciPy's fit of each single cause name the cause that was hidden.
    assert f"mirror_posture.diagnose: {hidden[1]}" in done.stdout
    assert f"SciPy least_squares of each offset and gear: {hidden[1]}" in done.stdout
    step = re.search(r"NumPy +│ +[\d.]+ │ +[\d.]+ │ +(\S+) rad", done.stdout)
    assert step is not None and float(step[1]) < 1e-12
