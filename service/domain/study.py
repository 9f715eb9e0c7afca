"""What a calibration study asks for, validated whole before anything is stored."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from service.domain import derived as expressions
from service.domain.errors import InvalidValue
from service.domain.model_use import ModelUse
from service.domain.observables import OBSERVABLES, NoiseLevel, Observable
from service.domain.search_space import PARAMETERS, SearchSpace
from service.domain.strategy import MODEL_BASED, STRATEGIES, least_budget

# Degrees of freedom from which on measured noise refuses a tolerance: below, the pooled sd of a sound test is off
# by a factor of two in one case of ten.
FEWEST_FREEDOM = 4
# Points at which a derived parameter is tried before a study is accepted.
_DERIVED_TRIALS = 1024


@dataclass(frozen=True)
class Response:
    """Make `observable` meet `target`; feasible inside `window` (Table 6's sense). All in its unit.

    `tolerance` is the certificate's: the recommended design's expected |response - target| must be below it.
    `uncertainty` is the sd of the lab's value.
    """

    observable: str
    target: float
    window: tuple[float, float]
    tolerance: float
    uncertainty: float = 0.0

    def __post_init__(self) -> None:
        if self.observable not in OBSERVABLES:
            raise InvalidValue("responses.observable", self.observable, "one of " + ", ".join(OBSERVABLES))
        known, at = OBSERVABLES[self.observable], f"responses.{self.observable}"
        for name, value in (
            ("target", self.target),
            ("window.lower", self.window[0]),
            ("window.upper", self.window[1]),
        ):
            _within(f"{at}.{name}", value, known.lowest, known.highest, known.unit)
        lower, upper = self.window
        if lower >= upper:
            raise InvalidValue(f"{at}.window", list(self.window), "lower bound below upper bound")
        if not lower <= self.target <= upper:
            raise InvalidValue(
                f"{at}.target", self.target, f"inside the window {lower:g} to {upper:g} {known.unit}"
            )
        span = known.highest - known.lowest
        if not (_is_number(self.tolerance) and 0.0 < self.tolerance <= span):
            raise InvalidValue(
                f"{at}.tolerance", self.tolerance, f"more than 0 and at most {span:g} {known.unit}"
            )
        _within(f"{at}.uncertainty", self.uncertainty, 0.0, span, known.unit)

    @property
    def meaning(self) -> Observable:
        return OBSERVABLES[self.observable]

    def contains(self, value: float) -> bool:
        return self.window[0] <= value <= self.window[1]


@dataclass(frozen=True)
class CoarsePrior:
    """`runs` simulations at the coarser `scale` before the first one at the study's; they cost no budget."""

    scale: float
    runs: int

    def __post_init__(self) -> None:
        _within("coarse.scale", self.scale, 0.5, 8.0)
        _integer("coarse.runs", self.runs, 3, 200)


@dataclass(frozen=True)
class TableRow:
    """A design of the user's table: x by parameter; results by observable where they are known already."""

    x: Mapping[str, float]
    results: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "x", MappingProxyType(dict(self.x)))
        if self.results is None:
            return
        for name, value in self.results.items():
            if name not in OBSERVABLES:
                raise InvalidValue("table.results", name, "one of " + ", ".join(OBSERVABLES))
            if not _is_number(value):
                raise InvalidValue(f"table.results.{name}", value, "a finite number")
        object.__setattr__(self, "results", MappingProxyType(dict(self.results)))


