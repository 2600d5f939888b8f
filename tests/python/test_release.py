"""One version in all files that name it; workflows that build what is published."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

PROJECT = Path(__file__).resolve().parents[2]
WORKSPACE = tomllib.loads((PROJECT / "Cargo.toml").read_text(encoding="utf-8"))["workspace"]["package"]
VERSION = WORKSPACE["version"]


def test_one_version() -> None:
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["dynamic"] == ["version"], "it comes from Cargo.toml"
    asked = {d for extra in project["optional-dependencies"].values() for d in extra}
    for package in ("mirror_lab", "mirror_simulation"):
        file = PROJECT / "python" / package / "pyproject.toml"
        other = tomllib.loads(file.read_text(encoding="utf-8"))["project"]
        assert {"version", "dependencies"} <= set(other["dynamic"]), "hatch_build.py: both from Cargo.toml"
        pinned = {d for d in asked if d.startswith(other["name"])}
        assert pinned == {other["name"]}, "it asks for its own version of mirror-posture"
    for crate in (PROJECT / "crates").glob("*/Cargo.toml"):
        assert tomllib.loads(crate.read_text(encoding="utf-8"))["package"]["version"] == {"workspace": True}
    lock = (PROJECT / "Cargo.lock").read_text(encoding="utf-8")
    assert set(re.findall(r'name = "mirror-(?:core|py)"\nversion = "([^"]+)"', lock)) == {VERSION}


def test_the_changelog_begins_with_what_is_not_released() -> None:
    text = (PROJECT / "CHANGELOG.md").read_text(encoding="utf-8")
    heads = re.findall(r"^## (.+)$", text, re.MULTILINE)
    assert heads[0] == "Unreleased" and all(re.match(r"\d+\.\d+\.\d+", head) for head in heads[1:])
    kinds = re.findall(r"^### (.+)$", text, re.MULTILINE)
    assert set(kinds) <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert "<<<<<<<" not in text and ">>>>>>>" not in text


def test_the_workflows_are_of_this_project() -> None:
    found = {
        file.stem: yaml.safe_load(file.read_text(encoding="utf-8"))
        for file in (PROJECT / ".github" / "workflows").glob("*.yml")
    }
    assert set(found) >= {"tests", "wheels", "crate"}
    names = {
        entry["name"].partition("-")[0]
        for entry in found["wheels"]["jobs"]["wheels"]["strategy"]["matrix"]["include"]
    }
    assert names == {"manylinux", "musllinux", "macos", "windows"}
    makefile = (PROJECT / "Makefile").read_text(encoding="utf-8")
    for workflow in found.values():
        for job in workflow["jobs"].values():
            for step in job["steps"]:
                run = step.get("run", "")
                for target in re.findall(r"\bmake ([a-z-]+)", run):
                    assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"make {target}"
                for path in re.findall(r"tests/python/\S+\.py", run):
                    assert (PROJECT / path).is_file(), path
    versions = {
        s["uses"]
        for w in found.values()
        for j in w["jobs"].values()
        for s in j["steps"]
        if "rust-toolchain" in s.get("uses", "")
    }
    assert versions == {f"dtolnay/rust-toolchain@{WORKSPACE['rust-version']}"}


@pytest.mark.skipif(shutil.which("cargo") is None, reason="cargo is not installed")
def test_the_wheel_and_the_core_s_tests_share_one_build() -> None:
    """A feature that the tests alone bring to a crate below the core compiles the core, and that crate, once more for the wheel."""

    def crates(*packages: str) -> set[str]:
        command = ["cargo", "tree", "--locked", "--offline", "--prefix", "none", "-f", "{p} [{f}]", *packages]
        done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False)
        if done.returncode:
            pytest.skip(f"cargo cannot list the crates: {done.stderr[:200]}")
        return {line.removesuffix(" (*)") for line in done.stdout.splitlines()}

    wheel = crates("-p", "mirror-py", "-e", "normal")
    tests = crates("-p", "mirror-core", "-p", "mirror-py", "-e", "normal,dev")
    assert len(wheel) > 50 and sorted(wheel - tests) == []
