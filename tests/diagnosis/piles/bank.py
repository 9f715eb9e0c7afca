"""A bank of piles by another code: effect-free data sets, and some in which a cause is hidden.

    python -m tests.diagnosis.piles.bank make        # LIGGGHTS; what is there is kept
    python -m tests.diagnosis.piles.bank write NAME FOLDER   # one data set as the tables of a laboratory
    python -m tests.diagnosis.piles.bank hide CAUSE NAME     # one more, of a size that nobody has seen

One file a data set in `bank/`: `values` (conditions, replicates, observables), `heights` likewise (mm, 240 cells),
and `about`, the inputs that made it. Imports the data format and nothing of the analyser, who gets the tables.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import secrets
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from service.domain.data_set.columns import CONDITION_COLUMNS, PILE_OBSERVABLES
from service.domain.data_set.records import Condition, DataSet, Observation, Profile
from tests.diagnosis.piles.heap_reading import RINGS, SECTORS, readings
from tests.diagnosis.piles.liggghts_pile import Array, Contacts, Pile, run

BANK = Path(__file__).parent / "bank"
REPLICATES = 3
FREE = 8
# The data sets that are scored, by what is hidden: a third of them nothing, or what a calibration has to absorb.
SCORED = {
    "null": 12,
    "decoy": 4,
    "cohesion": 6,
    "shape_roll": 5,
    "lift_speed": 5,
    "base_rough": 5,
    "wide_psd": 4,
    "feed_offcentre": 4,
    "rim": 3,
    "one_mass": 2,
}
PSD = ((0.04, 0.3), (0.05, 0.4), (0.06, 0.3))
DENSITY, BASE, CYLINDER = 3480.0, 0.6, 0.35
MOISTURE = 4.0
WRONGLY_WEIGHED = "wet"


def _condition(
    name: str, mass: float, lift: float = 0.0, wet: bool = False, holdout: bool = False
) -> Condition:
    lifted = {"removal": "lift", "lift_speed_m_s": lift} if lift else {}
    return Condition(
        name,
        "pile",
        "pellet",
        mass,
        psd=PSD,
        particle_density_kg_m3=DENSITY,
        moisture_percent=MOISTURE if wet else 0.0,
        base_diameter_m=BASE,
        cylinder_diameter_m=CYLINDER,
        cylinder_height_m=0.45,
        holdout=holdout,
        **lifted,  # type: ignore[arg-type]
    )


CONDITIONS = (
    _condition("full", 60.0),
    _condition("slow", 60.0, lift=0.4),
    _condition("wet", 60.0, wet=True),
    _condition("wet_slow", 50.0, lift=0.4, wet=True),
    _condition("fast", 50.0, lift=0.8, holdout=True),
    _condition("wet_half", 40.0, wet=True, holdout=True),
)


@dataclass(frozen=True)
class Truth:
    """What a data set was made of; `hidden` by the library's names, or `rim`, which the library lacks."""

    seed: int
    contacts: Contacts
    hidden: Mapping[str, float] = field(default_factory=dict)


def draw_truth(seed: int, hidden: Mapping[str, float], decoy: bool = False) -> Truth:
    """Contacts anywhere well inside of what an analyser searches; laws that it does not have among them.

    A decoy's grains slide and roll a third harder: a strong change that a calibration absorbs.
    """
    stream = np.random.default_rng(np.random.SeedSequence([seed, 6]))
    lower, upper = np.array([0.3, 0.25, 0.15, 0.12]), np.array([0.75, 0.8, 0.5, 0.5])
    friction, wall, restitution, rolling = (lower + stream.random(4) * (upper - lower)).round(3).tolist()
    if decoy:
        friction, rolling = round(1.3 * friction, 3), round(1.3 * rolling, 3)
    contacts = Contacts(
        friction,
        wall,
        restitution,
        rolling,
        wall_restitution=round(float(stream.uniform(0.2, 0.5)), 3),
        rolling_model=("epsd2", "cdt")[int(stream.integers(2))],
        youngs=(5e6, 1e7, 2e7)[int(stream.integers(3))],
    )
    return Truth(seed, contacts, dict(hidden))


