"""Where the model is wrong, by which effect, and how far the gap shrinks once the effect is added.

    import mirror_posture as mp

    found = mp.diagnose("my-session")
    found.verdict                       # insufficient, none, explained, partial or unknown
    [(c.effect, c.at, c.probability) for c in found.causes]
    found.gap.before_m, found.gap.after_m

`recording` hands a session to the core, `result` and `parts` hold what comes back, `page` draws it, `applied` writes the better model,
`feed_forward` commands around what stays, `own_effects` takes laws of one's own.
"""

from .feed_forward import FeedForward, feed_forward
from .own_effects import OwnEffect, PlaceQuantities
from .parts import (
    Alternative,
    Cause,
    Checked,
    ChosenAnew,
    Estimate,
    Field,
    Gap,
    Ground,
    LeftOutThere,
    Limit,
    Member,
    Place,
    Ranked,
    SeenMarker,
    Signature,
    Step,
    Track,
    Witness,
)
from .result import Diagnosis
from .run import DiagnosisInterrupted, diagnose

__all__ = [
    "Alternative",
    "Cause",
    "Checked",
    "ChosenAnew",
    "Diagnosis",
    "DiagnosisInterrupted",
    "Estimate",
    "FeedForward",
    "Field",
    "Gap",
    "Ground",
    "LeftOutThere",
    "Limit",
    "Member",
    "OwnEffect",
    "Place",
    "PlaceQuantities",
    "Ranked",
    "SeenMarker",
    "Signature",
    "Step",
    "Track",
    "Witness",
    "diagnose",
    "feed_forward",
]
