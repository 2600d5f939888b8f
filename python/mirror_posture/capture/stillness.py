"""Whether a picture is still and sharp, by comparison with the previous pictures."""

from __future__ import annotations

from collections import deque

import cv2
import numpy as np
import numpy.typing as npt

from ..importing.write import sharpness

Floats = npt.NDArray[np.float32]

SMALL_WIDTH_PX = 160
"""Width to which pictures are shrunk: averages away the sensor's noise."""
MOVED_GREY = 1.5
"""RMS difference of small pictures, grey levels: a hand that moves by its own width gives 3 and more, a webcam's noise 0.3."""
LEAST_SHARPNESS = 0.5
"""Of the usual sharpness of the pictures taken so far."""


class Stillness:
    """Follows a film: since when everything is still, and whether anything moved since the last picture
    that was taken."""

    def __init__(self) -> None:
        self._before: Floats | None = None
        self._taken: Floats | None = None
        self._since_s = 0.0
        self._sharp: deque[float] = deque(maxlen=15)
        self.motion = 0.0
        """RMS grey levels between the last two pictures."""
        self.moved = True
        """Whether anything moved since the last picture that was taken."""

    def see(self, picture: npt.NDArray[np.uint8], time_s: float) -> float:
        """Takes the next picture; returns for how long all has stood still, s."""
        height = max(1, round(SMALL_WIDTH_PX * picture.shape[0] / picture.shape[1]))
        small = cv2.resize(picture, (SMALL_WIDTH_PX, height), interpolation=cv2.INTER_AREA).astype(np.float32)
        if self._before is None or self._before.shape != small.shape:
            self.motion, self._since_s = 0.0, time_s
        else:
            self.motion = float(np.sqrt(np.mean((small - self._before) ** 2)))
            if self.motion > MOVED_GREY:
                self._since_s, self.moved = time_s, True
        if self._taken is not None and self._taken.shape == small.shape:
            # A slow move never shows from picture to picture.
            self.moved |= float(np.sqrt(np.mean((small - self._taken) ** 2))) > MOVED_GREY
        self._before = small
        return time_s - self._since_s

    def restart(self) -> None:
        """What comes now is of another posture, whatever was still before."""
        self._before, self.moved = None, True

    def is_sharp(self, picture: npt.NDArray[np.uint8]) -> bool:
        """Whether it is about as sharp as the pictures taken so far."""
        return len(self._sharp) < 3 or sharpness(picture) > LEAST_SHARPNESS * float(np.median(self._sharp))

    def take(self, picture: npt.NDArray[np.uint8]) -> None:
        """This picture was taken: the next one must be of something else."""
        self._taken, self.moved = self._before, False
        self._sharp.append(sharpness(picture))
