"""Columns of foreign keys, in the words of ``service/db/base.py``."""

import sqlalchemy as sa


def belongs_to(name, target, *, nullable=False, index=True, **options):
    """A foreign key whose rows go when the row that they belong to goes."""
    key = sa.ForeignKey(target, ondelete="CASCADE")
    return sa.Column(name, sa.Uuid(), key, nullable=nullable, index=index, **options)


def refers_to(name, target):
    """A nullable foreign key that is emptied when its target goes."""
    return sa.Column(name, sa.Uuid(), sa.ForeignKey(target, ondelete="SET NULL"), nullable=True, index=True)
