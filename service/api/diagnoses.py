"""Measured data in, diagnoses of them, and the models that they extend."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Path, Query, Response
from sqlalchemy.orm import Session

from service.api.dependencies import LARGEST_ID, DatabaseDep, IdCursor, Limit, RowId
from service.api.diagnosis_views import (
    ClaimCheckBody,
    DataSetAnswer,
    DataSetBody,
    DataSetList,
    DiagnosisAnswer,
    DiagnosisBody,
    DiagnosisList,
    ModelVersionAnswer,
    ModelVersionList,
)
from service.api.problems import problem_responses
from service.api.studies import IdempotencyKey
from service.db import queries, read_diagnoses
from service.db.models import DataSetRow, ModelVersionRow
from service.db.read_diagnoses import DiagnosisView
from service.domain.data_set.cells import BadCell, BadDataSet
from service.domain.data_set.reading import data_set_from_tables
from service.errors import Conflict, FieldError, InvalidRequest, NotFound, brief
from service.studies.cancel_job import JobNotCancellable, cancel_job
from service.studies.check_claim import NoSuchClaim, check_claim
from service.studies.create_diagnosis import create_diagnosis
from service.studies.create_study import KeyReused
from service.studies.store_data_set import store_data_set

router = APIRouter(prefix="/v1", tags=["diagnoses"])

# As many bad cells are listed one by one; the detail says how many there are.
MOST_CELLS = 100

DataSetFilter = Annotated[int | None, Query(ge=1, le=LARGEST_ID)]
Claimed = Annotated[str, Path(description="id of the claimed effect", max_length=64)]
MEASUREMENTS_PATH = "/v1/measurements"


@router.post(
    "/measurements", status_code=201, operation_id="createDataSet", responses=problem_responses(413, 422)
)
def post_data_set(body: DataSetBody, response: Response, database: DatabaseDep) -> DataSetAnswer:
    """Store measured tables. Every bad cell is named; the same tables again are the same data set (200)."""
    try:
        data = data_set_from_tables(body.tables, body.planned)
    except BadDataSet as error:
        raise _refusal(error.cells) from error
    with database.writing() as session:
        row, is_new = store_data_set(session, body.name, data)
        session.flush()
        session.refresh(row)
        answer = DataSetAnswer.of(row)
    response.status_code = 201 if is_new else 200
    response.headers["Location"] = f"{MEASUREMENTS_PATH}/{answer.id}"
    return answer


def _refusal(cells: tuple[BadCell, ...]) -> InvalidRequest:
    fields = []
    for cell in cells[:MOST_CELLS]:
        row = "" if cell.row is None else f"[{cell.row}]"
        column = f".{cell.column}" if cell.column else ""
        fields.append(FieldError(f"tables.{cell.file}{row}{column}", cell.value, cell.allowed))
    refused = InvalidRequest.of(*fields)
    more = len(cells) - 5
    return InvalidRequest(f"{refused.detail}; and {more} more", fields) if more > 0 else refused


@router.get("/measurements", operation_id="listDataSets", responses=problem_responses(422))
def list_data_sets(database: DatabaseDep, limit: Limit = 50, cursor: IdCursor = None) -> DataSetList:
    """Data sets, newest first."""
    with database.reading() as session:
        rows = read_diagnoses.list_data_sets(session, limit + 1, cursor)
        items = [DataSetAnswer.of(row) for row in rows[:limit]]
    return DataSetList(items=items, next_cursor=items[-1].id if len(rows) > limit else None)


@router.get("/measurements/{data_set_id}", operation_id="getDataSet", responses=problem_responses(404, 422))
def get_data_set(data_set_id: RowId, database: DatabaseDep) -> DataSetAnswer:
    """One data set: its conditions, and what it is too thin for."""
    with database.reading() as session:
        row = session.get(DataSetRow, data_set_id)
        if row is None:
            raise NotFound(f"There is no data set {data_set_id}.")
        return DataSetAnswer.of(row)


@router.post("/diagnoses", status_code=201, operation_id="createDiagnosis", responses=problem_responses(422))
def post_diagnosis(
    body: DiagnosisBody, response: Response, database: DatabaseDep, idempotency_key: IdempotencyKey = None
) -> DiagnosisAnswer:
    """Diagnose a data set, or with `plan` say what its tests could show. The answer tells what it will take."""
    spec = body.to_spec()
    with database.writing() as session:
        try:
            row, _ = create_diagnosis(session, spec, idempotency_key)
        except KeyReused as error:
            refusal = FieldError("Idempotency-Key", idempotency_key, f"a new key: this one {error}")
            raise InvalidRequest.of(refusal) from error
        answer = DiagnosisAnswer.of(_diagnosis(session, row.id))
    response.headers["Location"] = f"/v1/diagnoses/{answer.id}"
    return answer


@router.get("/diagnoses", operation_id="listDiagnoses", responses=problem_responses(422))
def list_diagnoses(
    database: DatabaseDep, limit: Limit = 50, cursor: IdCursor = None, data_set: DataSetFilter = None
) -> DiagnosisList:
    """Diagnoses, newest first."""
    with database.reading() as session:
        views = read_diagnoses.list_diagnoses(session, limit + 1, cursor, data_set)
        items = [DiagnosisAnswer.of(view) for view in views[:limit]]
    return DiagnosisList(items=items, next_cursor=items[-1].id if len(views) > limit else None)


@router.get("/diagnoses/{diagnosis_id}", operation_id="getDiagnosis", responses=problem_responses(404, 422))
def get_diagnosis(diagnosis_id: RowId, database: DatabaseDep) -> DiagnosisAnswer:
    """One diagnosis with what it says."""
    with database.reading() as session:
        return DiagnosisAnswer.of(_diagnosis(session, diagnosis_id))


@router.post(
    "/diagnoses/{diagnosis_id}/cancel",
    status_code=202,
    operation_id="cancelDiagnosis",
    responses=problem_responses(404, 409, 422),
)
def post_cancel(diagnosis_id: RowId, database: DatabaseDep) -> DiagnosisAnswer:
    """Stop a diagnosis. Its runs stay: the same diagnosis asked for again goes on from them."""
    with database.writing() as session:
        job = _diagnosis(session, diagnosis_id).job
        assert job is not None, "every diagnosis has its job"
        try:
            cancel_job(session, job.id)
        except JobNotCancellable as error:
            raise Conflict(f"Diagnosis {diagnosis_id} cannot be cancelled: {error}.") from error
        session.flush()
        session.expire_all()
        return DiagnosisAnswer.of(_diagnosis(session, diagnosis_id))


@router.post(
    "/diagnoses/{diagnosis_id}/claims/{claimed}",
    status_code=200,
    operation_id="checkClaim",
    responses=problem_responses(404, 409, 422),
)
def post_check(
    diagnosis_id: RowId, claimed: Claimed, body: ClaimCheckBody, database: DatabaseDep
) -> DiagnosisAnswer:
    """Record what the check of a claimed effect showed: it is confirmed, or withdrawn with the model versions that
    rest on it. A withdrawn claim stays visible. Twice is as once."""
    check = body.to_check()
    with database.writing() as session:
        try:
            found = check_claim(session, diagnosis_id, claimed, check)
        except NoSuchClaim as error:
            raise NotFound(f"Diagnosis {diagnosis_id} has no claim of {brief(claimed)}: {error}.") from error
        if found is None:
            raise NotFound(f"There is no diagnosis {diagnosis_id}.")
        return DiagnosisAnswer.of(_diagnosis(session, diagnosis_id))


@router.get("/model-versions", operation_id="listModelVersions", responses=problem_responses(422))
def list_model_versions(
    database: DatabaseDep, limit: Limit = 50, cursor: IdCursor = None
) -> ModelVersionList:
    """Models that diagnoses have extended, newest first; those that were withdrawn stay visible."""
    with database.reading() as session:
        rows = read_diagnoses.list_model_versions(session, limit + 1, cursor)
        items = [ModelVersionAnswer.of(row) for row in rows[:limit]]
    return ModelVersionList(items=items, next_cursor=items[-1].id if len(rows) > limit else None)


@router.post(
    "/model-versions/{version_id}/withdraw",
    status_code=200,
    operation_id="withdrawModelVersion",
    responses=problem_responses(404, 422),
)
def post_withdraw(version_id: RowId, database: DatabaseDep) -> ModelVersionAnswer:
    """Take a claim back: the version stays visible and can no longer be used. Twice is as once."""
    with database.writing() as session:
        row = session.get(ModelVersionRow, version_id, with_for_update=True)
        if row is None:
            raise NotFound(f"There is no model version {version_id}.")
        if row.withdrawn_at is None:
            row.withdrawn_at = queries.now(session)
        session.flush()
        return ModelVersionAnswer.of(row)


def _diagnosis(session: Session, diagnosis_id: int) -> DiagnosisView:
    view = read_diagnoses.open_diagnosis(session, diagnosis_id)
    if view is None:
        raise NotFound(f"There is no diagnosis {diagnosis_id}.")
    return view
