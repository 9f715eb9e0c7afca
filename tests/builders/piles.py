"""Piles as a pile test leaves them, and studies in every state that a page must show."""

from __future__ import annotations

import hashlib
import struct
import zlib
from pathlib import Path
from typing import Any

from service.db import queries
from service.db.models import JobRow
from service.db.queries import Lease
from service.db.session import Database
from service.domain.history import ProposedDesign, StudyStop
from service.domain.outcome import Failure, FailureClass, PileMeasurement, StoredArtifact
from service.domain.states import JobKind
from service.settings import Settings
from service.studies.record_failure import record_failure
from service.studies.record_measurement import record_measurement
from service.studies.record_recommendation import record_recommendation
from tests.builders.studies import a_proposal, a_study, claimed, open_jobs, propose_next, write_report

SCRIPT = "<script>alert(1)</script>"
RINGS = 30

PREDICTION = {
    "mean_deg": 25.6,
    "sd_deg": 0.5,
    "ok_probability": 0.93,
    "window_probability": 0.7,
    "expected_miss_deg": 0.4,
}


def pile_results(angle_deg: float) -> dict[str, Any]:
    """The keys of `PileResult.summary()`; the profile is a cone."""
    radius = 0.3
    r = [(k + 0.5) * radius / RINGS for k in range(RINGS)]
    h = [0.14 * (1.0 - 0.9 * value / radius) for value in r]
    return {
        "angle_deg": angle_deg,
        "angle_standard_error_deg": 0.2,
        "sector_angles_deg": [angle_deg + 0.1 * (k % 5 - 2) for k in range(23)] + [None],
        "fit_intercept_m": 0.145,
        "literal_angle_deg": angle_deg - 8.0,
        "literal_standard_error_deg": 0.4,
        "literal_share_of_bins_under_3": 0.81,
        "mass_on_base_kg": 50.8,
        "mass_filled_kg": 90.4,
        "fill_height_m": 0.4,
        "apex_height_m": 0.16,
        "discharge_t90_s": 0.9,
        "particles_filled": 2100,
        "particles_on_base": 1180,
        "simulated_s": 2.4,
        "settled_at_s": 0.7,
        "time_step_s": 3.5e-5,
        "steps": 68203,
        "neighbour_searches": 1700,
        "particle_steps": 57_800_000,
        "wall_s": 17.0,
        "profile": {"r_m": r, "h_m": h, "h_low_m": [0.9 * v for v in h], "h_high_m": [1.1 * v for v in h]},
        "material": "pellet",
        "scale": 2.0,
        "seed": 7,
        "fill_level": 1.0,
        "time_step_preset": "fast",
        "diameters_across_base_radius": 9.4,
        "parameters": {
            "particle_particle_static_friction": 0.3,
            "particle_wall_static_friction": 0.5,
            "particle_particle_restitution": 0.3,
            "rolling_resistance": 0.2,
        },
        "rig": {"name": "pellet", "base_diameter": 0.6, "cylinder_diameter": 0.35, "cylinder_height": 0.45},
    }


def a_picture(folder: Path) -> StoredArtifact:
    """A grey PNG in the artifact store."""
    width, height = 90, 52

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    pixels = zlib.compress(b"".join(b"\0" + b"\xb0" * width for _ in range(height)))
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    body = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    sha256 = hashlib.sha256(body).hexdigest()
    path = Path(sha256[:2]) / sha256
    (folder / path.parent).mkdir(parents=True, exist_ok=True)
    (folder / path).write_bytes(body)
    return StoredArtifact("picture", "pile.png", "image/png", sha256, len(body), path.as_posix())


def a_pile(angle_deg: float, settings: Settings | None = None) -> PileMeasurement:
    """A whole measurement, with a picture where there is a store for it."""
    files = () if settings is None else (a_picture(settings.artifacts_dir),)
    return PileMeasurement(angle_deg, 0.2, angle_deg - 8.0, pile_results(angle_deg), files)


def add_pile(
    database: Database,
    study_id: int,
    angle_deg: float,
    settings: Settings | None = None,
    proposal: ProposedDesign | None = None,
) -> None:
    """Propose and simulate the next design of a study with `parallel=1`."""
    propose_next(database, study_id, proposal)
    (job_id,) = open_jobs(database, study_id, JobKind.SIMULATE)
    with database.writing() as session:
        assert record_measurement(session, claimed(database, job_id).lease, a_pile(angle_deg, settings))


