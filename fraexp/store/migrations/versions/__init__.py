"""One file per revision, which stands on nothing but Alembic: the tables of today change."""
