"""Measured data sets, diagnoses with their jobs and files, versions of the model, and stored runs

Revision 0004. Reversible; downgrading loses what 0003 has no place for: everything named above.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from migrations.tables_0001 import ID, JSON, one_of
from migrations.tables_0003 import (
    OPEN,
    artifacts_table_0003,
    check_foreign_keys,
    create_open,
    jobs_table_0003,
)

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

JOB_KINDS = ("propose", "simulate", "recommend", "report", "charge")
JOB_KINDS_NOW = (*JOB_KINDS, "diagnose")
STATES = ("WAITING", "RUNNING", "COMPLETE", "FAILED", "CANCELLED")
OF_DIAGNOSIS = "(kind = 'diagnose') = (diagnosis_id is not null)"
OWNER_BEFORE = "(study_id is null) = (charge_id is not null)"
OWNER = (
    "(case when study_id is null then 0 else 1 end) + (case when charge_id is null then 0 else 1 end)"
    " + (case when diagnosis_id is null then 0 else 1 end) = 1"
)
OWNER_OF_FILE_BEFORE = "(design_id is null) = (charge_id is not null)"
OWNER_OF_FILE = (
    "(case when design_id is null then 0 else 1 end) + (case when charge_id is null then 0 else 1 end)"
    " + (case when diagnosis_id is null then 0 else 1 end) = 1"
)


def upgrade() -> None:
    _create_tables()
    _drop_open()
    with op.batch_alter_table("jobs", copy_from=jobs_table_0003()) as jobs:
        jobs.add_column(sa.Column("diagnosis_id", ID, nullable=True))
        _replace_check(jobs, "kind", one_of("kind", JOB_KINDS_NOW))
        _replace_check(jobs, "owner", OWNER)
        jobs.create_check_constraint(op.f("ck_jobs_diagnosis"), OF_DIAGNOSIS)
        jobs.create_foreign_key(
            op.f("fk_jobs_diagnosis_id_diagnoses"), "diagnoses", ["diagnosis_id"], ["id"], ondelete="CASCADE"
        )
    op.create_index("uq_jobs_charge_id", "jobs", ["charge_id"], unique=True)
    op.create_index("uq_jobs_diagnosis_id", "jobs", ["diagnosis_id"], unique=True)
    create_open()
    with op.batch_alter_table(
        "artifacts", copy_from=artifacts_table_0003(), table_kwargs={"sqlite_autoincrement": True}
    ) as files:
        files.add_column(sa.Column("diagnosis_id", ID, nullable=True))
        files.create_unique_constraint(op.f("uq_artifacts_diagnosis_id"), ["diagnosis_id", "kind"])
        files.drop_constraint(op.f("ck_artifacts_owner"), type_="check")
        files.create_check_constraint(op.f("ck_artifacts_owner"), OWNER_OF_FILE)
        files.create_foreign_key(
            op.f("fk_artifacts_diagnosis_id_diagnoses"),
            "diagnoses",
            ["diagnosis_id"],
            ["id"],
            ondelete="CASCADE",
        )
    check_foreign_keys()


def downgrade() -> None:
    op.execute("delete from runs where job_id in (select id from jobs where diagnosis_id is not null)")
    op.execute("delete from jobs where diagnosis_id is not null")
    op.execute("delete from artifacts where diagnosis_id is not null")
    with op.batch_alter_table(
        "artifacts", copy_from=_artifacts_now(), table_kwargs={"sqlite_autoincrement": True}
    ) as files:
        files.drop_constraint(op.f("fk_artifacts_diagnosis_id_diagnoses"), type_="foreignkey")
        files.drop_constraint(op.f("ck_artifacts_owner"), type_="check")
        files.create_check_constraint(op.f("ck_artifacts_owner"), OWNER_OF_FILE_BEFORE)
        files.drop_constraint(op.f("uq_artifacts_diagnosis_id"), type_="unique")
        files.drop_column("diagnosis_id")
    _drop_open()
    op.drop_index("uq_jobs_diagnosis_id", table_name="jobs")
    with op.batch_alter_table("jobs", copy_from=_jobs_now()) as jobs:
        jobs.drop_constraint(op.f("fk_jobs_diagnosis_id_diagnoses"), type_="foreignkey")
        jobs.drop_constraint(op.f("ck_jobs_diagnosis"), type_="check")
        _replace_check(jobs, "owner", OWNER_BEFORE)
        _replace_check(jobs, "kind", one_of("kind", JOB_KINDS))
        jobs.drop_column("diagnosis_id")
    op.create_index("uq_jobs_charge_id", "jobs", ["charge_id"], unique=True)
    create_open()
    for table in ("model_versions", "diagnoses", "simulator_runs", "null_calibrations", "data_sets"):
        op.drop_table(table)
    check_foreign_keys()


def _drop_open() -> None:
    for name in (*OPEN, "uq_jobs_charge_id"):
        op.drop_index(name, table_name="jobs")


def _replace_check(table: object, name: str, condition: str) -> None:
    """Of the jobs: a constraint keeps its name."""
    table.drop_constraint(op.f(f"ck_jobs_{name}"), type_="check")  # type: ignore[attr-defined]
    table.create_check_constraint(op.f(f"ck_jobs_{name}"), condition)  # type: ignore[attr-defined]


def _create_tables() -> None:
    op.create_table(
        "data_sets",
        sa.Column("id", ID, nullable=False),
        sa.Column("name", sa.String(length=100), nullable=False),
        sa.Column("split_hash", sa.String(length=64), nullable=False),
        sa.Column("content", JSON, nullable=False),
        sa.Column("facts", JSON, nullable=False),
        sa.Column("opened_by", sa.BigInteger(), nullable=True),
        sa.Column("opened_at", sa.Double(), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_data_sets")),
        sa.UniqueConstraint("split_hash", name=op.f("uq_data_sets_split_hash")),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "diagnoses",
        sa.Column("id", ID, nullable=False),
        sa.Column("data_set_id", ID, nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("spec", JSON, nullable=False),
        sa.Column("cost", JSON, nullable=False),
        sa.Column("verdict", sa.String(length=32), nullable=True),
        sa.Column("results", JSON, nullable=True),
        sa.Column("failure_class", sa.String(length=32), nullable=True),
        sa.Column("failure_text", sa.Text(), nullable=True),
        sa.Column("code_version", sa.String(length=64), nullable=True),
        sa.Column("idempotency_key", sa.String(length=200), nullable=True),
        sa.Column("request_hash", sa.String(length=64), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=True),
        sa.Column("ended_at", sa.Double(), nullable=True),
        sa.CheckConstraint(one_of("state", STATES), name=op.f("ck_diagnoses_state")),
        sa.ForeignKeyConstraint(
            ["data_set_id"],
            ["data_sets.id"],
            name=op.f("fk_diagnoses_data_set_id_data_sets"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_diagnoses")),
        sa.UniqueConstraint("idempotency_key", name=op.f("uq_diagnoses_idempotency_key")),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_diagnoses_data_set_id", "diagnoses", ["data_set_id"])
    op.create_table(
        "model_versions",
        sa.Column("id", ID, nullable=False),
        sa.Column("name", sa.String(length=100), nullable=False),
        sa.Column("parent_id", ID, nullable=True),
        sa.Column("diagnosis_id", ID, nullable=False),
        sa.Column("base", sa.String(length=100), nullable=False),
        sa.Column("effects", JSON, nullable=False),
        sa.Column("withdrawn_at", sa.Double(), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.ForeignKeyConstraint(
            ["parent_id"], ["model_versions.id"], name=op.f("fk_model_versions_parent_id_model_versions")
        ),
        sa.ForeignKeyConstraint(
            ["diagnosis_id"],
            ["diagnoses.id"],
            name=op.f("fk_model_versions_diagnosis_id_diagnoses"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_model_versions")),
        sa.UniqueConstraint("name", name=op.f("uq_model_versions_name")),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_model_versions_diagnosis_id", "model_versions", ["diagnosis_id"])
    op.create_table(
        "simulator_runs",
        sa.Column("key", sa.String(length=64), nullable=False),
        sa.Column("reading", JSON, nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("key", name=op.f("pk_simulator_runs")),
    )
    op.create_table(
        "null_calibrations",
        sa.Column("key", sa.String(length=200), nullable=False),
        sa.Column("content", JSON, nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("key", name=op.f("pk_null_calibrations")),
    )


def _jobs_now() -> sa.Table:
    """As `upgrade` leaves it, but for its indexes with a condition."""
    table = jobs_table_0003(JOB_KINDS_NOW, OWNER)
    table.append_column(sa.Column("diagnosis_id", ID, nullable=True))
    table.append_constraint(sa.CheckConstraint(OF_DIAGNOSIS, name="ck_jobs_diagnosis"))
    table.append_constraint(
        sa.ForeignKeyConstraint(
            ["diagnosis_id"], ["diagnoses.id"], name="fk_jobs_diagnosis_id_diagnoses", ondelete="CASCADE"
        )
    )
    return table


def _artifacts_now() -> sa.Table:
    table = artifacts_table_0003(OWNER_OF_FILE)
    table.append_column(sa.Column("diagnosis_id", ID, nullable=True))
    table.append_constraint(sa.UniqueConstraint("diagnosis_id", "kind", name="uq_artifacts_diagnosis_id"))
    table.append_constraint(
        sa.ForeignKeyConstraint(
            ["diagnosis_id"],
            ["diagnoses.id"],
            name="fk_artifacts_diagnosis_id_diagnoses",
            ondelete="CASCADE",
        )
    )
    return table
