"""What the optimizer knows of a study: finished designs, pending ones, and what their scatter says of noise.

Notation
    x       design in physical units, order of the space's variables      tuple (d,)
    group   all finished runs at one x (same parameters, other seeds)
    s_i^2   variance of the angles inside group i, n_i runs
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass

# Prior of the noise, until replicates speak: a scaled inverse chi-square with 4 degrees of freedom at 0.5 deg
# (calibration.md; the paper's repeats pool to 0.58). Four degrees weigh as two designs of three seeds.
PRIOR_NOISE_DEG = 0.5
PRIOR_FREEDOM = 4.0


@dataclass(frozen=True)
class Design:
    """One finished design. `angle_deg` None: the run ended in error (crash, no pile, never settles)."""

    number: int
    x: tuple[float, ...]
    seed: int
    angle_deg: float | None
    origin: str

    def __post_init__(self) -> None:
        if self.angle_deg is not None and not math.isfinite(self.angle_deg):
            raise ValueError(f"design {self.number}: an angle is finite, or None after an error")


@dataclass(frozen=True)
class Pending:
    """One design whose result is not known yet (or not to be looked at yet)."""

    number: int
    x: tuple[float, ...]
    seed: int
    origin: str


@dataclass(frozen=True)
class Group:
    """The finished runs of one x: all numbers, the angles of those that ran, the count of the others."""

    x: tuple[float, ...]
    numbers: tuple[int, ...]
    angles_deg: tuple[float, ...]
    failures: int

    @property
    def mean_deg(self) -> float:
        return sum(self.angles_deg) / len(self.angles_deg)


@dataclass(frozen=True)
class History:
    """Cancelled designs are left out by the caller; the order of the tuples carries no meaning."""

    finished: tuple[Design, ...] = ()
    pending: tuple[Pending, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "finished", tuple(sorted(self.finished, key=lambda d: d.number)))
        object.__setattr__(self, "pending", tuple(sorted(self.pending, key=lambda p: p.number)))

    @property
    def failures(self) -> int:
        return sum(d.angle_deg is None for d in self.finished)

    @property
    def succeeded(self) -> int:
        return len(self.finished) - self.failures

    def groups(self) -> tuple[Group, ...]:
        """Finished designs by x, in the order of their first number."""
        by_x: dict[tuple[float, ...], list[Design]] = {}
        for design in self.finished:
            by_x.setdefault(design.x, []).append(design)
        return tuple(_group(x, designs) for x, designs in by_x.items())

    def seeds_used(self, x: tuple[float, ...]) -> frozenset[int]:
        done = {d.seed for d in self.finished if d.x == x}
        return frozenset(done | {p.seed for p in self.pending if p.x == x})

    def visited(self) -> frozenset[tuple[float, ...]]:
        return frozenset({d.x for d in self.finished} | {p.x for p in self.pending})

    def scatter(self) -> tuple[float, int]:
        """Sum of squares inside the groups (deg^2) and its degrees of freedom."""
        squares, freedom = 0.0, 0
        for group in self.groups():
            if len(group.angles_deg) > 1:
                squares += sum((a - group.mean_deg) ** 2 for a in group.angles_deg)
                freedom += len(group.angles_deg) - 1
        return squares, freedom

    def replicate_sd_deg(self) -> float | None:
        """Pooled sd of replicates, `sqrt(sum (n_i - 1) s_i^2 / sum (n_i - 1))`; None without replicates."""
        squares, freedom = self.scatter()
        return math.sqrt(squares / freedom) if freedom else None

    def noise_sd_deg(self) -> float:
        """The pooled sd shrunk towards the prior: `sqrt((nu0 s0^2 + sum (n_i - 1) s_i^2) / (nu0 + nu))`."""
        squares, freedom = self.scatter()
        return math.sqrt((PRIOR_FREEDOM * PRIOR_NOISE_DEG**2 + squares) / (PRIOR_FREEDOM + freedom))

    @property
    def training_hash(self) -> str:
        """sha256 of all that a proposal may depend on: results, and what is pending."""
        rows = [
            [[d.number, d.x, d.seed, d.angle_deg] for d in self.finished],
            [[p.number, p.x, p.seed] for p in self.pending],
        ]
        return hashlib.sha256(json.dumps(rows).encode()).hexdigest()


def _group(x: tuple[float, ...], designs: list[Design]) -> Group:
    angles = tuple(d.angle_deg for d in designs if d.angle_deg is not None)
    return Group(x, tuple(d.number for d in designs), angles, len(designs) - len(angles))
