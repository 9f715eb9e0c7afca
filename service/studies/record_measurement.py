"""Record a finished pile test: results, files, verdict, counters and state in one transaction."""

from __future__ import annotations

from sqlalchemy.orm import Session

from service.db import queries
from service.db.models import DesignRow
from service.db.queries import Lease
from service.domain.outcome import PileMeasurement, RunCost, judge
from service.domain.spec_record import spec_from_record
from service.domain.states import DesignState, JobState, Verdict, require_change
from service.studies.advance_study import advance_study
from service.studies.close_run import close_run
from service.studies.finish_job import finish_job
from service.studies.keep_files import keep_files
from service.studies.record_event import record_design_event


def record_measurement(
    session: Session, lease: Lease, measurement: PileMeasurement, cost: RunCost | None = None
) -> bool:
    """False: the lease was lost, nothing is written."""
    ended = finish_job(session, lease, JobState.DONE)
    if ended is None or ended.design is None:
        return False
    study, design = ended.study, ended.design
    require_change(design.state, DesignState.COMPLETE)
    design.state = DesignState.COMPLETE
    design.ended_at = queries.now(session)
    design.angle_deg = measurement.angle_deg
    design.angle_sd_deg = measurement.angle_sd_deg
    design.literal_angle_deg = measurement.literal_angle_deg
    design.results = dict(measurement.results)
    design.responses = measurement.observed
    design.verdict = judge(spec_from_record(study.spec).responses, design.responses)
    if design.verdict is Verdict.FEASIBLE:
        study.feasible += 1
    elif design.verdict is Verdict.UNFEASIBLE:
        study.unfeasible += 1
    else:
        study.error += 1
    _add_artifacts(session, design, measurement)
    close_run(session, lease, "done", cost=cost)
    record_design_event(session, design, "design_finished", literal_angle_deg=design.literal_angle_deg)
    advance_study(session, study)
    return True


def _add_artifacts(session: Session, design: DesignRow, measurement: PileMeasurement) -> None:
    keep_files(session, measurement.artifacts, design_id=design.id)
