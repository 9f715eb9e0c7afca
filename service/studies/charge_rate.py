"""How fast charges run here, by those that have run: what a new one's cost is told by."""

from __future__ import annotations

from sqlalchemy import select
from sqlalchemy.orm import Session

from demcore.experiments.charge_cost import Rate
from service.db.models import ChargeRow
from service.domain.charge import ChargeSpec
from service.domain.states import DesignState

# Searches included, on a small machine. One core, scale 10: a step took 50 us with 310 grains there on average
# (coke) and 97 us with 600 (iron); two cores, scale 4: 224 us with 2,500 and 620 us with 11,700. Within
# twice of each.
ASSUMED = Rate(1e7, step_seconds=2e-5, source="assumed, as no charge has run here yet")
LATEST = 50


def expected_rate(session: Session, spec: ChargeSpec) -> Rate:
    """Of the newest finished charge of the nearest scale."""
    newest = (
        select(ChargeRow.id, ChargeRow.scale, ChargeRow.results)
        .where(ChargeRow.state == DesignState.COMPLETE)
        .order_by(ChargeRow.id.desc())
        .limit(LATEST)
    )
    found = [
        (abs(row.scale - spec.scale), -row.id, row.results["particle_steps"] / row.results["wall_s"])
        for row in session.execute(newest)
        if row.results and row.results.get("wall_s")
    ]
    if not found:
        return ASSUMED
    _, number, rate = min(found)
    return Rate(rate, source=f"as charge {-number} ran here")
