"""Alembic's environment. ``service.platform.db.migrate`` gives the connection, the lock and the transaction."""

from alembic import context

from service.platform.db.base import Finite
from service.platform.db.clock import Instant
from service.platform.db.models import Base


def render_item(kind, item, autogen_context):
    if kind == "type" and isinstance(item, Instant):
        return "sa.BigInteger()"
    if kind == "type" and isinstance(item, Finite):
        return "sa.Double()"
    return False


def run(connection):
    context.configure(
        connection=connection,
        target_metadata=Base.metadata,
        render_as_batch=True,
        render_item=render_item,
    )
    with context.begin_transaction():
        context.run_migrations()


run(context.config.attributes["connection"])
