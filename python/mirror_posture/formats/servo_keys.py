"""servos.toml: every key, by the servos' make."""

from __future__ import annotations

from typing import Any, Literal

from .keys import REQUIRED, Flag, Key, Number, Section, Text, Whole

Make = Literal["dynamixel", "feetech"]
MAKES: tuple[Make, ...] = ("dynamixel", "feetech")
COUNTS_PER_TURN = 4096
LARGEST_ID = 252


def _share(name: str, what: str, default: Any = None) -> Number:
    return Number(
        name=name, what=what, default=default, above=0.0, at_most=1.0, needs="a share from 0 to 1, above 0"
    )


def _positive(name: str, what: str, unit: str, default: float | None) -> Number:
    return Number(
        name=name, what=what, unit=unit, default=default, above=0.0, needs="a finite number above 0"
    )


_BUS: tuple[Key, ...] = (
    Text(name="port", what="The serial line.", needs='a serial line such as "/dev/ttyUSB0" or "COM3"'),
    Whole(name="baudrate", what="The bus's rate.", unit="bit/s", default=1_000_000, at_least=1),
    _positive("speed_rad_per_s", "Written to each servo before torque.", "rad/s", 0.5),
    _positive("acceleration_rad_per_s2", "Written to each servo before torque.", "rad/s²", 5.0),
    _positive("tolerance_rad", "A joint farther from its command did not arrive.", "rad", 0.05),
    Text(
        name="at_end",
        what="The torque after a stop and at rest: off, or held within its limits.",
        default="off",
        one_of=("off", "hold"),
        needs='"off" or "hold"',
    ),
    Flag(
        name="end_with_parent",
        what="Whether the end of the process that started this one stops the robot.",
        default=True,
    ),
)
_TORQUE: dict[Make, tuple[Key, ...]] = {
    "dynamixel": (
        _positive(
            "current_a", "The torque limit of servos with current control, as motor current.", "A", None
        ),
        _share(
            "pwm_share",
            "The torque limit of servos without current control, as a share of the supply, 0 to 1.",
        ),
        _positive("current_unit_a", "Not needed; where it is given, it must be the model's.", "A", None),
    ),
    "feetech": (
        _share("torque_share", "The torque limit, as a share of what the servo can do, 0 to 1.", REQUIRED),
    ),
}
_RULES = {
    "dynamixel": {"oneOf": [{"required": ["current_a"]}, {"required": ["pwm_share"]}]},
    "feetech": {},
}
BUS: dict[Make, Section] = {
    make: Section(
        name="bus",
        what="The line, and the limits of all servos on it."
        + (" Exactly one torque limit: `current_a` or `pwm_share`." if make == "dynamixel" else ""),
        keys=_BUS + _TORQUE[make],
        closed=True,
        rules=_RULES[make],
    )
    for make in MAKES
}
_OF_MAKE: dict[Make, Key] = {
    "dynamixel": Flag(
        name="reversed",
        what="Whether its drive mode turns its positive sense round; verified before torque.",
        default=False,
    ),
    "feetech": Whole(
        name="homing_offset",
        what="The offset that `zero_counts` was found with (LeRobot's calibration file has it); verified before torque.",
        unit="counts",
        default=None,
    ),
}
SERVO: dict[Make, Section] = {
    make: Section(
        name="joints.NAME",
        what="One joint's servo: `theta = direction · (counts − zero_counts) · 2π / counts_per_turn`.",
        keys=(
            Whole(
                name="id",
                what="Each only once.",
                at_least=0,
                at_most=LARGEST_ID,
                needs=f"a whole number, 0 to {LARGEST_ID}, each only once",
            ),
            Whole(name="zero_counts", what="Where the URDF's joint is at 0.", unit="counts"),
            Whole(
                name="direction",
                what="The servo's positive sense against the URDF's.",
                one_of=(1, -1),
                needs="1 or -1",
            ),
            Number(
                name="lower_rad",
                what="Lower limit, narrower than the URDF's.",
                unit="rad",
                default=None,
                needs="a finite number",
            ),
            Number(
                name="upper_rad",
                what="Upper limit, narrower than the URDF's.",
                unit="rad",
                default=None,
                needs="a finite number",
            ),
            Whole(name="counts_per_turn", what="Of the servo.", default=COUNTS_PER_TURN, at_least=1),
            Text(
                name="model",
                what="Refuse any other servo.",
                default=None,
                needs="a text",
            ),
            Text(name="firmware", what="Refuse any other firmware.", default=None, needs="a text"),
            _OF_MAKE[make],
        ),
        closed=True,
    )
    for make in MAKES
}
REST = "Where to go before torque is taken off, if nothing failed: positions of joints of `[joints]` within their limits (rad)."
NOT_IN_A_SCHEMA = (
    "a joint that the robot lacks, a position outside its limits, limits of which nothing is left, counts that no servo knows",
    "two servos of one id",
    "a speed or an acceleration below a servo's step",
    "not-a-number, and 7.0 where a whole number is needed",
)
"""What the reader refuses beyond the schema."""


def document_schema(make: Make) -> dict[str, object]:
    """The whole file as JSON Schema."""
    position = Number(name="", what="").schema()
    return {
        "type": "object",
        "properties": {
            "bus": BUS[make].schema(),
            "rest": {"type": "object", "description": REST, "additionalProperties": position},
            "joints": {"type": "object", "minProperties": 1, "additionalProperties": SERVO[make].schema()},
        },
        "required": ["bus", "joints"],
        "additionalProperties": False,
    }