@dataclass(frozen=True)
class StudySpec:
    """A whole calibration: what to simulate, what to vary, what to reach and how much to spend.

    `parallel` is the number of designs in flight. A proposal for design n sees exactly the results of designs
    1 to n - parallel, whoever finished first, so that the same seed gives the same designs whatever dies.
    `derived` holds expressions of other parameters by the parameter that they give. The rows of `table` are run
    by the strategy `table`; those with results are known designs for any strategy. `warm_start` names stored
    studies of the same test. `model`: a version of the model that the piles are simulated with.
    """

    material: str
    scale: float
    space: SearchSpace
    responses: tuple[Response, ...]
    strategy: str = "auto"
    budget: int = 30
    initial_designs: int = 6
    replicates: int = 3
    parallel: int = 2
    seed: int = 1
    fixed: Mapping[str, float] = field(default_factory=dict)
    derived: Mapping[str, str] = field(default_factory=dict)
    table: tuple[TableRow, ...] = ()
    coarse: CoarsePrior | None = None
    warm_start: tuple[int, ...] = ()
    fill_level: float = 1.0
    time_step: str = "fast"
    model: ModelUse | None = None

    def __post_init__(self) -> None:
        _within("scale", self.scale, 0.5, 8.0)
        _within("fill_level", self.fill_level, 0.1, 1.0)
        _integer("budget", self.budget, 1, 1000)
        _integer("initial_designs", self.initial_designs, 2, 200)
        _integer("replicates", self.replicates, 1, 20)
        _integer("parallel", self.parallel, 1, 64)
        _integer("seed", self.seed, 0, 2**31 - 1)
        if self.time_step not in ("fast", "paper"):
            raise InvalidValue("time_step", self.time_step, "fast or paper")
        _check_responses(self.responses)
        object.__setattr__(self, "fixed", MappingProxyType(dict(self.fixed)))
        object.__setattr__(self, "derived", MappingProxyType(dict(self.derived)))
        _check_fixed(self)
        _check_derived(self)
        _check_strategy(self)
        _check_table(self)
        _check_help(self)

    @property
    def space_hash(self) -> str:
        """Of what is searched, and with which version of the model."""
        if self.model is None:
            return self.space.hash
        model = json.dumps(self.model.as_record(), sort_keys=True)
        return hashlib.sha256(f"{self.space.hash} {model}".encode()).hexdigest()

    @property
    def primary(self) -> Response:
        """The first response: the one that charts and one-line summaries show."""
        return self.responses[0]

    @property
    def imported(self) -> tuple[TableRow, ...]:
        """The rows of the table that need no simulation."""
        return tuple(row for row in self.table if row.results is not None)

    def parameters_of(self, x: tuple[float, ...]) -> dict[str, float]:
        """Every contact parameter of a design that the study says: searched, fixed and derived.

        Raises InvalidValue where a derived one leaves its limits.
        """
        values = {**self.fixed, **self.space.as_dict(x)}
        for name in expressions.in_order(self.derived):
            found = expressions.evaluate(f"derived.{name}", self.derived[name], values)
            limit = PARAMETERS[name]
            if not limit.lower <= found <= limit.upper:
                allowed = f"an expression between {limit.lower:g} and {limit.upper:g} in the whole space"
                raise InvalidValue(f"derived.{name}", f"{self.derived[name]} = {found:g}", allowed)
            values[name] = round(found, 12)
        return values


def refuse_tolerance_below_noise(spec: StudySpec, known: Mapping[str, NoiseLevel] | None = None) -> None:
    """Raises InvalidValue for a tolerance under half the noise: a certificate would take dozens of replicates.

    `known` is the pooled scatter of earlier replicates of the same test; without it the observable's prior
    counts. Asked of new studies only: what replicates tell later does not make a stored one unreadable.
    """
    for response in spec.responses:
        pooled = (known or {}).get(response.observable)
        if pooled is not None and pooled.freedom < FEWEST_FREEDOM:
            pooled = None
        noise = pooled.sd if pooled is not None else response.meaning.noise_sd
        if noise is None or response.tolerance >= 0.5 * noise:
            continue
        unit, source = response.meaning.unit, "of earlier replicates" if pooled else "expected"
        raise InvalidValue(
            f"responses.{response.observable}.tolerance",
            response.tolerance,
            f"at least {0.5 * noise:g} {unit}, half the noise between runs ({noise:g} {unit}, {source})",
        )


def _check_responses(responses: tuple[Response, ...]) -> None:
    if not responses:
        raise InvalidValue("responses", [], "at least one response")
    names = [r.observable for r in responses]
    for name in names:
        if names.count(name) > 1:
            raise InvalidValue("responses.observable", name, "each observable once")


def _check_fixed(spec: StudySpec) -> None:
    for name, value in spec.fixed.items():
        if name not in PARAMETERS:
            raise InvalidValue("fixed", name, "one of " + ", ".join(PARAMETERS))
        if name in spec.space.names:
            raise InvalidValue(f"fixed.{name}", value, "not also a variable of the study")
        _within(f"fixed.{name}", value, PARAMETERS[name].lower, PARAMETERS[name].upper)


