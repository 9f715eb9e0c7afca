"""Charges for tests: requests, claims and measurements, with defaults for whatever a test does not care about."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from sqlalchemy import select

from service.db import queries
from service.db.models import ChargeRow, JobRow
from service.db.queries import Lease
from service.db.session import Database
from service.domain.charge import ChargeRequest, ChargeSpec
from service.domain.outcome import ChargeMeasurement, StoredArtifact
from service.domain.states import JobState
from service.settings import Settings
from service.studies.check_charges import check_charges
from service.studies.claim_job import ChargeClaim, claim_job
from service.studies.create_charges import create_charges
from service.studies.record_charge import record_charge
from tests.builders.piles import a_picture
from tests.builders.studies import LEASE_S

NOWHERE = Path("no-geometries")
RESULTS = {"particle_steps": 6e8, "wall_s": 300.0, "findings": {"piles": 2}, "in_hopper_kg": 2990.0}


def a_summary(name: str = "coke", **changes: Any) -> dict[str, Any]:
    """As a finished charge leaves it, with four sectors."""
    per_sector = [1.0, 2.0, 3.0, 4.0]
    pile = {"azimuth_deg": 200.0, "radius": 1.2, "height": -0.9, "volume": 2.0, "mass": 1000.0, "size": 0.1}
    slope = {"angle_deg": 34.2, "error_deg": 1.1, "directions": 5}
    found = {
        "piles": 2,
        "near_height_m": 1.0,
        "far_height_m": 1.5,
        "near_size_m": 0.10,
        "far_size_m": 0.14,
        "near_mass_kg": 1000.0,
        "near_slope_deg": 34.2,
        "far_slope_deg": 36.1,
        "far_mass_kg": 2000.0,
        "depressions": ["behind the rod", "under the deflector"],
    }
    belt = {"rate_kg_s": 41.6, "set_rate_kg_s": 41.67, "kg_per_m": 23.0, "stratification": 0.6}
    layers = {"layer_height_m": [0.01, 0.03], "layer_share": [0.6, 0.4], "layer_size_m": [0.08, None]}
    parameters = {"particle_particle_static_friction": 0.5, "youngs_modulus_pa": None}
    material = {"name": name, "target_deg": 36.5, "window_deg": [35.0, 38.0]}
    charge = {"name": name, "rate": 41.67, "duration": 72.0, "parameters": parameters, "material": material}
    sources = {"belt.speed_m_s": "paper, section 3.1", "bell.slope_deg": "assumed: usual"}
    summary = {
        "findings": found,
        "inputs": {
            "charge": charge,
            "plant": {
                "hopper": {"seat_depth": 2.8},
                "deflector": {"ridge_across": -0.18},
                "sources": sources,
            },
            "replaced": {},
            "rest_seconds": 10.0,
            "numerics": {"may_squeeze": 0.01},
            "dormancy": {"wake_share": 0.1},
        },
        "sectors": dict.fromkeys(
            ("azimuth_deg", "mass", "particles", "height", "volume", "size"), per_sector
        ),
        "bell_layer": {"within_m": 0.3, "mass_kg": per_sector, "size_m": per_sector},
        "harmonics": {"mass_1": {"amplitude": 0.4, "azimuth_deg": 300.0}},
        "piles": [pile | {"prominence": 0.4, "slope": slope}],
        "depressions": [{"azimuth_deg": 90.0, "height": -2.0, "depth": 1.0, "cause": "behind the rod"}],
        "belt": belt | layers,
        "jet": {
            "level_m": [-0.1],
            "x_5_50_95_m": [[-0.3, 0.1, 0.5]],
            "at_ridge_x_5_50_95_m": [-0.2, -0.1, 0.0],
            "far_of_ridge": 0.6,
            "size_near_of_ridge_m": 0.1,
            "size_far_of_ridge_m": 0.14,
        },
        "walls": {"bell": {"energy_J": 1000.0, "strikes": 10.0, "load_N": 500.0}},
        "account": {
            "time": [0.0, 1.0],
            "fed": [0.0, 40.0],
            "on_belt": [0.0, 10.0],
            "in_flight": [0.0, 10.0],
            "in_hopper": [0.0, 19.5],
            "lost": [0.0, 0.25],
        },
        **dict.fromkeys(
            (
                "variation_of_mass",
                "variation_of_height",
                "variation_of_volume",
                "variation_of_size",
                "far_share_of_mass",
                "segregation_intensity",
                "segregation_of_a_random_mix",
                "merged_share_of_mass",
            ),
            0.3,
        ),
        **dict.fromkeys(("volume_m3", "bulk_density_kg_m3", "level_if_even_m", "largest_diameter_m"), 1.0),
        **dict.fromkeys(("fed_kg", "asked_kg", "on_belt_kg", "in_flight_kg", "in_hopper_kg", "lost_kg"), 9.0),
        **dict.fromkeys(("particles", "squeezed_through_walls", "steps"), 5),
        **dict.fromkeys(("steady_from_s", "time_step_s", "wall_s"), 2.0),
        "particle_steps": 1e7,
    }
    return summary | changes


def a_request(**changes: Any) -> ChargeRequest:
    spec = {name: changes.pop(name) for name in list(changes) if name in ChargeSpec.__dataclass_fields__}
    return ChargeRequest(ChargeSpec(**{"charge": "coke", "scale": 8.0, **spec}), **changes)


def charges(database: Database, **changes: Any) -> list[int]:
    """The ids of new charges, with their jobs queued."""
    with database.writing() as session:
        checked = check_charges(session, a_request(**changes), NOWHERE.joinpath)
        return [row.id for row in create_charges(session, checked)[0]]


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


def beat_charge(database: Database, claim: ChargeClaim, fraction: float) -> None:
    """It has come so far."""
    progress = {"phase": "charge", "fraction": fraction, "seconds_left": 74.0}
    with database.writing() as session:
        assert queries.beat(session, claim.lease, LEASE_S, progress) is False


def finish_charge(
    database: Database,
    charge_id: int,
    settings: Settings,
    results: dict[str, Any] | None = None,
    more_files: tuple[StoredArtifact, ...] = (),
    **findings: Any,
) -> None:
    """Run to its end, with a report, two pictures and `more_files`; `findings` replace those of `a_summary`."""
    summary = a_summary() if results is None else results
    summary["findings"] |= findings
    picture = a_picture(settings.artifacts_dir)
    files = tuple(
        replace(picture, kind=kind, file_name=name)
        for kind, name in (("burden", "burden.png"), ("wear", "wear.png"), ("report", "report.html"))
    )
    job = job_of_charge(database, charge_id)
    lease = (
        claimed_charge(database, charge_id).lease
        if job.state is JobState.QUEUED
        else Lease(job.id, job.attempt)
    )
    with database.writing() as session:
        assert record_charge(session, lease, ChargeMeasurement(summary, (*files, *more_files)))
