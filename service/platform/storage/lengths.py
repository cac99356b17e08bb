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


def with_length(address: str, size: int, access_key_id: str, secret_access_key: str) -> str:
    """The same address, for a PUT of ``size`` bytes alone; as it is where other keys signed it, such as a role's."""
    members = dict(parse_qsl(urlsplit(address).query))
    if members["X-Amz-Credential"].partition("/")[0] != access_key_id:
        return address
    headers = {"content-length": str(size), "host": urlsplit(address).netloc}
    return signed(address, headers, secret_access_key)


def signed(address: str, headers: Mapping[str, str], secret_access_key: str) -> str:
    """A presigned PUT's address, signed again for these headers: names in lower case and in order."""
    parts = urlsplit(address)
    members = {name: value for name, value in parse_qsl(parts.query) if name != "X-Amz-Signature"}
    members["X-Amz-SignedHeaders"] = ";".join(headers)
    query = urlencode(sorted(members.items()), quote_via=quote, safe="")
    lines = "".join(f"{name}:{value}\n" for name, value in headers.items())
    request = "\n".join(["PUT", parts.path, query, lines, members["X-Amz-SignedHeaders"], "UNSIGNED-PAYLOAD"])
    scope = members["X-Amz-Credential"].partition("/")[2]
    digest = hashlib.sha256(request.encode()).hexdigest()
    key = f"AWS4{secret_access_key}".encode()
    for step in (*scope.split("/"), "\n".join([_ALGORITHM, members["X-Amz-Date"], scope, digest])):
        key = hmac.digest(key, step.encode(), "sha256")
    return f"{parts.scheme}://{parts.netloc}{parts.path}?{query}&X-Amz-Signature={key.hex()}"
