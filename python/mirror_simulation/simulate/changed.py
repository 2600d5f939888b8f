"""The simulator's model while a session's causes are added."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mirror_posture import MirrorPostureError
from mirror_posture.session import Session

from .model import Simulator
from .motion import Drive

Values = Mapping[str, float]


@dataclass
class Changed:
    """What a cause may change."""

    simulator: Simulator
    session: Session
    largest_torque_nm: Mapping[str, float]
    drives: dict[str, list[Drive]] = field(default_factory=dict)
    swapped: list[tuple[str, str]] = field(default_factory=list)
    """Pairs of joints whose servos get each other's commands."""
    comments: list[tuple[str, str]] = field(default_factory=list)
    """Name of the changed element of the model, and the change."""

    def joint(self, name: str) -> Any:
        """A joint of the model. Raises `MirrorPostureError` that lists the joints there are."""
        joint = self.simulator.spec.joint(name)
        if joint is None:
            raise MirrorPostureError(
                f"the model has no joint {name!r} of the diagnosis; it has {', '.join(self.simulator.joints)}"
            )
        return joint

    def drive(self, joint: str, law: Drive) -> None:
        """Adds a fault of a joint's drive."""
        self.joint(joint)
        self.drives.setdefault(joint, []).append(law)


Law = Callable[[Changed, str, Values], tuple[str, str]]
