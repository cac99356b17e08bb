"""What a report holds, read as its page reads it."""

from __future__ import annotations

import base64
import gzip
import json
import re
from typing import Any


def data_of(text: str) -> dict[str, Any]:
    """The document within a report."""
    found = re.search(r'<script type="text/plain" id="data">(.*?)</script>', text, re.DOTALL)
    assert found
    return json.loads(gzip.decompress(base64.b64decode(found[1].strip(), validate=True)))
