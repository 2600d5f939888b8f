"""Blind check: sessions whose effect is withheld, from a simulator that shares nothing with the diagnosis.

Nothing in this package imports the rest of `mirror_posture`: bodies come from MuJoCo's dynamics, pictures'
points from
an exact ray path, and what the data can show from an own reference. What scores or runs a diagnosis is
handed it.
"""

from .errors import BlindError

__all__ = ["BlindError"]