def draw_hidden(name: str, seed: int) -> dict[str, float]:
    """A cause of a size drawn with the seed."""
    stream = np.random.default_rng(np.random.SeedSequence([seed, 7]))
    sign = -1.0 if stream.random() < 0.5 else 1.0
    size = float(stream.random())
    drawn = {
        "cohesion": {"cohesion": 1.0 + 0.8 * size},
        "lift_speed": {"lift_speed": sign * (0.4 + 0.5 * size)},
        "feed_offcentre": {"feed_offcentre": 0.05 + 0.05 * size},
        "base_rough": {"base_rough": sign * (0.15 + 0.2 * size)},
        "wide_psd": {"wide_psd": 0.2 + 0.2 * size},
        # Clumps: the middles of a grain's two spheres, by their diameter.
        "shape_roll": {"shape_roll": 0.2 + 0.3 * size},
        "rim": {"rim": 0.03 + 0.03 * size},
        # One condition's mass was written down wrong, relatively.
        "one_mass": {"one_mass": sign * (0.12 + 0.1 * size)},
        "null": {},
        "decoy": {},
    }[name]
    return {key: round(value, 3) for key, value in drawn.items()}


def pile_of(condition: Condition, truth: Truth, replicate: int) -> Pile:
    """The run behind one replicate."""
    hidden = truth.hidden
    wet = condition.moisture_percent / MOISTURE
    # The Bond number of the library, 1.5 gamma / (rho g R^2), of the median grain.
    tension = hidden.get("cohesion", 0.0) * wet * DENSITY * 9.81 * 0.025**2 / 1.5
    place = [c.condition for c in CONDITIONS].index(condition.condition)
    lift = condition.lift_speed_m_s if condition.removal == "lift" else 0.0
    base = truth.contacts.wall_friction + hidden.get("base_rough", 0.0)
    wrong = hidden.get("one_mass", 0.0) if condition.condition == WRONGLY_WEIGHED else 0.0
    return Pile(
        contacts=truth.contacts,
        mass=condition.mass_kg * (1.0 + wrong),
        psd=PSD,
        density=DENSITY,
        base_radius=0.5 * BASE,
        cylinder_radius=0.5 * CYLINDER,
        seed=truth.seed * 1000 + place * 20 + replicate,
        lift=lift * math.exp(hidden.get("lift_speed", 0.0)),
        aside=(hidden.get("feed_offcentre", 0.0), 0.0),
        surface_tension=tension,
        rim=hidden.get("rim", 0.0),
        base_friction=max(base, 0.05),
        spread=hidden.get("wide_psd", 0.0),
        clump=hidden.get("shape_roll", 0.0),
    )


def make(name: str, truth: Truth, folder: Path = BANK) -> None:
    """All runs of one data set, into its file; a run that was made before it was stopped is not made again."""
    folder.mkdir(exist_ok=True)
    part = folder / f"{name}.part"
    values = np.full((len(CONDITIONS), REPLICATES, len(PILE_OBSERVABLES)), np.nan)
    heights = np.zeros((len(CONDITIONS), REPLICATES, RINGS * SECTORS), dtype=np.uint16)
    about = json.dumps({"truth": asdict(truth), "conditions": [c.condition for c in CONDITIONS]})
    if part.is_file():
        with np.load(part) as file:
            if str(file["about"]) == about:
                values, heights = file["values"], file["heights"]
    for c, condition in enumerate(CONDITIONS):
        for k in range(REPLICATES):
            if np.isnan(values[c, k, 0]):
                pile = pile_of(condition, truth, k)
                found, surface = readings(pile, run(pile))
                values[c, k] = [found[observable] for observable in PILE_OBSERVABLES]
                heights[c, k] = np.round(1000.0 * surface)
                with part.open("wb") as file:
                    np.savez_compressed(file, values=values, heights=heights, about=np.array(about))
    part.rename(folder / f"{name}.npz")


def truth_of(name: str, folder: Path = BANK) -> Truth:
    """For the scorer."""
    with np.load(folder / f"{name}.npz") as file:
        found: dict[str, Any] = json.loads(str(file["about"]))["truth"]
    return Truth(found["seed"], Contacts(**found["contacts"]), found["hidden"])


