"""What the optimizer knows of a study: finished designs, pending ones, and what their replicates scatter.

Notation
    x       design in physical units, order of the space's variables      tuple (d,)
    group   all finished runs at one x (same parameters, other seeds)
    s_i^2   variance of the angles inside group i, n_i runs
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from service.domain.noise import sum_of_squares
from service.domain.observables import ANGLE, NoiseLevel

# Designs of these origins cost no budget: they were known before, or ran at the coarse scale.
FREE_ORIGINS = ("import", "warm", "coarse")


@dataclass(frozen=True)
class Design:
    """One finished design, with a value for every response of its study.

    `results` None: the run ended in error (crash, no pile, never settles), or a response was not measured.
    """

    number: int
    x: tuple[float, ...]
    seed: int
    results: Mapping[str, float] | None
    origin: str
    scale: float = 1.0

    def __post_init__(self) -> None:
        for name, value in (self.results or {}).items():
            if not math.isfinite(value):
                raise ValueError(f"design {self.number}: {name} is finite, or all results are None")

    @property
    def angle_deg(self) -> float | None:
        """None after an error, and where the study does not ask for the angle."""
        return None if self.results is None else self.results.get(ANGLE)


@dataclass(frozen=True)
class Pending:
    """One design whose result is not known yet (or not to be looked at yet)."""

    number: int
    x: tuple[float, ...]
    seed: int
    origin: str
    scale: float = 1.0


@dataclass(frozen=True)
class WarmStudy:
    """The finished designs of a stored study of the same test, x in this study's order."""

    study_id: int
    finished: tuple[Design, ...]


@dataclass(frozen=True)
class Group:
    """The finished runs of one x: all numbers, the results of those that ran, the count of the others."""

    x: tuple[float, ...]
    numbers: tuple[int, ...]
    results: tuple[Mapping[str, float], ...]
    failures: int

    @property
    def runs(self) -> int:
        """Runs with results."""
        return len(self.results)

    def values(self, observable: str) -> tuple[float, ...]:
        """Of the runs that have one: observables that are no response may lack."""
        return tuple(r[observable] for r in self.results if observable in r)

    @property
    def angles_deg(self) -> tuple[float, ...]:
        return self.values(ANGLE)


@dataclass(frozen=True)
class History:
    """Designs at the study's own scale, at its coarse one, and of earlier studies; never pooled.

    Cancelled designs are left out by the caller; the order of the tuples carries no meaning.
    noise: by observable, what earlier replicates of the same test scatter. accepted: failures up to this number
    were looked at by a person, who went on. replaced: designs without a cost that another run of the same seed
    stands for now; their numbers are used up.
    """

    finished: tuple[Design, ...] = ()
    pending: tuple[Pending, ...] = ()
    coarse: tuple[Design, ...] = ()
    coarse_pending: tuple[Pending, ...] = ()
    warm: tuple[WarmStudy, ...] = ()
    noise: Mapping[str, NoiseLevel] = field(default_factory=dict)
    accepted: int = 0
    replaced: int = 0

    def __post_init__(self) -> None:
        for name in ("finished", "pending", "coarse", "coarse_pending"):
            object.__setattr__(self, name, tuple(sorted(getattr(self, name), key=lambda d: d.number)))

    @property
    def failures(self) -> int:
        return sum(d.results is None for d in self.finished)

    @property
    def free(self) -> int:
        """Designs that cost no budget."""
        known = sum(d.origin in FREE_ORIGINS for d in self.finished)
        return known + len(self.coarse) + len(self.coarse_pending) + self.replaced

    @property
    def succeeded(self) -> int:
        return len(self.finished) - self.failures

    def groups(self) -> tuple[Group, ...]:
        """Finished designs by x, in the order of their first number."""
        return grouped(self.finished)

    def seeds_used(self, x: tuple[float, ...]) -> frozenset[int]:
        done = {d.seed for d in self.finished if d.x == x}
        return frozenset(done | {p.seed for p in self.pending if p.x == x})

    def visited(self) -> frozenset[tuple[float, ...]]:
        return frozenset({d.x for d in self.finished} | {p.x for p in self.pending})

    def scatter(self, observable: str = ANGLE) -> tuple[float, int]:
        """Sum of squares inside the groups (unit^2) and its degrees of freedom."""
        return sum_of_squares(group.values(observable) for group in self.groups())

    @property
    def training_hash(self) -> str:
        """sha256 of all that a proposal may depend on: results, and what is pending."""
        rows = [
            [_row(d) for d in self.finished],
            [[p.number, p.x, p.seed] for p in self.pending],
            [_row(d) for d in self.coarse],
            [[p.number, p.x, p.seed] for p in self.coarse_pending],
            [[study.study_id, [_row(d) for d in study.finished]] for study in self.warm],
            {name: [level.sd, level.freedom] for name, level in self.noise.items()},
        ]
        return hashlib.sha256(json.dumps(rows, sort_keys=True).encode()).hexdigest()


def _row(design: Design) -> list[object]:
    results = None if design.results is None else dict(design.results)
    return [design.number, design.x, design.seed, results]


def grouped(designs: Iterable[Design]) -> tuple[Group, ...]:
    """Designs by x, in the order in which each x comes first."""
    by_x: dict[tuple[float, ...], list[Design]] = {}
    for design in designs:
        by_x.setdefault(design.x, []).append(design)
    return tuple(_group(x, same) for x, same in by_x.items())


def _group(x: tuple[float, ...], designs: list[Design]) -> Group:
    results = tuple(d.results for d in designs if d.results is not None)
    return Group(x, tuple(d.number for d in designs), results, len(designs) - len(results))
