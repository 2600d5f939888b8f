"""The blind simulator shares nothing with what it tests: proven on its source and in a process where the
rest is barred."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "python" / "mirror_lab"
BLIND = PACKAGE / "blind"

BARRED = """
import importlib, importlib.abc, sys, types
parent = types.ModuleType("mirror_lab")
parent.__path__ = [{package!r}]
sys.modules["mirror_lab"] = parent

class Barrier(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        ours = name.partition(".")[0] in ("mirror_posture", "mirror_lab")
        if ours and not name.startswith("mirror_lab.blind"):
            raise ImportError("barred: " + name)
        return None

sys.meta_path.insert(0, Barrier())
for module in {modules!r}:
    importlib.import_module("mirror_lab.blind." + module)
try:
    importlib.import_module("mirror_posture._core")
except ImportError as error:
    assert "barred" in str(error)
else:
    raise SystemExit("the barrier lets _core through")
{body}
"""


def _modules() -> list[str]:
    return sorted(p.stem for p in BLIND.glob("*.py") if p.stem != "__init__")


def run_barred(body: str = "") -> subprocess.CompletedProcess[str]:
    """Run `body` where nothing of this project but mirror_lab.blind can be imported."""
    code = BARRED.format(package=str(PACKAGE), modules=_modules(), body=body)
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_every_module_imports_with_the_rest_of_the_package_barred() -> None:
    assert len(_modules()) > 8
    done = run_barred()
    assert done.returncode == 0, done.stderr


def test_a_session_is_made_with_the_rest_of_the_package_barred(tmp_path: Path) -> None:
    body = f"""
from pathlib import Path
from mirror_lab.blind.make import make_cases
from mirror_lab.blind.simulate import Options
one = [("one", "small", ["backlash"])]
made = make_cases(Path({str(tmp_path)!r}), 1, 3, Options(robots=("small",), frames=(20, 21), least_postures=10), one)
assert (made[0] / "detections.csv").is_file()
ours, blind = ("mirror_posture", "mirror_lab."), "mirror_lab.blind"
loaded = [m for m in sys.modules if m.startswith(ours) and not m.startswith(blind)]
assert not loaded, loaded
"""
    done = run_barred(body)
    assert done.returncode == 0, done.stderr


def test_no_source_line_names_a_module_of_the_rest() -> None:
    for path in BLIND.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                assert not any(a.name.startswith("mirror_") for a in node.names), path
            if isinstance(node, ast.ImportFrom):
                assert node.level <= 1, f"{path.name} reaches out of the blind package"
                assert not (node.module or "").startswith("mirror_") or node.level == 1, path
