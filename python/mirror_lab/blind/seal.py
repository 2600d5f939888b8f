"""Seals: an answer lies apart from its session; a salted hash beside the session proves that it was not
changed.

The seal is SHA-256(salt ‖ bytes of the answer file). The salt (32 random bytes) lies with the answer: with the seal alone nobody can read
the answer, nor try the few thousand possible ones.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import secrets
from pathlib import Path
from typing import Any

from .errors import BlindError
from .whole_file import write_whole

FORMAT = "mirror-posture/seal"


def seal(answer: dict[str, Any], answer_path: Path, seal_path: Path) -> None:
    """Write the answer with its salt to `answer_path`, and the seal to `seal_path`."""
    salted = {**answer, "salt": secrets.token_hex(32)}
    data = (json.dumps(salted, indent=1, sort_keys=True) + "\n").encode()
    answer_path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(answer_path, data)
    body = {
        "format": FORMAT,
        "version": 1,
        "algorithm": "sha256(salt || answer file)",
        "sha256": _digest(salted["salt"], data),
    }
    # The seal is written last: a session without a seal is incomplete.
    write_whole(seal_path, json.dumps(body, indent=1) + "\n")


def _digest(salt: str, data: bytes) -> str:
    return hashlib.sha256(bytes.fromhex(salt) + data).hexdigest()


def unseal(answer_path: Path, seal_path: Path) -> dict[str, Any]:
    """Read an answer and check it against its seal.

    Raises BlindError where either file is missing or the answer is not the one that was sealed.
    """
    for path in (answer_path, seal_path):
        if not path.is_file():
            raise BlindError(f"{path} is missing: an answer is read only with its seal")
    data = answer_path.read_bytes()
    try:
        answer = json.loads(data)
        stored = json.loads(seal_path.read_text(encoding="utf-8"))
        computed = _digest(answer["salt"], data)
        matches = hmac.compare_digest(computed, stored["sha256"])
    except (KeyError, TypeError, ValueError) as e:
        raise BlindError(f"{answer_path} or {seal_path} is damaged: {e}") from e
    if not matches:
        raise BlindError(
            f"{answer_path} is not the answer that {seal_path} sealed: it was changed afterwards"
        )
    result: dict[str, Any] = answer
    return result
