"""How far a simulated pile is from a real one that hides nothing: the floor under every misfit of the DEM.

Read from pile_floor.json, which `python -m worker.estimate_floor` makes of effect-free piles by another code, and
which says of how many. Coherent (floor.py): codes differ in a law, and a law moves many summaries at once.

Of a contact model that was never compared it is assumed, and a diagnosis says so: independent sds about what one
bed in four codes' hands showed (angle by surface scan: LIGGGHTS 35.5, demcore 35.7, LAMMPS 34.4, YADE 33.3 with
another scale of the rolling couple: sd 1.1 degrees; LIGGGHTS and demcore 2.3 % apart in t90, .2 % in mass on the
base).

Notation (K summaries of both tests, P effect-free data sets)
    A, B    covariances: what the conditions of a material share, and each condition's own     (K, K)
    R       radius of the base, m: lengths (toe, curvature, dipole, offset) grow with it

A and B are moments of few data sets: as Student's t with P degrees of freedom, wider in variance by P/(P - 2).

Of other materials, or of grains coarser than those, nobody has seen the floor: there it is the larger of what was
measured and what is assumed, and a diagnosis says so.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from service.domain.data_set.records import Condition
from service.domain.errors import InvalidValue
from service.domain.measured_pile import pile_scale, rig_of
from worker.diagnosis.floor import KEYS, Floor
from worker.diagnosis.simulator import FloatArray

FILE = Path(__file__).parent / "pile_floor.json"
LENGTHS = ("offset_x", "offset_y", "toe", "curvature", "dipole_c", "dipole_s")
LEAST_PAIRS = 4
# Standard deviations in the unit of the summary, of what all conditions of a material share, on such a base (m);
# how it varies from condition to condition was never measured: a share of it.
ASSUMED = {
    "angle": 1.1,
    "slope": 1.1,
    "ln_apex": 0.03,
    "ln_mass": 0.02,
    "ln_t90": 0.025,
    "ln_density": 0.02,
    "ln_d50": 0.02,
    "offset_x": 0.003,
    "offset_y": 0.003,
    "toe": 0.01,
    "curvature": 0.003,
    "dipole_c": 0.003,
    "dipole_s": 0.003,
}
OWN_SHARE, ASSUMED_BASE, CERTAIN = 0.4, 0.375, 10**9
NEVER_COMPARED = (
    "How far simulated piles are from real ones that hide nothing was never estimated for {} contacts: it is "
    "assumed, so a verdict is as good as that assumption."
)
ELSEWHERE = (
    "The floor between simulated and real piles was estimated on {}; of {} it was never measured, so it is taken "
    "as no smaller than an assumed one: a verdict is as good as that assumption."
)
# A scale is rounded; so much coarser is none.
_AS_COARSE = 1.05
_PILES = [k for k, (test, _) in enumerate(KEYS) if test == "pile"]


@dataclass(frozen=True)
class PileFloor:
    """One floor as it was estimated with a contact model, on bases of `base_radius`, from `pairs` data sets of
    `materials`, whose grains were at most `coarseness` times their real size.

    Raises InvalidValue with fewer than four.
    """

    floor: Floor
    base_radius: float
    pairs: int
    materials: tuple[str, ...] = ()
    coarseness: float = 1.0

    def __post_init__(self) -> None:
        if self.pairs < LEAST_PAIRS:
            raise InvalidValue("floor.pairs", self.pairs, f"at least {LEAST_PAIRS} effect-free data sets")

    def on(self, base_radius: float) -> Floor:
        """On a base of another radius, widened for the few data sets behind it."""
        ratio = base_radius / self.base_radius
        scale = np.array([ratio if name in LENGTHS else 1.0 for _, name in KEYS])
        wide = self.pairs / (self.pairs - 2.0) * np.outer(scale, scale)
        return Floor(self.floor.shared * wide, self.floor.own * wide)

    def as_record(self) -> dict[str, Any]:
        """Plain JSON types: only the summaries of piles, rounded to five digits."""
        return {
            "pairs": self.pairs,
            "base_radius_m": self.base_radius,
            "materials": list(self.materials),
            "coarseness": self.coarseness,
            "summaries": [KEYS[k][1] for k in _PILES],
            "shared": _rows(self.floor.shared),
            "own": _rows(self.floor.own),
        }


def from_record(record: dict[str, Any]) -> PileFloor:
    """What as_record made; summaries may have got a new order or company since."""
    places = [KEYS.index(("pile", name)) for name in record["summaries"]]
    tables = []
    for name in ("shared", "own"):
        table = np.zeros((len(KEYS), len(KEYS)))
        table[np.ix_(places, places)] = record[name]
        tables.append(table)
    return PileFloor(
        Floor(*tables),
        record["base_radius_m"],
        record["pairs"],
        tuple(record["materials"]),
        record["coarseness"],
    )


class Known(NamedTuple):
    """The floor, and the sentence that says what it lacks; empty where it was estimated."""

    floor: Floor
    sentence: str


def pile_floor(contact_model: str, conditions: Sequence[Condition], grains: int) -> Known:
    """Of a contact model, for the largest base among these conditions, whose piles hold about `grains`."""
    base, stored = base_radius_of(conditions), _stored()
    if contact_model not in stored:
        return Known(assumed().on(base), NEVER_COMPARED.format(contact_model))
    found = stored[contact_model]
    others = _elsewhere(found, conditions, grains)
    if not others:
        return Known(found.on(base), "")
    return Known(larger(found.on(base), assumed().on(base)), ELSEWHERE.format(_compared(found), others))


def larger(measured: Floor, other: Floor) -> Floor:
    """`measured`, with every variance raised to that of `other` where it is smaller."""
    tables = [
        a + np.diag(np.maximum(np.diag(b) - np.diag(a), 0.0))
        for a, b in ((measured.shared, other.shared), (measured.own, other.own))
    ]
    return Floor(*tables)


def _elsewhere(found: PileFloor, conditions: Sequence[Condition], grains: int) -> str:
    """Which of these tests are unlike those that were compared, in words; empty where none is."""
    materials = sorted({c.material for c in conditions} - set(found.materials))
    coarsest = max(pile_scale(c, grains) for c in conditions)
    coarse = f"grains {coarsest:.3g} times coarser than real ones" if _is_coarser(coarsest, found) else ""
    return " and ".join(part for part in (", ".join(materials), coarse) if part)


def _is_coarser(scale: float, found: PileFloor) -> bool:
    return scale > _AS_COARSE * found.coarseness


def _compared(found: PileFloor) -> str:
    size = (
        "their real size"
        if found.coarseness <= _AS_COARSE
        else f"{found.coarseness:.3g} times their real size"
    )
    return f"{found.pairs} data sets of {', '.join(found.materials)} at {size}"


def assumed() -> PileFloor:
    """Independent between summaries, since nothing says how they go together."""
    sd = np.array([ASSUMED.get(name, 0.0) if test == "pile" else 0.0 for test, name in KEYS])
    # Known for certain as it is: nothing widens an assumption.
    return PileFloor(Floor(np.diag(sd**2), np.diag((OWN_SHARE * sd) ** 2)), ASSUMED_BASE, CERTAIN)


def base_radius_of(conditions: Sequence[Condition]) -> float:
    """m, the largest."""
    return max(0.5 * rig_of(c).base_diameter for c in conditions)


@cache
def _stored() -> dict[str, PileFloor]:
    if not FILE.is_file():
        return {}
    found = json.loads(FILE.read_text(encoding="utf-8"))["contact_models"]
    return {name: from_record(record) for name, record in found.items()}


def _rows(table: FloatArray) -> list[list[float]]:
    return [[float(f"{x:.5g}") for x in row] for row in table[np.ix_(_PILES, _PILES)].tolist()]
