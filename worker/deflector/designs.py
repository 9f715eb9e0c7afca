"""What of a deflector a study varies, and the plant that a design makes.

Notation: u a design in the unit cube, (V,) in the order of VARIABLES; x the same in the variables' own units.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from demcore.allowed import within
from demcore.errors import InputError
from demcore.plant.checks import check_deflector
from demcore.plant.parts import Deflector, Plant
from worker.optimizer.design import FloatArray, generator, sobol

# Lower and upper bound: pitches slide grains off and stay short of upright; the ridge goes where the jet may come.
VARIABLES: dict[str, tuple[float, float]] = {
    "near_pitch_deg": (30.0, 65.0),
    "far_pitch_deg": (30.0, 65.0),
    "ridge_across": (-0.45, 0.35),
    "ridge_along": (-1.15, -0.7),
    "rotation_deg": (-60.0, 60.0),
    "edge_length": (0.5, 1.1),
}
# Points of the box that are tried for one design before it counts as too narrow.
TRIES = 1024
STREAM = 11


@dataclass(frozen=True)
class Space:
    """The box around a present deflector, in a plant that the designs must fit."""

    plant: Plant
    bounds: tuple[tuple[str, float, float], ...] = tuple((k, *v) for k, v in VARIABLES.items())

    def __post_init__(self) -> None:
        for name, lower, upper in self.bounds:
            if name not in VARIABLES:
                raise InputError("variables", name, "one of " + ", ".join(VARIABLES))
            if not lower < upper:
                raise InputError(f"variables.{name}", [lower, upper], "lower bound below upper bound")

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for name, _, _ in self.bounds)

    def deflector(self, u: Sequence[float]) -> Deflector:
        """The device of a point of the unit cube, to a tenth of a millimetre or of a degree."""
        x = {
            name: round(lower + (upper - lower) * share, 1 if name.endswith("_deg") else 4)
            for (name, lower, upper), share in zip(self.bounds, u, strict=True)
        }
        return replace(self.plant.deflector, **x)

    def unit_of(self, deflector: Deflector) -> tuple[float, ...]:
        """The point of a device; outside the box it is moved to its edge."""
        return tuple(
            min(max((getattr(deflector, name) - lower) / (upper - lower), 0.0), 1.0)
            for name, lower, upper in self.bounds
        )

    def plant_of(self, u: Sequence[float]) -> Plant:
        """The plant with that device. Raises InputError where it does not fit; the rest of the plant is sound."""
        plant = replace(self.plant, deflector=self.deflector(u))
        check_deflector(plant)
        return plant

    def fits(self, u: Sequence[float]) -> bool:
        """Whether the device lies inside the hopper, clear of lid, rod and wall."""
        try:
            self.plant_of(u)
        except InputError:
            return False
        return True


def first_designs(space: Space, seed: int, count: int) -> list[tuple[float, ...]]:
    """The first `count` points of a Sobol sequence that fit. Raises InputError where too few do."""
    within("designs", count, 1, TRIES)
    found = [
        tuple(float(v) for v in u) for u in sobol(len(space.bounds), TRIES, STREAM, seed) if space.fits(u)
    ]
    if len(found) < count:
        raise InputError(
            "designs", count, f"at most {len(found)}: so many devices of {TRIES} tried fit the plant"
        )
    return found[:count]


def candidates(space: Space, seed: int, number: int, best: FloatArray) -> FloatArray:
    """(C, V) points that fit: all over the box, and about the points `best` (B, V)."""
    stream = generator(STREAM, seed, number)
    spread = stream.random((256, len(space.bounds)))
    about = [b + 0.08 * stream.standard_normal((32, len(space.bounds))) for b in best]
    points = np.clip(np.concatenate([spread, *about]), 0.0, 1.0)
    return np.array([u for u in points if space.fits(u)]).reshape(-1, len(space.bounds))
