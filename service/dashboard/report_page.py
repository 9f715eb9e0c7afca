"""Reports to keep: a study or a diagnosis as one page with everything in it, for mail, print and years from now.

No script and nothing fetched: style and pictures are inside, and the page works from a disk. What was asked, what
was assumed, what came out with its uncertainty, how it was checked, and the request that asks for the same again.
"""

from __future__ import annotations

import base64
import hashlib
import json
from functools import lru_cache
from importlib.metadata import version
from importlib.resources import files
from typing import Any

from fastapi import APIRouter, Request, Response

from demcore.rig import FEWEST_DIAMETERS
from service.code_version import demcore_hash
from service.dashboard.angle_plot import draw_angles
from service.dashboard.diagnosis_page import read_diagnosis_page
from service.dashboard.pages import database_of, parse_id
from service.dashboard.rendering import POLICY, PageRoute, page
from service.dashboard.study_page import count_verdicts, read_study_page
from service.dashboard.words import DIAGNOSIS_STATES, DIAGNOSIS_TONES, DIAGNOSIS_VERDICTS
from service.db.models import ArtifactRow
from service.domain.diagnosis import request_of as diagnosis_request_of
from service.domain.spec_record import primary_response, request_of
from service.errors import NotFound
from service.file_store import artifact_store
from service.settings import Settings

router = APIRouter(include_in_schema=False, route_class=PageRoute)


@lru_cache(maxsize=1)
def style() -> str:
    """The reports' style sheet."""
    return files("service.dashboard").joinpath("templates/report.css").read_text(encoding="utf-8")


def policy() -> str:
    """The pages' own, and this one style sheet inside the page."""
    digest = base64.b64encode(hashlib.sha256(style().encode()).digest()).decode()
    return POLICY.replace("style-src 'self'", f"style-src 'sha256-{digest}'")


@router.get("/studies/{study_id}/report")
def study_report(request: Request, study_id: str) -> Response:
    """A study to keep."""
    with database_of(request).reading() as session:
        shown = read_study_page(session, parse_id(study_id, "study"))
    if shown is None:
        raise NotFound(f"There is no study {study_id}.")
    study, designs = shown.study, shown.snapshot.designs
    target = primary_response(study.spec)["target"]
    return _report(
        "report_study.html",
        f"study-{study.id}",
        page=shown,
        study=study,
        counts=count_verdicts(shown),
        fewest_diameters=FEWEST_DIAMETERS,
        plot=draw_angles(designs, shown.window, target, shown.chosen),
        picture=_embedded(request, shown.picture),
        request=json.dumps(request_of(study.spec), indent=1),
    )


@router.get("/diagnoses/{diagnosis_id}/report")
def diagnosis_report(request: Request, diagnosis_id: str) -> Response:
    """A diagnosis, or a plan, to keep."""
    with database_of(request).reading() as session:
        shown = read_diagnosis_page(session, parse_id(diagnosis_id, "diagnosis"))
    if shown is None:
        raise NotFound(f"There is no diagnosis {diagnosis_id}.")
    return _report(
        "report_diagnosis.html",
        f"diagnosis-{shown.diagnosis.id}",
        shown=shown,
        diagnosis=shown.diagnosis,
        result=shown.result,
        verdicts=DIAGNOSIS_VERDICTS,
        tones=DIAGNOSIS_TONES,
        states=DIAGNOSIS_STATES,
        picture=_embedded(request, shown.card),
        request=json.dumps(diagnosis_request_of(shown.diagnosis.spec), indent=1),
    )


def _report(template: str, name: str, **context: Any) -> Response:
    headers = {
        "Content-Security-Policy": policy(),
        "Content-Disposition": f'inline; filename="{name}.html"',
    }
    made_by = {"version": version("talus"), "code": demcore_hash()[:16], "style": style()}
    return page(template, 200, headers, **made_by, **context)


def _embedded(request: Request, artifact: ArtifactRow | None) -> str | None:
    """The file as a data address; None where there is none, or it was removed by retention."""
    if artifact is None:
        return None
    settings = request.app.state.settings
    assert isinstance(settings, Settings)
    path = artifact_store(settings).local(artifact.path)
    if not path.is_file():
        return None
    return f"data:{artifact.media_type};base64,{base64.b64encode(path.read_bytes()).decode()}"
