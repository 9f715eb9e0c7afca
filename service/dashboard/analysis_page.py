"""A study's analysis: its designs as columns, and of its report what is drawn. Linked and brushed in the browser.

The numbers come from rows and from the stored report, which a worker writes: nothing is fitted or predicted here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fastapi import APIRouter, Request, Response
from sqlalchemy.orm import Session

from service.dashboard import words
from service.dashboard.pages import After, database_of, draw_parts, parse_id, parts_answer
from service.dashboard.rendering import PageRoute, page
from service.dashboard.reported_study import ReportedStudy
from service.db import dashboard_reads, read_models
from service.db.dashboard_reads import StudySnapshot
from service.db.models import DesignRow, ReportRow, StudyRow
from service.domain.observables import OBSERVABLES
from service.domain.search_space import PARAMETERS
from service.errors import NotFound

router = APIRouter(include_in_schema=False, route_class=PageRoute)

PARTS = ("known",)
# What a chart needs of an effect; its Sobol indices are told with it.
EFFECT = ("name", "values", "means", "sds", "total_share", "total_share_error", "total_share_emulator_error")


@dataclass(frozen=True)
class AnalysisPage(ReportedStudy):
    """Everything that the analysis' templates read."""

    snapshot: StudySnapshot
    known: ReportRow | None

    @property
    def data(self) -> dict[str, Any]:
        """What the charts are drawn from."""
        report = self.report or {}
        return {
            "study": self.study.id,
            "columns": columns(self.study, self.snapshot.designs),
            "designs": design_columns(self.study, self.snapshot.designs),
            "verdicts": {key: word.text for key, word in words.VERDICTS.items()},
            "report": report_charts(report) if self.report_says_enough else None,
        }


def read_analysis(session: Session, study_id: int) -> AnalysisPage | None:
    """None: there is no such study."""
    snapshot = dashboard_reads.open_study(session, study_id)
    if snapshot is None:
        return None
    return AnalysisPage(snapshot, read_models.newest_report(session, study_id))


def columns(study: StudyRow, designs: Sequence[DesignRow]) -> list[dict[str, Any]]:
    """Every number that a design has: searched parameters, the study's responses, what else was measured."""
    searched = [
        {
            "name": name,
            "text": words.parameter_name(name),
            "meaning": words.parameter_meaning(name),
            "unit": parameter_unit(name),
            "kind": "parameter",
            "range": [limits["lower"], limits["upper"]],
        }
        for name, limits in study.spec["variables"].items()
    ]
    goals = {goal["observable"]: goal for goal in study.spec["responses"]}
    seen = {name for row in designs for name in row.responses or {}}
    # The study's own first, in its order; then the others in the order of the table of observables.
    names = [*goals, *(name for name in OBSERVABLES if name in seen and name not in goals)]
    return [*searched, *(_observed(name, goals.get(name)) for name in names)]


def _observed(name: str, goal: Mapping[str, Any] | None) -> dict[str, Any]:
    known = OBSERVABLES.get(name)
    return {
        "name": name,
        "text": words.OBSERVABLE_NAMES.get(name, name.replace("_", " ")),
        "meaning": known.meaning if known else name,
        "unit": words.UNITS.get(known.unit, known.unit) if known else "",
        "kind": "other" if goal is None else "response",
        "target": None if goal is None else goal["target"],
        "window": None if goal is None else goal["window"],
    }


def parameter_unit(name: str) -> str:
    """Contact parameters are ratios, but for moduli; their names say so."""
    return "Pa" if name in PARAMETERS and name.endswith("_pa") else ""


def design_columns(study: StudyRow, designs: Sequence[DesignRow]) -> dict[str, Any]:
    """The finished designs column by column: half of the bytes of rows with their keys."""
    done = [row for row in designs if row.verdict is not None]
    names = list(study.spec["variables"])
    seen = dict.fromkeys(name for row in done for name in row.responses or {})
    values = {
        **{name: [row.x.get(name) for row in done] for name in names},
        **{name: [_number((row.responses or {}).get(name)) for row in done] for name in seen},
    }
    return {
        "number": [row.number for row in done],
        "id": [row.id for row in done],
        "verdict": [row.verdict.value for row in done if row.verdict is not None],
        "origin": [words.look_up(words.ORIGINS, row.origin).text for row in done],
        "angle_sd": [_number(row.angle_sd_deg) for row in done],
        "predicted": [_number((row.prediction or {}).get("mean_deg")) for row in done],
        "predicted_sd": [_number((row.prediction or {}).get("sd_deg")) for row in done],
        "values": values,
    }


def _number(value: float | None) -> float | None:
    """Six digits are more than any chart shows."""
    return None if value is None else float(f"{value:.6g}")


def report_charts(report: Mapping[str, Any]) -> dict[str, Any]:
    """Effects, slices and posterior of a report of any version; what it lacks is empty."""
    cuts, posterior = report.get("slices") or {}, report.get("posterior") or {}
    return {
        "effects": {
            name: [{key: row.get(key) for key in EFFECT} for row in rows]
            for name, rows in (report.get("sensitivity") or {}).items()
        },
        "along": cuts.get("along") or [],
        "pairs": cuts.get("pairs") or ([cuts["over"]] if cuts.get("over") else []),
        "optimum": (report.get("optimum") or {}).get("x") or {},
        "posterior": {key: posterior.get(key) or [] for key in ("parameters", "correlations")},
        "draws": posterior.get("draws"),
    }


@router.get("/studies/{study_id}/analysis")
def analysis(request: Request, study_id: str) -> Response:
    """The page."""
    return page("analysis.html", **_context(request, study_id))


@router.get("/studies/{study_id}/analysis/parts")
def analysis_parts(request: Request, study_id: str, after: After = 0) -> Response:
    """What changes on it: all charts' data, when a design ended or a report was written."""
    context = _context(request, study_id)
    shown: AnalysisPage = context["page"]
    html = draw_parts(PARTS, **context)
    changed = {"analysis": shown.data} if shown.snapshot.cursor > after else {}
    return parts_answer(shown.snapshot.cursor, shown.is_settled, html, charts=changed)


def _context(request: Request, study_id: str) -> dict[str, Any]:
    with database_of(request).reading() as session:
        shown = read_analysis(session, parse_id(study_id, "study"))
    if shown is None:
        raise NotFound(f"There is no study {study_id}.")
    return {"page": shown, "study": shown.study}
