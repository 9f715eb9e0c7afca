"""How far runs of one design scatter, beside the tolerance that a study asks for (calibration.md decision 4).

Notation (one observable, in its unit; groups of runs that differ by their seed alone)
    n_i, s_i^2   runs of group i and their variance
    SS           sum (n_i - 1) s_i^2, with nu = sum (n_i - 1) degrees of freedom
    s            sqrt(SS / nu), the pooled within-design sd
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from service.domain.observables import NoiseLevel
from service.domain.study import Response


@dataclass(frozen=True)
class RunNoise:
    """Of one response, in its unit. `freedom` 0: `sd` is what is expected of the observable, or None."""

    observable: str
    unit: str
    tolerance: float
    sd: float | None
    freedom: int

    @property
    def is_measured(self) -> bool:
        return self.freedom > 0

    @property
    def text(self) -> str:
        """A clause."""
        if self.sd is None:
            return "not known before a design has run with two seeds"
        if not self.is_measured:
            return f"{self.sd:.2g} {self.unit} expected, not yet measured"
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


def run_noise(
    response: Response, groups: Iterable[Sequence[float]], earlier: NoiseLevel | None = None
) -> RunNoise:
    """Pooled over the study's groups and `earlier` replicates of the same test, or what is expected."""
    squares, freedom = sum_of_squares(groups)
    if earlier is not None:
        squares, freedom = squares + earlier.freedom * earlier.sd**2, freedom + earlier.freedom
    sd = math.sqrt(squares / freedom) if freedom else response.meaning.noise_sd
    return RunNoise(response.observable, response.meaning.unit, response.tolerance, sd, freedom)
