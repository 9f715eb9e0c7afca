"""How far demcore is from another code, or a plant from demcore, where nothing is hidden: pile_floor.json.

    python -m worker.estimate_floor hertz_mindlin FOLDER FOLDER ... [--grains 320] [--out pile_floor.json]

Each FOLDER holds the tables of a data set of which it is known that no effect hides in it: another code's piles
(tests/diagnosis/piles makes such), or a reference material. Data sets of the same conditions share their simulated
runs, which are stored in the installation's database as those of a diagnosis are, and found there again.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from demcore.identity import identity
from service.db.migrate import upgrade
from service.db.session import Database
from service.domain.data_set.reading import read_data_set
from service.domain.data_set.records import DataSet
from service.domain.diagnosis import CONTACT_MODELS
from service.domain.measured_pile import pile_scale
from service.settings import get_settings
from worker.diagnose import StoredRuns
from worker.diagnosis.diagnose import Options, effect_free_misfits
from worker.diagnosis.floor import KEYS, estimate_floor
from worker.diagnosis.simulator import Simulator
from worker.pile_floor import FILE, PileFloor, base_radius_of
from worker.pile_simulator import GRAINS, PileSimulator

WAVE = 64


def estimate(data: Sequence[DataSet], simulator: Simulator, wave: int = WAVE, seed: int = 1) -> PileFloor:
    """From effect-free data sets, each re-calibrated with emulators over the whole box. Raises BadDataSet,
    InvalidValue with fewer than four."""
    options = Options(first_wave=wave, second_wave=0, seed=seed)
    pairs = [effect_free_misfits(one, simulator, options) for one in data]
    conditions = [c for one in data for c in one.conditions]
    materials = tuple(sorted({c.material for c in conditions}))
    return PileFloor(estimate_floor(pairs), base_radius_of(conditions), len(data), materials)


def parser() -> argparse.ArgumentParser:
    """The arguments."""
    made = argparse.ArgumentParser(prog="python -m worker.estimate_floor")
    made.add_argument("contact_model", choices=CONTACT_MODELS)
    made.add_argument("folders", nargs="+", type=Path)
    made.add_argument("--grains", type=int, default=GRAINS)
    made.add_argument("--wave", type=int, default=WAVE, help="runs of each condition")
    made.add_argument("--out", type=Path, default=FILE)
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the sds of the floor, and keeps it in the file beside those of other contact models."""
    given = parser().parse_args(arguments)
    settings = get_settings()
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    upgrade(settings.resolved_database_url)
    data = [read_data_set(folder) for folder in given.folders]
    distinct = {c.settings for one in data for c in one.conditions}
    runs = StoredRuns(Database(settings.resolved_database_url), _say, given.wave * len(distinct))
    found = estimate(data, PileSimulator(runs, given.grains, given.contact_model), given.wave)
    coarsest = max(pile_scale(c, given.grains) for one in data for c in one.conditions)
    found = replace(found, coarseness=coarsest)
    _keep(given.out, given.contact_model, {**found.as_record(), "grains": given.grains, "wave": given.wave})
    sys.stdout.write("\n".join(["", *lines(found), ""]))
    return 0


def lines(found: PileFloor) -> list[str]:
    """The sds of each summary of a pile: shared by the conditions, and each one's own."""
    shared, own = (np.sqrt(np.diag(table)) for table in (found.floor.shared, found.floor.own))
    rows = [(name, shared[k], own[k]) for k, (test, name) in enumerate(KEYS) if test == "pile"]
    return [f"{name:12} shared {a:.4g}  own {b:.4g}" for name, a, b in rows]


def _keep(path: Path, contact_model: str, record: Mapping[str, Any]) -> None:
    found = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {"contact_models": {}}
    found["contact_models"][contact_model] = {**record, "code": identity(())[:12]}
    path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def _say(progress: Mapping[str, Any]) -> bool:
    sys.stderr.write(f"\r{progress['runs']} runs asked, {progress['simulated']} made")
    return True


if __name__ == "__main__":
    sys.exit(main())
