"""The effects by name: the public vocabulary for commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .._core import MirrorPostureError, effects, mistakes
from ..session.errors import choices

BESIDE: Mapping[str, Mapping[str, object]] = {str(mistake["name"]): mistake for mistake in mistakes()}
"""Groups, faults of the data and gross mistakes, as the core describes them: `signature`, `remedy`,
`written_to`, `is_mistake`."""
MISTAKES = tuple(name for name, told in BESIDE.items() if told["is_mistake"])
"""Whole mistakes of model, log or mounting, which are tried exactly before small errors are searched."""
IN_WORDS: Mapping[str, Mapping[str, object]] = {str(effect["name"]): effect for effect in effects()}
"""Each effect as the core describes it: `at`, `parameters`, `law`, `joint_law`, `words`, `remedy`,
`written_to`, `fed_forward`, `signature`, `shown_by`, `confused_with`."""
EFFECTS = (*IN_WORDS, *BESIDE)
"""All names that a diagnosis accepts and reports."""
MOST_LIKE = 8
"""How many of them an error lists: the most like the one that was got."""


def remedy(effect: str) -> str:
    """What to do about an effect of the vocabulary or a mistake, in a few words."""
    return str((IN_WORDS.get(effect) or BESIDE[effect])["remedy"])


def joint_terms(effect: str, values: Mapping[str, float]) -> dict[str, float]:
    """The parameters of an effect by the terms of its joint's law; empty where it has none (it is no effect at a joint).

    The terms are `offset`, `share`, `sine`, `cosine_less_one`, `compliance`, `coupling`, `rate`, `play` and `dead_band` of
    `θ = q + a + e q + s sin q + c (cos q − 1) + k τ + κ q_other + r t ± w/2 ± d`.
    """
    told = IN_WORDS.get(effect)
    if told is None:
        return {}
    names, terms = told["parameters"], told["joint_law"]
    assert isinstance(names, list) and isinstance(terms, list)
    return {term: values[name] for name, term in zip(names, terms, strict=False) if name in values}


def along_joint(effect: str) -> bool:
    """Whether an effect at a joint is along or about its axis: its parameters are then lengths where the joint is prismatic. A tilt is an angle."""
    told = IN_WORDS.get(effect)
    return told is None or bool(told["joint_law"])


def checked_effects(names: Sequence[str]) -> list[str]:
    """The names, where all are of the vocabulary.

    Raises:
        MirrorPostureError: an effect that is none; the message lists those most like it.
    """
    for name in names:
        if name not in EFFECTS:
            valid = choices(EFFECTS, MOST_LIKE, got=name)
            raise MirrorPostureError(f"without: got {name!r}, needed one of {valid}")
    return list(names)
