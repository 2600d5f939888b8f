"""The version of this distribution is that of the workspace's Cargo.toml, and so is the mirror-posture that it asks for."""

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

CARGO = Path(__file__).resolve().parents[2] / "Cargo.toml"


class CustomMetadataHook(MetadataHookInterface):
    """Hatchling's hook: fills what pyproject.toml calls dynamic."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Reads `version` of `[workspace.package]`."""
        section = CARGO.read_text(encoding="utf-8").partition("[workspace.package]")[2]
        found = re.search(r'^version = "([^"]+)"', section, re.MULTILINE)
        if found is None:
            raise ValueError(f"{CARGO}: [workspace.package] has no version")
        metadata["version"] = found[1]
        metadata["dependencies"] = [f"mirror-posture=={found[1]}"]
