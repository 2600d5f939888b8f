"""The blind check: sessions whose cause is withheld, from a simulator that shares no code with the
diagnosis.

Nothing in this package imports the rest of `mirror_posture`: bodies come from MuJoCo's dynamics, image
points from an exact ray path, and what the data can show from a separate reference. The diagnosis that is
run and scored is passed in as a function.
"""

from .errors import BlindError

__all__ = ["BlindError"]
