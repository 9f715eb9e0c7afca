"""What a study will take, by the pile tests that have run here: told before anything is stored."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import median

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import DesignRow, JobRow, RunRow, StudyRow
from service.domain.study import StudySpec

LATEST = 200
# Particles go with the cube of one over the scale, steps with one over it (the time step is a grain's).
SCALE_POWER = 4


@dataclass(frozen=True)
class StudyCost:
    """`seconds_each` of one simulation on one worker; None: no pile of the material has run here."""

    simulations: int
    seconds_each: float | None
    source: str

    @property
    def seconds(self) -> float | None:
        """Of all, on one worker."""
        return None if self.seconds_each is None else self.simulations * self.seconds_each

    @property
    def text(self) -> str:
        """For the one who asks."""
        count = f"At most {self.simulations} simulations"
        if self.seconds_each is None or self.seconds is None:
            return f"{count}; {self.source}."
        each, whole = _told(self.seconds_each), _told(self.seconds)
        return f"{count} of about {each} each, {whole} on one worker ({self.source})."


def expected_study_cost(session: Session, spec: StudySpec) -> StudyCost:
    """By the newest runs of the material at the nearest scale, carried over to the study's own scale."""
    done = (
        select(DesignRow.scale, RunRow.wall_s)
        .join(JobRow, JobRow.id == RunRow.job_id)
        .join(DesignRow, DesignRow.id == JobRow.design_id)
        .join(StudyRow, StudyRow.id == JobRow.study_id)
        .where(StudyRow.material == spec.material, RunRow.exit_class == "done", RunRow.wall_s.is_not(None))
        .order_by(RunRow.id.desc())
        .limit(LATEST)
    )
    known = [(row.scale, row.wall_s) for row in session.execute(done) if row.wall_s]
    runs = spec.budget if spec.coarse is None else spec.budget + spec.coarse.runs
    if not known:
        return StudyCost(runs, None, f"how long each takes is not known: no {spec.material} has run here yet")
    nearest = min((scale for scale, _ in known), key=lambda scale: abs(math.log(scale / spec.scale)))
    seconds = median(wall for scale, wall in known if scale == nearest)
    each = seconds * (nearest / spec.scale) ** SCALE_POWER
    return StudyCost(runs, each, f"as {spec.material} at scale {nearest:g} ran here")


def _told(seconds: float) -> str:
    if seconds < 90.0:
        return f"{max(1, round(seconds))} s"
    if seconds < 5400.0:
        return f"{round(seconds / 60.0)} min"
    return f"{seconds / 3600.0:.1f} h" if seconds < 48 * 3600.0 else f"{seconds / 86400.0:.1f} days"
