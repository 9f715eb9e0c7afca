"""Keep a measured data set. The same tables again are the same row: what was held out stays held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.db.models import DataSetRow
from service.domain.data_set.records import Condition, DataSet
from service.domain.data_set.stored import as_record
from service.domain.data_set.suitability import suitability
from service.domain.diagnosis import MOST_GRAINS, DiagnosisSpec
from service.domain.measured_pile import cannot_simulate

DEFAULT = DiagnosisSpec(1)
# A reason may hold a condition's own numbers, and there may be hundreds of conditions.
MOST_REASONS = 5


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
    """What is shown of a data set, what it is too thin for, and what of it the model cannot represent."""
    judged = suitability(data)
    never = _not_simulated(data.conditions, MOST_GRAINS)
    coarse = {} if never else _not_simulated(data.conditions, DEFAULT.grains)
    sentences = [*judged.sentences, *_told("Refused, {}: {}.", never)]
    sentences += _told(
        f"With the {DEFAULT.grains} grains of a usual pile, {{}} cannot be simulated: {{}}.", coarse
    )
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
        "can_be_diagnosed": not judged.is_refused and not never,
        "sentences": sentences,
    }


def _not_simulated(conditions: Sequence[Condition], grains: int) -> Mapping[str, list[str]]:
    """Conditions that make no test of so many grains, by the reason. The finest piles can be made if any can."""
    found: dict[str, list[str]] = {}
    for condition in conditions:
        why = cannot_simulate(condition, grains, DEFAULT.contact_model)
        if why is not None:
            found.setdefault(why, []).append(condition.condition)
    return found


def _told(sentence: str, found: Mapping[str, list[str]]) -> list[str]:
    """A sentence for each reason, with its conditions; of many reasons, how many more there are."""
    told = [sentence.format(", ".join(names), why) for why, names in list(found.items())[:MOST_REASONS]]
    more = len(found) - MOST_REASONS
    return [*told, f"There are {more} more such reasons."] if more > 0 else told
