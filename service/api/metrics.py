"""What Prometheus reads: how much work there is, how it ended, who is there.

Counted from the tables at each request, so that every API process says the same and nothing is lost with one."""

from __future__ import annotations

from collections.abc import Iterable

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from sqlalchemy.orm import Session

from service.api.dependencies import DatabaseDep
from service.api.health import SILENCE_S
from service.api.problems import problem_responses
from service.db import metric_reads, read_models

router = APIRouter(tags=["health"])

METRICS_PATH = "/metrics"
ROLES = ("dispatcher", "worker")


class Tables(Collector):
    """The metrics of one moment."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def collect(self) -> Iterable[Metric]:
        """Gauges for what is, counters for what ended."""
        jobs = GaugeMetricFamily("talus_jobs", "Jobs by kind and state.", labels=("kind", "state"))
        for kind, state, count in metric_reads.jobs_by_kind_and_state(self._session):
            jobs.add_metric((kind.value, state.value), count)
        yield jobs
        studies = GaugeMetricFamily("talus_studies", "Studies by state.", labels=("state",))
        for study_state, count in metric_reads.studies_by_state(self._session):
            studies.add_metric((study_state.value,), count)
        yield studies
        attempts = CounterMetricFamily(
            "talus_attempts", "Ended attempts by their end.", labels=("exit_class",)
        )
        for exit_class, count in metric_reads.attempts_by_end(self._session):
            attempts.add_metric((exit_class,), count)
        yield attempts
        waited = metric_reads.longest_wait_s(self._session)
        yield GaugeMetricFamily("talus_queue_wait_seconds", "Age of the oldest queued job.", value=waited)
        paused = metric_reads.paused_jobs(self._session)
        yield GaugeMetricFamily(
            "talus_paused_jobs", "Queued jobs that wait for room on the disk.", value=paused
        )
        stored = CounterMetricFamily("talus_artifact_bytes", "Bytes of all files that were stored.")
        stored.add_metric((), metric_reads.artifact_bytes(self._session))
        yield stored
        there = GaugeMetricFamily("talus_processes", "Processes that reported lately.", labels=("role",))
        for role in ROLES:
            there.add_metric((role,), len(read_models.seen_lately(self._session, role, SILENCE_S)))
        yield there


@router.get(
    METRICS_PATH,
    operation_id="getMetrics",
    response_class=Response,
    responses={
        200: {
            "description": "Prometheus' text format",
            "content": {"text/plain": {"schema": {"type": "string"}}},
        },
        **problem_responses(),
    },
)
def get_metrics(database: DatabaseDep) -> Response:
    """Metrics for Prometheus."""
    registry = CollectorRegistry()
    with database.reading() as session:
        registry.register(Tables(session))
        content = generate_latest(registry)
    return Response(content, media_type=CONTENT_TYPE_LATEST)
