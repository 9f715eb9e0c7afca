"""Read in a study that was calculated elsewhere: finished, read-only, and good for a warm start."""

from __future__ import annotations

import uuid
from typing import Any

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.db.models import (
    BudgetChangeRow,
    DesignRow,
    JobRow,
    ProposalRow,
    ReportRow,
    RunRow,
    StudyRow,
    SurrogateRow,
)
from service.domain.errors import InvalidValue
from service.domain.spec_record import design_hash, spec_from_record
from service.domain.states import DesignState, JobKind, JobState, StudyState, Verdict, is_over
from service.domain.study import StudySpec
from service.studies.record_event import record_study_event
from service.studies.study_file import DesignRecord, RunRecord, StopRecord, StudyFile, StudyRecord

CUT_OFF = StopRecord(
    reason="exported_early",
    text="It was exported before its end; this is what it had measured.",
    numbers=None,
)
JOB_STATES = {
    DesignState.COMPLETE: JobState.DONE,
    DesignState.FAILED: JobState.FAILED,
    DesignState.CANCELLED: JobState.CANCELLED,
}
OBJECT = "an object by parameter"
# Placeholders of rows that nobody will claim.
ELSEWHERE = "imported"


def import_study(session: Session, file: StudyFile) -> tuple[StudyRow, bool]:
    """The study's row, and whether it is new: the same content gives the stored study again.

    A study that was not over becomes a cancelled one; its open designs count for nothing. Raises InvalidValue,
    naming the field, for a file that contradicts itself.
    """
    stored = _find(session, file.content_sha256)
    if stored is not None:
        return stored, False
    spec = _spec(file.study.spec)
    _check_designs(spec, file.study.designs)
    study = _study_row(file, spec)
    try:
        # A savepoint: where another request was faster with the same file, only this insert is undone.
        with session.begin_nested():
            session.add(study)
            session.flush()
    except IntegrityError:
        stored = _find(session, file.content_sha256)
        if stored is None:
            raise
        return stored, False
    _add_designs(session, study, spec, file.study)
    for change in file.study.budget_changes:
        session.add(BudgetChangeRow(study_id=study.id, **change.model_dump()))
    if file.study.report is not None:
        measured = sum(design.state is DesignState.COMPLETE for design in file.study.designs)
        session.add(ReportRow(study_id=study.id, designs=measured, content=file.study.report))
    record_study_event(session, study, "study_imported")
    session.flush()
    return study, True


def _find(session: Session, content_hash: str) -> StudyRow | None:
    return session.scalars(select(StudyRow).where(StudyRow.import_hash == content_hash)).one_or_none()


def _spec(record: dict[str, Any]) -> StudySpec:
    for name, kind, allowed in (
        ("material", str, "a text"),
        ("fixed", dict, OBJECT),
        ("derived", dict, OBJECT),
    ):
        if not isinstance(record.get(name, kind()), kind):
            raise InvalidValue(f"study.spec.{name}", record[name], allowed)
    try:
        return spec_from_record(record)
    except InvalidValue as error:
        raise InvalidValue(f"study.spec.{error.field}", error.value, error.allowed) from error
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        what = f"missing {error}" if isinstance(error, KeyError) else str(error)
        raise InvalidValue("study.spec", what, "a specification as `talus export` writes it") from error


def _check_designs(spec: StudySpec, designs: list[DesignRecord]) -> None:
    keys = set[tuple[Any, ...]]()
    for place, design in enumerate(designs):
        field = f"study.designs.{place}"
        if design.number != place + 1:
            raise InvalidValue(f"{field}.number", design.number, f"{place + 1}: numbers have no gaps")
        if set(design.x) != set(spec.space.names):
            raise InvalidValue(f"{field}.x", sorted(design.x), "the variables " + ", ".join(spec.space.names))
        _check_verdict(field, design)
        attempts = [run.attempt for run in design.runs]
        if len(set(attempts)) < len(attempts):
            raise InvalidValue(f"{field}.runs", attempts, "each attempt once")
        if design.state in (DesignState.COMPLETE, DesignState.WAITING, DesignState.RUNNING):
            key = (tuple(sorted(design.x.items())), design.scale, design.seed)
            if key in keys:
                raise InvalidValue(f"{field}.seed", design.seed, "another seed: this design was there before")
            keys.add(key)


