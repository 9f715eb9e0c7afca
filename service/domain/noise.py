"""How far runs of one design scatter, beside the tolerance that a study asks for (calibration.md decision 4).

Notation (one observable, in its unit; groups of runs that differ by their seed alone)
    n_i, s_i^2   runs of group i and their variance
    SS           sum (n_i - 1) s_i^2, with nu = sum (n_i - 1) degrees of freedom
    s            sqrt(SS / nu), the pooled within-design sd
    e_i          standard error of run i's angle, from the sectors of its pile
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from service.domain.observables import ANGLE, OBSERVABLES, NoiseLevel
from service.domain.study import Response

# Runs scatter more than the sectors of one pile let expect, since neighbouring sectors are not independent: the sd
# between seeds over the standard error was 2.3 (coke, scale 3.2: 4.1 deg), 2.2 (sinter, scale 4: 2.4) and 1.5
# (pellet, scale 1.7: .83). Worth three degrees of freedom, it keeps seeds that happen to agree from certifying a
# coarse pile: four of sinter lay within .6 deg, three others 4.7 deg higher.
SECTOR_FACTOR, SECTOR_FREEDOM = 1.8, 3
FEWEST_RUNS = 3


@dataclass(frozen=True)
class RunNoise:
    """Of one response, in its unit. `freedom` 0: `sd` is what is expected, by the sectors of the piles or of the
    observable, or None."""

    observable: str
    unit: str
    tolerance: float
    sd: float | None
    freedom: int
    by_sectors: bool = False

    @property
    def is_measured(self) -> bool:
        return self.freedom > 0

    @property
    def text(self) -> str:
        """A clause."""
        if self.sd is None:
            return "not known before a design has run with two seeds"
        if not self.is_measured:
            source = " from the sectors of the piles" if self.by_sectors else ""
            return f"{self.sd:.2g} {self.unit} expected{source}, not yet measured"
        degrees = "degree" if self.freedom == 1 else "degrees"
        return f"{self.sd:.2g} {self.unit} measured ({self.freedom} {degrees} of freedom)"


def sum_of_squares(groups: Iterable[Sequence[float]]) -> tuple[float, int]:
    """SS and nu."""
    squares, freedom = 0.0, 0
    for values in groups:
        if len(values) > 1:
            mean = sum(values) / len(values)
            squares += sum((value - mean) ** 2 for value in values)
            freedom += len(values) - 1
    return squares, freedom


def pooled(groups: Iterable[Sequence[float]]) -> NoiseLevel | None:
    """s; None without replicates."""
    squares, freedom = sum_of_squares(groups)
    return NoiseLevel(math.sqrt(squares / freedom), freedom) if freedom else None


def expected_of_sectors(errors: Iterable[float | None]) -> NoiseLevel | None:
    """Scatter of the angle between runs, deg, from their e_i (None: of no pile): SECTOR_FACTOR times the median.

    None before FEWEST_RUNS, and where it is no more than what is expected of any pile anyway.
    """
    known = [error for error in errors if error is not None]
    if len(known) < FEWEST_RUNS:
        return None
    expected, usual = SECTOR_FACTOR * statistics.median(known), OBSERVABLES[ANGLE].noise_sd
    return None if usual is not None and expected <= usual else NoiseLevel(expected, SECTOR_FREEDOM)


def run_noise(
    response: Response,
    groups: Iterable[Sequence[float]],
    earlier: NoiseLevel | None = None,
    sectors: NoiseLevel | None = None,
) -> RunNoise:
    """Pooled over the study's groups and `earlier` replicates of the same test, or what is expected: by
    `sectors`, where they tell, or of the observable."""
    squares, freedom = sum_of_squares(groups)
    if earlier is not None:
        squares, freedom = squares + earlier.freedom * earlier.sd**2, freedom + earlier.freedom
    name, unit, tolerance = response.observable, response.meaning.unit, response.tolerance
    if freedom:
        return RunNoise(name, unit, tolerance, math.sqrt(squares / freedom), freedom)
    if sectors is not None:
        return RunNoise(name, unit, tolerance, sectors.sd, 0, by_sectors=True)
    return RunNoise(name, unit, tolerance, response.meaning.noise_sd, 0)
