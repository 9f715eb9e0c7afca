"""Charges of the hopper, their jobs and files, and uploaded meshes

Revision 0003. Reversible; downgrading loses what 0002 has no place for: charges with their jobs and files, and
geometries. The files themselves stay in the store.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from migrations.tables_0001 import ID, JSON, jobs_table, one_of

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

JOB_KINDS = ("propose", "simulate", "recommend", "report")
JOB_KINDS_NOW = (*JOB_KINDS, "charge")
STATES = ("WAITING", "RUNNING", "COMPLETE", "FAILED", "CANCELLED")
# Indexes with a condition, which SQLite does not take along when it makes the table anew.
OPEN = {
    "uq_jobs_open_design": ("design_id", "state in ('queued', 'running')"),
    "uq_jobs_open_study": (
        "study_id",
        "kind in ('propose', 'recommend') and state in ('queued', 'running')",
    ),
    "uq_jobs_open_report": ("study_id", "kind = 'report' and state in ('queued', 'running')"),
}
OF_CHARGE = "(kind = 'charge') = (charge_id is not null)"
OWNER = "(study_id is null) = (charge_id is not null)"
OWNER_OF_FILE = "(design_id is null) = (charge_id is not null)"


def upgrade() -> None:
    _create_tables()
    _drop_open()
    with op.batch_alter_table("jobs", copy_from=jobs_table(JOB_KINDS)) as jobs:
        jobs.add_column(sa.Column("charge_id", ID, nullable=True))
        jobs.alter_column("study_id", existing_type=ID, nullable=True)
        jobs.drop_constraint(op.f("ck_jobs_kind"), type_="check")
        jobs.create_check_constraint(op.f("ck_jobs_kind"), one_of("kind", JOB_KINDS_NOW))
        jobs.create_check_constraint(op.f("ck_jobs_charge"), OF_CHARGE)
        jobs.create_check_constraint(op.f("ck_jobs_owner"), OWNER)
        jobs.create_foreign_key(
            op.f("fk_jobs_charge_id_charges"), "charges", ["charge_id"], ["id"], ondelete="CASCADE"
        )
    op.create_index("uq_jobs_charge_id", "jobs", ["charge_id"], unique=True)
    _create_open()
    with op.batch_alter_table(
        "artifacts", copy_from=_artifacts_table(), table_kwargs={"sqlite_autoincrement": True}
    ) as artifacts:
        artifacts.add_column(sa.Column("charge_id", ID, nullable=True))
        artifacts.alter_column("design_id", existing_type=ID, nullable=True)
        artifacts.create_unique_constraint(op.f("uq_artifacts_charge_id"), ["charge_id", "kind"])
        artifacts.create_check_constraint(op.f("ck_artifacts_owner"), OWNER_OF_FILE)
        artifacts.create_foreign_key(
            op.f("fk_artifacts_charge_id_charges"), "charges", ["charge_id"], ["id"], ondelete="CASCADE"
        )
    _check_foreign_keys()


def downgrade() -> None:
    op.execute("delete from runs where job_id in (select id from jobs where charge_id is not null)")
    op.execute("delete from jobs where charge_id is not null")
    op.execute("delete from artifacts where charge_id is not null")
    with op.batch_alter_table(
        "artifacts",
        copy_from=_artifacts_table(with_charges=True),
        table_kwargs={"sqlite_autoincrement": True},
    ) as artifacts:
        artifacts.drop_constraint(op.f("fk_artifacts_charge_id_charges"), type_="foreignkey")
        artifacts.drop_constraint(op.f("ck_artifacts_owner"), type_="check")
        artifacts.drop_constraint(op.f("uq_artifacts_charge_id"), type_="unique")
        artifacts.alter_column("design_id", existing_type=ID, nullable=False)
        artifacts.drop_column("charge_id")
    _drop_open()
    op.drop_index("uq_jobs_charge_id", table_name="jobs")
    with op.batch_alter_table("jobs", copy_from=_jobs_table_now()) as jobs:
        jobs.drop_constraint(op.f("fk_jobs_charge_id_charges"), type_="foreignkey")
        for name in ("owner", "charge", "kind"):
            jobs.drop_constraint(op.f(f"ck_jobs_{name}"), type_="check")
        jobs.create_check_constraint(op.f("ck_jobs_kind"), one_of("kind", JOB_KINDS))
        jobs.alter_column("study_id", existing_type=ID, nullable=False)
        jobs.drop_column("charge_id")
    _create_open()
    op.drop_table("geometries")
    op.drop_table("charges")
    _check_foreign_keys()


def _create_tables() -> None:
    op.create_table(
        "charges",
        sa.Column("id", ID, nullable=False),
        sa.Column("series", sa.BigInteger(), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("charge", sa.String(length=64), nullable=False),
        sa.Column("scale", sa.Double(), nullable=False),
        sa.Column("seed", sa.BigInteger(), nullable=False),
        sa.Column("spec", JSON, nullable=False),
        sa.Column("cost", JSON, nullable=False),
        sa.Column("results", JSON, nullable=True),
        sa.Column("failure_class", sa.String(length=32), nullable=True),
        sa.Column("failure_text", sa.Text(), nullable=True),
        sa.Column("code_version", sa.String(length=64), nullable=True),
        sa.Column("idempotency_key", sa.String(length=200), nullable=True),
        sa.Column("request_hash", sa.String(length=64), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=True),
        sa.Column("ended_at", sa.Double(), nullable=True),
        sa.CheckConstraint(one_of("state", STATES), name=op.f("ck_charges_state")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_charges")),
        sa.UniqueConstraint("idempotency_key", name=op.f("uq_charges_idempotency_key")),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_charges_series", "charges", ["series"])
    op.create_table(
        "geometries",
        sa.Column("id", ID, nullable=False),
        sa.Column("file_name", sa.String(length=100), nullable=False),
        sa.Column("sha256", sa.String(length=64), nullable=False),
        sa.Column("size_bytes", sa.BigInteger(), nullable=False),
        sa.Column("triangles", sa.BigInteger(), nullable=False),
        sa.Column("extent", JSON, nullable=False),
        sa.Column("path", sa.String(length=200), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_geometries")),
        sa.UniqueConstraint("sha256", name=op.f("uq_geometries_sha256")),
        sqlite_autoincrement=True,
    )


def _drop_open() -> None:
    for name in OPEN:
        op.drop_index(name, table_name="jobs")


def _create_open() -> None:
    for name, (column, condition) in OPEN.items():
        where = sa.text(condition)
        op.create_index(name, "jobs", [column], unique=True, sqlite_where=where, postgresql_where=where)


def _jobs_table_now() -> sa.Table:
    """As `upgrade` leaves it, but for its indexes with a condition."""
    table = jobs_table(JOB_KINDS_NOW)
    table.append_column(sa.Column("charge_id", ID, nullable=True))
    table.c.study_id.nullable = True
    table.append_constraint(sa.CheckConstraint(OF_CHARGE, name="ck_jobs_charge"))
    table.append_constraint(sa.CheckConstraint(OWNER, name="ck_jobs_owner"))
    table.append_constraint(
        sa.ForeignKeyConstraint(
            ["charge_id"], ["charges.id"], name="fk_jobs_charge_id_charges", ondelete="CASCADE"
        )
    )
    return table


def _artifacts_table(with_charges: bool = False) -> sa.Table:
    """As revision 0001 left it, or as `upgrade` does."""
    table = sa.Table(
        "artifacts",
        sa.MetaData(),
        sa.Column("id", ID, nullable=False),
        sa.Column("design_id", ID, nullable=with_charges),
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
    if with_charges:
        table.append_column(sa.Column("charge_id", ID, nullable=True))
        table.append_constraint(sa.UniqueConstraint("charge_id", "kind", name="uq_artifacts_charge_id"))
        table.append_constraint(sa.CheckConstraint(OWNER_OF_FILE, name="ck_artifacts_owner"))
        table.append_constraint(
            sa.ForeignKeyConstraint(
                ["charge_id"], ["charges.id"], name="fk_artifacts_charge_id_charges", ondelete="CASCADE"
            )
        )
    return table


def _check_foreign_keys() -> None:
    connection = op.get_bind()
    if connection.dialect.name == "sqlite":
        broken = connection.exec_driver_sql("PRAGMA foreign_key_check").fetchall()
        if broken:
            raise RuntimeError(f"rows that refer to nothing: {broken[:5]}")
