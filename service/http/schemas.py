"""What all request and answer bodies share."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

# No control characters: they break logs and headers, and PostgreSQL's text cannot hold a NUL.
Name = Annotated[
    str, StringConstraints(strip_whitespace=True, min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]+$")
]


# What is only looked for: a NUL is in no stored text, and PostgreSQL refuses it.
Sought = Annotated[str, StringConstraints(max_length=200, pattern=r"^[^\x00]*$")]
# Pixels, metres, radians, degrees and coefficients are all far below; a square of more may be infinite.
Magnitude = Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]


class Received(BaseModel):
    """A request's body: unknown fields are refused, so that a misspelt one is not silently ignored."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class Sent(BaseModel):
    """An answer's body, read from a row's attributes where it is given one."""

    model_config = ConfigDict(from_attributes=True)
