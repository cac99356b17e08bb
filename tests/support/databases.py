"""Which databases a test runs on, where it shall not run on both always."""

import pytest

# What ends before the database is asked, or asks for nothing special: on one always, on the other in the long form.
one_database = pytest.mark.parametrize(
    "database_url", ["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)], indirect=True
)
