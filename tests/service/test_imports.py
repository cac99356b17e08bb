"""What a process imports costs processor time at its every start."""

import subprocess
import sys

import pytest

_LOADED = "import sys, {0}; print(*sys.modules)"


# One after the other in one process: what one must not import, those before it must not import either.
@pytest.mark.parametrize(
    "never",
    [
        {
            "service.app": {"alembic", "mako", "numba", "numpy", "scipy", "cv2", "celery", "redis", "rich"},
            "service.prepare": {"alembic", "celery", "numpy"},
        },
        {
            "apexcal.cli": {"httpx", "pydantic", "numpy", "sqlalchemy", "workers", "rich.progress"},
            "workers.app": {"sqlalchemy", "fastapi", "redis", "numpy", "numba"},
            "workers.tasks.entry": {"fastapi", "alembic", "cv2", "scipy"},
            "workers.tasks.solving": {"fastapi", "cv2", "scipy.linalg", "scipy.optimize"},
        },
    ],
    ids=lambda never: "-".join(never),
)
def test_what_is_not_needed_to_start_is_not_imported(never: dict[str, set[str]]) -> None:
    loads = "\n".join(map(_LOADED.format, never))
    done = subprocess.run([sys.executable, "-c", loads], capture_output=True, text=True, check=True)
    loaded = dict(zip(never, map(str.split, done.stdout.splitlines()), strict=True))
    assert {name: never[name] & set(loaded[name]) for name in never} == {name: set() for name in never}
