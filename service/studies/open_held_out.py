"""Let one diagnosis look at the held-out conditions of its data set, once and for all."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import DataSetRow, DiagnosisRow
from service.db.queries import Lease


def open_held_out(session: Session, lease: Lease) -> bool:
    """True: this diagnosis may look, now and after a restart. False: another one has looked already, or the lease
    was lost. The verdict must stand before this is asked, or the block is no judge of it."""
    owner = queries.lock_owner(session, lease.job_id)
    if not isinstance(owner, DiagnosisRow) or not queries.holds(session, lease):
        return False
    data_set = session.get_one(DataSetRow, owner.data_set_id, with_for_update=True, populate_existing=True)
    if data_set.opened_by is None:
        data_set.opened_by, data_set.opened_at = owner.id, queries.now(session)
    return data_set.opened_by == owner.id
