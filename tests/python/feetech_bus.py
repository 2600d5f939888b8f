"""A simulated line of Feetech's STS3215 on a pseudo-terminal: protocol and memory table as they are published.

Written from the table alone; it shares nothing with the vendor's SDK.
"""

from __future__ import annotations

from servo_bus import BROADCAST, FREE_ACCELERATION, FREE_SPEED, SimulatedLine
from servo_bus import SimulatedServo as AnyServo

PING, READ, WRITE, SYNC_READ, SYNC_WRITE = 0x01, 0x02, 0x03, 0x82, 0x83
MODEL_NUMBER = 777
FINE_SPEED, ZERO_IS_FREE = 4, 8
"""Bits of the phase: speeds in units of 1 step/s instead of 50; speed 0 is the fastest instead of none."""


def packet(servo_id: int, body: bytes) -> bytes:
    """FF FF, id, length, the rest, and the complement of the sum of all but the head."""
    inner = bytes([servo_id, len(body) + 1]) + body
    return b"\xff\xff" + inner + bytes([~sum(inner) % 256])


def magnitude(value: int, bit: int) -> int:
    """A number with its sign in a bit of its own."""
    return abs(value) + (2**bit if value < 0 else 0)


class SimulatedServo(AnyServo):
    """An STS3215: 0 firmware, 3 model, 9 and 11 range, 16 torque, 18 phase, 31 offset, 33 mode; 40 torque, 41 acceleration,
    42 goal, 44 time, 46 speed, 48 torque limit, 55 lock, 56 position, 58 speed, 65 status, 66 moving."""

    EEPROM_END = 40
    SIZE = 100

    def __init__(self, servo_id: int, position: float, phase: int = FINE_SPEED | ZERO_IS_FREE) -> None:
        self.kept = bytearray(40)
        """What outlives a loss of power."""
        for address, data in (
            *((0, b"\x03\x0a\x00"), (3, MODEL_NUMBER.to_bytes(2, "little")), (5, bytes([servo_id, 0, 0, 1]))),
            *(
                (11, (4095).to_bytes(2, "little")),
                (16, (1000).to_bytes(2, "little")),
                (18, bytes([phase, 44])),
            ),
        ):
            self.kept[address : address + len(data)] = data
        self.needed_torque = 50
        """0.1 %; with less the load is too heavy to move."""
        self.began = position
        super().__init__(servo_id, position)

    def reset(self) -> None:
        self.table[:] = bytes(len(self.table))
        self.table[:40] = self.kept
        self.set(42, 2, round(self.position))
        self.set(46, 2, 0 if self.table[18] & ZERO_IS_FREE else 60)
        self.set(48, 2, self.get(16, 2))
        self.table[55] = 1
        self.set(56, 2, round(self.position))

    @property
    def torque(self) -> bool:
        return bool(self.table[40]) and self.alive

    @property
    def offset(self) -> int:
        raw = self.get(31, 2)
        return -(raw & 0x7FF) if raw & 0x800 else raw & 0x7FF

    def shut_down(self, status: int) -> None:
        self.table[65], self.table[40] = status, 0

    def in_force(self) -> dict[str, int]:
        return {
            "mode": self.table[33],
            "speed": self.get(46, 2),
            "time": self.get(44, 2),
            "acceleration": self.table[41],
            "torque": self.get(48, 2),
            "jump": self.get(42, 2) - round(self.position),
        }

    def write(self, address: int, data: bytes) -> int:
        value = int.from_bytes(data, "little")
        if address + len(data) > 56 or address < 5 or (address < self.EEPROM_END and self.torque):
            return 0
        if address == 42 and not self.get(9, 2) <= value <= self.get(11, 2):
            return 0
        if address == 48 and value > 1000:
            return 0
        if address == 40 and value and self.table[65]:
            return 0  # shut down
        self.table[address : address + len(data)] = data
        if address < 40 and not self.table[55]:
            self.kept[:] = self.table[:40]
        if address == 42:
            self.began = self.position
            if not self.table[65]:
                self.table[40] = 1  # a goal puts torque on
        return 0

    def tick(self, dt_s: float, now_s: float) -> None:
        if not self.alive:
            self.motor.speed = 0.0
            return
        goal, phase, time_ms = self.get(42, 2), self.table[18], self.get(44, 2)
        unit = 1 if phase & FINE_SPEED else 50
        speed: float = self.get(46, 2) * unit
        if speed == 0 and phase & ZERO_IS_FREE:
            speed = FREE_SPEED
        if time_ms:
            speed = abs(goal - self.began) / (time_ms / 1000.0)
        ramp = self.table[41] * 100.0 or FREE_ACCELERATION
        strong = self.get(48, 2) >= self.needed_torque
        moves = self.torque and strong and self.table[33] == 0
        self.motor.run(dt_s, goal if moves else None, min(speed, FREE_SPEED), ramp)
        self.set(56, 2, magnitude(round(self.position), 15))
        self.set(58, 2, magnitude(round(self.motor.speed / unit), 15))
        self.table[66] = int(self.motor.speed != 0.0)


class SimulatedBus(SimulatedLine):
    """Servos on a line whose other end is `port`; a context."""

    def _next_packet(self) -> tuple[int, int, bytes] | None:
        while True:
            start = self._buffer.find(b"\xff\xff")
            if start < 0:
                self._buffer = self._buffer[-1:]
                return None
            self._buffer = self._buffer[start:]
            if len(self._buffer) < 4:
                return None
            length = self._buffer[3]
            if self._buffer[2] == 0xFF or length < 2:
                self._buffer = self._buffer[1:]
                continue
            if len(self._buffer) < 4 + length:
                return None
            whole, self._buffer = self._buffer[: 4 + length], self._buffer[4 + length :]
            if ~sum(whole[2:-1]) % 256 == whole[-1]:
                return whole[2], whole[4], whole[5:-1]

    def _obey(self, servo_id: int, instruction: int, given: bytes) -> None:
        if instruction == SYNC_WRITE:
            address, size = given[:2]
            for at in range(2, len(given), size + 1):
                self._write(given[at], address, given[at + 1 : at + 1 + size], answer=False)
        elif instruction in (SYNC_READ, READ):
            address, size = given[:2]
            for one in given[2:] if instruction == SYNC_READ else (servo_id,):
                for servo in self._with_id(one):
                    self._answer(servo, 0, bytes(servo.table[address : address + size]))
        elif instruction == WRITE:
            self._write(servo_id, given[0], given[1:], answer=servo_id != BROADCAST)
        elif instruction == PING:
            for servo in self._with_id(servo_id):
                self._answer(servo)

    def _answer_bytes(self, servo: AnyServo, error: int, data: bytes) -> bytes:
        return packet(servo.servo_id, bytes([error | servo.table[65]]) + data)
