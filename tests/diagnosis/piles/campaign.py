"""The tier of simulated piles: another code's data sets, diagnosed with demcore's piles by `talus`, and scored.

    python -m tests.diagnosis.piles.campaign run ANSWERS [--cases case_00,case_01]   # goes on where it was stopped
    python -m tests.diagnosis.piles.campaign score ANSWERS [--json]

`run` hands the tables of one data set after the other to `talus diagnose --json`, of whichever service runs on
TALUS_DATA_DIR, and keeps each answer with the seconds that it took. `score` alone knows what was hidden.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from service.domain.data_set.records import DataSet
from tests.diagnosis.hider import Case
from tests.diagnosis.piles.bank import BANK, data_set, draw_hidden, scored_sets, seed_of, write_tables
from tests.diagnosis.scorer import Pair, claims, flagged, located, right, score, worth, wrong

GRAINS = 320  # more than there are: piles of the real sizes
COMMAND = ("diagnose", "--json", "--contact-model", "hertz_mindlin", "--grains", str(GRAINS))
# An answer is scored without a look at the measurement.
NO_DATA = DataSet((), ())
# Where a cause that the library lacks sits: the blocks of the analyser's published answer.
PLACES = {"rim": ("summary:pile.toe", "summary:pile.ln_mass"), "one_mass": ("condition:wet",)}


def ask(name: str) -> dict[str, Any]:
    """The published answer to one data set, with `seconds`. Raises CalledProcessError where there is none."""
    with tempfile.TemporaryDirectory() as folder:
        write_tables(data_set(name), Path(folder) / name)
        started = time.monotonic()
        told = subprocess.run(
            [sys.executable, "-m", "service.cli", *COMMAND, str(Path(folder) / name)],
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
    return {**json.loads(told.stdout), "seconds": round(time.monotonic() - started, 1)}


def run(folder: Path, names: Sequence[str]) -> None:
    """Every data set that has no answer yet."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        place = folder / f"{name}.json"
        if not place.exists() and (BANK / f"{name}.npz").exists():
            answer = ask(name)
            place.write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")
            print(f"{name}: {answer['verdict']}, {answer['seconds']:.0f} s", flush=True)


def case_of(name: str) -> Case:
    """As the scorer knows it. The signal-to-noise ratio of a simulated cause is not known."""
    cause = scored_sets()[name]
    kind = cause if cause in ("null", "decoy") else "outside" if cause in PLACES else "single"
    inside = draw_hidden(cause, seed_of(name)) if kind == "single" else {}
    places = frozenset(PLACES.get(cause, ()))
    return Case(int(name[-2:]), kind, math.nan, NO_DATA, inside, places=places)


def answered(folder: Path) -> dict[str, Pair]:
    """Data sets with their answers, by name."""
    found = {}
    for place in sorted(folder.glob("case_*.json")):
        found[place.stem] = (case_of(place.stem), json.loads(place.read_text(encoding="utf-8")))
    return found


def table(pairs: dict[str, Pair]) -> list[dict[str, Any]]:
    """A row for each cause: how many, their verdicts, what was named right and wrong, held in the set, placed."""
    causes = scored_sets()
    rows = []
    for cause in dict.fromkeys(causes.values()):
        mine = [pair for name, pair in pairs.items() if causes[name] == cause]
        if mine:
            rows.append(
                {
                    "hidden": cause,
                    "sets": len(mine),
                    "verdicts": dict(Counter(answer["verdict"] for _, answer in mine)),
                    "flagged": sum(flagged(answer) for _, answer in mine),
                    "named_right": sum(right(*pair) for pair in mine),
                    "named_wrong": sum(wrong(*pair) for pair in mine),
                    "claims": dict(Counter(name for _, answer in mine for name in claims(answer))),
                    "held_in_set": sum(
                        cause in {p["effect"] for p in answer["also_possible"]} for _, answer in mine
                    ),
                    "placed": sum(located(*pair) for pair in mine),
                    "utility": round(sum(worth(*pair) for pair in mine) / len(mine), 3),
                }
            )
    return rows


def told(folder: Path) -> dict[str, Any]:
    """Everything that a run has shown so far."""
    pairs = answered(folder)
    seconds = [answer["seconds"] for _, answer in pairs.values()]
    runs = [answer["cost"] for _, answer in pairs.values()]
    return {
        "sets": len(pairs),
        "utility": score(list(pairs.values()))["utility"],
        "by_cause": table(pairs),
        "hours": round(sum(seconds) / 3600.0, 2),
        "runs_asked": sum(cost.get("runs", 0) for cost in runs),
        "runs_made": sum(cost.get("simulated", 0) for cost in runs),
    }


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(prog="python -m tests.diagnosis.piles.campaign")
    made.add_argument("what", choices=["run", "score"])
    made.add_argument("folder", type=Path)
    made.add_argument("--cases", help="names with commas; all where none is given")
    made.add_argument("--json", action="store_true")
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit status."""
    given = parser().parse_args(arguments)
    if given.what == "run":
        run(given.folder, given.cases.split(",") if given.cases else list(scored_sets()))
        return 0
    found = told(given.folder)
    if given.json:
        print(json.dumps(found, indent=1))
        return 0
    print(
        f"{found['sets']} data sets, utility {found['utility']:.3f}, {found['hours']:g} h, "
        f"{found['runs_asked']} runs asked, {found['runs_made']} made"
    )
    for row in found["by_cause"]:
        print(
            f"{row['hidden']:15} {row['sets']:2}  right {row['named_right']}  wrong {row['named_wrong']}  "
            f"in the set {row['held_in_set']}  placed {row['placed']}  {row['verdicts']}  claims {row['claims']}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
