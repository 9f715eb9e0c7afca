"""The first page: whether the installation is well, what runs now, what ended in the last day, and all studies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy.orm import Session

from service.dashboard.ended_lately import Ended, read_ended
from service.dashboard.gauge import Gauge, draw_gauge
from service.db import dashboard_reads, queries, read_models
from service.db.dashboard_reads import Health, Observed, OpenJob
from service.db.models import StudyRow
from service.domain.spec_record import primary_response
from service.domain.states import is_over

STUDIES_A_PAGE = 25
NO_WORKER = "none reports; at its first start a worker compiles the simulation, for a minute or two"


@dataclass(frozen=True)
class StudyLine:
    """A study in the list. `best`: the observed angle nearest to the target."""

    study: StudyRow
    best: Observed | None
    now: float

    @property
    def is_over(self) -> bool:
        return is_over(self.study.state)

    @property
    def used(self) -> int:
        return self.study.feasible + self.study.unfeasible + self.study.error

    @property
    def gauge(self) -> Gauge | None:
        """None: there is no angle yet."""
        goal, found = primary_response(self.study.spec), self.study.recommendation or {}
        middle = found.get("mean_deg", self.best.angle_deg if self.best else None)
        if middle is None:
            return None
        lower, upper = goal["window"]
        return draw_gauge((lower, upper), goal["target"], middle, found.get("half_width_90_deg"))

    @property
    def seconds(self) -> float:
        return (self.study.ended_at or self.now) - self.study.created_at


@dataclass(frozen=True)
class HealthItem:
    """One thing that must work for jobs to be done."""

    name: str
    is_well: bool
    text: str


@dataclass(frozen=True)
class OverviewPage:
    """Everything that the overview's templates read.

    `ended`: of every kind, in the last day, on the first page only. `older`: the id to go on from, None at the
    end.
    """

    lines: Sequence[StudyLine]
    jobs: Sequence[OpenJob]
    health: Sequence[HealthItem]
    ended: Sequence[Ended]
    older: int | None
    is_first: bool

    @property
    def running(self) -> Sequence[OpenJob]:
        return [job for job in self.jobs if job.is_running]

    @property
    def waiting(self) -> int:
        return len(self.jobs) - len(self.running)


def read_overview(session: Session, before: int | None = None) -> OverviewPage:
    """Studies newest first; `before`: the last id of the page that came before."""
    rows = read_models.list_studies(session, STUDIES_A_PAGE + 1, before)
    shown = rows[:STUDIES_A_PAGE]
    now = queries.now(session)
    without = [row.id for row in shown if row.recommendation is None]
    angles = dashboard_reads.observed_angles(session, without) if without else {}
    return OverviewPage(
        lines=[StudyLine(row, _best(row, angles.get(row.id, ())), now) for row in shown],
        jobs=dashboard_reads.open_jobs(session),
        health=health_items(dashboard_reads.health(session)),
        ended=read_ended(session, now) if before is None else (),
        older=shown[-1].id if len(rows) > STUDIES_A_PAGE else None,
        is_first=before is None,
    )


def _best(study: StudyRow, seen: Sequence[Observed]) -> Observed | None:
    target = float(primary_response(study.spec)["target"])
    return min(seen, key=lambda one: abs(one.angle_deg - target), default=None)


def health_items(health: Health) -> Sequence[HealthItem]:
    """In the order in which a job passes them."""
    problems = [row.problem for row in health.dispatchers if row.problem]
    workers = len(health.workers)
    jobs = f"{health.running} running, {health.queued} waiting"
    return (
        HealthItem("Database", True, "answers"),
        HealthItem(
            "Dispatcher", bool(health.dispatchers), "runs" if health.dispatchers else "does not report"
        ),
        HealthItem(
            "Broker",
            bool(health.dispatchers) and not problems,
            problems[0] if problems else "takes messages" if health.dispatchers else "nobody looks at it",
        ),
        HealthItem("Workers", workers > 0, f"{workers} at work" if workers else NO_WORKER),
        HealthItem("Jobs", workers > 0 or not health.queued, jobs),
    )
