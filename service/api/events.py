"""A study's events as a stream (server-sent events)."""

from __future__ import annotations

from collections.abc import AsyncIterable
from typing import Annotated

from fastapi import APIRouter, Depends, Header
from fastapi.sse import EventSourceResponse, ServerSentEvent
from starlette.exceptions import HTTPException

from service.api.dependencies import LARGEST_ID, DatabaseDep, RowId
from service.api.problems import problem_responses
from service.api.studies import no_study
from service.db import read_models
from service.db.models import StudyRow
from service.db.session import Database
from service.domain.states import is_over
from service.progress import Glance, Look, StreamItem, follow

router = APIRouter(prefix="/v1/studies", tags=["studies"])

LastEventId = Annotated[
    int | None, Header(ge=0, le=LARGEST_ID, description="the id of the last event that the client has")
]


def look_at(database: Database, study_id: int) -> Look:
    """What `service.progress.follow` asks again and again for one study."""

    def look(after: int) -> Glance:
        with database.reading() as session:
            study = session.get(StudyRow, study_id)
            rows = read_models.events_after(session, study_id, after)
            running = read_models.running_designs(session, study_id)
            return Glance(
                events=[StreamItem(row.kind, row.data, row.id) for row in rows],
                progress=[
                    StreamItem("progress", {"number": number, "attempt": job.attempt, **(job.progress or {})})
                    for number, job in running
                ],
                # The report on a study that is over comes a little later, and is told too.
                is_over=study is None
                or (is_over(study.state) and not read_models.has_open_report(session, study_id)),
            )

    return look


def opened(study_id: RowId, database: DatabaseDep, last_event_id: LastEventId = None) -> tuple[Look, int]:
    """Refuses an unknown study; answers 204 where nothing more can come, so that EventSource stops asking."""
    after = last_event_id or 0
    look = look_at(database, study_id)
    with database.reading() as session:
        if session.get(StudyRow, study_id) is None:
            raise no_study(study_id)
    glance = look(after)
    if glance.is_over and not glance.events:
        raise HTTPException(204)
    return look, after


@router.get(
    "/{study_id}/events",
    operation_id="followStudy",
    response_class=EventSourceResponse,
    responses={
        204: {"description": "The study is over and all of it was told"},
        **problem_responses(404, 422),
    },
)
async def follow_study(
    stream: Annotated[tuple[Look, int], Depends(opened)],
) -> AsyncIterable[ServerSentEvent]:
    """Everything that happened since Last-Event-ID, then what happens next, until the study is over.

    Events: study_created, study_imported, study_paused, study_resumed, budget_extended, design_proposed,
    design_started, design_returned, design_finished, study_stopping, study_goes_on (the last results took the stop
    back), study_finished, report_written; between them `progress` (without an id) of the simulations that run.
    """
    look, after = stream
    async for item in follow(look, after):
        yield ServerSentEvent(data=item.data, event=item.kind, id=None if item.id is None else str(item.id))
