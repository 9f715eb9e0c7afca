"""Let one diagnosis look at the held-out conditions of its data set, once and for all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import DataSetRow, DiagnosisRow
from service.db.queries import Lease
from service.domain.data_set.stored import from_record


def open_held_out(session: Session, lease: Lease) -> bool:
    """True: this diagnosis may look, now and after a restart. False: another one has looked already, here or at
    the same block in another data set of the project, or the lease was lost. The verdict must stand before this
    is asked, or the block is no judge of it."""
    owner = queries.lock_owner(session, lease.job_id)
    if not isinstance(owner, DiagnosisRow) or not queries.holds(session, lease):
        return False
    # All of the project, in one order: two data sets may hold one block, and only one of them may be opened.
    rows = select(DataSetRow.id).where(DataSetRow.project == owner.project).order_by(DataSetRow.id)
    session.execute(rows.with_for_update()).all()
    data_set = session.get_one(DataSetRow, owner.data_set_id, populate_existing=True)
    if data_set.opened_by is None and not _was_seen(session, data_set):
        data_set.opened_by, data_set.opened_at = owner.id, queries.now(session)
    return data_set.opened_by == owner.id


def _was_seen(session: Session, data_set: DataSetRow) -> bool:
    """Whether the block was opened in another data set: the same tables with a training replicate renamed, say."""
    opened = select(DataSetRow.id, DataSetRow.facts).where(
        DataSetRow.project == data_set.project,
        DataSetRow.id != data_set.id,
        DataSetRow.opened_by.is_not(None),
    )
    alike = [number for number, facts in session.execute(opened) if _block(facts) == _block(data_set.facts)]
    mine = from_record(data_set.content).held_out_hash if alike else None
    # One by one: a content may be tens of megabytes.
    contents = (session.scalars(select(DataSetRow.content).where(DataSetRow.id == n)).one() for n in alike)
    return mine is not None and any(from_record(content).held_out_hash == mine for content in contents)


def _block(facts: Mapping[str, Any]) -> Counter[tuple[str, str, int]]:
    """What is cheap to compare: the held-out conditions without their names."""
    held_out = (c for c in facts["conditions"] if c["holdout"])
    return Counter((c["test"], c["material"], c["replicates"]) for c in held_out)
