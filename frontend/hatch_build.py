"""Build hook: puts the built pages and the built report into the wheel. An editable install has them where
``make frontend`` writes them."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CustomBuildHook(BuildHookInterface):
    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if version == "editable":
            return
        built = ("service/web/index.html", "workers/reports/report.html")
        if not all((Path(self.root) / name).exists() for name in built):
            subprocess.run(["make", "frontend"], cwd=self.root, check=True)
