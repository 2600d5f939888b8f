"""The exceptions of the blind check."""


class BlindError(ValueError):
    """A blind check cannot be made, run or scored; the message names the file or the option and the fix."""


class NoPlaceError(BlindError):
    """No place is left on the drawn robot for a drawn effect."""


class UnstableError(BlindError):
    """The simulated body of a draw never comes to rest."""
