"""The ends of a computation: refused before it starts, stopped from outside, or as a minimisation may end."""

from enum import Enum
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from apexcal.documents.errors import InputError


class Outcome(Enum):
    """The end of a minimisation; `sentence` says it to people."""

    CONVERGED = "converged"
    NO_STEP_LEFT = "no_step_left"
    NOTHING_FREE = "nothing_free"
    OUT_OF_STEPS = "out_of_steps"

    @property
    def sentence(self) -> str:
        """The outcome in one sentence."""
        return _SENTENCES[self]

    @property
    def converged(self) -> bool:
        """Whether the end is a minimum, so that its parameters may be used."""
        return self is not Outcome.OUT_OF_STEPS


_SENTENCES = {
    Outcome.CONVERGED: "The last step changed the loss by less than the tolerance.",
    Outcome.NO_STEP_LEFT: "No step lowers the loss.",
    Outcome.NOTHING_FREE: "No parameter is free.",
    Outcome.OUT_OF_STEPS: "The steps ran out before a minimum was reached.",
}


class SolveError(InputError):
    """A request or data that cannot be fitted; carries `code`, `message` and `hint`.

    Codes: too_few_pairs, non_finite, bad_shape, bounds_inside_out, unknown_parameter, unknown_bounds_preset,
    bad_schedule, bad_prior, bad_folds, bad_document, bad_covariances,
    no_covariances, and those of GeometryError
    (unknown_model, unknown_search_form, bad_transform, ...).
    """


class Stop(Protocol):
    """Whoever may end a computation from another thread; a worker's lease is one."""

    @property
    def flag(self) -> bytearray:
        """One byte, 0 while the computation is wanted. Kernels look at it; `check` raises where it is set."""
        ...

    def check(self) -> None:
        """Raise where the computation must end."""
        ...


class _Never:
    def __init__(self) -> None:
        self.flag = bytearray(1)

    def check(self) -> None: ...


NEVER: Final[Stop] = _Never()
"""Nobody ends the computation."""


def flag_of(stop: Stop) -> NDArray[np.uint8]:
    """The flag (1,) for a kernel: the same byte, not a copy."""
    return np.frombuffer(stop.flag, dtype=np.uint8)
