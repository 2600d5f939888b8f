"""A simulated serial line on a pseudo-terminal with motors on it, and faults; what is spoken on it says a subclass.

It shares nothing with the vendors' SDKs, nor with the drivers.
"""

from __future__ import annotations

import contextlib
import math
import os
import random
import select
import threading
import time
import tty
from abc import ABC, abstractmethod
from collections.abc import Sequence

TICK_S = 0.002
FREE_SPEED = 4300.0
"""Counts a second: what the motor does without any limit (63 turns a minute)."""
FREE_ACCELERATION = 60_000.0
BROADCAST = 254


class Motor:
    """A shaft that follows a goal by a trapezoid of speed."""

    def __init__(self, position: float) -> None:
        self.position = position
        self.speed = 0.0
        """Counts a second, signed."""
        self.fastest = 0.0
        """Of its life, while its torque was on."""
        self.jammed = False
        self.dead_until_s = 0.0
        """Without power until then: deaf, and without torque."""

    def run(self, dt_s: float, goal: float | None, top: float, acceleration: float) -> None:
        """On by `dt_s`; no goal: the shaft is free (and stays, as one with friction does)."""
        if goal is None or self.jammed:
            self.speed = 0.0
            return
        while dt_s > 0.0:
            dt = min(dt_s, TICK_S)
            dt_s -= dt
            away = goal - self.position
            # Slow enough to come to a halt at the goal, fast enough to get there within a tick.
            wanted = math.copysign(min(top, math.sqrt(2.0 * acceleration * abs(away)), abs(away) / dt), away)
            change = max(-acceleration * dt, min(acceleration * dt, wanted - self.speed))
            self.speed += change
            if abs(away) <= abs(self.speed) * dt and abs(self.speed) <= acceleration * dt * 2.0:
                self.position, self.speed = goal, 0.0
            else:
                self.position += self.speed * dt
            self.fastest = max(self.fastest, abs(self.speed))


class SimulatedServo(ABC):
    """A memory and a motor."""

    EEPROM_END: int
    SIZE = 256

    def __init__(self, servo_id: int, position: float) -> None:
        self.servo_id = servo_id
        self.motor = Motor(position)
        self.table = bytearray(self.SIZE)
        self.heard_s = time.monotonic()
        self.reset()

    @property
    def position(self) -> float:
        return self.motor.position

    @property
    def jammed(self) -> bool:
        return self.motor.jammed

    @jammed.setter
    def jammed(self, value: bool) -> None:
        self.motor.jammed = value

    @property
    def fastest(self) -> float:
        return self.motor.fastest

    @property
    def alive(self) -> bool:
        return time.monotonic() >= self.motor.dead_until_s

    def get(self, address: int, size: int) -> int:
        return int.from_bytes(self.table[address : address + size], "little")

    def set(self, address: int, size: int, value: int) -> None:
        self.table[address : address + size] = (value % 256**size).to_bytes(size, "little")

    @abstractmethod
    def reset(self) -> None:
        """What is in the memory after power came."""

    @property
    @abstractmethod
    def torque(self) -> bool: ...

    @abstractmethod
    def shut_down(self, status: int) -> None:
        """A fault of its own: torque off, and it says why."""

    @abstractmethod
    def write(self, address: int, data: bytes) -> int:
        """Takes a write, or says by its error why not."""

    @abstractmethod
    def tick(self, dt_s: float, now_s: float) -> None: ...

    @abstractmethod
    def in_force(self) -> dict[str, int]:
        """Limits and goal, for the record of torque going on."""

    def brown_out(self, seconds: float) -> None:
        """Its power dips: what is volatile is gone, and it does not listen for a while."""
        self.reset()
        self.motor.speed = 0.0
        self.motor.dead_until_s = time.monotonic() + seconds


