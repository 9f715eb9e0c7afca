"""One line of the verification table, and how a case that cannot finish becomes one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from demcore.errors import SimulationError

SECTION_1 = "physics.md section 1"
SECTION_3 = "physics.md section 3"


@dataclass(frozen=True)
class Outcome:
    """Passed when |got - expected| <= tolerance. A yes/no question is 1 or 0 with tolerance 0."""

    name: str
    source: str
    expected: float
    got: float
    tolerance: float

    @property
    def passed(self) -> bool:
        return bool(abs(self.got - self.expected) <= self.tolerance)

    def record(self) -> dict[str, str | float | bool | None]:
        """As JSON knows it: a number that is not finite is null."""
        numbers = {
            name: float(value) if math.isfinite(value) else None
            for name, value in (
                ("expected", self.expected),
                ("got", self.got),
                ("tolerance", self.tolerance),
            )
        }
        return {"name": self.name, "source": self.source, **numbers, "passed": self.passed}


Case = Callable[[], Iterator[Outcome]]


def run_cases(cases: Iterable[Case]) -> Iterator[Outcome]:
    """The outcomes of all cases, one after another; a simulation that breaks down is a failed outcome."""
    for case in cases:
        try:
            yield from case()
        except SimulationError as error:
            yield Outcome(f"{case.__name__}: {error.kind}: {error}", "the run itself", 0.0, math.nan, 0.0)


def share_of(name: str, source: str, expected: float, got: float, share: float) -> Outcome:
    """An outcome whose tolerance is a share of what is expected."""
    return Outcome(name, source, expected, got, share * abs(expected))
