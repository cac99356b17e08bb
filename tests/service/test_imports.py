"""What a process imports costs processor time at its every start."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("module", "never"),
    [
        ("service.app", {"alembic", "mako", "numba", "numpy", "scipy", "cv2", "celery", "rich"}),
        ("workers.app", {"sqlalchemy", "fastapi", "redis", "numpy", "numba"}),
        ("workers.tasks.entry", {"fastapi", "alembic", "cv2", "scipy"}),
        ("service.prepare", {"alembic", "celery", "numpy"}),
        ("apexcal.cli", {"httpx", "pydantic", "numpy", "sqlalchemy", "workers", "rich.progress"}),
    ],
)
def test_what_is_not_needed_to_start_is_not_imported(module: str, never: set[str]) -> None:
    loads = f"import sys, {module}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", loads], capture_output=True, text=True, check=True)
    assert not never & set(done.stdout.split())
