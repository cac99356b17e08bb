"""How many bytes a page loads, gzipped: before its points in 3D, and with all that it may show."""

import json
from typing import Any

from tests.e2e.conftest import WEB

MOST_BYTES, MOST_BYTES_WITH_VIEWER = 100_000, 300_000
ENTRY = "index.html"
Manifest = dict[str, dict[str, Any]]


def needed(manifest: Manifest, names: list[str], *, ever: bool) -> set[str]:
    """The files of some chunks, of what they import, and if ``ever`` of what they may load later."""
    seen: list[str] = [*names]
    for name in seen:
        chunk = manifest[name]
        later = chunk.get("dynamicImports", []) if ever and name != ENTRY else []
        seen += [other for other in (*chunk.get("imports", []), *later) if other not in seen]
    return {file for name in seen for file in (manifest[name]["file"], *manifest[name].get("css", []))}


def test_no_page_loads_too_much() -> None:
    manifest: Manifest = json.loads((WEB.parent / ".vite" / "manifest.json").read_text())
    pages = [name for name in manifest if name.startswith("src/pages/")]
    assert len(pages) > 8
    for page in pages:
        for most, ever in ((MOST_BYTES, False), (MOST_BYTES_WITH_VIEWER, True)):
            files = needed(manifest, [ENTRY, page], ever=ever) | {ENTRY, "icon.svg"}
            size = sum((WEB.parent / f"{name}.gz").stat().st_size for name in files)
            assert 40_000 < size <= most, (page, ever, size)
