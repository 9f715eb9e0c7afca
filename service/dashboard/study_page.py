"""One study as its page shows it: the headline, the running jobs, the designs, the best pile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy.orm import Session

from service.dashboard import charts, formats, words
from service.dashboard.gauge import Gauge, draw_gauge
from service.dashboard.reported_study import ReportedStudy
from service.dashboard.words import Word
from service.db import dashboard_reads, read_models
from service.db.dashboard_reads import Health, StudySnapshot
from service.db.models import ArtifactRow, DesignRow, ReportRow, StudyRow
from service.db.read_models import DesignView
from service.domain.noise import RunNoise
from service.domain.spec_record import primary_response
from service.domain.states import StudyState, Verdict, is_over
from service.studies.read_noise import read_noise

# The certificate's demand on the window (worker/optimizer/acquisition.py, calibration.md decision 5).
WINDOW_PROBABILITY = 0.99


@dataclass(frozen=True)
class Headline:
    """What the study has found. `is_posterior`: `angle_deg` is the model's, else of one simulation."""

    verdict: Word
    tone: str
    is_certified: bool
    is_posterior: bool
    angle_deg: float | None
    spread_deg: float | None
    window_probability: float | None
    repeats_deg: tuple[float, ...]
    x: Mapping[str, float]
    numbers: tuple[int, ...]
    reason: str | None
    gauge: Gauge


@dataclass(frozen=True)
class Check:
    """One demand of the certificate, and how the recommended parameters stand to it."""

    name: str
    demand: str
    value: str
    holds: bool


@dataclass(frozen=True)
class StudyPage(ReportedStudy):
    """Everything that the templates of a study read."""

    snapshot: StudySnapshot
    headline: Headline
    shown: DesignView | None
    health: Health
    known: ReportRow | None = None
    noise: tuple[RunNoise, ...] = ()

    @property
    def can_be_changed(self) -> bool:
        return self.study.state in (StudyState.RUNNING, StudyState.PAUSED)

    @property
    def used(self) -> int:
        return self.study.feasible + self.study.unfeasible + self.study.error

    @property
    def seconds(self) -> float:
        """From the study's start to its end, or until now."""
        return (self.study.ended_at or self.snapshot.now) - self.study.created_at

    @property
    def parameters(self) -> tuple[str, ...]:
        return tuple(self.study.spec["variables"])

    @property
    def window(self) -> tuple[float, float]:
        lower, upper = primary_response(self.study.spec)["window"]
        return lower, upper

    @property
    def chosen(self) -> frozenset[int]:
        """Numbers of the designs that the headline is about."""
        return frozenset(self.headline.numbers)

    @property
    def picture(self) -> ArtifactRow | None:
        return picture_of(self.shown)

    @property
    def results(self) -> Mapping[str, Any]:
        """Of the pile that is shown; empty where there is none."""
        return (self.shown.design.results if self.shown else None) or {}

    @property
    def charts(self) -> dict[str, Any]:
        designs = self.snapshot.designs
        return {
            "angle": charts.angle_chart(self.study, designs, self.chosen),
            "profile": charts.profile_chart(self.shown.design if self.shown else None),
        }

    @property
    def checks(self) -> list[Check]:
        """The certificate's demands; empty without a recommendation."""
        found, spec = self.study.recommendation, self.study.spec
        return certificate_checks(found, spec) if found is not None else []

    @property
    def problems(self) -> list[str]:
        """Why nothing happens, if so."""
        if self.is_over:
            return []
        found = []
        if not self.health.dispatchers:
            found.append("The dispatcher does not report, so no job reaches a worker.")
        if not self.health.workers:
            found.append("No worker reports, so nothing is simulated until one starts (make serve).")
        return found + [row.problem for row in self.health.dispatchers if row.problem]


def read_study_page(session: Session, study_id: int) -> StudyPage | None:
    """None: there is no such study."""
    snapshot = dashboard_reads.open_study(session, study_id)
    if snapshot is None:
        return None
    headline = headline_of(snapshot.study, snapshot.designs)
    shown = next((row.id for row in snapshot.designs if row.number in headline.numbers and row.verdict), None)
    view = read_models.open_design(session, shown) if shown is not None else None
    known = read_models.newest_report(session, study_id)
    noise = read_noise(session, snapshot.study)
    return StudyPage(snapshot, headline, view, dashboard_reads.health(session), known, noise)


