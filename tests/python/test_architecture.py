"""Which module may import which, read from the sources: functions' imports count as well."""

from __future__ import annotations

import ast
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest

import mirror_posture

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PYTHON = Path(__file__).resolve().parents[2] / "python"
PRODUCT = PYTHON / "mirror_posture"
LAB = PYTHON / "mirror_lab"


def imports(file: Path) -> set[str]:
    """Full names of the modules that a file imports, at its top or in a function."""
    inside = file.relative_to(PYTHON).with_suffix("").parts
    package = inside[:-1]
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            above = package[: len(package) - (node.level - 1)] if node.level else ()
            base = ".".join((*above, *(node.module or "").split("."))).strip(".")
            found |= {base} | {f"{base}.{alias.name}" for alias in node.names}
    return found


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(package + ".")


@pytest.mark.parametrize("file", sorted(PRODUCT.rglob("*.py")), ids=lambda f: str(f.relative_to(PRODUCT)))
def test_the_product_imports_nothing_of_the_lab(file: Path) -> None:
    wrong = {name for name in imports(file) if within(name, "mirror_lab")}
    assert not wrong
    text = file.read_text(encoding="utf-8")
    assert 'import_module("mirror_lab' not in text and "mirror_lab." not in text


@pytest.mark.parametrize("file", sorted(LAB.rglob("*.py")), ids=lambda f: str(f.relative_to(LAB)))
def test_the_lab_imports_nothing_of_the_diagnosis(file: Path) -> None:
    wrong = {name for name in imports(file) if within(name, "mirror_posture.diagnosis")}
    assert not wrong


def test_this_reader_of_imports_sees_what_it_should() -> None:
    assert "mirror_posture.session.load_session" in imports(PRODUCT / "measurement.py") | imports(
        PRODUCT / "cli" / "commands" / "check.py"
    )
    assert "mirror_lab.blind.make" in imports(LAB / "commands" / "blind.py")


def test_both_distributions_have_one_version() -> None:
    project = tomllib.loads((LAB / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["version"] == mirror_posture.__version__
    assert project["dependencies"][0] == f"mirror-posture=={mirror_posture.__version__}"
    try:
        assert version("mirror-posture-lab") == mirror_posture.__version__
    except PackageNotFoundError:
        pytest.skip("run from the sources, not from installed wheels")