def add_failure(database: Database, study_id: int, text: str = "overlap 7 % > 5 %, stopped") -> None:
    """Propose the next design, which ends in error."""
    propose_next(database, study_id)
    (job_id,) = open_jobs(database, study_id, JobKind.SIMULATE)
    with database.writing() as session:
        failure = Failure(FailureClass.BLOW_UP, text)
        assert record_failure(session, claimed(database, job_id).lease, failure)


def start_next(database: Database, study_id: int, fraction: float = 0.42) -> str:
    """Propose the next design and begin its simulation; the job's id."""
    propose_next(database, study_id)
    (job_id,) = open_jobs(database, study_id, JobKind.SIMULATE)
    progress = {"phase": "discharge", "fraction": fraction, "seconds_left": 74.0, "particles": 2000}
    lease = claimed(database, job_id).lease
    with database.writing() as session:
        assert queries.beat(session, lease, 600.0, progress) is False
    return job_id


def finish_running(database: Database, study_id: int, angle_deg: float) -> None:
    """The simulation under way ends with a pile."""
    (job_id,) = open_jobs(database, study_id, JobKind.SIMULATE)
    with database.reading() as session:
        lease = Lease(job_id, session.get_one(JobRow, job_id).attempt)
    with database.writing() as session:
        assert record_measurement(session, lease, a_pile(angle_deg))


def a_searching_study(database: Database, settings: Settings | None = None) -> int:
    """Running: in the window, outside, a replicate, an error, and one under way."""
    study_id = a_study(database, parallel=1, budget=12)
    add_pile(database, study_id, 22.4, settings)
    add_pile(database, study_id, 25.4, settings)
    add_failure(database, study_id)
    x = a_proposal(2).x
    reason = "Another seed of design 2, the shortest way to a certificate: 25.5 +- 0.4 deg from 1 so far."
    replicate = a_proposal(4, x=x, origin="replicate", prediction=PREDICTION, reason=reason)
    add_pile(database, study_id, 25.9, settings, replicate)
    start_next(database, study_id)
    return study_id


def a_finished_study(
    database: Database, certified: bool, settings: Settings | None = None, reason: str | None = None
) -> int:
    """Over, with a recommendation from three seeds of the second design."""
    study_id = a_study(database, parallel=1, budget=12)
    add_pile(database, study_id, 22.4, settings)
    x = a_proposal(2).x
    angles = (25.4, 25.6, 25.3)
    for number, angle in enumerate(angles, start=2):
        add_pile(database, study_id, angle, settings, a_proposal(number, x=x))
    word = reason or ("certified" if certified else "budget")
    propose_next(database, study_id, StudyStop(word, "25.4 deg: certified within +-0.4 deg (90 %).", {}))
    names = ("particle_particle_static_friction", "particle_wall_static_friction")
    finish(
        database,
        study_id,
        {
            "x": {**dict(zip(names, x, strict=False)), "rolling_resistance": x[3]},
            "numbers": [2, 3, 4],
            "mean_deg": 25.43,
            "sd_deg": 0.24,
            "expected_miss_deg": 0.2,
            "window_probability": 0.994 if certified else 0.81,
            "replicates_deg": list(angles),
            "certified": certified,
            "half_width_90_deg": 0.39,
        },
    )
    return study_id


def finish(database: Database, study_id: int, recommendation: dict[str, Any] | None) -> None:
    """Do the recommend job of a study that is finishing."""
    (job_id,) = open_jobs(database, study_id, JobKind.RECOMMEND)
    with database.writing() as session:
        assert record_recommendation(session, claimed(database, job_id).lease, recommendation)
    if recommendation is not None:
        write_report(database, study_id)


def a_study_without_piles(database: Database) -> int:
    """Paused after errors alone; their text is hostile."""
    study_id = a_study(database, parallel=1)
    add_failure(database, study_id, SCRIPT)
    propose_next(database, study_id, StudyStop("too_many_failures", f"1 of 1 ended in error {SCRIPT}", {}))
    return study_id


def a_failed_study(database: Database) -> int:
    """The proposal itself failed."""
    study_id = a_study(database)
    (job_id,) = open_jobs(database, study_id, JobKind.PROPOSE)
    with database.writing() as session:
        failure = Failure(FailureClass.ERROR, "singular matrix")
        assert record_failure(session, claimed(database, job_id).lease, failure)
    return study_id
