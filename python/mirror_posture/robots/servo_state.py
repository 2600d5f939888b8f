"""The states of a robot of servos and their transitions: one rule for every make of servo."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Literal

from .errors import HardwareFaultError, RobotError

AtEnd = Literal["off", "hold"]
"""The torque when a robot stops or rests: off, or held, within its limits, where the joints stand."""


class State(Enum):
    """The state of a robot of servos."""

    UNPOWERED = "unpowered"
    """No torque; nothing was promised yet, or it rests."""
    HOLDING = "holding"
    """Torque within verified limits, every goal where its joint stands."""
    MOVING = "moving"
    """Goals were sent; the joints are on their way."""
    STOPPED = "stopped"
    """Something failed: nothing is sent any more, and the robot has to be opened again."""


class Torque(Enum):
    """What is known of the torque."""

    OFF = "off"
    """Every servo was queried and confirms that it is off."""
    HELD = "held"
    """Every servo was queried: torque within its limits, goal where it stands."""
    UNKNOWN = "not known"
    """A servo could not be queried: a cut line, a servo without power."""


FOLLOWS: dict[State, tuple[State, ...]] = {
    State.UNPOWERED: (State.HOLDING, State.STOPPED),
    State.HOLDING: (State.MOVING, State.UNPOWERED, State.STOPPED),
    State.MOVING: (State.HOLDING, State.STOPPED),
    State.STOPPED: (State.STOPPED,),
}


@dataclass(frozen=True)
class Standing:
    """A state, the torque in it, and why the last change came."""

    state: State
    torque: Torque
    why: str

    @property
    def sentence(self) -> str:
        """In words."""
        return f"{self.state.value}, torque is {self.torque.value}: {self.why}"


class StateMachine:
    """The present state; only changes of `FOLLOWS` can be made, and only `HOLDING` and `MOVING` may be commanded."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._now = Standing(State.UNPOWERED, Torque.UNKNOWN, "not opened yet")

    @property
    def now(self) -> Standing:
        """Its state."""
        return self._now

    def to(self, state: State, torque: Torque, why: str) -> Standing:
        """Changes the state. Raises `RobotError` for a change that must not be."""
        if state not in FOLLOWS[self._now.state]:
            raise RobotError(
                f"{self._name}: {state.value} cannot follow {self._now.sentence}; only "
                f"{', '.join(s.value for s in FOLLOWS[self._now.state])} can"
            )
        self._now = Standing(state, torque, why)
        return self._now

    def check_holding(self) -> None:
        """Raises `HardwareFaultError` where nothing may be sent: the robot does not hold itself."""
        if self._now.state is not State.HOLDING:
            raise HardwareFaultError(
                f"{self._name}: {self._now.sentence}; see to the robot and open it again"
            )
