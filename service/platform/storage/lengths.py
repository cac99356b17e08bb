"""Presigned addresses that take a stated number of bytes: obstore's, signed again with the length.

Amazon's Signature Version 4, as query parameters ("Authenticating Requests: Using Query Parameters (AWS Signature
Version 4)" of the S3 API reference). A store refuses a body of another length than the signed one.
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Mapping
from urllib.parse import parse_qsl, quote, urlencode, urlsplit

_ALGORITHM = "AWS4-HMAC-SHA256"


def signed(address: str, headers: Mapping[str, str], access_key_id: str, secret_access_key: str) -> str:
    """A presigned PUT's address, signed again with these headers beside the host.

    ``headers``: names in lower case. It stays as it is where other keys signed it, such as those of a role.
    """
    parts = urlsplit(address)
    members = {name: value for name, value in parse_qsl(parts.query) if name != "X-Amz-Signature"}
    access_key, _, scope = members["X-Amz-Credential"].partition("/")
    if access_key != access_key_id:
        return address
    of_request = sorted([*headers.items(), ("host", parts.netloc)])
    members["X-Amz-SignedHeaders"] = names = ";".join(name for name, _ in of_request)
    query = urlencode(sorted(members.items()), quote_via=quote, safe="")
    lines = "".join(f"{name}:{value}\n" for name, value in of_request)
    request = "\n".join(["PUT", parts.path, query, lines, names, "UNSIGNED-PAYLOAD"])
    digest = hashlib.sha256(request.encode()).hexdigest()
    key = f"AWS4{secret_access_key}".encode()
    for step in (*scope.split("/"), "\n".join([_ALGORITHM, members["X-Amz-Date"], scope, digest])):
        key = hmac.digest(key, step.encode(), "sha256")
    return f"{parts.scheme}://{parts.netloc}{parts.path}?{query}&X-Amz-Signature={key.hex()}"
