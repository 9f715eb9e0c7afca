"""From a design to its numbers and files."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from demcore.experiments.pile_case import PileTest
from demcore.run import Progress
from service.db.queries import Lease
from service.domain.search_space import SearchSpace, Variable
from service.domain.states import JobKind
from service.file_store import FolderStore
from service.settings import Settings
from service.studies.claim_job import Claim
from tests.builders.studies import a_spec
from worker import evaluate


def a_claim(**changes: Any) -> Claim:
    space = SearchSpace(
        (Variable("rolling_resistance", 0.1, 0.4), Variable("particle_wall_static_friction", 0.2, 0.8))
    )
    spec = a_spec(space=space, fixed={"particle_particle_restitution": 0.4}, scale=3.0, fill_level=0.5)
    defaults = {
        "lease": Lease("job-1", 1),
        "kind": JobKind.SIMULATE,
        "study_id": 1,
        "spec": spec,
        "time_step_factor": 0.5,
        "attempts_left": 2,
        "x": (0.25, 0.6),
        "seed": 77,
        "scale": 3.0,
    }
    return Claim(**{**defaults, **changes})


class FakeResult:
    angle_deg = 25.4
    angle_sd_deg = math.nan
    literal_angle_deg = 17.0
    positions, radii = np.zeros((1, 3)), np.ones(1)

    def __init__(self, test: PileTest) -> None:
        self.test = test

    def summary(self) -> dict[str, Any]:
        return {
            "steps": np.int64(7),
            "time_step_s": 1e-4,
            "sector_angles_deg": [1.0, math.inf],
            "r": np.arange(2),
        }

    def write(self, path: Path) -> None:
        path.write_bytes(b"vtkhdf")


def test_searched_fixed_and_default_values_reach_the_pile_test() -> None:
    test = evaluate.pile_test(a_claim())
    assert test.parameters.rolling_resistance == 0.25
    assert test.parameters.particle_wall_static_friction == 0.6
    assert test.parameters.particle_particle_restitution == 0.4
    assert test.parameters.particle_particle_static_friction == 0.5
    assert (test.material.name, test.rig.name) == ("pellet", "pellet")
    assert (test.scale, test.seed, test.fill_level, test.time_step_factor) == (3.0, 77, 0.5, 0.5)


@pytest.fixture
def fake_run(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    calls = list[dict[str, Any]]()

    def run(test: PileTest, on_progress: Callable[[Progress], bool], **options: Any) -> FakeResult:
        told = on_progress(Progress("settle", 0.1, 900, math.nan, 1e6, 0.25, math.nan))
        calls.append({"test": test, "went_on": told, **options})
        return FakeResult(test)

    monkeypatch.setattr(evaluate, "run_pile_test", run)
    monkeypatch.setattr(evaluate, "draw_pile", lambda *given: given[-1].write_bytes(b"png"))
    return calls


def test_a_result_is_plain_json_and_its_files_lie_in_the_store(
    fake_run: list[dict[str, Any]], tmp_path: Path
) -> None:
    settings = Settings(data_dir=tmp_path)
    seen = list[Any]()

    def report(progress: Any) -> bool:
        seen.append(progress)
        return False

    measurement = evaluate.evaluate(a_claim(), report, settings)
    assert (measurement.angle_deg, measurement.angle_sd_deg, measurement.literal_angle_deg) == (
        25.4,
        None,
        17.0,
    )
    assert measurement.results == {
        "steps": 7,
        "time_step_s": 1e-4,
        "sector_angles_deg": [1.0, None],
        "r": [0, 1],
    }
    json.dumps(measurement.results, allow_nan=False)
    assert [(a.kind, a.file_name, a.media_type) for a in measurement.artifacts] == [
        ("vtkhdf", "result.vtkhdf", "application/x-hdf5"),
        ("picture", "pile.png", "image/png"),
    ]
    for artifact, content in zip(measurement.artifacts, (b"vtkhdf", b"png"), strict=True):
        assert artifact.sha256 == hashlib.sha256(content).hexdigest()
        assert artifact.path == f"{artifact.sha256[:2]}/{artifact.sha256}"
        assert (settings.artifacts_dir / artifact.path).read_bytes() == content
        assert artifact.size_bytes == len(content)
    left = {path.name for path in settings.artifacts_dir.iterdir()}
    assert left == {artifact.sha256[:2] for artifact in measurement.artifacts}, "nothing else is left behind"
    assert seen[0]["kinetic_energy_j"] is None
    assert (seen[0]["phase"], seen[0]["fraction"]) == ("settle", 0.25)
    assert fake_run[0]["went_on"] is False
    assert fake_run[0]["checkpoint_path"] == evaluate.checkpoint_path("job-1", settings)


def test_storing_the_same_file_twice_is_one_file(tmp_path: Path) -> None:
    store = FolderStore(tmp_path / "store")
    stored = []
    for _ in range(2):
        file = tmp_path / "pile.png"
        file.write_bytes(b"same")
        stored.append(evaluate.store_file(file, "picture", "image/png", store))
    assert stored[0] == stored[1]
    assert len([path for path in store.folder.rglob("*") if path.is_file()]) == 1