class SimulatedLine(ABC):
    """Servos on a line whose other end is `port`; a context."""

    def __init__(self, *servos: SimulatedServo) -> None:
        self.all = list(servos)
        """Every servo, those with the same id as well."""
        self.servos = {servo.servo_id: servo for servo in reversed(servos)}
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self._slave = slave  # kept open, so that the line does not hang up between two users
        self.port = os.ttyname(slave)
        self.instructions: list[tuple[int, int, bytes]] = []
        """(id, instruction, parameters) as they were heard."""
        self.torque_on: list[dict[str, int]] = []
        """What was in force at each moment at which a torque went on."""
        self.drop, self.garble, self.deaf = 0, 0, 0
        """How many of the next answers are lost, or have a bit turned; how many of the next packets are not heard."""
        self.noise = 0.0
        """Share of answers that come with a few foreign bytes before them."""
        self.late_s = 0.0
        """How late answers come."""
        self.mute = False
        self._random = random.Random(5)
        self._buffer = b""
        self._answers: dict[int, list[bytes]] = {}
        self._lock = threading.Lock()
        self._running = True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def __enter__(self):  # type: ignore[no-untyped-def]
        return self

    def __exit__(self, *_: object) -> None:
        self._running = False
        self._thread.join()
        self.cut()
        with contextlib.suppress(OSError):
            os.close(self._slave)

    def cut(self) -> None:
        """Cuts the line for good; the servos live on."""
        with self._lock:
            if self.master >= 0:
                os.close(self.master)
                self.master = -1

    def remove(self, servo_id: int) -> None:
        """Takes a servo off the line."""
        with self._lock:
            del self.servos[servo_id]
            self.all = [servo for servo in self.all if servo.servo_id != servo_id]

    def fault(self, servo_id: int, status: int) -> None:
        """A servo shuts itself down."""
        with self._lock:
            self.servos[servo_id].shut_down(status)

    def brown_out(self, servo_id: int, seconds: float = 0.0) -> None:
        with self._lock:
            self.servos[servo_id].brown_out(seconds)

    def positions(self) -> dict[int, float]:
        with self._lock:
            return {servo_id: servo.position for servo_id, servo in self.servos.items()}

    def comes_to_rest(self, within_s: float = 1.0) -> bool:
        """Whether all shafts stand still in time: a busy machine lets the line's thread lag behind the program's."""
        end = time.monotonic() + within_s
        while any(self.speeds().values()) and time.monotonic() < end:
            time.sleep(0.01)
        return not any(self.speeds().values())

    def speeds(self) -> dict[int, float]:
        with self._lock:
            return {servo_id: servo.motor.speed for servo_id, servo in self.servos.items()}

    def all_off(self) -> bool:
        with self._lock:
            return not any(servo.torque for servo in self.all)

    def torques(self) -> list[bool]:
        with self._lock:
            return [servo.torque for servo in self.all]

    def fastest(self) -> float:
        """Counts a second, of all servos, over their lives."""
        with self._lock:
            return max(servo.fastest for servo in self.all)

    def _run(self) -> None:
        last = time.monotonic()
        while self._running:
            with self._lock:
                master = self.master
            try:
                ready = master >= 0 and bool(select.select([master], [], [], TICK_S)[0])
            except OSError:  # cut in this moment
                ready, master = False, -1
            if master < 0:
                time.sleep(TICK_S)
            with self._lock:
                now = time.monotonic()
                for servo in self.all:
                    was_on = servo.torque
                    servo.tick(max(now - last, 1e-6), now)
                    if servo.torque and not was_on:
                        self._note(servo)
                last = now
                if ready and self.master >= 0:
                    with contextlib.suppress(OSError):
                        self._buffer += os.read(self.master, 4096)
                        if self.mute:
                            self._buffer = b""
                        while (packet := self._next_packet()) is not None:
                            self._hear(*packet, now)

    @abstractmethod
    def _next_packet(self) -> tuple[int, int, bytes] | None:
        """Takes the next whole packet out of `_buffer`: id, instruction, parameters. None: there is none yet."""

    @abstractmethod
    def _obey(self, servo_id: int, instruction: int, given: bytes) -> None: ...

    @abstractmethod
    def _answer_bytes(self, servo: SimulatedServo, error: int, data: bytes) -> bytes: ...

    def _hear(self, servo_id: int, instruction: int, given: bytes, now_s: float) -> None:
        if self.deaf > 0:
            self.deaf -= 1
            return
        self.instructions.append((servo_id, instruction, given))
        self._answers, self._now_s = {}, now_s
        self._obey(servo_id, instruction, given)
        for answers in self._answers.values():
            self._transmit(answers)

    def _with_id(self, servo_id: int) -> list[SimulatedServo]:
        """Those that listen to it; they have heard something."""
        found = [s for s in self.all if s.alive and servo_id in (s.servo_id, BROADCAST)]
        for servo in found:
            servo.heard_s = self._now_s
        return found

    def _write(self, servo_id: int, address: int, data: bytes, *, answer: bool) -> None:
        for servo in self._with_id(servo_id):
            was_on = servo.torque
            error = servo.write(address, data)
            if servo.torque and not was_on:
                self._note(servo)
            if answer:
                self._answer(servo, error)

    def _note(self, servo: SimulatedServo) -> None:
        self.torque_on.append({"id": servo.servo_id, **servo.in_force()})

    def _answer(self, servo: SimulatedServo, error: int = 0, data: bytes = b"") -> None:
        self._answers.setdefault(servo.servo_id, []).append(self._answer_bytes(servo, error, data))

    def _transmit(self, answers: Sequence[bytes]) -> None:
        if self.master < 0:
            return
        if self.drop > 0:
            self.drop -= 1
            return
        # Two that speak at once: what is low for one is low on the line.
        longest = max(map(len, answers))
        said = bytearray(b"\xff" * longest)
        for one in answers:
            for at, byte in enumerate(one):
                said[at] &= byte
        if self.garble > 0:
            self.garble -= 1
            said[-4] ^= 0x10
        if self.noise and self._random.random() < self.noise:
            said = bytearray(self._random.randbytes(self._random.randint(1, 6))) + said
        if self.late_s:
            time.sleep(self.late_s)
        with contextlib.suppress(OSError):
            os.write(self.master, said)