def _check_verdict(field: str, design: DesignRecord) -> None:
    if design.state is DesignState.COMPLETE:
        if design.verdict is None:
            raise InvalidValue(f"{field}.verdict", None, "a verdict for a design that is complete")
        if design.verdict is not Verdict.ERROR and not design.responses:
            raise InvalidValue(f"{field}.responses", design.responses, "what was measured, by observable")
    elif design.state is DesignState.FAILED and design.verdict is not Verdict.ERROR:
        raise InvalidValue(f"{field}.verdict", _value(design.verdict), "error for a design that failed")
    elif design.state is not DesignState.FAILED and design.verdict is not None:
        raise InvalidValue(
            f"{field}.verdict", _value(design.verdict), f"none for a design that is {design.state.value}"
        )


def _value(verdict: Verdict | None) -> str | None:
    return None if verdict is None else verdict.value


def _study_row(file: StudyFile, spec: StudySpec) -> StudyRow:
    record = file.study
    ended = is_over(record.state)
    stop = record.stop if ended else CUT_OFF
    simulated = [d.verdict for d in record.designs if d.origin != "import"]
    counts = {verdict: simulated.count(verdict) for verdict in Verdict}
    last = max((d.ended_at or d.created_at for d in record.designs), default=record.created_at)
    return StudyRow(
        state=record.state if ended else StudyState.CANCELLED,
        material=spec.material,
        spec=record.spec,
        space_hash=spec.space_hash,
        seed=spec.seed,
        budget=spec.budget,
        feasible=counts[Verdict.FEASIBLE],
        unfeasible=counts[Verdict.UNFEASIBLE],
        error=counts[Verdict.ERROR],
        stop_reason=stop.reason if stop else None,
        stop_text=stop.text if stop else None,
        stop_numbers=stop.numbers if stop else None,
        recommendation=record.recommendation,
        failures_forgiven=record.failures_forgiven,
        import_hash=file.content_sha256,
        created_at=record.created_at,
        ended_at=record.ended_at if record.ended_at is not None else last,
    )


def _add_designs(session: Session, study: StudyRow, spec: StudySpec, record: StudyRecord) -> None:
    """All rows of a kind go in one flush: a study of thousands of designs is a matter of seconds."""
    plain = [name for name in DesignRecord.model_fields if name in DesignRow.__table__.columns]
    rows = list[DesignRow]()
    for design in record.designs:
        values = {name: getattr(design, name) for name in plain}
        if not is_over(design.state):
            values |= {"state": DesignState.CANCELLED, "ended_at": study.ended_at}
        x = tuple(design.x[name] for name in spec.space.names)
        rows.append(DesignRow(study_id=study.id, x_hash=design_hash(spec.parameters_of(x)), **values))
    session.add_all(rows)
    fits = _surrogates(study.id, record.designs)
    session.add_all(fits.values())
    session.flush()
    for row, design in zip(rows, record.designs, strict=True):
        session.add_all(_simulation(row, design.runs))
        if design.training_hash is not None:
            fit = fits.get(design.training_hash) if design.hyperparameters is not None else None
            session.add(_proposal(spec, row, design.training_hash, fit))


def _simulation(design: DesignRow, runs: list[RunRecord]) -> list[JobRow | RunRow]:
    """The job that was done elsewhere, with its attempts, so that its cost is shown like any other's."""
    attempts = max((run.attempt for run in runs), default=0)
    job = JobRow(
        id=str(uuid.uuid4()),
        kind=JobKind.SIMULATE,
        study_id=design.study_id,
        design_id=design.id,
        state=JOB_STATES[design.state],
        attempt=attempts,
        max_attempts=max(1, attempts),
        created_at=design.created_at,
        ended_at=design.ended_at,
    )
    return [job, *(RunRow(job_id=job.id, worker_id=ELSEWHERE, **run.model_dump()) for run in runs)]


def _surrogates(study_id: int, designs: list[DesignRecord]) -> dict[str, SurrogateRow]:
    """What had been fitted, once per training set."""
    fits = dict[str, SurrogateRow]()
    for design in designs:
        if design.hyperparameters is None or design.training_hash is None or design.training_hash in fits:
            continue
        fits[design.training_hash] = SurrogateRow(
            study_id=study_id,
            training_hash=design.training_hash,
            hyperparameters=design.hyperparameters,
            created_at=design.created_at,
        )
    return fits


def _proposal(
    spec: StudySpec, design: DesignRow, training_hash: str, fit: SurrogateRow | None
) -> ProposalRow:
    basis = max(0, design.number - spec.parallel)
    return ProposalRow(
        study_id=design.study_id,
        surrogate_id=None if fit is None else fit.id,
        number=design.number,
        chosen=design.number,
        basis=basis,
        pending=design.number - 1 - basis,
        seed=spec.seed,
        strategy=spec.strategy,
        acquisition=design.acquisition,
        training_hash=training_hash,
        created_at=design.created_at,
    )
