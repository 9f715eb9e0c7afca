"""Data sets, diagnoses with their jobs and files, and versions of the model, as the API shows them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import ColumnElement, select
from sqlalchemy.orm import Session, defer

from service.db.models import (
    ArtifactRow,
    ClaimCheckRow,
    DataSetRow,
    DiagnosisRow,
    JobRow,
    ModelVersionRow,
)
from service.domain.claims import ClaimCheck, JudgedClaim, judged, with_levels


@dataclass(frozen=True)
class DiagnosisView:
    """A diagnosis with the job that makes it, its files, and the checks of its claims by effect."""

    diagnosis: DiagnosisRow
    job: JobRow | None
    artifacts: Sequence[ArtifactRow] = ()
    checks: Mapping[str, Sequence[ClaimCheck]] = field(default_factory=dict)

    @property
    def claims(self) -> list[JudgedClaim]:
        """What it claims, with what became of that."""
        return judged(self.diagnosis.results, self.checks)

    @property
    def results(self) -> dict[str, Any] | None:
        """What it says, its claims with the levels that they have now."""
        return with_levels(self.diagnosis.results, self.claims)


def open_diagnosis(session: Session, diagnosis_id: int) -> DiagnosisView | None:
    """One diagnosis."""
    found = _views(session, DiagnosisRow.id == diagnosis_id)
    return found[0] if found else None


def list_diagnoses(
    session: Session, limit: int, before: int | None = None, data_set: int | None = None
) -> Sequence[DiagnosisView]:
    """Newest first; `before` is the last id of the page that came before."""
    chosen = select(DiagnosisRow.id).order_by(DiagnosisRow.id.desc()).limit(limit)
    if before is not None:
        chosen = chosen.where(DiagnosisRow.id < before)
    if data_set is not None:
        chosen = chosen.where(DiagnosisRow.data_set_id == data_set)
    return _views(session, DiagnosisRow.id.in_(chosen))


def _views(session: Session, condition: ColumnElement[bool]) -> list[DiagnosisView]:
    # A diagnosis has one job in its life: retries are attempts of the same job.
    statement = (
        select(DiagnosisRow, JobRow)
        .outerjoin(JobRow, JobRow.diagnosis_id == DiagnosisRow.id)
        .where(condition)
        .order_by(DiagnosisRow.id.desc())
    )
    found = session.execute(statement).all()
    files: dict[int | None, list[ArtifactRow]] = {}
    stored = (
        select(ArtifactRow).join(DiagnosisRow, DiagnosisRow.id == ArtifactRow.diagnosis_id).where(condition)
    )
    for artifact in session.scalars(stored.order_by(ArtifactRow.kind)):
        files.setdefault(artifact.diagnosis_id, []).append(artifact)
    checks: dict[int, dict[str, list[ClaimCheck]]] = {}
    told = select(ClaimCheckRow).join(DiagnosisRow, DiagnosisRow.id == ClaimCheckRow.diagnosis_id)
    for check in session.scalars(told.where(condition).order_by(ClaimCheckRow.id)):
        of_effect = checks.setdefault(check.diagnosis_id, {}).setdefault(check.effect, [])
        of_effect.append(ClaimCheck(check.outcome, check.note, check.created_at))
    return [
        DiagnosisView(row[0], row[1], files.get(row[0].id, ()), checks.get(row[0].id, {})) for row in found
    ]


def list_data_sets(session: Session, limit: int, before: int | None = None) -> Sequence[DataSetRow]:
    """Newest first, without their tables."""
    statement = select(DataSetRow).order_by(DataSetRow.id.desc()).limit(limit)
    if before is not None:
        statement = statement.where(DataSetRow.id < before)
    return session.scalars(statement.options(defer(DataSetRow.content, raiseload=True))).all()


def list_model_versions(session: Session, limit: int, before: int | None = None) -> Sequence[ModelVersionRow]:
    """Newest first, those that were withdrawn too."""
    statement = select(ModelVersionRow).order_by(ModelVersionRow.id.desc()).limit(limit)
    if before is not None:
        statement = statement.where(ModelVersionRow.id < before)
    return session.scalars(statement).all()
