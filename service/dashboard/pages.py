"""The dashboard's addresses: its pages, and for each the parts of it that change while it is open.

A page is whole without any script. Its script listens to the study's events and then asks for the parts, which
are drawn by the same templates, so that there is one place that says how a row looks.
"""

from __future__ import annotations

import json
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response

from demcore.rig import FEWEST_DIAMETERS
from service.dashboard.charge_page import ChargePage, read_charge_list, read_charge_page
from service.dashboard.design_page import read_design_page
from service.dashboard.overview_page import OverviewPage, read_overview
from service.dashboard.rendering import HEADERS, PageRoute, page, render
from service.dashboard.study_page import StudyPage, count_verdicts, read_study_page
from service.db import dashboard_reads
from service.db.models import JobRow
from service.db.session import Database
from service.domain.access import Principal
from service.errors import NotFound
from service.scene.journal_file import JOURNAL
from service.settings import Settings

router = APIRouter(include_in_schema=False, route_class=PageRoute)

LARGEST_ID = 2**63 - 1

OVERVIEW_PARTS = ("studies", "ended", "jobs", "health")
STUDY_PARTS = ("headline", "used", "now", "best", "known", "controls", "assumptions", "problems")
CHARGE_PARTS = ("charge_state", "charge_findings", "charge_burden", "charge_series", "charge_files")
DESIGN_PARTS = ("design_outcome", "design_pile", "design_numbers", "jobs")

Before = Annotated[int | None, Query(ge=1, le=LARGEST_ID)]
After = Annotated[int, Query(ge=0, le=LARGEST_ID)]


def database_of(request: Request) -> Database:
    """The application's database, as whoever asks may see it."""
    database = request.app.state.database
    assert isinstance(database, Database)
    principal = request.state.principal
    assert isinstance(principal, Principal)
    return database.within(principal.project)


def parse_id(text: str, what: str) -> int:
    """A row's id from an address. A page that cannot exist is not found, rather than wrongly asked for."""
    if text.isascii() and text.isdigit() and 1 <= int(text[:20]) <= LARGEST_ID and len(text) <= 19:
        return int(text)
    raise NotFound(f"There is no {what} {text[:40]}.")


def parts_answer(cursor: int, is_over: bool, html: dict[str, str], **more: Any) -> Response:
    """The changing parts of a page by the id of their element."""
    content = {"cursor": cursor, "is_over": is_over, "html": html, **more}
    return Response(json.dumps(content, allow_nan=False), 200, dict(HEADERS), "application/json")


def draw_parts(names: tuple[str, ...], **context: Any) -> dict[str, str]:
    """Each part by its template."""
    return {name: render(f"parts/{name}.html", **context) for name in names}


def list_page(part: str, title: str, start: str, before: int | None, context: dict[str, Any]) -> Response:
    """A list that keeps itself up to date: `part` its template and its address, `start` what it is of."""
    more = "" if before is None else f"?before={before}"
    own: dict[str, Any] = {"heading": part.capitalize(), "title": title, "part": part, "start": start}
    return page("list.html", **own, parts=f"/{part}/parts{more}", **context)


@router.get("/")
def overview(request: Request, before: Before = None) -> Response:
    """All studies."""
    shown = _read_overview(request, before)
    return page("overview.html", overview=shown, jobs=shown.jobs, names_study=True)


@router.get("/parts")
def overview_parts(request: Request, before: Before = None) -> Response:
    """What changes on the overview."""
    shown = _read_overview(request, before)
    html = draw_parts(OVERVIEW_PARTS, overview=shown, jobs=shown.jobs, names_study=True)
    return parts_answer(0, False, html)


@router.get("/studies/{study_id}")
def study(request: Request, study_id: str) -> Response:
    """One study."""
    shown = _read_study(request, study_id)
    return page("study.html", **_study_context(shown))


@router.get("/studies/{study_id}/parts")
def study_parts(request: Request, study_id: str, after: After = 0) -> Response:
    """What changed on a study's page since the event `after`: of the table, only the rows concerned."""
    with database_of(request).reading() as session:
        shown = read_study_page(session, parse_id(study_id, "study"))
        # In this order: what happens in between is drawn too early rather than never.
        changed = dashboard_reads.changed_designs(session, parse_id(study_id, "study"), after)
    if shown is None:
        raise NotFound(f"There is no study {study_id}.")
    context = _study_context(shown)
    rows = {
        f"design-{row.number}": render("parts/design_row.html", row=row, **context)
        for row in shown.snapshot.designs
        if changed is None or row.number in changed
    }
    return parts_answer(
        shown.snapshot.cursor,
        shown.is_settled,
        draw_parts(STUDY_PARTS, **context),
        rows=rows,
        chosen=sorted(shown.chosen),
        counts=context["counts"],
        charts=shown.charts,
    )


