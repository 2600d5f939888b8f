"""The stand of a simulated robot, which is turned by hand with an error."""

from __future__ import annotations

import math

import numpy as np

from mirror_posture._core import MirrorPostureError
from mirror_posture.viewpoint import View


class SimulatedStand:
    """A robot that turns before its mirror (`TurnsView`): the intended view and the true one.

    A mix-in of robots; `_stand(view, error_rad, random)` sets it up.
    """

    def _stand(self, view: View, error_rad: float, random: np.random.Generator) -> None:
        """Starts at a view; `error_rad` is the error of the stand, standard deviation of one axis."""
        self._stand_error_rad, self._stand_random = error_rad, random
        self.turn(view)

    @property
    def view(self) -> View:
        """The intended view."""
        return self._view

    def turn(self, view: View) -> None:
        """Has the mirror stand there, but for the stand's error."""
        if not (view.distance_m > 0.0 and math.isfinite(view.yaw_rad) and math.isfinite(view.pitch_rad)):
            raise MirrorPostureError(f"{view}: needed finite angles and a distance above 0 m")
        off = self._stand_random.normal(0.0, self._stand_error_rad, 2)
        self._view = view
        self._real_view = View(view.yaw_rad + off[0], view.pitch_rad + off[1], view.distance_m)
