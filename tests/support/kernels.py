"""`python -m tests.support.kernels`: compile once what processes of tests would each compile at the same time.

Numba keeps the machine code beside the source.
"""

import tempfile
from pathlib import Path

from workers.simulation.__main__ import main as simulate
from workers.tasks.warming import warm_up


def compile_kernels() -> None:
    """Those of the workers, and those of a simulated walk."""
    warm_up()
    with tempfile.TemporaryDirectory() as folder:
        assert simulate(["--out", str(Path(folder) / "walk"), "--seconds", "1"]) == 0


if __name__ == "__main__":
    compile_kernels()
