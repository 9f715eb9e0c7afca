"""The page that sets any two things of a kind beside each other, and the lists to pick them from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from sqlalchemy.orm import Session

from service.dashboard.compared_things import (
    compare_charges,
    compare_designs,
    compare_studies,
    compare_versions,
)
from service.dashboard.comparison import Comparison, draw_outlines
from service.dashboard.pages import LARGEST_ID, database_of
from service.dashboard.rendering import PageRoute, page
from service.db import dashboard_reads, read_charges, read_diagnoses, read_models
from service.db.models import DesignRow
from service.errors import NotFound

router = APIRouter(include_in_schema=False, route_class=PageRoute)

MOST_OFFERED = 100
Chosen = Annotated[str, Query(max_length=20)]
Choices = Sequence[tuple[int, str]]


@dataclass(frozen=True)
class Kind:
    """`plural` and `one` name it; `compare` reads two of them by id."""

    one: str
    plural: str
    compare: Callable[[Session, int, int], Comparison]


KINDS: Mapping[str, Kind] = {
    "study": Kind("study", "Studies", compare_studies),
    "design": Kind("simulation", "Piles", compare_designs),
    "charge": Kind("charge", "Charges", compare_charges),
    "model": Kind("model version", "Model versions", compare_versions),
}


@router.get("/compare")
def compare(request: Request, kind: Chosen = "study", a: Chosen = "", b: Chosen = "") -> Response:
    """Two things of a kind, or the picker alone; what cannot be compared is told instead, never an error page."""
    found, refused, status = None, None, 200
    known = KINDS.get(kind)
    first, second = _number(a), _number(b)
    with database_of(request).reading() as session:
        if known is None:
            refused = f"There are no {kind} to compare: choose studies, piles, charges or model versions."
        elif first is not None and first == second:
            refused = f"Both are the same {known.one}: choose another."
        elif first is not None and second is not None:
            try:
                found = known.compare(session, first, second)
            except NotFound as error:
                refused, status = error.detail, 404
        elif (a and first is None) or (b and second is None):
            refused = "The numbers in the address are no ids."
        offered = _offered(session, kind if known else "study", first, second)
    return page(
        "compare.html",
        status,
        kinds=KINDS,
        kind=kind if known else "study",
        chosen=(first, second),
        offered=offered,
        refused=refused,
        found=found,
        outlines=None if found is None else draw_outlines(found.first, found.second),
    )


def _number(text: str) -> int | None:
    is_number = text.isascii() and text.isdigit() and len(text) <= 19
    return int(text) if is_number and 1 <= int(text) <= LARGEST_ID else None


def _offered(session: Session, kind: str, first: int | None, second: int | None) -> Choices:
    """Ids and what they are called, newest first; those that are chosen among them."""
    if kind == "study":
        studies = read_models.list_studies(session, MOST_OFFERED, None)
        return [(row.id, f"{row.id}: {row.material}, {row.state.value}") for row in studies]
    if kind == "charge":
        charges = [view.charge for view in read_charges.list_charges(session, MOST_OFFERED)]
        return [(row.id, f"{row.id}: {row.charge}, scale {row.scale:g}, seed {row.seed}") for row in charges]
    if kind == "model":
        versions = read_diagnoses.list_model_versions(session, MOST_OFFERED)
        return [(row.id, f"{row.id}: {row.name}") for row in versions]
    return _piles(session, first, second)


def _piles(session: Session, first: int | None, second: int | None) -> Choices:
    """Piles of the studies that the chosen ones are of; without any, of the newest study."""
    rows = [row for one in (first, second) if one is not None and (row := session.get(DesignRow, one))]
    ids = list(dict.fromkeys(row.study_id for row in rows))
    if not ids:
        ids = [row.id for row in read_models.list_studies(session, 1, None)]
    found = []
    for study_id in ids:
        snapshot = dashboard_reads.open_study(session, study_id)
        designs = snapshot.designs if snapshot is not None else ()
        found += [
            (row.id, f"study {study_id}, simulation {row.number}: {row.angle_deg:.2f}°")
            for row in designs
            if row.angle_deg is not None
        ]
    return found
