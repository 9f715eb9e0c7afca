"""Diagnoses as their pages show them: a list, and each with its card, claims, limits, gain, cost and files.

The routes are here too: these pages share nothing with the studies' but how a page is drawn and kept up to date.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fastapi import APIRouter, Request, Response
from sqlalchemy.orm import Session

from service.dashboard.formats import NOTHING
from service.dashboard.pages import Before, database_of, draw_parts, list_page, parse_id, parts_answer
from service.dashboard.rendering import PageRoute, page
from service.dashboard.words import DIAGNOSIS_STATES, DIAGNOSIS_TONES, DIAGNOSIS_VERDICTS, parameter_name
from service.db import read_diagnoses
from service.db.models import ArtifactRow, DataSetRow, DiagnosisRow, JobRow
from service.db.read_diagnoses import DiagnosisView
from service.domain.claims import ClaimCheck, JudgedClaim
from service.domain.effect_words import estimate_in_words, size_in_words
from service.domain.effects import library
from service.domain.states import OPEN_JOBS, is_over
from service.domain.verdict_words import is_one_likely
from service.errors import NotFound

router = APIRouter(include_in_schema=False, route_class=PageRoute)

PAGE_SIZE = 50
PARTS = (
    "diagnosis_state",
    "diagnosis_card",
    "diagnosis_claims",
    "diagnosis_checks",
    "diagnosis_limits",
    "diagnosis_parameters",
    "diagnosis_files",
)


@dataclass(frozen=True)
class ClaimLine:
    """One claim in words: what it is, how large with its interval, how sure, what would settle it, and what checks
    made of it."""

    effect: str
    what: str
    size: str
    inclusion: float
    level: str
    check: str
    is_withdrawn: bool
    checks: Sequence[ClaimCheck]


@dataclass(frozen=True)
class Calibrated:
    """One contact parameter of a material without any effect, with its 90 % interval."""

    material: str
    name: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Outlook:
    """One cause in a plan: sizes as text, a dash beyond what is physical."""

    effect: str
    what: str
    verdict: str
    detectable_from: str
    nameable_from: str
    alike: Sequence[str]


@dataclass(frozen=True)
class DiagnosisPage:
    """Everything that the templates of one diagnosis read."""

    view: DiagnosisView
    data_set: DataSetRow

    @property
    def diagnosis(self) -> DiagnosisRow:
        return self.view.diagnosis

    @property
    def job(self) -> JobRow | None:
        return self.view.job

    @property
    def result(self) -> Mapping[str, Any]:
        return self.view.results or {}

    @property
    def is_over(self) -> bool:
        return is_over(self.diagnosis.state)

    @property
    def can_stop(self) -> bool:
        return self.job is not None and self.job.state in OPEN_JOBS

    @property
    def is_plan(self) -> bool:
        return self.diagnosis.spec.get("plan") is not None

    @property
    def outlooks(self) -> Sequence[Outlook]:
        """Of a plan: each cause, how sure one could be of it, and from which size on."""
        known = library()
        return [
            Outlook(
                effect=found["effect"],
                what=known[found["effect"]].what if found["effect"] in known else "",
                verdict=found["verdict"],
                detectable_from=_size(found, "detectable_from"),
                nameable_from=_size(found, "nameable_from"),
                alike=found["alike"],
            )
            for found in self.result.get("effects", ())
        ]

    @property
    def card(self) -> ArtifactRow | None:
        return next((a for a in self.view.artifacts if a.kind == "card"), None)

    @property
    def progress(self) -> Mapping[str, Any]:
        return (self.job.progress if self.job is not None else None) or {}

    @property
    def claims(self) -> Sequence[ClaimLine]:
        found = zip(self.result.get("claims", ()), self.view.claims, strict=True)
        return [_claim(claim, checked) for claim, checked in found]

    @property
    def calibrated(self) -> Sequence[Calibrated]:
        """The baseline on the conditions learnt from; none where it was not kept."""
        kept = self.result.get("baseline") or {}
        return [
            Calibrated(material, parameter_name(name), found["value"], *found["ci90"])
            for material, parameters in kept.get("parameters", {}).items()
            for name, found in parameters.items()
        ]

    @property
    def possible(self) -> Sequence[tuple[str, str, float]]:
        """Of what is not excluded: effect, what it is, how probable it is that it is needed."""
        known = library()
        return [
            (item["effect"], known[item["effect"]].what if item["effect"] in known else "", item["inclusion"])
            for item in self.result.get("also_possible", ())
        ]

    @property
    def is_one_likely(self) -> bool:
        return is_one_likely(self.diagnosis.verdict, self.result)

    @property
    def limits(self) -> Sequence[tuple[str, str, str]]:
        """Effect, what it is, and the size in plant words from which on these data would show it."""
        known = library()
        return [
            (
                limit["effect"],
                known[limit["effect"]].what if limit["effect"] in known else "",
                _size(limit, "detectable_from"),
            )
            for limit in self.result.get("limits", ())
        ]


def _claim(claim: Mapping[str, Any], checked: JudgedClaim) -> ClaimLine:
    size, name = claim["amplitude"], claim["effect"]
    effect = next((e for e in library().effects if e.id == name), None)
    return ClaimLine(
        effect=name,
        what=name if effect is None else effect.what,
        size=estimate_in_words(name, size["value"], (size["ci90"][0], size["ci90"][1]), size["unit"]),
        inclusion=claim["inclusion"],
        level=claim["level"],
        check="" if effect is None else effect.check.what,
        is_withdrawn=checked.is_withdrawn,
        checks=checked.checks,
    )


def _size(found: Mapping[str, Any], which: str) -> str:
    size = found[which]
    return NOTHING if size is None else size_in_words(found["effect"], size, found["unit"])


def read_diagnosis_page(session: Session, diagnosis_id: int) -> DiagnosisPage | None:
    """None where there is none."""
    view = read_diagnoses.open_diagnosis(session, diagnosis_id)
    if view is None:
        return None
    return DiagnosisPage(view, session.get_one(DataSetRow, view.diagnosis.data_set_id))


@router.get("/diagnoses")
def diagnoses(request: Request, before: Before = None) -> Response:
    """All diagnoses, newest first."""
    context = _list_context(request, before)
    return list_page("diagnoses", "What simulations get wrong", "diagnosis", before, context)


@router.get("/diagnoses/parts")
def diagnoses_parts(request: Request, before: Before = None) -> Response:
    """What changes on the list."""
    return parts_answer(0, False, draw_parts(("diagnoses",), **_list_context(request, before)))


@router.get("/diagnoses/{diagnosis_id}")
def diagnosis(request: Request, diagnosis_id: str) -> Response:
    """One diagnosis."""
    return page("diagnosis.html", **_context(request, diagnosis_id))


@router.get("/diagnoses/{diagnosis_id}/parts")
def diagnosis_parts(request: Request, diagnosis_id: str) -> Response:
    """What changes on its page."""
    context = _context(request, diagnosis_id)
    return parts_answer(0, context["shown"].is_over, draw_parts(PARTS, **context))


def _list_context(request: Request, before: int | None) -> dict[str, Any]:
    with database_of(request).reading() as session:
        views = read_diagnoses.list_diagnoses(session, PAGE_SIZE + 1, before)
    return {
        "views": views[:PAGE_SIZE],
        "older": views[PAGE_SIZE - 1].diagnosis.id if len(views) > PAGE_SIZE else None,
        "is_first": before is None,
        "before": before,
        "verdicts": DIAGNOSIS_VERDICTS,
        "tones": DIAGNOSIS_TONES,
        "states": DIAGNOSIS_STATES,
    }


def _context(request: Request, diagnosis_id: str) -> dict[str, Any]:
    with database_of(request).reading() as session:
        shown = read_diagnosis_page(session, parse_id(diagnosis_id, "diagnosis"))
    if shown is None:
        raise NotFound(f"There is no diagnosis {diagnosis_id}.")
    return {
        "shown": shown,
        "diagnosis": shown.diagnosis,
        "result": shown.result,
        "verdicts": DIAGNOSIS_VERDICTS,
        "tones": DIAGNOSIS_TONES,
        "states": DIAGNOSIS_STATES,
    }
