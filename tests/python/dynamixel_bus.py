"""A simulated Dynamixel bus on a pseudo-terminal: protocol 2.0 and the X series' memory from the e-Manual, and what they refuse.

Written from the descriptions alone; it shares nothing with the vendor's SDK (its check sum is worked out bit by
bit, not looked up).
"""

from __future__ import annotations

from servo_bus import BROADCAST, FREE_ACCELERATION, FREE_SPEED, SimulatedLine
from servo_bus import SimulatedServo as AnyServo

HEADER = b"\xff\xff\xfd\x00"
STATUS = 0x55
PING, READ, WRITE, SYNC_READ, SYNC_WRITE = 0x01, 0x02, 0x03, 0x82, 0x83
INSTRUCTION_ERROR, CRC_ERROR, RANGE_ERROR, LIMIT_ERROR, ACCESS_ERROR, ALERT = 2, 3, 4, 6, 7, 0x80
MODEL_NUMBER = 1020  # XM430-W350
FIRMWARE = 45
UNIT_COUNTS_PER_S = 0.229 / 60.0 * 4096
UNIT_COUNTS_PER_S2 = 214.577 / 3600.0 * 4096


def crc16(data: bytes) -> int:
    """CRC-16 of protocol 2.0: polynomial x¹⁶ + x¹⁵ + x² + 1, starting at 0."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def stuffed(body: bytes) -> bytes:
    """FF FF FD within a packet is followed by one more FD, or it would look like a header."""
    return body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")


def unstuffed(body: bytes) -> bytes:
    return body.replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")


def packet(servo_id: int, body: bytes) -> bytes:
    body = stuffed(body)
    head = HEADER + bytes([servo_id]) + (len(body) + 2).to_bytes(2, "little") + body
    return head + crc16(head).to_bytes(2, "little")


class SimulatedServo(AnyServo):
    """An XM430-W350: 0 model, 6 firmware, 10 drive mode, 11 mode, 12 second id, 36 to 52 limits, 60 start-up; 64 torque,
    70 error, 98 watchdog, 100 PWM, 102 current, 108 and 112 profile, 116 goal, 128 speed, 132 position."""

    EEPROM_END = 64

    def __init__(self, servo_id: int, position: float, needed_current: int = 10) -> None:
        self.needed_current = needed_current
        """Below it the load is too heavy to move."""
        self.duration_s, self.began = 0.0, (0.0, 0.0)
        self._fresh = True
        super().__init__(servo_id, position)

    def reset(self) -> None:
        if self._fresh:
            self._fresh = False
            for address, size, value in (
                *((0, 2, MODEL_NUMBER), (6, 1, FIRMWARE), (7, 1, self.servo_id), (11, 1, 3), (12, 1, 255)),
                *((36, 2, 885), (38, 2, 1193), (44, 4, 415), (48, 4, 4095)),
            ):
                self.set(address, size, value)
        self.table[64:] = bytes(len(self.table) - 64)
        self.set(102, 2, self.get(38, 2))
        self.set(100, 2, self.get(36, 2))
        self._here()
        self.table[64] = self.table[60] & 1

    def _here(self) -> None:
        self.set(116, 4, round(self.position))
        self.set(132, 4, round(self.position))
        self.set(128, 4, 0)

    @property
    def torque(self) -> bool:
        return bool(self.table[64]) and self.alive

    @property
    def time_based(self) -> bool:
        return bool(self.table[10] & 4)

    def shut_down(self, status: int) -> None:
        self.table[70], self.table[64] = status, 0

    def in_force(self) -> dict[str, int]:
        return {
            "mode": self.table[11],
            "drive_mode": self.table[10],
            "speed": self.get(112, 4),
            "acceleration": self.get(108, 4),
            "current": self.get(102, 2),
            "pwm": self.get(100, 2),
            "jump": self.get(116, 4) - round(self.position),
        }

    def refuses(self, address: int, data: bytes) -> int:
        """The error of a write, 0 if it is taken."""
        value = int.from_bytes(data, "little", signed=len(data) > 1)
        if address < self.EEPROM_END and self.torque:
            return ACCESS_ERROR
        if address in (0, 6, 128, 132):
            return ACCESS_ERROR
        if self.table[98] == 255 and address in (100, 102, 104, 116):
            return RANGE_ERROR  # the watchdog has bitten, and is cleared by 0 alone
        if address == 98 and value > 127:
            return RANGE_ERROR
        if address == 116 and not self.get(52, 4) <= value <= self.get(48, 4):
            return LIMIT_ERROR
        if address == 102 and abs(value) > self.get(38, 2):
            return LIMIT_ERROR
        if address == 100 and abs(value) > self.get(36, 2):
            return LIMIT_ERROR
        if address == 112 and not self.time_based and not 0 <= value <= self.get(44, 4):
            return RANGE_ERROR
        if address == 64 and value not in (0, 1):
            return RANGE_ERROR
        return 0

    def write(self, address: int, data: bytes) -> int:
        error = self.refuses(address, data)
        if error:
            return error
        if address == 64 and data[0] and self.table[70]:
            return 0  # shut down until it is rebooted
        self.table[address : address + len(data)] = data
        if address in (10, 11):
            # Another mode begins without a profile.
            self.set(108, 4, 0)
            self.set(112, 4, 0)
        if address == 116:
            self.began = (self.position, self.motor.speed)
            if self.table[10] & 8:
                self.table[64] = 1
        if address == 64 and data[0]:
            self.began = (self.position, 0.0)
        return 0

    def tick(self, dt_s: float, now_s: float) -> None:
        if not self.alive:
            self.motor.speed = 0.0
            return
        watchdog = self.table[98]
        if watchdog not in (0, 255) and now_s - self.heard_s > 0.02 * watchdog:
            self.table[98] = 255
            self.set(116, 4, round(self.position))
        goal = int.from_bytes(self.table[116:120], "little", signed=True)
        strong = self.table[11] != 5 or self.get(102, 2) >= self.needed_current
        top, acceleration = self.get(112, 4), self.get(108, 4)
        if self.time_based:
            # The whole way within so many ms, however far.
            speed = abs(goal - self.began[0]) / (top / 1000.0) if top else FREE_SPEED
            ramp = FREE_ACCELERATION
        else:
            speed = top * UNIT_COUNTS_PER_S or FREE_SPEED
            ramp = acceleration * UNIT_COUNTS_PER_S2 or FREE_ACCELERATION
        self.motor.run(dt_s, goal if self.torque and strong else None, speed, ramp)
        self.set(128, 4, round(self.motor.speed / UNIT_COUNTS_PER_S))
        self.set(132, 4, round(self.position))


class SimulatedBus(SimulatedLine):
    """Servos on a line whose other end is `port`; a context."""

    def _next_packet(self) -> tuple[int, int, bytes] | None:
        while True:
            start = self._buffer.find(HEADER)
            if start < 0:
                self._buffer = self._buffer[-3:]
                return None
            self._buffer = self._buffer[start:]
            if len(self._buffer) < 7:
                return None
            length = int.from_bytes(self._buffer[5:7], "little")
            if len(self._buffer) < 7 + length:
                return None
            whole, self._buffer = self._buffer[: 7 + length], self._buffer[7 + length :]
            servo_id, body = whole[4], unstuffed(whole[7:-2])
            if crc16(whole[:-2]) == int.from_bytes(whole[-2:], "little"):
                return servo_id, body[0], body[1:]

    def _obey(self, servo_id: int, instruction: int, given: bytes) -> None:
        if instruction == SYNC_WRITE:
            address, size = (int.from_bytes(given[i : i + 2], "little") for i in (0, 2))
            for at in range(4, len(given), size + 1):
                self._write(given[at], address, given[at + 1 : at + 1 + size], answer=False)
        elif instruction in (SYNC_READ, READ):
            address, size = (int.from_bytes(given[i : i + 2], "little") for i in (0, 2))
            for one in given[4:] if instruction == SYNC_READ else (servo_id,):
                for servo in self._with_id(one):
                    self._answer(servo, 0, bytes(servo.table[address : address + size]))
        elif instruction == WRITE:
            address = int.from_bytes(given[:2], "little")
            self._write(servo_id, address, given[2:], answer=servo_id != BROADCAST)
        elif instruction == PING:
            for servo in self._with_id(servo_id):
                self._answer(servo, 0, bytes(servo.table[0:2]) + bytes(servo.table[6:7]))
        else:
            for servo in self._with_id(servo_id):
                self._answer(servo, INSTRUCTION_ERROR)

    def _answer_bytes(self, servo: AnyServo, error: int, data: bytes) -> bytes:
        alert = ALERT if servo.table[70] else 0
        return packet(servo.servo_id, bytes([STATUS, error | alert]) + data)
