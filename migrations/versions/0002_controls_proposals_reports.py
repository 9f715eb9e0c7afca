"""Paused studies, proposals, surrogates, reports, changes of budget, and studies that were read in

Revision 0002. Reversible; downgrading loses what 0001 has no place for: reports and their jobs, changes of
budget, the proposals that ended a study. A paused study runs again, and an error that was repeated by hand
counts as cancelled.

SQLite changes a table by making a new one; env.py turns foreign keys off meanwhile, since dropping the old table
would delete what refers to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sqlalchemy as sa
from alembic import op

from migrations.tables_0001 import ID, JSON, designs_table, jobs_table, one_of, studies_table

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

KEY = ["study_id", "x_hash", "scale", "seed"]

AUTOINCREMENT: Mapping[str, Any] = {"sqlite_autoincrement": True}

STUDY_STATES = ("running", "finishing", "cancelling", "completed", "cancelled", "failed")
STUDY_STATES_NOW = ("running", "paused", "finishing", "cancelling", "completed", "cancelled", "failed")
JOB_KINDS = ("propose", "simulate", "recommend")
JOB_KINDS_NOW = (*JOB_KINDS, "report")

# Where 0001 kept what an observable is called now.
OBSERVABLES: Mapping[str, str] = {
    "mass_on_base_kg": "mass_on_base_kg",
    "discharge_t90_s": "discharge_t90_s",
    "heap_height_m": "apex_height_m",
    "fill_height_m": "fill_height_m",
}


def upgrade() -> None:
    _create_tables()
    _change_studies(STUDY_STATES, STUDY_STATES_NOW)
    _upgrade_jobs()
    _upgrade_designs()
    _check_foreign_keys()


def downgrade() -> None:
    op.execute("update studies set state = 'running' where state = 'paused'")
    op.execute("delete from jobs where kind = 'report'")
    _downgrade_designs()
    _downgrade_jobs()
    _change_studies(STUDY_STATES_NOW, STUDY_STATES)
    for table in ("proposals", "surrogates", "reports", "budget_changes"):
        op.drop_table(table)
    _check_foreign_keys()


def _create_tables() -> None:
    op.create_table(
        "surrogates",
        *_numbered("surrogates"),
        sa.Column("training_hash", sa.String(length=64), nullable=False),
        sa.Column("hyperparameters", JSON, nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.UniqueConstraint("study_id", "training_hash", name=op.f("uq_surrogates_study_id")),
        sqlite_autoincrement=True,
    )
    op.create_table(
        "proposals",
        *_numbered("proposals"),
        sa.Column("surrogate_id", ID, nullable=True),
        sa.Column("number", sa.BigInteger(), nullable=False),
        sa.Column("chosen", sa.BigInteger(), nullable=True),
        sa.Column("basis", sa.BigInteger(), nullable=False),
        sa.Column("pending", sa.BigInteger(), nullable=False),
        sa.Column("seed", sa.BigInteger(), nullable=False),
        sa.Column("strategy", sa.String(length=32), nullable=False),
        sa.Column("acquisition", sa.Double(), nullable=True),
        sa.Column("training_hash", sa.String(length=64), nullable=True),
        sa.Column("stop_reason", sa.String(length=32), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.ForeignKeyConstraint(
            ["surrogate_id"],
            ["surrogates.id"],
            name=op.f("fk_proposals_surrogate_id_surrogates"),
            ondelete="CASCADE",
        ),
        sa.UniqueConstraint("study_id", "chosen", name=op.f("uq_proposals_study_id")),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_proposals_surrogate_id", "proposals", ["surrogate_id"])
    op.create_table(
        "reports",
        *_numbered("reports"),
        sa.Column("designs", sa.BigInteger(), nullable=False),
        sa.Column("code_version", sa.String(length=64), nullable=True),
        sa.Column("content", JSON, nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_reports_study_id_id", "reports", ["study_id", "id"])
    op.create_table(
        "budget_changes",
        *_numbered("budget_changes"),
        sa.Column("number", sa.BigInteger(), nullable=False),
        sa.Column("before", sa.BigInteger(), nullable=False),
        sa.Column("after", sa.BigInteger(), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_budget_changes_study_id_id", "budget_changes", ["study_id", "id"])


def _numbered(table: str) -> list[Any]:
    """Key and study of a table whose rows belong to a study."""
    return [
        sa.Column("id", ID, nullable=False),
        sa.Column("study_id", ID, nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f(f"pk_{table}")),
        sa.ForeignKeyConstraint(
            ["study_id"], ["studies.id"], name=op.f(f"fk_{table}_study_id_studies"), ondelete="CASCADE"
        ),
    ]


def _change_studies(before: tuple[str, ...], after: tuple[str, ...]) -> None:
    is_upgrade = after == STUDY_STATES_NOW
    table = studies_table(before, [] if is_upgrade else _new_study_columns())
    with op.batch_alter_table("studies", copy_from=table, table_kwargs=AUTOINCREMENT) as studies:
        studies.drop_constraint(op.f("ck_studies_state"), type_="check")
        studies.create_check_constraint(op.f("ck_studies_state"), one_of("state", after))
        if is_upgrade:
            for column in _new_study_columns():
                studies.add_column(column)
            studies.create_unique_constraint(op.f("uq_studies_import_hash"), ["import_hash"])
        else:
            studies.drop_constraint(op.f("uq_studies_import_hash"), type_="unique")
            for column in _new_study_columns():
                studies.drop_column(column.name)


def _new_study_columns() -> list[sa.Column[Any]]:
    return [
        sa.Column("pause_reason", sa.String(length=32), nullable=True),
        sa.Column("pause_text", sa.Text(), nullable=True),
        sa.Column("pause_numbers", JSON, nullable=True),
        sa.Column("failures_forgiven", sa.BigInteger(), nullable=False, server_default="0"),
        sa.Column("import_hash", sa.String(length=64), nullable=True),
    ]


def _upgrade_jobs() -> None:
    op.drop_index("uq_jobs_open_study", table_name="jobs")
    op.drop_index("uq_jobs_open_design", table_name="jobs")
    _change_kinds(JOB_KINDS, JOB_KINDS_NOW)
    _index_open("uq_jobs_open_design", "design_id", "state in ('queued', 'running')")
    _index_open(
        "uq_jobs_open_study",
        "study_id",
        "kind in ('propose', 'recommend') and state in ('queued', 'running')",
    )
    _index_open("uq_jobs_open_report", "study_id", "kind = 'report' and state in ('queued', 'running')")


def _downgrade_jobs() -> None:
    for name in ("uq_jobs_open_report", "uq_jobs_open_study", "uq_jobs_open_design"):
        op.drop_index(name, table_name="jobs")
    _change_kinds(JOB_KINDS_NOW, JOB_KINDS)
    _index_open("uq_jobs_open_design", "design_id", "state in ('queued', 'running')")
    _index_open("uq_jobs_open_study", "study_id", "kind <> 'simulate' and state in ('queued', 'running')")


def _change_kinds(before: tuple[str, ...], after: tuple[str, ...]) -> None:
    with op.batch_alter_table("jobs", copy_from=jobs_table(before)) as jobs:
        jobs.drop_constraint(op.f("ck_jobs_kind"), type_="check")
        jobs.create_check_constraint(op.f("ck_jobs_kind"), one_of("kind", after))


def _index_open(name: str, column: str, condition: str) -> None:
    where = sa.text(condition)
    op.create_index(name, "jobs", [column], unique=True, sqlite_where=where, postgresql_where=where)


def _upgrade_designs() -> None:
    op.drop_index("uq_designs_key", table_name="designs")
    with op.batch_alter_table(
        "designs", copy_from=designs_table(_old_design_columns()), table_kwargs=AUTOINCREMENT
    ) as designs:
        for column in _new_design_columns():
            designs.add_column(column)
        designs.create_unique_constraint(op.f("uq_designs_idempotency_key"), ["study_id", "idempotency_key"])
    _fill_responses()
    _move_surrogates_out()
    _index_key("state not in ('CANCELLED', 'FAILED')")


def _downgrade_designs() -> None:
    op.drop_index("uq_designs_key", table_name="designs")
    op.execute(
        "update designs set state = 'CANCELLED', verdict = null where state = 'FAILED' and exists (select 1 from "
        "designs as again where again.study_id = designs.study_id and again.supersedes = designs.number)"
    )
    with op.batch_alter_table(
        "designs", copy_from=designs_table(_new_design_columns()), table_kwargs=AUTOINCREMENT
    ) as designs:
        designs.drop_constraint(op.f("uq_designs_idempotency_key"), type_="unique")
        for column in _new_design_columns():
            designs.drop_column(column.name)
        for column in _old_design_columns():
            designs.add_column(column)
    op.execute(
        "update designs set training_hash = (select training_hash from proposals where proposals.study_id = "
        "designs.study_id and proposals.chosen = designs.number), hyperparameters = (select hyperparameters from "
        "surrogates join proposals on proposals.surrogate_id = surrogates.id where proposals.study_id = "
        "designs.study_id and proposals.chosen = designs.number)"
    )
    _index_key("state <> 'CANCELLED'")


def _index_key(condition: str) -> None:
    where = sa.text(condition)
    op.create_index("uq_designs_key", "designs", KEY, unique=True, sqlite_where=where, postgresql_where=where)


def _fill_responses() -> None:
    """What was measured, by observable, from where 0001 kept it."""
    connection = op.get_bind()
    designs = sa.table(
        "designs",
        sa.column("id"),
        sa.column("angle_deg"),
        sa.column("literal_angle_deg"),
        sa.column("results", JSON),
        sa.column("responses", JSON),
    )
    measured = sa.select(designs).where(designs.c.angle_deg.is_not(None)).order_by(designs.c.id)
    for row in connection.execute(measured).all():
        results = row.results or {}
        found = {name: results.get(place) for name, place in OBSERVABLES.items()}
        found |= {"angle_deg": row.angle_deg, "literal_angle_deg": row.literal_angle_deg}
        responses = {name: value for name, value in sorted(found.items()) if value is not None}
        connection.execute(designs.update().where(designs.c.id == row.id).values(responses=responses))


def _move_surrogates_out() -> None:
    """The optimizer's side of each design becomes a proposal and, where a model was fitted, a surrogate."""
    connection = op.get_bind()
    studies = {row.id: row for row in connection.execute(sa.text("select id, seed from studies"))}
    parallel = _parallel(connection)
    old = sa.table(
        "designs",
        *(
            sa.column(name)
            for name in ("id", "study_id", "number", "training_hash", "acquisition", "created_at")
        ),
        sa.column("hyperparameters", JSON),
    )
    surrogates = sa.table(
        "surrogates",
        *(sa.column(name) for name in ("id", "study_id", "training_hash", "created_at")),
        sa.column("hyperparameters", JSON),
    )
    names = (
        "study_id",
        "surrogate_id",
        "number",
        "chosen",
        "basis",
        "pending",
        "seed",
        "strategy",
        "acquisition",
    )
    proposals = sa.table("proposals", *(sa.column(n) for n in (*names, "training_hash", "created_at")))
    known: dict[tuple[int, str], int] = {}
    for row in connection.execute(sa.select(old).order_by(old.c.study_id, old.c.number)).all():
        key = (row.study_id, row.training_hash)
        if row.hyperparameters is not None and row.training_hash is not None and key not in known:
            values = {
                "study_id": row.study_id,
                "training_hash": row.training_hash,
                "created_at": row.created_at,
            }
            insert = surrogates.insert().values(**values, hyperparameters=row.hyperparameters)
            connection.execute(insert)
            same = (surrogates.c.study_id == key[0]) & (surrogates.c.training_hash == key[1])
            known[key] = connection.execute(sa.select(surrogates.c.id).where(same)).scalar_one()
        basis = max(0, row.number - parallel[row.study_id])
        connection.execute(
            proposals.insert().values(
                study_id=row.study_id,
                surrogate_id=known.get(key) if row.hyperparameters is not None else None,
                number=row.number,
                chosen=row.number,
                basis=basis,
                pending=row.number - 1 - basis,
                seed=studies[row.study_id].seed,
                strategy="auto",
                acquisition=row.acquisition,
                training_hash=row.training_hash,
                created_at=row.created_at,
            )
        )
    with op.batch_alter_table(
        "designs",
        copy_from=designs_table(_old_design_columns() + _new_design_columns()),
        table_kwargs=AUTOINCREMENT,
    ) as designs:
        designs.drop_column("training_hash")
        designs.drop_column("hyperparameters")


def _parallel(connection: sa.Connection) -> dict[int, int]:
    specs = sa.table("studies", sa.column("id"), sa.column("spec", JSON))
    return {row.id: int(row.spec["parallel"]) for row in connection.execute(sa.select(specs))}


def _check_foreign_keys() -> None:
    connection = op.get_bind()
    if connection.dialect.name == "sqlite":
        broken = connection.exec_driver_sql("PRAGMA foreign_key_check").fetchall()
        if broken:
            raise RuntimeError(f"rows that refer to nothing: {broken[:5]}")


def _new_design_columns() -> list[sa.Column[Any]]:
    return [
        sa.Column("responses", JSON, nullable=True),
        sa.Column("supersedes", sa.BigInteger(), nullable=True),
        sa.Column("idempotency_key", sa.String(length=200), nullable=True),
    ]


def _old_design_columns() -> list[sa.Column[Any]]:
    return [
        sa.Column("training_hash", sa.String(length=64), nullable=True),
        sa.Column("hyperparameters", JSON, nullable=True),
    ]
