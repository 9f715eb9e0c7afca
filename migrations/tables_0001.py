"""Tables as revision 0001 left them, for later revisions that change them on SQLite.

SQLite changes a table by making a new one, and reflects neither CHECK constraints nor the conditions of indexes:
Alembic must be told the whole table. Columns that a revision adds or takes away are passed in.
"""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

# SQLite only numbers rows by itself in a column of type INTEGER.
ID = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
JSON = sa.JSON(none_as_null=True)


def one_of(column: str, values: tuple[str, ...]) -> str:
    return f"{column} IN ({', '.join(repr(value) for value in values)})"


def studies_table(states: tuple[str, ...], new: list[sa.Column[Any]]) -> sa.Table:
    constraints = [sa.UniqueConstraint("import_hash", name="uq_studies_import_hash")] if new else []
    return sa.Table(
        "studies",
        sa.MetaData(),
        sa.Column("id", ID, nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("material", sa.String(length=64), nullable=False),
        sa.Column("spec", JSON, nullable=False),
        sa.Column("space_hash", sa.String(length=64), nullable=False),
        *(
            sa.Column(name, sa.BigInteger(), nullable=False)
            for name in ("seed", "budget", "feasible", "unfeasible", "error")
        ),
        sa.Column("stop_reason", sa.String(length=32), nullable=True),
        sa.Column("stop_text", sa.Text(), nullable=True),
        sa.Column("stop_numbers", JSON, nullable=True),
        sa.Column("recommendation", JSON, nullable=True),
        sa.Column("idempotency_key", sa.String(length=200), nullable=True),
        sa.Column("request_hash", sa.String(length=64), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("ended_at", sa.Double(), nullable=True),
        *new,
        sa.PrimaryKeyConstraint("id", name="pk_studies"),
        sa.CheckConstraint(one_of("state", states), name="ck_studies_state"),
        sa.UniqueConstraint("idempotency_key", name="uq_studies_idempotency_key"),
        *constraints,
        sqlite_autoincrement=True,
    )


def designs_table(more: list[sa.Column[Any]]) -> sa.Table:
    is_new = any(column.name == "idempotency_key" for column in more)
    again = sa.UniqueConstraint("study_id", "idempotency_key", name="uq_designs_idempotency_key")
    states = ("WAITING", "RUNNING", "COMPLETE", "FAILED", "CANCELLED")
    return sa.Table(
        "designs",
        sa.MetaData(),
        sa.Column("id", ID, nullable=False),
        sa.Column("study_id", ID, nullable=False),
        sa.Column("number", sa.BigInteger(), nullable=False),
        sa.Column("x", JSON, nullable=False),
        sa.Column("x_hash", sa.String(length=64), nullable=False),
        sa.Column("scale", sa.Double(), nullable=False),
        sa.Column("seed", sa.BigInteger(), nullable=False),
        sa.Column("origin", sa.String(length=16), nullable=False),
        sa.Column("prediction", JSON, nullable=True),
        sa.Column("acquisition", sa.Double(), nullable=True),
        sa.Column("reason", sa.Text(), nullable=False),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("verdict", sa.String(length=16), nullable=True),
        *(
            sa.Column(name, sa.Double(), nullable=True)
            for name in ("angle_deg", "angle_sd_deg", "literal_angle_deg")
        ),
        sa.Column("results", JSON, nullable=True),
        sa.Column("failure_class", sa.String(length=32), nullable=True),
        sa.Column("failure_text", sa.Text(), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=True),
        sa.Column("ended_at", sa.Double(), nullable=True),
        *more,
        sa.ForeignKeyConstraint(
            ["study_id"], ["studies.id"], name="fk_designs_study_id_studies", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_designs"),
        sa.CheckConstraint(one_of("state", states), name="ck_designs_state"),
        sa.CheckConstraint(one_of("verdict", ("feasible", "unfeasible", "error")), name="ck_designs_verdict"),
        sa.UniqueConstraint("study_id", "number", name="uq_designs_study_id"),
        *([again] if is_new else []),
        sqlite_autoincrement=True,
    )


def jobs_table(kinds: tuple[str, ...]) -> sa.Table:
    states = ("queued", "running", "done", "failed", "cancelled")
    return sa.Table(
        "jobs",
        sa.MetaData(),
        sa.Column("id", sa.String(length=36), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("study_id", ID, nullable=False),
        sa.Column("design_id", ID, nullable=True),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("attempt", sa.BigInteger(), nullable=False),
        sa.Column("max_attempts", sa.BigInteger(), nullable=False),
        sa.Column("time_step_factor", sa.Double(), nullable=False),
        sa.Column("lease_until", sa.Double(), nullable=True),
        sa.Column("worker_id", sa.String(length=36), nullable=True),
        sa.Column("published_at", sa.Double(), nullable=True),
        sa.Column("publications", sa.BigInteger(), nullable=False),
        sa.Column("progress", JSON, nullable=True),
        sa.Column("cancel_requested", sa.Boolean(), nullable=False),
        sa.Column("checkpoint", JSON, nullable=True),
        sa.Column("failure_text", sa.Text(), nullable=True),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("ended_at", sa.Double(), nullable=True),
        sa.CheckConstraint("(kind = 'simulate') = (design_id is not null)", name="ck_jobs_design"),
        sa.CheckConstraint(one_of("kind", kinds), name="ck_jobs_kind"),
        sa.CheckConstraint(one_of("state", states), name="ck_jobs_state"),
        sa.ForeignKeyConstraint(
            ["design_id"], ["designs.id"], name="fk_jobs_design_id_designs", ondelete="CASCADE"
        ),
        sa.ForeignKeyConstraint(
            ["study_id"], ["studies.id"], name="fk_jobs_study_id_studies", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_jobs"),
        sa.Index("ix_jobs_created_at_id", "created_at", "id"),
        sa.Index("ix_jobs_design_id", "design_id"),
        sa.Index("ix_jobs_state_published_at", "state", "published_at"),
        sa.Index("ix_jobs_study_id", "study_id"),
    )