def data_set(name: str, folder: Path = BANK, chosen: tuple[str, ...] = ()) -> DataSet:
    """What a laboratory would hand over; of the `chosen` conditions, all where none is named."""
    with np.load(folder / f"{name}.npz") as file:
        values, heights = file["values"], file["heights"]
    base = 0.5 * BASE
    theta = tuple(((np.arange(SECTORS) + 0.5) * 360.0 / SECTORS).tolist()) * RINGS
    r = tuple(np.repeat((np.arange(RINGS) + 0.5) * base / RINGS, SECTORS).tolist())
    observations, profiles = [], []
    for c, condition in enumerate(CONDITIONS):
        for k in range(REPLICATES):
            row = zip(PILE_OBSERVABLES, values[c, k].tolist(), strict=True)
            measured = [(o, _rounded(v)) for o, v in row if math.isfinite(v)]
            observations += [Observation(condition.condition, str(k + 1), o, v) for o, v in measured]
            mm: Array = heights[c, k] / 1000.0
            profiles.append(Profile(condition.condition, str(k + 1), theta, r, tuple(mm.tolist())))
    whole = DataSet(CONDITIONS, tuple(observations), tuple(profiles))
    return whole.restricted(chosen) if chosen else whole


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")


def write_tables(data: DataSet, folder: Path) -> None:
    """conditions.csv, observations.csv and profiles.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    conditions = [
        {
            **{k: v for k, v in asdict(c).items() if v is not None and k in CONDITION_COLUMNS},
            "holdout": int(c.holdout),
            "psd": ";".join(f"{d:g}:{share:g}" for d, share in c.psd or ()),
        }
        for c in data.conditions
    ]
    charge_only = ("belt_", "feed_", "deflector_")
    columns = [name for name in CONDITION_COLUMNS if not name.startswith(charge_only)]
    _write(folder / "conditions.csv", columns, conditions)
    unit = {name: quantity.unit for name, quantity in PILE_OBSERVABLES.items()}
    rows = [
        {**{k: v for k, v in asdict(o).items() if v is not None}, "unit": unit[o.observable]}
        for o in data.observations
    ]
    columns = ["condition", "replicate", "observable", "value", "unit"]
    _write(folder / "observations.csv", columns, rows)
    points = [
        {"condition": p.condition, "replicate": p.replicate, "theta_deg": t, "r_m": round(r, 4), "h_m": h}
        for p in data.profiles
        for t, r, h in zip(p.theta_deg, p.r_m, p.h_m, strict=True)
    ]
    _write(folder / "profiles.csv", ["condition", "replicate", "theta_deg", "r_m", "h_m"], points)


def _write(path: Path, columns: list[str], rows: list[dict[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)


def free_sets(folder: Path = BANK) -> list[str]:
    """Names of the effect-free ones that are there."""
    return sorted(path.stem for path in folder.glob("free_*.npz"))


def scored_sets() -> dict[str, str]:
    """What is hidden in the data sets that are scored, by their names, in an order that mixes the causes."""
    causes = [cause for cause, count in SCORED.items() for _ in range(count)]
    order = np.random.default_rng(8000).permutation(len(causes))
    return {f"case_{k:02d}": causes[j] for k, j in enumerate(order)}


def seed_of(name: str) -> int:
    """Of a scored data set."""
    return 8001 + int(name[-2:])


def _make_all() -> None:
    wanted = {f"free_{k:02d}": draw_truth(7000 + k, {}) for k in range(FREE)}
    for name, cause in scored_sets().items():
        seed = seed_of(name)
        wanted[name] = draw_truth(seed, draw_hidden(cause, seed), cause == "decoy")
    for name, truth in wanted.items():
        if not (BANK / f"{name}.npz").is_file():
            make(name, truth)
            print(name, flush=True)


def parser() -> argparse.ArgumentParser:
    made = argparse.ArgumentParser(prog="python -m tests.diagnosis.piles.bank")
    made.add_argument("what", choices=["make", "hide", "write"])
    made.add_argument("names", nargs="*", help="hide: CAUSE NAME; write: NAME FOLDER")
    return made


def main() -> None:
    given = parser().parse_args()
    if given.what == "make":
        _make_all()
    elif given.what == "hide":
        cause, name = given.names
        # Fresh in each call: nobody who tunes the analyser has seen it.
        seed = secrets.randbelow(2**20) + 10_000
        make(name, draw_truth(seed, draw_hidden(cause, seed)))
    else:
        name, folder = given.names
        write_tables(data_set(name), Path(folder))


if __name__ == "__main__":
    main()
