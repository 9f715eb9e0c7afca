"""Record what a check made of a claim: it is confirmed, or withdrawn with the model that rests on it."""

from __future__ import annotations

from datetime import UTC, datetime

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import ClaimCheckRow, DiagnosisRow, ModelVersionRow
from service.domain.claims import CheckOutcome, ClaimCheck
from service.domain.states import ActionNotAllowed, is_over


class NoSuchClaim(LookupError):
    """The diagnosis claims no such effect; the text says what it claims."""


def check_claim(session: Session, diagnosis_id: int, effect: str, check: ClaimCheck) -> DiagnosisRow | None:
    """None: no such diagnosis. The same check twice is as once.

    Raises NoSuchClaim; ActionNotAllowed while the diagnosis runs, and for a claim that was withdrawn: it does not
    come back, since the models that rested on it do not.
    """
    diagnosis = session.get(DiagnosisRow, diagnosis_id, with_for_update=True, populate_existing=True)
    if diagnosis is None:
        return None
    if not is_over(diagnosis.state):
        raise ActionNotAllowed(
            f"diagnosis {diagnosis_id} claims nothing yet, it is {diagnosis.state.value.lower()}"
        )
    claimed = [claim["effect"] for claim in (diagnosis.results or {}).get("claims", ())]
    if effect not in claimed:
        raise NoSuchClaim(f"it claims {', '.join(claimed)}" if claimed else "it claims nothing")
    last = session.scalars(
        select(ClaimCheckRow)
        .where(ClaimCheckRow.diagnosis_id == diagnosis_id, ClaimCheckRow.effect == effect)
        .order_by(ClaimCheckRow.id.desc())
        .limit(1)
    ).one_or_none()
    if last is not None and (last.outcome, last.note) == (check.outcome, check.note):
        return diagnosis
    if last is not None and (last.outcome, check.outcome) == (CheckOutcome.WITHDRAWN, CheckOutcome.CONFIRMED):
        when = datetime.fromtimestamp(last.created_at, UTC).date().isoformat()
        raise ActionNotAllowed(f"the claim of {effect} was withdrawn on {when} and stays so")
    session.add(
        ClaimCheckRow(diagnosis_id=diagnosis_id, effect=effect, outcome=check.outcome, note=check.note)
    )
    if check.outcome is CheckOutcome.WITHDRAWN:
        _withdraw_versions(session, diagnosis)
    session.flush()
    return diagnosis


def _withdraw_versions(session: Session, diagnosis: DiagnosisRow) -> None:
    """That which the diagnosis made, and all that extend it: each simulates with the effect that is not there."""
    now = queries.now(session)
    found = session.scalars(select(ModelVersionRow).where(ModelVersionRow.diagnosis_id == diagnosis.id)).all()
    while found:
        for row in found:
            row.withdrawn_at = row.withdrawn_at or now
        parents = [row.id for row in found]
        found = session.scalars(select(ModelVersionRow).where(ModelVersionRow.parent_id.in_(parents))).all()
