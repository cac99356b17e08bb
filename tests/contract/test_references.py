"""Pages and comments name files that are there."""

import re
import subprocess
from pathlib import Path

from tests.support.places import ROOT

ROOMS = "apexcal|service|workers|frontend|tests|benchmarks|docs"
_NAMED = re.compile(rf"`((?:{ROOMS})/[\w./-]*\w)`")
_MADE = {"service/web", "workers/reports/report.html"}
"""What `make frontend` writes."""


def test_named_files_are_there():
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    files = [Path(name) for name in tracked.stdout.splitlines()]
    there = {str(path) for file in files for path in (file, *file.parents)} | _MADE
    dead = [
        f"{file}: {named}"
        for file in files
        if file.suffix in {".md", ".py", ".ts", ".svelte", ".toml", ".yml"}
        for named in _NAMED.findall((ROOT / file).read_text("utf-8"))
        if named not in there
    ]
    assert dead == []
