"""Charges of the hopper: ask for them, see how far they are, read what they found, stop them."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response
from sqlalchemy.orm import Session

from service.api.charge_body import ChargeBody
from service.api.charge_views import ChargeAnswer, ChargeList, ChargesAnswer, ChargeSummary
from service.api.dependencies import LARGEST_ID, DatabaseDep, GeometriesDep, IdCursor, Limit, RowId
from service.api.problems import problem_responses
from service.api.studies import IdempotencyKey
from service.api.views import ArtifactList
from service.db import read_charges
from service.db.read_charges import ChargeView
from service.errors import Conflict, FieldError, InvalidRequest, NotFound
from service.studies.cancel_job import JobNotCancellable, cancel_job
from service.studies.check_charges import check_charges
from service.studies.create_charges import create_charges
from service.studies.create_study import KeyReused

router = APIRouter(prefix="/v1/charges", tags=["charges"])

SeriesFilter = Annotated[int | None, Query(ge=1, le=LARGEST_ID)]


@router.post("", status_code=201, operation_id="createCharges", responses=problem_responses(422))
def post_charges(
    body: ChargeBody,
    response: Response,
    database: DatabaseDep,
    geometries: GeometriesDep,
    idempotency_key: IdempotencyKey = None,
) -> ChargesAnswer:
    """Ask for a charge of each seed and parameter set. Plant, masses and meshes are checked whole before anything
    is stored, and the answer tells what it will take."""
    request = body.to_request()
    with database.reading() as session:
        checked = check_charges(session, request, geometries.local)
    with database.writing() as session:
        try:
            rows, _ = create_charges(session, checked, idempotency_key)
        except KeyReused as error:
            refusal = FieldError("Idempotency-Key", idempotency_key, f"a new key: this one {error}")
            raise InvalidRequest.of(refusal) from error
        answer = ChargesAnswer.of(read_charges.open_series(session, rows[0].series))
    response.headers["Location"] = f"/v1/charges/{answer.series}"
    return answer


@router.get("", operation_id="listCharges", responses=problem_responses(422))
def list_charges(
    database: DatabaseDep, limit: Limit = 50, cursor: IdCursor = None, series: SeriesFilter = None
) -> ChargeList:
    """Charges, newest first."""
    with database.reading() as session:
        views = read_charges.list_charges(session, limit + 1, cursor, series)
        items = [ChargeAnswer.of(view) for view in views[:limit]]
    return ChargeList(items=items, next_cursor=items[-1].id if len(views) > limit else None)


@router.get("/{charge_id}", operation_id="getCharge", responses=problem_responses(404, 422))
def get_charge(charge_id: RowId, database: DatabaseDep) -> ChargeAnswer:
    """One charge, with its findings and files."""
    with database.reading() as session:
        return ChargeAnswer.of(_charge(session, charge_id))


@router.get(
    "/{charge_id}/summary", operation_id="getChargeSummary", responses=problem_responses(404, 409, 422)
)
def get_summary(charge_id: RowId, database: DatabaseDep) -> ChargeSummary:
    """Every number of a finished charge: sectors, piles, segregation, belt, jet, walls, mass over time."""
    with database.reading() as session:
        row = _charge(session, charge_id).charge
    if row.results is None:
        raise Conflict(f"Charge {charge_id} has no results: it is {row.state.value}.")
    return ChargeSummary(id=row.id, summary=row.results)


@router.get(
    "/{charge_id}/artifacts", operation_id="listChargeArtifacts", responses=problem_responses(404, 422)
)
def list_artifacts(charge_id: RowId, database: DatabaseDep) -> ArtifactList:
    """The files of a charge: report, pictures, result, time series."""
    with database.reading() as session:
        return ArtifactList.of(_charge(session, charge_id).artifacts)


@router.post(
    "/{charge_id}/cancel",
    status_code=202,
    operation_id="cancelCharge",
    responses=problem_responses(404, 409, 422),
)
def post_cancel(charge_id: RowId, database: DatabaseDep) -> ChargeAnswer:
    """Stop a charge. A queued one ends now, a running one within a second or two."""
    with database.writing() as session:
        job = _charge(session, charge_id).job
        assert job is not None, "every charge has its job"
        try:
            cancel_job(session, job.id)
        except JobNotCancellable as error:
            raise Conflict(f"Charge {charge_id} cannot be cancelled: {error}.") from error
        session.flush()
        session.expire_all()
        return ChargeAnswer.of(_charge(session, charge_id))


def _charge(session: Session, charge_id: int) -> ChargeView:
    view = read_charges.open_charge(session, charge_id)
    if view is None:
        raise NotFound(f"There is no charge {charge_id}.")
    return view
