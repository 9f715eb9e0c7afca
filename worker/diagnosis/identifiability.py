"""What a plan of tests could show, before it is bought (rule 4 and 10).

Notation (N cells of the plan's conditions, K directions)
    V       noise of the planned replicates + emulator + floor + what re-calibration absorbs       (N, N)
    |F|     length of a fingerprint under V^-1 per unit of amplitude
    |F|_u   its unique part: the length left when the most similar other effect is projected out

Silent: not detectable at 4 sigma within the physical range. Nameable from: the amplitude at which the unique part
has the length 5, about where a name is right more often than not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from service.domain.data_set.records import Condition
from service.domain.effects import Effect, Library
from service.domain.errors import InvalidValue
from worker.diagnosis.calibration import PRIOR_VARIANCE
from worker.diagnosis.diagnose import Options, check_represented, first_waves
from worker.diagnosis.evidence import whiten
from worker.diagnosis.fingerprints import Fingerprints, Prober, screen
from worker.diagnosis.limits import ALIKE_FROM, SIGMAS
from worker.diagnosis.measured import Frame, NDArrayBool
from worker.diagnosis.model import Model, build_model, represented
from worker.diagnosis.ranking import directions_of
from worker.diagnosis.simulator import FloatArray, Simulator
from worker.diagnosis.summaries import NAMES

NAMEABLE_AT = 5.0


@dataclass(frozen=True)
class Plan:
    """Conditions with so many replicates each; `summaries` are those that would be observed (all where None);
    `candidates`: further conditions of which the best single one is sought."""

    conditions: tuple[Condition, ...]
    replicates: int = 4
    summaries: frozenset[str] | None = None
    candidates: tuple[Condition, ...] = ()

    def __post_init__(self) -> None:
        if not self.conditions:
            raise InvalidValue("plan.conditions", self.conditions, "at least one condition")
        if self.replicates < 3:
            raise InvalidValue("plan.replicates", self.replicates, "3 or more: the noise comes from them")


@dataclass(frozen=True)
class Outlook:
    """Of one effect: amplitudes in its unit, None beyond its range; `alike`: effects it is mistaken for."""

    effect: str
    unit: str
    detectable_from: float | None
    nameable_from: float | None
    alike: tuple[str, ...]

    @property
    def verdict(self) -> str:
        if self.detectable_from is None:
            return "silent"
        return "nameable" if self.nameable_from is not None else "detectable"


@dataclass(frozen=True)
class Identifiability:
    """`effects` in the library's order; `adds`: by candidate what it makes nameable, the best first."""

    effects: tuple[Outlook, ...]
    adds: Mapping[str, tuple[str, ...]]


def identifiability(simulator: Simulator, plan: Plan, options: Options | None = None) -> Identifiability:
    """At the middle of the parameters' box, with the simulation's own scatter as the noise.

    Raises BadDataSet for a condition that the simulator cannot represent, InvalidValue where nothing is read of
    one.
    """
    options = Options() if options is None else options
    conditions = (*plan.conditions, *plan.candidates)
    check_represented(conditions, simulator)
    frame = _frame(conditions, plan.summaries)
    runs = first_waves(simulator, frame, options)
    frame = represented(frame, runs)
    d = len(simulator.parameters)
    model = build_model(frame, runs, d, options.first_wave)
    theta = np.full(d * len(model.materials), 0.5)
    prober = Prober(simulator, model, options.seed * 1000 + 6 * 10**6)
    prints = screen(options.known, prober, model, theta)
    view = _View(model, prints, options, theta, plan.replicates)
    condition = np.array(frame.condition)
    planned = condition < len(plan.conditions)
    effects = view.outlook(planned)
    before = {o.effect for o in effects if o.verdict == "nameable"}
    adds = {}
    for k, candidate in enumerate(plan.candidates, start=len(plan.conditions)):
        after = view.outlook(planned | (condition == k))
        gained = [o.effect for o in after if o.verdict == "nameable" and o.effect not in before]
        adds[candidate.condition] = tuple(gained)
    ordered = dict(sorted(adds.items(), key=lambda item: -len(item[1])))
    return Identifiability(effects, ordered)


def _frame(conditions: Sequence[Condition], summaries: frozenset[str] | None) -> Frame:
    cells = [
        (c, k)
        for c, condition in enumerate(conditions)
        for k, name in enumerate(NAMES[condition.test])
        if summaries is None or name in summaries
    ]
    for c, condition in enumerate(conditions):
        if c not in {cell for cell, _ in cells}:
            allowed = f"at least one of {condition.condition}: " + ", ".join(NAMES[condition.test])
            raise InvalidValue("plan.summaries", sorted(summaries or ()), allowed)
    return Frame(tuple(conditions), tuple(c for c, _ in cells), tuple(k for _, k in cells))


class _View:
    """Covariances and fingerprints of all cells, to be looked at through some of them."""

    def __init__(
        self, model: Model, prints: Fingerprints, options: Options, theta: FloatArray, replicates: int
    ) -> None:
        self._known: Library = options.known
        self._directions = directions_of(options.known, prints)
        J = model.tangent(theta)[1]
        noise = model.run_covariance / replicates + options.floor.covariance(model.frame)
        self._V = noise + model.error(theta) + PRIOR_VARIANCE * J @ J.T

    def outlook(self, cells: NDArrayBool) -> tuple[Outlook, ...]:
        """Of every effect when only `cells` (N,) are observed."""
        white = whiten(np.zeros(int(cells.sum())), self._V[np.ix_(cells, cells)])
        F = white.of(self._directions.f[:, cells])
        length = np.linalg.norm(F, axis=1)
        unit = F / np.maximum(length, 1e-300)[:, None]
        cosines = unit @ unit.T
        owner = self._directions.effect
        return tuple(
            self._of(k, effect, length, cosines[owner == k][:, owner != k], owner[owner != k])
            for k, effect in enumerate(self._known.effects)
        )

    def _of(
        self, k: int, effect: Effect, length: FloatArray, cosines: FloatArray, others: FloatArray
    ) -> Outlook:
        mine = length[self._directions.effect == k]
        reach = max(effect.highest, -effect.lowest)
        shortest = float(np.min(mine))
        closest = np.max(cosines, axis=1) if cosines.shape[1] else np.zeros(len(mine))
        unique = float(np.min(mine * np.sqrt(np.maximum(1.0 - np.maximum(closest, 0.0) ** 2, 0.0))))
        seen = SIGMAS / shortest if shortest > 0.0 else np.inf
        named = NAMEABLE_AT / unique if unique > 0.0 else np.inf
        alike = sorted({int(others[j]) for j in np.flatnonzero(np.max(cosines, axis=0) >= ALIKE_FROM)})
        return Outlook(
            effect.id,
            effect.unit,
            seen if seen <= reach else None,
            max(named, seen) if max(named, seen) <= reach else None,
            tuple(self._known.effects[j].id for j in alike),
        )
