"""Charges for tests: requests, claims and measurements, with defaults for whatever a test does not care about."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sqlalchemy import select

from service.db.models import ChargeRow, JobRow
from service.db.session import Database
from service.domain.charge import ChargeRequest, ChargeSpec
from service.domain.outcome import ChargeMeasurement
from service.studies.claim_job import ChargeClaim, claim_job
from service.studies.create_charges import create_charges
from tests.builders.studies import LEASE_S

NOWHERE = Path("no-geometries")
RESULTS = {"particle_steps": 6e8, "wall_s": 300.0, "findings": {"piles": 2}, "in_hopper_kg": 2990.0}


def a_request(**changes: Any) -> ChargeRequest:
    spec = {name: changes.pop(name) for name in list(changes) if name in ChargeSpec.__dataclass_fields__}
    return ChargeRequest(ChargeSpec(**{"charge": "coke", "scale": 8.0, **spec}), **changes)


def charges(database: Database, **changes: Any) -> list[int]:
    """The ids of new charges, with their jobs queued."""
    with database.writing() as session:
        return [row.id for row in create_charges(session, a_request(**changes), NOWHERE)[0]]


def charge(database: Database, charge_id: int) -> ChargeRow:
    with database.reading() as session:
        return session.get_one(ChargeRow, charge_id)


def job_of_charge(database: Database, charge_id: int) -> JobRow:
    with database.reading() as session:
        return session.scalars(select(JobRow).where(JobRow.charge_id == charge_id)).one()


def claimed_charge(database: Database, charge_id: int) -> ChargeClaim:
    with database.writing() as session:
        claim = claim_job(session, job_of_charge(database, charge_id).id, "worker-a", LEASE_S)
    assert isinstance(claim, ChargeClaim)
    return claim


def a_charge_measurement(**changes: Any) -> ChargeMeasurement:
    return ChargeMeasurement({**RESULTS, **changes})
