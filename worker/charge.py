"""A charge becomes numbers and files: request -> plant, belt and hopper -> burden, report, pictures, series."""

from __future__ import annotations

import json
import shutil

from demcore.experiments.charge_drawing import draw_all
from demcore.experiments.charge_file import write_charge
from demcore.experiments.charge_result import ChargeResult
from demcore.experiments.charge_test import run_charge
from demcore.experiments.plant_drawing import draw_plant
from demcore.recorder import SeriesRecorder
from service.domain.charge import charge_test
from service.domain.outcome import ChargeMeasurement, StoredArtifact
from service.file_store import artifact_store, geometry_store
from service.settings import Settings
from service.studies.claim_job import ChargeClaim
from worker.charge_report import Source, write_report
from worker.evaluate import Report, as_progress, checkpoint_path, plain, store_file

HDF, PNG = "application/x-hdf5", "image/png"
# Kind of an artifact, the file that it is written to, and its media type.
FILES = (
    ("report", "report.html", "text/html"),
    ("summary", "summary.json", "application/json"),
    ("result", "charge.vtkhdf", HDF),
    ("spheres", "spheres.vtkhdf", HDF),
    ("walls", "walls.vtkhdf", HDF),
    ("plant", "plant.png", PNG),
    ("burden", "burden.png", PNG),
    ("charge", "charge.png", PNG),
    ("curves", "curves.png", PNG),
    ("wear", "wear.png", PNG),
)


def evaluate_charge(claim: ChargeClaim, report: Report, settings: Settings) -> ChargeMeasurement:
    """Simulate the claimed charge. `report` gets the progress and answers False to stop.

    A run that was lost goes on from its last checkpoint, with the same bits, and its series with it. Raises
    demcore.errors.SimulationError (Cancelled after a False).
    """
    test = charge_test(claim.spec, geometry_store(settings).local, claim.time_step_factor)
    checkpoint = checkpoint_path(claim.lease.job_id, settings)
    checkpoint.parent.mkdir(parents=True, exist_ok=True)
    recorder = None
    if claim.spec.frame_seconds is not None:
        folder = settings.series_folder(claim.lease.job_id)
        folder.mkdir(exist_ok=True)
        recorder = SeriesRecorder(folder, claim.spec.frame_seconds)
    try:
        result = run_charge(
            test,
            on_progress=lambda progress: report(as_progress(progress)),
            threads=settings.threads,
            checkpoint_path=checkpoint,
            checkpoint_seconds=settings.checkpoint_seconds,
            recorder=recorder,
        )
        if recorder is not None:
            recorder.finish()
    finally:
        if recorder is not None:
            recorder.close()
    summary = plain(result.summary() | {"findings": result.findings()})
    source = Source(claim.charge_id, claim.spec)
    return ChargeMeasurement(summary, _store_files(result, source, claim.lease.job_id, settings))


def _store_files(
    result: ChargeResult, source: Source, job_id: str, settings: Settings
) -> tuple[StoredArtifact, ...]:
    """Write everything that the charge leaves, and put it into the store by its content."""
    store = artifact_store(settings)
    with store.incoming() as folder:
        for file in settings.series_folder(job_id).glob("*.vtkhdf"):
            shutil.move(file, folder / file.name)  # another disk, where the store is not a folder
        write_charge(result, folder / "charge.vtkhdf")
        draw_plant(result.test.plant, folder / "plant.png")
        draw_all(result, folder)
        summary = plain(result.summary() | {"findings": result.findings()})
        (folder / "summary.json").write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")
        write_report(summary, source, folder, folder / "report.html")
        return tuple(
            store_file(folder / file, kind, media_type, store)
            for kind, file, media_type in FILES
            if (folder / file).exists()
        )
