"""The stand of a simulated robot: it is turned by hand, with an error."""

from __future__ import annotations

import math

import numpy as np

from mirror_posture._core import MirrorPostureError
from mirror_posture.viewpoint import View


class SimulatedStand:
    """What turns before its mirror (`TurnsView`): the view that is meant, and the real one beside it.

    A mix-in of robots; `_stand(view, error_rad, random)` sets it up.
    """

    def _stand(self, view: View, error_rad: float, random: np.random.Generator) -> None:
        """Stands at a view; `error_rad` is how far the stand ends up beside it, one axis, standard deviation."""
        self._stand_error_rad, self._stand_random = error_rad, random
        self.turn(view)

    @property
    def view(self) -> View:
        """Where the mirror is meant to stand."""
        return self._view

    def turn(self, view: View) -> None:
        """Has the mirror stand there, but for the stand's error."""
        if not (view.distance_m > 0.0 and math.isfinite(view.yaw_rad) and math.isfinite(view.pitch_rad)):
            raise MirrorPostureError(f"{view}: needed finite angles and a distance above 0 m")
        off = self._stand_random.normal(0.0, self._stand_error_rad, 2)
        self._view = view
        self._real_view = View(view.yaw_rad + off[0], view.pitch_rad + off[1], view.distance_m)
