"""How a long computation is ended from outside: it checks often whether it must stop."""

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray


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