def _check_derived(spec: StudySpec) -> None:
    known = {*spec.fixed, *spec.space.names, *spec.derived}
    for name, text in spec.derived.items():
        if name not in PARAMETERS:
            raise InvalidValue("derived", name, "one of " + ", ".join(PARAMETERS))
        if name in spec.space.names or name in spec.fixed:
            raise InvalidValue(
                f"derived.{name}", text, "not also a variable or a fixed parameter of the study"
            )
        unknown = sorted(expressions.names_in(f"derived.{name}", text) - known)
        if unknown:
            raise InvalidValue(
                f"derived.{name}",
                unknown[0],
                "a searched, fixed or derived parameter: " + ", ".join(sorted(known)),
            )
    if spec.derived:
        for x in _spread(spec.space):
            spec.parameters_of(x)


def _spread(space: SearchSpace) -> list[tuple[float, ...]]:
    """The corners of the box and even levels between them, as many as the trials allow."""
    levels = max(2, math.floor(_DERIVED_TRIALS ** (1.0 / space.dimension) + 1e-9))
    sides = [
        [v.lower + (v.upper - v.lower) * i / (levels - 1) for i in range(levels)] for v in space.variables
    ]
    return list(itertools.product(*sides))


def _check_strategy(spec: StudySpec) -> None:
    if spec.strategy not in STRATEGIES:
        raise InvalidValue("strategy", spec.strategy, "one of " + ", ".join(STRATEGIES))
    least = least_budget(spec.strategy, spec.space.dimension)
    if spec.budget < least:
        raise InvalidValue(
            "budget",
            spec.budget,
            f"at least {least} for the strategy {spec.strategy} with {spec.space.dimension} variables",
        )


def _check_table(spec: StudySpec) -> None:
    for k, row in enumerate(spec.table, start=1):
        if set(row.x) != set(spec.space.names):
            raise InvalidValue(
                f"table.{k}", sorted(row.x), "a value for each of " + ", ".join(spec.space.names)
            )
        for v in spec.space.variables:
            _within(f"table.{k}.{v.name}", row.x[v.name], v.lower, v.upper)
        missing = [
            r.observable
            for r in spec.responses
            if row.results is not None and r.observable not in row.results
        ]
        if missing:
            raise InvalidValue(
                f"table.{k}.results", missing[0], "a result for every response, or none at all"
            )
    to_run = len(spec.table) - len(spec.imported)
    if spec.strategy == "table":
        if not spec.table:
            raise InvalidValue("table", [], "at least one row for the strategy table")
        if to_run > spec.budget:
            raise InvalidValue(
                "budget", spec.budget, f"at least {to_run}, the rows of the table without results"
            )
    elif to_run:
        allowed = "rows with results only: designs of a table are run by the strategy table"
        raise InvalidValue("table", f"{to_run} rows without results", allowed)


def _check_help(spec: StudySpec) -> None:
    """Coarse runs and earlier studies: for strategies that ask the surrogate."""
    if spec.coarse is not None and spec.coarse.scale <= spec.scale:
        raise InvalidValue(
            "coarse.scale", spec.coarse.scale, f"more than the study's own scale {spec.scale:g}"
        )
    for study in spec.warm_start:
        _integer("warm_start", study, 1, 2**63 - 1)
        if spec.warm_start.count(study) > 1:
            raise InvalidValue("warm_start", study, "each study once")
    helped = "coarse" if spec.coarse is not None else "warm_start" if spec.warm_start else None
    if helped is not None and spec.strategy not in MODEL_BASED:
        raise InvalidValue(helped, spec.strategy, "only with the strategy " + " or ".join(MODEL_BASED))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _within(field_name: str, value: float, lower: float, upper: float, unit: str = "") -> None:
    if not (_is_number(value) and lower <= value <= upper):
        raise InvalidValue(field_name, value, f"{lower:g} to {upper:g} {unit}".strip())


def _integer(field_name: str, value: int, lower: int, upper: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not lower <= value <= upper:
        raise InvalidValue(field_name, value, f"a whole number from {lower} to {upper}")
