"""Build hook: puts the built pages into the wheel. An editable install serves them from ``service/web`` as well,
where ``make frontend`` writes them."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CustomBuildHook(BuildHookInterface):
    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if version == "editable":
            return
        pages = Path(self.root) / "service" / "web" / "index.html"
        if not pages.exists():
            subprocess.run(["make", "frontend"], cwd=self.root, check=True)
