"""The paper's statements and the results here, side by side."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

Status = Literal["holds", "does not hold", "differs", "beyond the paper"]


@dataclass(frozen=True)
class Claim:
    """One statement of the paper, in words, and what was found."""

    what: str
    """What the statement is about."""
    paper: str
    """What the paper found, in its own terms."""
    here: str
    """What was found here, with its numbers."""
    status: Status


def judged(what: str, paper: str, here: str, holds: bool) -> Claim:
    """A statement that either holds or does not."""
    return Claim(what, paper, here, "holds" if holds else "does not hold")


@dataclass(frozen=True)
class Experiment:
    """One figure or table of the paper, redone."""

    name: str
    """`fig7`, `table1` …"""
    title: str
    claims: tuple[Claim, ...]
    data: dict[str, Any]
    """All plotted numbers and the settings that produced them, as JSON data."""
    pictures: dict[str, bytes] = field(default_factory=dict, repr=False)
    """PNG by file name; the figure itself first."""
    notes: tuple[str, ...] = ()
    """What had to be chosen because the paper does not state it, and what is missing."""

    @property
    def label(self) -> str:
        """As the paper writes it: `Fig. 7`, `Table I`."""
        return self.name.replace("fig", "Fig. ").replace("table1", "Table I")

    @property
    def holds(self) -> bool:
        """Whether no statement failed."""
        return all(claim.status != "does not hold" for claim in self.claims)
