"""Keep a measured data set. The same tables again are the same row: what was held out stays held out."""

from __future__ import annotations

from typing import Any

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.db.models import DataSetRow
from service.domain.data_set.records import DataSet
from service.domain.data_set.stored import as_record
from service.domain.data_set.suitability import suitability


def store_data_set(session: Session, name: str, data: DataSet) -> tuple[DataSetRow, bool]:
    """The row, and whether it is new."""
    stored = _stored(session, data.split_hash)
    if stored is not None:
        return stored, False
    row = DataSetRow(name=name, split_hash=data.split_hash, content=as_record(data), facts=facts(data))
    try:
        # A savepoint: where another upload of the same was faster, only this insert is undone.
        with session.begin_nested():
            session.add(row)
            session.flush()
    except IntegrityError:
        stored = _stored(session, data.split_hash)
        if stored is None:
            raise
        return stored, False
    return row, True


def _stored(session: Session, split_hash: str) -> DataSetRow | None:
    return session.scalars(select(DataSetRow).where(DataSetRow.split_hash == split_hash)).one_or_none()


def facts(data: DataSet) -> dict[str, Any]:
    """What is shown of a data set, and what it is too thin for."""
    judged = suitability(data)
    return {
        "conditions": [
            {
                "condition": c.condition,
                "test": c.test,
                "material": c.material,
                "holdout": c.holdout,
                "replicates": len(data.replicates[c.condition]),
            }
            for c in data.conditions
        ],
        "observations": len(data.observations),
        "profiles": len(data.profiles),
        "can_be_diagnosed": not judged.is_refused,
        "sentences": list(judged.sentences),
    }
