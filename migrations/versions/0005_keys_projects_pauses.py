"""API keys, projects that do not see each other, and jobs that wait for room on the disk

Revision 0005. Reversible; downgrading loses the keys, and what other projects than the default one hold.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from migrations.tables_0001 import ID, one_of

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

DEFAULT = "default"
# Every table that a project owns rows of, and what was unique in it until now. Those that others refer to come
# last, so that a downgrade deletes from the leaves.
UNIQUE = {
    "model_versions": ("name",),
    "diagnoses": ("idempotency_key",),
    "data_sets": ("split_hash",),
    "charges": ("idempotency_key",),
    "geometries": ("sha256",),
    "studies": ("idempotency_key", "import_hash"),
}


def upgrade() -> None:
    op.create_table(
        "api_keys",
        sa.Column("id", ID, nullable=False),
        sa.Column("name", sa.String(length=100), nullable=False),
        sa.Column("prefix", sa.String(length=16), nullable=False),
        sa.Column("secret_hash", sa.String(length=64), nullable=False),
        sa.Column("scope", sa.String(length=16), nullable=False),
        sa.Column("project", sa.String(length=32), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("revoked_at", sa.Double(), nullable=True),
        sa.CheckConstraint(one_of("scope", ("read", "run", "admin")), name=op.f("ck_api_keys_scope")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_api_keys")),
        sa.UniqueConstraint("prefix", name=op.f("uq_api_keys_prefix")),
        sqlite_autoincrement=True,
    )
    op.add_column("jobs", sa.Column("paused_until", sa.Double(), nullable=True))
    op.add_column("jobs", sa.Column("pause_reason", sa.Text(), nullable=True))
    for table, columns in UNIQUE.items():
        project = sa.Column("project", sa.String(length=32), nullable=False, server_default=DEFAULT)
        with _changed(table) as batch:
            batch.add_column(project)
            for column in columns:
                name = op.f(f"uq_{table}_{column}")
                batch.drop_constraint(name, type_="unique")
                batch.create_unique_constraint(name, [column, "project"])


def downgrade() -> None:
    for table in UNIQUE:
        if table in ("studies", "charges", "diagnoses"):
            _delete_jobs(table)
        op.execute(f"delete from {table} where project <> '{DEFAULT}'")  # noqa: S608 - names of our own
    for table, columns in UNIQUE.items():
        with _changed(table) as batch:
            for column in columns:
                name = op.f(f"uq_{table}_{column}")
                batch.drop_constraint(name, type_="unique")
                batch.create_unique_constraint(name, [column])
            batch.drop_column("project")
    op.drop_column("jobs", "pause_reason")
    op.drop_column("jobs", "paused_until")
    op.drop_table("api_keys")


def _delete_jobs(owner: str) -> None:
    """Before their owners go: SQLite's foreign keys are off during a migration."""
    column = {"studies": "study_id", "charges": "charge_id", "diagnoses": "diagnosis_id"}[owner]
    others = f"select id from {owner} where project <> '{DEFAULT}'"  # noqa: S608 - names of our own
    jobs = f"select id from jobs where {column} in ({others})"  # noqa: S608
    op.execute(f"delete from runs where job_id in ({jobs})")  # noqa: S608
    op.execute(f"delete from jobs where {column} in ({others})")  # noqa: S608
    if owner == "studies":
        designs = f"select id from designs where study_id in ({others})"  # noqa: S608
        op.execute(f"delete from artifacts where design_id in ({designs})")  # noqa: S608
        for table in ("designs", "proposals", "surrogates", "reports", "budget_changes", "events"):
            op.execute(f"delete from {table} where study_id in ({others})")  # noqa: S608
    else:
        op.execute(f"delete from artifacts where {column} in ({others})")  # noqa: S608


def _changed(table: str):  # type: ignore[no-untyped-def]
    """A change of a table that SQLite makes anew, with its CHECKs, which Alembic's own reflection leaves out."""
    bind = op.get_bind()
    if bind.dialect.name != "sqlite":
        return op.batch_alter_table(table)
    found = sa.Table(table, sa.MetaData(), autoload_with=bind)
    named = {constraint.name for constraint in found.constraints}
    for check in sa.inspect(bind).get_check_constraints(table):
        if check["name"] not in named:
            found.append_constraint(sa.CheckConstraint(sa.text(check["sqltext"]), name=op.f(check["name"])))
    return op.batch_alter_table(table, copy_from=found, table_kwargs={"sqlite_autoincrement": True})
