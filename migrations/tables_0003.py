"""Tables as revision 0003 left them, for 0003's own way back and for later revisions; see tables_0001."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from migrations.tables_0001 import ID, jobs_table

JOB_KINDS = ("propose", "simulate", "recommend", "report", "charge")
OF_CHARGE = "(kind = 'charge') = (charge_id is not null)"
OWNER = "(study_id is null) = (charge_id is not null)"
OWNER_OF_FILE = "(design_id is null) = (charge_id is not null)"
# Indexes with a condition, which SQLite does not take along when it makes the table anew.
OPEN = {
    "uq_jobs_open_design": ("design_id", "state in ('queued', 'running')"),
    "uq_jobs_open_study": (
        "study_id",
        "kind in ('propose', 'recommend') and state in ('queued', 'running')",
    ),
    "uq_jobs_open_report": ("study_id", "kind = 'report' and state in ('queued', 'running')"),
}


def create_open() -> None:
    """The indexes with a condition."""
    for name, (column, condition) in OPEN.items():
        where = sa.text(condition)
        op.create_index(name, "jobs", [column], unique=True, sqlite_where=where, postgresql_where=where)


def jobs_table_0003(kinds: tuple[str, ...] = JOB_KINDS, owner: str = OWNER) -> sa.Table:
    """But for its indexes with a condition."""
    table = jobs_table(kinds)
    table.append_column(sa.Column("charge_id", ID, nullable=True))
    table.c.study_id.nullable = True
    table.append_constraint(sa.CheckConstraint(OF_CHARGE, name="ck_jobs_charge"))
    table.append_constraint(sa.CheckConstraint(owner, name="ck_jobs_owner"))
    table.append_constraint(
        sa.ForeignKeyConstraint(
            ["charge_id"], ["charges.id"], name="fk_jobs_charge_id_charges", ondelete="CASCADE"
        )
    )
    return table


def artifacts_table_0001(optional_design: bool = False) -> sa.Table:
    """As revision 0001 left it."""
    return sa.Table(
        "artifacts",
        sa.MetaData(),
        sa.Column("id", ID, nullable=False),
        sa.Column("design_id", ID, nullable=optional_design),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("file_name", sa.String(length=100), nullable=False),
        sa.Column("media_type", sa.String(length=100), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("size_bytes", sa.BigInteger(), nullable=False),
        sa.Column("path", sa.String(length=200), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.ForeignKeyConstraint(
            ["design_id"], ["designs.id"], name="fk_artifacts_design_id_designs", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_artifacts"),
        sa.UniqueConstraint("design_id", "kind", name="uq_artifacts_design_id"),
        sqlite_autoincrement=True,
    )


def artifacts_table_0003(owner: str = OWNER_OF_FILE) -> sa.Table:
    """With the files of charges."""
    table = artifacts_table_0001(optional_design=True)
    table.append_column(sa.Column("charge_id", ID, nullable=True))
    table.append_constraint(sa.UniqueConstraint("charge_id", "kind", name="uq_artifacts_charge_id"))
    table.append_constraint(sa.CheckConstraint(owner, name="ck_artifacts_owner"))
    table.append_constraint(
        sa.ForeignKeyConstraint(
            ["charge_id"], ["charges.id"], name="fk_artifacts_charge_id_charges", ondelete="CASCADE"
        )
    )
    return table


def check_foreign_keys() -> None:
    """SQLite does not, while it makes a table anew. Raises RuntimeError."""
    connection = op.get_bind()
    if connection.dialect.name == "sqlite":
        broken = connection.exec_driver_sql("PRAGMA foreign_key_check").fetchall()
        if broken:
            raise RuntimeError(f"rows that refer to nothing: {broken[:5]}")
