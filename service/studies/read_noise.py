"""How far the runs of a study's test scatter: its own replicates, and those of the studies that it starts from."""

from __future__ import annotations

from collections.abc import Iterable

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.db.models import DesignRow, StudyRow
from service.domain.noise import RunNoise, expected_of_sectors, run_noise
from service.domain.observables import ANGLE
from service.domain.spec_record import spec_from_record
from service.domain.states import DesignState
from service.studies.warm_start import pooled_noise, read_warm_start


def read_noise(session: Session, study: StudyRow) -> tuple[RunNoise, ...]:
    """One for each response, in the order of the spec; coarse runs are another test."""
    spec = spec_from_record(study.spec)
    rows = session.execute(
        select(DesignRow.x_hash, DesignRow.responses, DesignRow.angle_sd_deg).where(
            DesignRow.study_id == study.id,
            DesignRow.state == DesignState.COMPLETE,
            DesignRow.scale == spec.scale,
        )
    ).all()
    runs = [(x_hash, responses or {}) for x_hash, responses, _ in rows]
    earlier = pooled_noise(read_warm_start(session, study))
    sectors = {ANGLE: expected_of_sectors(error for _, _, error in rows)}
    return tuple(
        run_noise(r, _values(runs, r.observable), earlier.get(r.observable), sectors.get(r.observable))
        for r in spec.responses
    )


def _values(runs: Iterable[tuple[str, dict[str, float]]], observable: str) -> list[list[float]]:
    groups: dict[str, list[float]] = {}
    for x_hash, responses in runs:
        if observable in responses:
            groups.setdefault(x_hash, []).append(responses[observable])
    return list(groups.values())
