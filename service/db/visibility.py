"""Which rows a session sees: all of them, or one project's. The one place that keeps projects apart.

A session that belongs to a project gets its condition added to every ORM statement, whatever asks for it, so that
a new query or route cannot forget it; what it adds becomes that project's.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import ColumnElement, event, or_, select
from sqlalchemy.orm import ORMExecuteState, Session, with_loader_criteria

from service.db.base import OfProject
from service.db.models import (
    ArtifactRow,
    BudgetChangeRow,
    ChargeRow,
    ClaimCheckRow,
    DesignRow,
    DiagnosisRow,
    EventRow,
    JobRow,
    ProposalRow,
    ReportRow,
    RunRow,
    StudyRow,
    SurrogateRow,
)

PROJECT = "project"
OF_A_STUDY = (DesignRow, EventRow, ProposalRow, SurrogateRow, ReportRow, BudgetChangeRow)


def restrict(session: Session, project: str) -> None:
    """From now on `session` sees and makes rows of this project only."""
    session.info[PROJECT] = project


@event.listens_for(Session, "do_orm_execute")
def _add_conditions(state: ORMExecuteState) -> None:
    project = state.session.info.get(PROJECT)
    if project is not None and not state.is_column_load:
        state.statement = state.statement.options(*_conditions(project))


@event.listens_for(Session, "before_flush")
def _own_what_is_new(session: Session, _context: Any, _instances: Any) -> None:
    project = session.info.get(PROJECT)
    if project is not None:
        for row in session.new:
            if isinstance(row, OfProject):
                row.project = project


def _conditions(project: str) -> list[Any]:
    studies, charges, diagnoses = (_ids(row, project) for row in (StudyRow, ChargeRow, DiagnosisRow))
    designs = select(DesignRow.__table__.c.id).where(DesignRow.__table__.c.study_id.in_(studies))
    jobs = JobRow.__table__
    of_jobs = select(jobs.c.id).where(_of_any(jobs.c, "study_id", studies, charges, diagnoses))
    return [
        with_loader_criteria(OfProject, lambda row: row.project == project, include_aliases=True),
        *(with_loader_criteria(row, row.study_id.in_(studies), include_aliases=True) for row in OF_A_STUDY),
        with_loader_criteria(
            JobRow, _of_any(JobRow, "study_id", studies, charges, diagnoses), include_aliases=True
        ),
        with_loader_criteria(
            ArtifactRow, _of_any(ArtifactRow, "design_id", designs, charges, diagnoses), include_aliases=True
        ),
        with_loader_criteria(ClaimCheckRow, ClaimCheckRow.diagnosis_id.in_(diagnoses), include_aliases=True),
        with_loader_criteria(RunRow, RunRow.job_id.in_(of_jobs), include_aliases=True),
    ]


def _ids(row: type[StudyRow | ChargeRow | DiagnosisRow], project: str) -> Any:
    table = row.__table__
    return select(table.c.id).where(table.c.project == project)


def _of_any(columns: Any, first: str, firsts: Any, charges: Any, diagnoses: Any) -> ColumnElement[bool]:
    return or_(
        getattr(columns, first).in_(firsts),
        columns.charge_id.in_(charges),
        columns.diagnosis_id.in_(diagnoses),
    )
