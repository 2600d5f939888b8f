"""What is four times as large takes about four times as long: nothing that reads a session is quadratic."""

from __future__ import annotations

from pathlib import Path

import pytest

from growing_sessions import growth

SIZES = {"frames": 250, "joints": 200, "markers": 60, "chain": 1000, "yaml": 1000}
"""Large enough that a quadratic part shows beside what every session costs."""
LEAST_S = 0.05
"""What takes less says nothing."""


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("direction", SIZES)
def test_four_times_as_much_is_no_sixteen_times_the_work(direction: str, tmp_path: Path) -> None:
    sizes = [SIZES[direction], 4 * SIZES[direction]]
    for repeats in (1, 4):
        small, large = growth(direction, sizes, tmp_path, repeats)
        slow = {k: (small[k], s) for k, s in large.items() if s > max(LEAST_S, 8.0 * small[k])}
        if not slow:
            return
        # Once more, and the least of several: a machine with other work tells twice the time now and then.
    pytest.fail(f"{direction}: {slow}")
