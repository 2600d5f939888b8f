"""Two simulated Dynamixel servos as an arm: fixtures and helpers of the tests of their robot."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dynamixel_bus import SimulatedBus, SimulatedServo
from mirror_posture.robots import Nominal
from two_servos import JOINTS, blind  # noqa: F401

pytest.importorskip("dynamixel_sdk")

from mirror_posture.robots.servo_config import (
    ServoConfig,
    load_config,
)

TOML = (
    """
[bus]
port = "{port}"
baudrate = 1000000
speed_rad_per_s = 2.0
acceleration_rad_per_s2 = 20.0
current_a = 0.3
"""
    + JOINTS
)


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    return Nominal.load()


@pytest.fixture
def bus() -> Iterator[SimulatedBus]:
    with SimulatedBus(SimulatedServo(1, 1100.0), SimulatedServo(2, 2000.0)) as bus:
        yield bus


@pytest.fixture
def config(bus: SimulatedBus, nominal: Nominal, tmp_path: Path) -> ServoConfig:
    file = tmp_path / "servos.toml"
    file.write_text(TOML.format(port=bus.port))
    return load_config(file, nominal)


def soon(work: Callable[[], object], after_s: float) -> threading.Timer:
    timer = threading.Timer(after_s, work)
    timer.start()
    return timer
