"""For the distributions beside mirror-posture: their version is that of the workspace's Cargo.toml, and so is the mirror-posture that they ask for."""

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

CARGO = Path(__file__).resolve().parents[1] / "Cargo.toml"


class CustomMetadataHook(MetadataHookInterface):
    """Hatchling's hook: fills what pyproject.toml calls dynamic."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Reads `version` of `[workspace.package]`; `requires` of the hook's own table lists what else is needed."""
        section = CARGO.read_text(encoding="utf-8").partition("[workspace.package]")[2]
        found = re.search(r'^version = "([^"]+)"', section, re.MULTILINE)
        if found is None:
            raise ValueError(f"{CARGO}: [workspace.package] has no version")
        metadata["version"] = found[1]
        metadata["dependencies"] = [f"mirror-posture=={found[1]}", *self.config.get("requires", ())]
