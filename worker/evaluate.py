"""A design becomes numbers: parameters -> pile test -> angle, results and files."""

from __future__ import annotations

import hashlib
import math
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from demcore.errors import Cancelled
from demcore.experiments.pile_case import ContactParameters, PileTest
from demcore.experiments.pile_effects import with_effects
from demcore.experiments.pile_result import PileResult
from demcore.experiments.pile_test import run_pile_test
from demcore.material import load_material
from demcore.picture import draw_pile
from demcore.rig import load_rig
from demcore.run import Progress
from service.domain.outcome import PileMeasurement, StoredArtifact
from service.domain.search_space import default_values
from service.domain.study import StudySpec
from service.file_store import FileStore, artifact_store
from service.settings import Settings
from service.studies.claim_job import Claim

Report = Callable[[Mapping[str, Any]], bool]


def evaluate(claim: Claim, report: Report, settings: Settings) -> PileMeasurement:
    """Simulate the claimed design. `report` gets the progress and answers False to stop.

    A run that was lost goes on from its last checkpoint, with the same bits. Raises
    demcore.errors.SimulationError (Cancelled after a False).
    """
    checkpoint = checkpoint_path(claim.lease.job_id, settings)
    checkpoint.parent.mkdir(parents=True, exist_ok=True)
    result = run_pile_test(
        pile_test(claim),
        on_progress=lambda progress: report(as_progress(progress)),
        checkpoint_path=checkpoint,
        checkpoint_seconds=settings.checkpoint_seconds,
        threads=settings.threads,
    )
    return PileMeasurement(
        angle_deg=float(result.angle_deg),
        angle_sd_deg=finite(result.angle_sd_deg),
        literal_angle_deg=finite(result.literal_angle_deg),
        results=plain(result.summary()),
        artifacts=store_files(result, artifact_store(settings)),
    )


def checkpoint_path(job_id: str, settings: Settings) -> Path:
    """Where a job's checkpoint lies: beside it, under the same name with a suffix, the one before."""
    return settings.checkpoints_dir / job_id


def forget_checkpoint(job_id: str, settings: Settings) -> None:
    """Remove what a job that is over has left."""
    path = checkpoint_path(job_id, settings)
    shutil.rmtree(settings.series_folder(job_id), ignore_errors=True)
    for file in path.parent.glob(path.name + "*"):
        file.unlink(missing_ok=True)


def compile_kernels() -> None:
    """Make the first chunk of a small pile test, so that a worker's children are forked with compiled kernels."""
    test = PileTest(
        load_material("pellet"),
        load_rig("pellet"),
        ContactParameters(**default_values()),
        scale=4.0,
        fill_level=0.2,
    )
    with suppress(Cancelled):
        run_pile_test(test, on_progress=lambda _progress: False)


def pile_test(claim: Claim) -> PileTest:
    """The virtual experiment of a claimed design."""
    test = test_of(claim.spec, claim.x, claim.scale)
    return replace(test, seed=claim.seed, time_step_factor=claim.time_step_factor)


def test_of(spec: StudySpec, x: Sequence[float], scale: float) -> PileTest:
    """The virtual experiment of a design: what the study says of it, else defaults, with the effects of its
    version of the model; a mix takes one set of parameters for all its contacts.

    Raises demcore.errors.InputError for values that contradict each other.
    """
    ideal = PileTest(
        material=load_material(spec.material),
        rig=load_rig(spec.material),
        parameters=ContactParameters(**{**default_values(), **spec.parameters_of(tuple(x))}),
        scale=scale,
        fill_level=spec.fill_level,
        time_step=spec.time_step,
    )
    return ideal if spec.model is None else with_effects(ideal, spec.model.effects)


def as_progress(progress: Progress) -> dict[str, Any]:
    """What the job's row shows of a running simulation."""
    shown = (
        "phase",
        "time_s",
        "particles",
        "kinetic_energy_j",
        "particle_steps_per_s",
        "fraction",
        "seconds_left",
    )
    found = plain({name: getattr(progress, name) for name in shown})
    assert isinstance(found, dict)
    return found


def plain(value: Any) -> Any:
    """`value` as plain JSON: arrays become lists, numpy numbers Python's, what is not finite None."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return finite(value) if isinstance(value, float) else value


def finite(value: float | None) -> float | None:
    """None instead of a number that is not finite: JSON has none."""
    return float(value) if value is not None and math.isfinite(value) else None


def store_files(result: PileResult, store: FileStore) -> tuple[StoredArtifact, ...]:
    """Write the result file and the picture, and put them into the store by their content."""
    with store.incoming() as folder:
        data, picture = folder / "result.vtkhdf", folder / "pile.png"
        result.write(data)
        draw_pile(result.positions, result.radii, result.test.rig.base_radius, picture)
        return (
            store_file(data, "vtkhdf", "application/x-hdf5", store),
            store_file(picture, "picture", "image/png", store),
        )


def store_file(file: Path, kind: str, media_type: str, store: FileStore) -> StoredArtifact:
    """Move `file` to <sha256[:2]>/<sha256> of the store: all of it is there afterwards, or nothing."""
    with file.open("rb") as stream:
        sha256 = hashlib.file_digest(stream, "sha256").hexdigest()
        size = os.fstat(stream.fileno()).st_size
    name = f"{sha256[:2]}/{sha256}"
    store.put(file, name)
    return StoredArtifact(kind, file.name, media_type, sha256, size, name)
