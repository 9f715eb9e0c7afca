"""The analytic tier: data sets with and without hidden causes, diagnosed one after the other, and scored.

The hider and the scorer live in the repository's tests and share only the data format with this package, so the
bench needs a checkout. What it measures is the statistics: the analyser's model here is its stand-in
(stand_in.py), and the truth is another made-up world.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from service.domain.data_set.records import DataSet
from service.domain.effects import library
from service.domain.errors import InvalidValue
from worker.diagnosis.diagnose import Diagnosis, Options, diagnose, effect_free_misfits
from worker.diagnosis.floor import Floor, estimate_floor
from worker.diagnosis.gain import held_out_gain, with_gain
from worker.diagnosis.next_measurement import next_measurements
from worker.diagnosis.null_calibration import NullCalibration
from worker.diagnosis.result import Result
from worker.diagnosis.simulator import Simulator
from worker.diagnosis.stand_in import StandIn

# Effect-free pairs behind the floor, and where their seeds start: far from those of the cases.
FLOOR_PAIRS = 40
_FLOOR_SEED = 500_000
_OPTIONS_SEED = 17


class Hidden(Protocol):
    """What the bench may know of a case: the data, and which effect its library is to lack."""

    @property
    def number(self) -> int: ...

    @property
    def data(self) -> DataSet: ...

    @property
    def unknown(self) -> str | None: ...


class Tier(Protocol):
    """The hider and the scorer, which know each other."""

    def cases(self, count: int, seed: int) -> Iterator[Hidden]: ...

    def effect_free(self, count: int, seed: int) -> Iterator[DataSet]: ...

    def score(self, pairs: Sequence[tuple[Hidden, Mapping[str, Any]]]) -> dict[str, Any]: ...


ABLATIONS: Mapping[str, Mapping[str, bool]] = {
    "no pooling": {"pooled": False},
    "no refinement": {"refined": False},
    "no remainder test": {"remainder": False},
}
Progress = Callable[[int, Result], None]


def tier() -> Tier:
    """The one in the repository's tests. Raises InvalidValue outside of a checkout."""
    try:
        return importlib.import_module("tests.diagnosis.tier")
    except ModuleNotFoundError as error:
        raise InvalidValue(
            "bench", str(error), "started from the root of a checkout, with its tests"
        ) from None


@dataclass(frozen=True)
class Report:
    """Score of the method as it is, and of the ablations, on the first `compared` cases, beside it there."""

    score: Mapping[str, Any]
    ablations: Mapping[str, Mapping[str, Any]]
    compared: int

    def as_dict(self) -> dict[str, Any]:
        return {**self.score, "ablations": dict(self.ablations), "compared_on": self.compared}


def bench(cases: int, seed: int, compared: int, progress: Progress | None = None) -> Report:
    """About `cases` cases drawn with `seed`; the ablations on the first `compared` of them."""
    found, simulator = tier(), StandIn()
    floor = floor_of(found, simulator, seed)
    pairs = list(play(found, cases, seed, Options(floor=floor), simulator, progress))
    ablations: dict[str, Mapping[str, Any]] = {}
    if compared:
        ablations["as it is"] = found.score(pairs[:compared])
        for name, change in ABLATIONS.items():
            options = replace(Options(floor=floor), **change)  # type: ignore[arg-type]
            played = play(found, cases, seed, options, simulator, None, compared)
            ablations[name] = found.score(list(played))
    return Report(found.score(pairs), ablations, compared)


def floor_of(found: Tier, simulator: Simulator, seed: int, pairs: int = FLOOR_PAIRS) -> Floor:
    """From effect-free pairs of the two worlds, with seeds of their own."""
    free = found.effect_free(pairs, _FLOOR_SEED + seed)
    return estimate_floor(
        effect_free_misfits(data, simulator, Options(seed=k + 1)) for k, data in enumerate(free)
    )


def play(
    found: Tier,
    cases: int,
    seed: int,
    options: Options,
    simulator: Simulator,
    progress: Progress | None = None,
    most: int | None = None,
) -> Iterator[tuple[Hidden, Mapping[str, Any]]]:
    """Each case with the answer to it. Null calibrations are kept: several cases are of one design."""
    stored: dict[str, NullCalibration] = {}
    for number, case in enumerate(found.cases(cases, seed)):
        if number == most:
            return
        known = library() if case.unknown is None else library().without(case.unknown)
        mine = replace(options, known=known, seed=_OPTIONS_SEED + case.number)
        result = answer(case.data, simulator, mine, stored)
        if result.calibration is not None:
            stored[result.calibration.key] = result.calibration
        if progress is not None:
            progress(number, result)
        yield case, result.as_dict()


def answer(
    data: DataSet, simulator: Simulator, options: Options, stored: Mapping[str, NullCalibration]
) -> Result:
    """Verdict, then the held-out gain of what is named, and the next measurement."""
    found: Diagnosis = diagnose(data, simulator, options, stored)
    result = found.result
    if found.analysis is not None and found.measured is not None:
        proposals = next_measurements(found.analysis, found.measured, options.seed)
        result = replace(result, next_measurement=proposals)
    if result.claims and data.held_out.observations:
        result = with_gain(result, held_out_gain(data, simulator, found, options))
    return result


HEADER = f"{'measure':28} {'kind':20} {'SNR':>4} {'n':>5} {'value':>7}  {'90 %':13}  {'mark':>9}  met"


def as_line(mark: Mapping[str, Any]) -> str:
    """One mark for the terminal."""
    snr = "" if mark["snr"] is None else f"{mark['snr']:.0f}"
    met = {None: "", True: "yes", False: "NO"}[mark["met"]]
    asked = "" if mark["mark"] is None else f"{mark['mark']:.2f}"
    between = f"{mark['low']:.3f} - {mark['high']:.3f}"
    return (
        f"{mark['measure']:28} {mark['kind']:20} {snr:>4} {mark['count']:5d} {mark['value']:7.3f}  "
        f"{between:13}  {asked:>9}  {met}"
    )
