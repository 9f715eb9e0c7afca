"""What became of the claims of diagnoses: confirmed or withdrawn, appended with a note

Revision 0007. Reversible; downgrading loses the checks.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from migrations.tables_0001 import ID, one_of

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "claim_checks",
        sa.Column("id", ID, nullable=False),
        sa.Column("diagnosis_id", ID, nullable=False),
        sa.Column("effect", sa.String(length=64), nullable=False),
        sa.Column("outcome", sa.String(length=16), nullable=False),
        sa.Column("note", sa.Text(), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.CheckConstraint(
            one_of("outcome", ("confirmed", "withdrawn")), name=op.f("ck_claim_checks_outcome")
        ),
        sa.ForeignKeyConstraint(
            ["diagnosis_id"],
            ["diagnoses.id"],
            name=op.f("fk_claim_checks_diagnosis_id_diagnoses"),
            ondelete="CASCADE",
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_claim_checks")),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_claim_checks_diagnosis_id", "claim_checks", ["diagnosis_id"])


def downgrade() -> None:
    op.drop_table("claim_checks")