def picture_of(view: DesignView | None) -> ArtifactRow | None:
    """The pile's picture, if it was drawn."""
    files = view.artifacts if view is not None else ()
    return next((row for row in files if row.kind == "picture"), None)


def headline_of(study: StudyRow, designs: Any) -> Headline:
    """The recommendation where there is one, else the simulation nearest to the target."""
    response = primary_response(study.spec)
    lower, upper = response["window"]
    verdict, tone = _verdict(study)
    found = study.recommendation
    if found is not None:
        mean, half = found.get("mean_deg"), found.get("half_width_90_deg")
        repeats = tuple(found.get("replicates_deg") or ())
        return Headline(
            verdict=verdict,
            tone=tone,
            is_certified=bool(found.get("certified")),
            is_posterior=True,
            angle_deg=mean,
            spread_deg=half,
            window_probability=found.get("window_probability"),
            repeats_deg=repeats,
            x=found.get("x") or {},
            numbers=tuple(found.get("numbers") or ()),
            reason=study.stop_text or study.pause_text,
            gauge=draw_gauge((lower, upper), response["target"], mean, half, repeats),
        )
    best = nearest(designs, response["target"])
    angle = best.angle_deg if best is not None else None
    return Headline(
        verdict=verdict,
        tone=tone,
        is_certified=False,
        is_posterior=False,
        angle_deg=angle,
        spread_deg=best.angle_sd_deg if best is not None else None,
        window_probability=None,
        repeats_deg=(),
        x=best.x if best is not None else {},
        numbers=(best.number,) if best is not None else (),
        reason=study.stop_text or study.pause_text,
        gauge=draw_gauge((lower, upper), response["target"], angle),
    )


def nearest(designs: Any, target_deg: float) -> DesignRow | None:
    """The design whose angle is nearest to the target; the first of equals."""
    seen = [row for row in designs if row.angle_deg is not None]
    return min(seen, key=lambda row: abs(row.angle_deg - target_deg), default=None)


def _verdict(study: StudyRow) -> tuple[Word, str]:
    if study.state is StudyState.FAILED:
        return words.STOPS["error"], "bad"
    if study.recommendation is not None and study.recommendation.get("certified"):
        return words.STOPS["certified"], "good"
    if is_over(study.state):
        return words.STOPS.get(study.stop_reason or "", Word("Not certified", "The study is over.")), "doubt"
    if study.state is StudyState.PAUSED:
        return words.look_up(words.PAUSES, study.pause_reason), "doubt"
    return Word("Not certified yet", "The study goes on until it is sure, or its budget is spent."), "busy"


def certificate_checks(found: Mapping[str, Any], spec: Mapping[str, Any]) -> list[Check]:
    """The stored figures of a recommendation beside what the study asked for."""
    miss, inside = found.get("expected_miss_deg"), found.get("window_probability")
    seeds, tolerance = len(found.get("replicates_deg") or ()), primary_response(spec)["tolerance"]
    lower, upper = primary_response(spec)["window"]
    window = f"of {formats.plain_degrees(lower)} to {formats.plain_degrees(upper)}: at least "
    return [
        Check(
            "Expected distance from the target",
            f"at most {formats.plain_degrees(tolerance)}",
            formats.degrees(miss),
            miss is not None and miss <= tolerance,
        ),
        Check(
            "Sure to be inside the window",
            window + formats.percent(WINDOW_PROBABILITY),
            formats.chance(inside),
            inside is not None and inside >= WINDOW_PROBABILITY,
        ),
        Check(
            "Simulations with different seeds",
            f"at least {spec['replicates']}",
            str(seeds),
            seeds >= spec["replicates"],
        ),
    ]


def count_verdicts(page: StudyPage) -> dict[str, int]:
    """How many rows each filter of the table shows."""
    rows = page.snapshot.designs
    found = {verdict.value: sum(row.verdict is verdict for row in rows) for verdict in Verdict}
    return {"all": len(rows), **found, "open": sum(row.verdict is None for row in rows)}
