"""The median of a few numbers: NumPy's own takes ten times as long for what it checks before, and loads its masked arrays first."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def median(values: npt.ArrayLike) -> float:
    """The median of finite numbers of any shape, at least one; of an even count the mean of the two in the middle."""
    ordered = np.sort(np.asarray(values), axis=None)
    count = len(ordered)
    return 0.5 * (float(ordered[(count - 1) // 2]) + float(ordered[count // 2]))