@router.get("/designs/{design_id}")
def design(request: Request, design_id: str) -> Response:
    """One design."""
    return page("design.html", **_read_design(request, design_id))


@router.get("/designs/{design_id}/parts")
def design_parts(request: Request, design_id: str) -> Response:
    """What changes on a design's page: all of it, once, when the simulation ends."""
    context = _read_design(request, design_id)
    shown = context["page"]
    html = draw_parts(DESIGN_PARTS, **context)
    return parts_answer(
        shown.cursor, shown.is_over, html, charts=shown.charts, has_scene=bool(shown.view.artifacts)
    )


@router.get("/charges")
def charges(request: Request, before: Before = None) -> Response:
    """All charges of the hopper."""
    context = _read_charges(request, before)
    return list_page("charges", "Charges of the hopper", "charge", before, context)


@router.get("/charges/parts")
def charges_parts(request: Request, before: Before = None) -> Response:
    """What changes on the list of charges."""
    return parts_answer(0, False, draw_parts(("charges",), **_read_charges(request, before)))


@router.get("/charges/{charge_id}")
def charge(request: Request, charge_id: str) -> Response:
    """One charge."""
    return page("charge.html", **_charge_context(_read_charge(request, charge_id)))


@router.get("/charges/{charge_id}/parts")
def charge_parts(request: Request, charge_id: str) -> Response:
    """What changes on a charge's page."""
    shown = _read_charge(request, charge_id)
    html = draw_parts(CHARGE_PARTS, **_charge_context(shown))
    return parts_answer(
        0,
        shown.is_settled,
        html,
        charts=shown.charts,
        has_scene=bool(shown.line.view.artifacts),
        scene_size=_size_of_frames(request, None if shown.is_over else shown.line.view.job),
    )


def _size_of_frames(request: Request, job: JobRow | None) -> int:
    """Bytes of the frames that a charge under way has written: when they grow there is more to see; else 0."""
    settings = request.app.state.settings
    assert isinstance(settings, Settings)
    try:
        return 0 if job is None else (settings.series_folder(job.id) / JOURNAL).stat().st_size
    except OSError:
        return 0


def _read_charges(request: Request, before: int | None) -> dict[str, Any]:
    with database_of(request).reading() as session:
        return {"listed": read_charge_list(session, before)}


def _read_charge(request: Request, charge_id: str) -> ChargePage:
    with database_of(request).reading() as session:
        shown = read_charge_page(session, parse_id(charge_id, "charge"))
    if shown is None:
        raise NotFound(f"There is no charge {charge_id}.")
    return shown


def _charge_context(shown: ChargePage) -> dict[str, Any]:
    return {"page": shown, "charge": shown.charge, "jobs": shown.jobs, "names_study": False}


def _read_overview(request: Request, before: int | None) -> OverviewPage:
    with database_of(request).reading() as session:
        return read_overview(session, before)


def _read_study(request: Request, study_id: str) -> StudyPage:
    with database_of(request).reading() as session:
        shown = read_study_page(session, parse_id(study_id, "study"))
    if shown is None:
        raise NotFound(f"There is no study {study_id}.")
    return shown


def _study_context(shown: StudyPage) -> dict[str, Any]:
    return {
        "page": shown,
        "study": shown.study,
        "jobs": shown.snapshot.jobs,
        "names_study": False,
        "counts": count_verdicts(shown),
        "fewest_diameters": FEWEST_DIAMETERS,
    }


def _read_design(request: Request, design_id: str) -> dict[str, Any]:
    with database_of(request).reading() as session:
        shown = read_design_page(session, parse_id(design_id, "design"))
    if shown is None:
        raise NotFound(f"There is no design {design_id}.")
    context = {
        "page": shown,
        "study": shown.study,
        "design": shown.design,
        "results": shown.design.results or {},
    }
    return {**context, "jobs": shown.jobs, "names_study": False}
