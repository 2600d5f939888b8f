"""Standard output and error that cannot fail in the middle of the work.

A reader of the output may stop (`| head`), and a disk may be full: everything else that a command writes is
written all the same. A reader that stopped is no error; any other failure is reported when the work is
done.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import Any, TextIO


class Patient:
    """A text stream that goes quiet at its first failure, and remembers why."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.failure: OSError | None = None

    def write(self, text: str) -> int:
        """As of any text stream; nothing happens after a failure."""
        if self.failure is None:
            try:
                return self._stream.write(text)
            except OSError as error:
                self._end(error)
        return len(text)

    def flush(self) -> None:
        """As of any text stream."""
        if self.failure is None:
            try:
                self._stream.flush()
            except OSError as error:
                self._end(error)

    def _end(self, error: OSError) -> None:
        self.failure = error
        # What is buffered still would be tried again at the end of the process.
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def make_patient() -> Patient:
    """Puts both streams of the process behind `Patient` ones; returns that of standard output."""
    for stream in (sys.stdout, sys.stderr):
        # A console or file of another encoding (Windows' are) shows a question mark for ± rather than an error.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    out = Patient(sys.stdout)
    sys.stdout, sys.stderr = out, Patient(sys.stderr)
    return out


def end(out: Patient) -> str | None:
    """Flushes the buffer; returns why standard output failed, or None if it did not, or if its reader
    stopped."""
    out.flush()
    sys.stderr.flush()
    error = out.failure
    if error is None or error.errno in (errno.EPIPE, errno.ESHUTDOWN):
        return None
    return error.strerror or str(error)
