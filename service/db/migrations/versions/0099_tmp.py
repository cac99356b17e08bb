"""tmp"""

from alembic import op

revision = "0099"
down_revision = "0022"


def upgrade() -> None:
    from service.db.models import Base

    for name in ("withdrawal", "alias_move", "publication"):
        op.drop_table(name)
    Base.metadata.tables["publication"].create(op.get_bind())


def downgrade() -> None:
    raise NotImplementedError
