"""Alembic's environment. The connection comes from ``service.db.migrate``, or the URL from the settings."""

from alembic import context
from sqlalchemy import text

from service.db.clock import Instant
from service.db.models import Base
from service.db.session import open_engine
from service.settings import get_settings

# Any number: two services that start at once migrate one after the other.
_LOCK = 4_711_001


def render_item(kind, item, autogen_context):
    if kind == "type" and isinstance(item, Instant):
        return "sa.BigInteger()"
    return False


def run(connection):
    context.configure(
        connection=connection,
        target_metadata=Base.metadata,
        render_as_batch=True,
        render_item=render_item,
    )
    with context.begin_transaction():
        if connection.dialect.name == "postgresql":
            connection.execute(text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _LOCK})
        context.run_migrations()


connection = context.config.attributes.get("connection")
if connection is not None:
    run(connection)
else:
    engine = open_engine(context.config.attributes.get("url") or get_settings().database)
    with engine.execution_options(apexcal_writes=True).begin() as connection:
        run(connection)
    engine.dispose()
