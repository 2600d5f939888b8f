"""Ways to break a session, by kind; each is told by what must come of it.

`refused`: one clear error. `same`: the diagnosis of the whole session, since nothing that counts was changed. `any`: an error, or an
answer other than "nothing is wrong": what was broken may still be diagnosed, named as a mistake, or be too little.
"""

# Each adds its ways to KINDS, in this order: the seeds of the scripts stand for them.
from . import columns, rows, units, settings, models, files, evidence, harmless  # noqa: F401, I001
from .kinds import KINDS, Kind, Must, NotHere

__all__ = ["KINDS", "Kind", "Must", "NotHere"]
