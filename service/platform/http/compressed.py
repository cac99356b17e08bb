"""Long answers in few bytes."""

from __future__ import annotations

import gzip

from fastapi import Request, Response
from pydantic import BaseModel


def compressed(request: Request, document: BaseModel) -> Response:
    """A document as JSON, by gzip where the client takes it. The quickest level: lists shrink to a fifth by it."""
    body, headers = document.model_dump_json().encode(), {"Vary": "Accept-Encoding"}
    if "gzip" in request.headers.get("accept-encoding", ""):
        body, headers["Content-Encoding"] = gzip.compress(body, 1), "gzip"
    return Response(body, media_type="application/json", headers=headers)
