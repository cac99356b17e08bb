"""Which databases a test runs on, where it shall not run on both always."""

import pytest

# What is refused before the database is asked is refused on both alike: on one always, on the other in the long form.
one_database = pytest.mark.parametrize(
    "database_url", ["sqlite", pytest.param("postgresql", marks=pytest.mark.slow)], indirect=True
)
