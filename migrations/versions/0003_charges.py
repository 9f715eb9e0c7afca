"""Charges of the hopper, their jobs and files, and uploaded meshes

Revision 0003. Reversible; downgrading loses what 0002 has no place for: charges with their jobs and files, and
geometries. The files themselves stay in the store.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from migrations.tables_0001 import ID, JSON, jobs_table, one_of
from migrations.tables_0003 import (
    OF_CHARGE,
    OPEN,
    OWNER,
    OWNER_OF_FILE,
    artifacts_table_0001,
    artifacts_table_0003,
    check_foreign_keys,
    create_open,
    jobs_table_0003,
)

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

JOB_KINDS = ("propose", "simulate", "recommend", "report")
JOB_KINDS_NOW = (*JOB_KINDS, "charge")
STATES = ("WAITING", "RUNNING", "COMPLETE", "FAILED", "CANCELLED")


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
    create_open()
    with op.batch_alter_table(
        "artifacts", copy_from=artifacts_table_0001(), table_kwargs={"sqlite_autoincrement": True}
    ) as artifacts:
        artifacts.add_column(sa.Column("charge_id", ID, nullable=True))
        artifacts.alter_column("design_id", existing_type=ID, nullable=True)
        artifacts.create_unique_constraint(op.f("uq_artifacts_charge_id"), ["charge_id", "kind"])
        artifacts.create_check_constraint(op.f("ck_artifacts_owner"), OWNER_OF_FILE)
        artifacts.create_foreign_key(
            op.f("fk_artifacts_charge_id_charges"), "charges", ["charge_id"], ["id"], ondelete="CASCADE"
        )
    check_foreign_keys()


def downgrade() -> None:
    op.execute("delete from runs where job_id in (select id from jobs where charge_id is not null)")
    op.execute("delete from jobs where charge_id is not null")
    op.execute("delete from artifacts where charge_id is not null")
    with op.batch_alter_table(
        "artifacts",
        copy_from=artifacts_table_0003(),
        table_kwargs={"sqlite_autoincrement": True},
    ) as artifacts:
        artifacts.drop_constraint(op.f("fk_artifacts_charge_id_charges"), type_="foreignkey")
        artifacts.drop_constraint(op.f("ck_artifacts_owner"), type_="check")
        artifacts.drop_constraint(op.f("uq_artifacts_charge_id"), type_="unique")
        artifacts.alter_column("design_id", existing_type=ID, nullable=False)
        artifacts.drop_column("charge_id")
    _drop_open()
    op.drop_index("uq_jobs_charge_id", table_name="jobs")
    with op.batch_alter_table("jobs", copy_from=jobs_table_0003()) as jobs:
        jobs.drop_constraint(op.f("fk_jobs_charge_id_charges"), type_="foreignkey")
        for name in ("owner", "charge", "kind"):
            jobs.drop_constraint(op.f(f"ck_jobs_{name}"), type_="check")
        jobs.create_check_constraint(op.f("ck_jobs_kind"), one_of("kind", JOB_KINDS))
        jobs.alter_column("study_id", existing_type=ID, nullable=False)
        jobs.drop_column("charge_id")
    create_open()
    op.drop_table("geometries")
    op.drop_table("charges")
    check_foreign_keys()


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
