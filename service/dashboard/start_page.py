"""Forms that start work. They send what a program would send, and print it; the API checks and tells the cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response

from service.dashboard.pages import LARGEST_ID, database_of
from service.dashboard.rendering import PageRoute, page
from service.dashboard.start_fields import (
    FieldGroup,
    charge_fields,
    diagnosis_fields,
    measurement_fields,
    study_fields,
)
from service.db import read_diagnoses

router = APIRouter(include_in_schema=False, route_class=PageRoute, prefix="/new")

MOST_OFFERED = 100
ChosenSet = Annotated[int | None, Query(ge=1, le=LARGEST_ID)]


@dataclass(frozen=True)
class Form:
    """`path` takes the request, `estimate` says what it would cost; `call` is the notebook client's method, which
    takes the field `first` by its place and the others by name."""

    key: str
    title: str
    intro: str
    path: str
    estimate: str | None
    call: str
    button: str
    first: str = ""


FORMS = (
    Form(
        "study",
        "New study",
        "Finds the contact parameters with which a simulated pile has the repose angle of the real material.",
        "/v1/studies",
        "/v1/studies/estimate",
        "calibrate",
        "Start the study",
        "material",
    ),
    Form(
        "charge",
        "New charge",
        "Charges the hopper by belt and deflector, and measures where the burden lies.",
        "/v1/charges",
        "/v1/charges/estimate",
        "start_charges",
        "Start the charges",
        "charge",
    ),
    Form(
        "measurement",
        "New measurement",
        "Stores measured piles. Every bad cell is named; nothing is computed yet.",
        "/v1/measurements",
        None,
        "client.create_data_set",
        "Upload",
    ),
    Form(
        "diagnosis",
        "New diagnosis",
        "Compares measured piles with simulated ones, and names the cause of a difference where the data allow.",
        "/v1/diagnoses",
        "/v1/diagnoses/estimate",
        "diagnose_stored",
        "Start the diagnosis",
        "data_set",
    ),
)
NO_DATA = ("No measured data that can be diagnosed is stored yet:", "/new/measurement", "upload it first")
BY_KEY = {form.key: form for form in FORMS}


@router.get("/study")
def new_study(request: Request) -> Response:
    """Of a calibration."""
    with database_of(request).reading() as session:
        versions = read_diagnoses.list_model_versions(session, MOST_OFFERED, None)
    return _page("study", study_fields([row for row in versions if row.withdrawn_at is None]))


@router.get("/charge")
def new_charge() -> Response:
    """Of charges of the hopper."""
    return _page("charge", charge_fields())


@router.get("/measurement")
def new_measurement() -> Response:
    """Of measured tables."""
    return _page("measurement", measurement_fields())


@router.get("/diagnosis")
def new_diagnosis(request: Request, data_set: ChosenSet = None) -> Response:
    """Of a diagnosis of a stored data set; `data_set`: the one to begin with."""
    with database_of(request).reading() as session:
        stored = read_diagnoses.list_data_sets(session, MOST_OFFERED, None)
        versions = read_diagnoses.list_model_versions(session, MOST_OFFERED, None)
    held = [row for row in versions if row.withdrawn_at is None]
    usable = [row for row in stored if row.facts.get("can_be_diagnosed")]
    return _page("diagnosis", diagnosis_fields(usable, data_set, held), None if usable else NO_DATA)


def _page(key: str, groups: Sequence[FieldGroup], lead: tuple[str, str, str] | None = None) -> Response:
    """`lead`: what must come before, its address and its name."""
    return page("start.html", form=BY_KEY[key], forms=FORMS, groups=groups, lead=lead)
