"""The hand-written stub says what the compiled module has: no more, no less."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def test_stub_agrees_with_the_module(tmp_path: Path) -> None:
    # pyo3 lists all names in __all__; the stub need not say them twice.
    allowed = tmp_path / "allowed.txt"
    allowed.write_text("mirror_posture._core.__all__\n")
    # What is compared are names and parameters: NumPy's own stubs need not be read for that, which takes as long again.
    config = tmp_path / "mypy.ini"
    config.write_text("[mypy]\nfollow_imports = skip\ndisable_error_code = valid-type\n")
    command = [sys.executable, "-m", "mypy.stubtest", "mirror_posture._core", "--allowlist", str(allowed)]
    command += ["--mypy-config-file", str(config)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
