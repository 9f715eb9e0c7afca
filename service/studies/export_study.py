"""A study as the one JSON that another installation imports (`study_file`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db import queries, read_models
from service.db.models import BudgetChangeRow, JobRow, RunRow, StudyRow
from service.db.read_models import DesignView
from service.domain.states import JobKind
from service.studies.study_file import FORMAT, VERSION, BudgetChange, DesignRecord, RunRecord, content_hash


def export_study(session: Session, study_id: int, talus_version: str) -> dict[str, Any] | None:
    """None: no such study. Whatever state it is in; a few statements, however many designs."""
    page = read_models.open_study(session, study_id)
    if page is None:
        return None
    content = _study(session, page.study, page.designs)
    return {
        "format": FORMAT,
        "version": VERSION,
        "content_sha256": content_hash(content),
        "exported_at": queries.now(session),
        "talus_version": talus_version,
        "study": content,
    }


def _study(session: Session, study: StudyRow, designs: Sequence[DesignView]) -> dict[str, Any]:
    changes = session.scalars(
        select(BudgetChangeRow).where(BudgetChangeRow.study_id == study.id).order_by(BudgetChangeRow.id)
    )
    report = read_models.newest_report(session, study.id)
    runs = _runs(session, study.id)
    stop = None
    if study.stop_reason is not None:
        stop = {"reason": study.stop_reason, "text": study.stop_text, "numbers": study.stop_numbers}
    return {
        "spec": study.spec,
        "state": study.state.value,
        "stop": stop,
        "recommendation": study.recommendation,
        "report": None if report is None else report.content,
        "failures_forgiven": study.failures_forgiven,
        "budget_changes": [_plain(change, BudgetChange.model_fields) for change in changes],
        "created_at": study.created_at,
        "ended_at": study.ended_at,
        "designs": [_design(view, runs) for view in designs],
    }


def _design(view: DesignView, runs: Mapping[str, list[dict[str, Any]]]) -> dict[str, Any]:
    row = view.design
    elsewhere = {
        "training_hash": view.proposal.training_hash if view.proposal else None,
        "hyperparameters": view.surrogate.hyperparameters if view.surrogate else None,
        "state": row.state.value,
        "verdict": row.verdict.value if row.verdict else None,
        "runs": runs.get(view.job.id, []) if view.job else [],
    }
    return {**_plain(row, [name for name in DesignRecord.model_fields if name not in elsewhere]), **elsewhere}


def _runs(session: Session, study_id: int) -> dict[str, list[dict[str, Any]]]:
    """The attempts at each simulation, by job."""
    rows = session.scalars(
        select(RunRow)
        .join(JobRow, JobRow.id == RunRow.job_id)
        .where(JobRow.study_id == study_id, JobRow.kind == JobKind.SIMULATE)
        .order_by(RunRow.job_id, RunRow.attempt)
    )
    found: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        found.setdefault(row.job_id, []).append(_plain(row, RunRecord.model_fields))
    return found


def _plain(row: object, names: Any) -> dict[str, Any]:
    return {name: getattr(row, name) for name in names}
