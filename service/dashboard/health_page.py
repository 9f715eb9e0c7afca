"""The page of the installation itself: who works, what waits, how attempts ended, how much room is left."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fastapi import APIRouter, Request, Response
from sqlalchemy.engine import make_url
from sqlalchemy.orm import Session

from service.dashboard import formats
from service.dashboard.design_page import Figure
from service.dashboard.overview_page import HealthItem, health_items
from service.dashboard.pages import database_of, draw_parts, parts_answer
from service.dashboard.rendering import PageRoute, page
from service.dashboard.words import FAILURES, JOB_KINDS
from service.db import dashboard_reads, metric_reads, migrate, queries
from service.db.models import ProcessRow
from service.domain.states import JobKind, JobState
from service.settings import Settings

router = APIRouter(include_in_schema=False, route_class=PageRoute)

PARTS = ("health", "processes", "work")
STATES: Mapping[JobState, str] = {
    JobState.QUEUED: "waiting",
    JobState.RUNNING: "running",
    JobState.DONE: "done",
    JobState.FAILED: "failed",
    JobState.CANCELLED: "stopped",
}
ENDS: Mapping[str, str] = {
    "done": "came to its end",
    "lost": "its worker died; done again",
    "late": "its worker was late; done again",
    "cancelled": "stopped by a user",
    "released": "given back at a shutdown",
    "disk_full": "given back for want of room",
    "store_away": "given back: the store of files was away",
}


@dataclass(frozen=True)
class ProcessLine:
    """A process that reported lately."""

    process: ProcessRow
    now: float

    @property
    def silent_s(self) -> float:
        return max(self.now - self.process.seen_at, 0.0)

    @property
    def runs_s(self) -> float:
        return max(self.now - self.process.started_at, 0.0)


@dataclass(frozen=True)
class HealthPage:
    """Everything that the templates of the page read; `jobs`: for each kind, how many are in each of STATES."""

    health: Sequence[HealthItem]
    processes: Sequence[ProcessLine]
    jobs: Sequence[tuple[str, Sequence[int]]]
    ends: Sequence[tuple[str, int]]
    queue: Sequence[Figure]
    storage: Sequence[Figure]
    promises: Sequence[Figure]

    @property
    def states(self) -> Sequence[str]:
        return list(STATES.values())


def read_health_page(session: Session, settings: Settings) -> HealthPage:
    """At this moment."""
    now, health = queries.now(session), dashboard_reads.health(session)
    return HealthPage(
        health=health_items(health),
        processes=[ProcessLine(row, now) for row in (*health.dispatchers, *health.workers)],
        jobs=_jobs(session),
        ends=[(_end(name), count) for name, count in sorted(metric_reads.attempts_by_end(session))],
        queue=(
            Figure("Longest wait", formats.duration(metric_reads.longest_wait_s(session)), "of a queued job"),
            Figure(
                "Wait for room",
                formats.count(metric_reads.paused_jobs(session)),
                "jobs that found the disk full",
            ),
        ),
        storage=_storage(session, settings),
        promises=_promises(settings),
    )


def _jobs(session: Session) -> Sequence[tuple[str, Sequence[int]]]:
    counted = {(kind, state): count for kind, state, count in metric_reads.jobs_by_kind_and_state(session)}
    kinds = [kind for kind in JobKind if any(counted.get((kind, state)) for state in STATES)]
    return [(JOB_KINDS[kind.value], [counted.get((kind, state), 0) for state in STATES]) for kind in kinds]


def _end(name: str) -> str:
    return ENDS.get(name) or f"failed: {FAILURES.get(name, name)}"


def _storage(session: Session, settings: Settings) -> Sequence[Figure]:
    disk = shutil.disk_usage(settings.data_dir)
    return (
        Figure(
            "Files of runs",
            formats.size(metric_reads.artifact_bytes(session)),
            "a shared one counted each time",
        ),
        Figure(
            "Free on the disk",
            f"{formats.size(disk.free)} of {formats.size(disk.total)}",
            "of the data folder",
        ),
        Figure("Database", make_url(settings.resolved_database_url).get_backend_name(), ""),
        Figure("Schema", migrate.current_revision(session) or formats.NOTHING, "revision of the tables"),
        Figure("Store of files", "object store" if settings.store_url else "data folder", ""),
    )


def _promises(settings: Settings) -> Sequence[Figure]:
    """What an operator has set; no address and no key."""
    return (
        Figure("Lease", formats.duration(settings.lease_seconds), "a dead worker is noticed within it"),
        Figure(
            "Checkpoint every", formats.duration(settings.checkpoint_seconds), "at most so much work is lost"
        ),
        Figure("Threads a worker", formats.count(settings.threads), ""),
        Figure("Keys", "asked for" if settings.asks_for_keys else "not asked for", ""),
    )


@router.get("/health")
def health(request: Request) -> Response:
    """The installation."""
    return page("health.html", shown=_read(request))


@router.get("/health/parts")
def health_parts(request: Request) -> Response:
    """What changes on its page."""
    shown = _read(request)
    return parts_answer(0, False, draw_parts(PARTS, shown=shown, overview=shown))


def _read(request: Request) -> HealthPage:
    settings = request.app.state.settings
    assert isinstance(settings, Settings)
    with database_of(request).reading() as session:
        return read_health_page(session, settings)
