"""Mutations of a border's sound inputs: bytes, tokens, numbers, lines, and parts of trees of JSON."""

from __future__ import annotations

import copy
import itertools
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from mirror_posture import MirrorPostureError


@dataclass(frozen=True)
class Target:
    """A border: what it does with bytes, and sound inputs that mutations start from."""

    check: Callable[[bytes], bool]
    seeds: tuple[bytes, ...]
    json_tree: bool = False
    """Whether inputs are JSON, whose trees can be mutated."""
    raises: tuple[type[Exception], ...] = (MirrorPostureError,)
    lengths: bool = False
    """Whether inputs tell places and lengths within themselves: then most mutations keep the length, or none would come past the outside."""


ODD_NUMBERS = [
    b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e999", b"0", b"-0.0", b"-1", b"1e-320", b"9" * 40, b"1e12", b"1000000.5", b"0x10",
    b"1_000", b"1,5", b"true", b'""', b"[]", b"{}", b"null", b"4294967296", b"9223372036854775808", b"2020-01-01", b"1e15", b"50",
]  # fmt: skip
TOKENS = [
    b"", b"\n", b",", b'"', b"\x00", b"\xff\xfe", b"[", b"]", b"{", b"}", b"=", b": ", b"&a *a", b"!!python/object:os.system", b"'''",
    b"\xef\xbb\xbf", b"<", b"/>", b"&lol;", b"board", b"measured:", "ä".encode(), b"\r", b"[" * 200, b"hand", b"elbow", b"measured:elbow",
    b"accelerometer:base:x", b"direct", b"mirror", b"\xed\xa0\x80", b"#", b"../x", b"[[markers]]", b"1/0", b"\\u0000", b"%s", b"\t",
]  # fmt: skip
ODD_TREES: list[Any] = [
    None,
    "",
    "x",
    -1,
    0,
    1e308,
    10**400,
    True,
    [],
    {},
    [[1]],
    {"a": 1},
    "joint:",
    "\0",
    0.5,
    [0.1] * 50,
]


def unended(chance: Any, target: Target) -> Iterator[bytes]:
    """Mutated inputs without end."""
    for count in itertools.count():
        yield mutated(chance.choice(target.seeds), chance, target, count)


def mutated(seed: bytes, chance: Any, target: Target, count: int = 0) -> bytes:
    """The input with one to four places changed: bytes, tokens, numbers, lines, or parts of a tree."""
    if target.json_tree and count % 2:
        return _mutated_tree(seed, chance)
    if target.lengths and count % 4:
        return _overwritten(seed, chance)
    data = seed
    for _ in range(chance.choice([1, 1, 1, 2, 3, 4])):
        data = _mutated_once(data, chance)
    return data


def _mutated_once(data: bytes, chance: Any) -> bytes:
    import re

    how = chance.randrange(10)
    start = chance.randrange(len(data) + 1)
    end = min(len(data), start + chance.randrange(30))
    if how == 0:
        return data[:start]
    if how == 1:
        return data[:end] + data[start:]
    if how in (2, 3):
        return data[:start] + chance.choice(TOKENS) + data[chance.choice([start, end]) :]
    if how == 4:
        return data[:start] + bytes(chance.randrange(256) for _ in range(chance.randrange(1, 8))) + data[end:]
    if how == 5 and data:
        start = min(start, len(data) - 1)
        return data[:start] + bytes([data[start] ^ (1 << chance.randrange(8))]) + data[start + 1 :]
    if how in (6, 7):
        numbers = list(re.finditer(rb"-?\d+\.?\d*", data))
        if numbers:
            one = chance.choice(numbers)
            return data[: one.start()] + chance.choice(ODD_NUMBERS) + data[one.end() :]
    lines = data.split(b"\n")
    k, j = chance.randrange(len(lines)), chance.randrange(len(lines))
    if how == 8:
        lines[k], lines[j] = lines[j], lines[k]
    elif chance.random() < 0.5:
        lines.insert(j, lines[k])
    else:
        del lines[k]
    return b"\n".join(lines)


ODD_BYTES = [
    b"\x00" * 4,
    b"\xff" * 4,
    b"\xff\xff\xff\x7f",
    b"\x00" * 8,
    b"\xff" * 8,
    b"\x01\x00\x00\x00",
    b"\x00\x00\x00\x80",
    b"\xff",
    b"\x00",
]


def _overwritten(data: bytes, chance: Any) -> bytes:
    """Some bytes exchanged for others, as many."""
    out = bytearray(data)
    # Long runs of zeros between what is told would take most of the changes.
    told = [k for k, byte in enumerate(data) if byte] or [0]
    for _ in range(chance.choice([1, 1, 1, 2, 4])):
        at = chance.choice(told)
        new = chance.choice(ODD_BYTES) if chance.random() < 0.4 else bytes([chance.randrange(256)])
        out[at : at + len(new)] = new[: len(out) - at]
    return bytes(out)


def _mutated_tree(seed: bytes, chance: Any) -> bytes:
    try:
        tree = json.loads(seed)
    except ValueError:
        return _mutated_once(seed, chance)
    for _ in range(chance.choice([1, 1, 2])):
        found = list(_places(tree))
        if not found:
            return json.dumps(chance.choice(ODD_TREES)).encode()
        owner, key = chance.choice(found)
        if chance.random() < 0.2 and isinstance(owner, dict):
            owner.pop(key)
        else:
            owner[key] = copy.deepcopy(chance.choice(ODD_TREES))
    return json.dumps(tree).encode()


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    items: Any = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        yield tree, key
        yield from _places(value)
