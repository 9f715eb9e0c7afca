"""A version of the model keeps the contact parameters that were calibrated beside its effects

Revision 0006. Reversible; downgrading loses them.
"""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from migrations.tables_0001 import JSON

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("model_versions", sa.Column("parameters", JSON, nullable=True))


def downgrade() -> None:
    op.drop_column("model_versions", "parameters")
