"""What is believed of any design, given a study's history: a surrogate per response, and the classifier.

Notation: see surrogate.py (m, s), crashes.py (P(ok)), acquisition.py (E|f - t|, chi, windows). The responses'
surrogates are independent. With one response every figure is the closed form, in the response's unit; with
several, "miss" and "gain" are in units of chi.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from service.domain.study import Response, StudySpec
from worker.optimizer.acquisition import (
    Course,
    counting_sd,
    expected_improvement,
    expected_miss,
    joint_improvement,
    joint_miss,
    seeds_for_certificate,
    seeds_within_tolerance,
    window_probability,
)
from worker.optimizer.crashes import CrashClassifier
from worker.optimizer.design import FloatArray, X, to_unit
from worker.optimizer.emulator import SPREAD_IN_DEGREES, data_of, own_emulator, unit_of
from worker.optimizer.history import Design, Group, History, grouped
from worker.optimizer.link import FEWEST_SOURCE, Fit, Source, best_surrogate, fit_of, refitted
from worker.optimizer.noise import noise_evidence
from worker.optimizer.surrogate import Surrogate, TrainingSet

# Beyond this a still larger power would only make the search shy of every untried corner.
MOST_SEEDS = 8
COARSE = "coarse"


class Belief(NamedTuple):
    """Arrays over k designs; `means`, `sds` and `wides` (sds after inflation) are (responses, k)."""

    means: FloatArray
    sds: FloatArray
    wides: FloatArray
    ok: FloatArray

    @property
    def mean(self) -> FloatArray:
        """Of the first response, as `sd` and `wide`."""
        return np.asarray(self.means[0])

    @property
    def sd(self) -> FloatArray:
        return np.asarray(self.sds[0])

    @property
    def wide(self) -> FloatArray:
        return np.asarray(self.wides[0])


@dataclass(frozen=True)
class Outlook:
    """Built from finished designs alone; pending ones enter by `with_runs`.

    surrogates and inflations: in the order of the study's responses.
    """

    spec: StudySpec
    surrogates: tuple[Surrogate, ...]
    crashes: CrashClassifier
    inflations: tuple[float, ...]
    groups: tuple[Group, ...]

    @property
    def surrogate(self) -> Surrogate:
        """Of the first response, as `inflation`."""
        return self.surrogates[0]

    @property
    def inflation(self) -> float:
        return self.inflations[0]

    @property
    def fits(self) -> dict[str, Fit]:
        """By observable, what makes the same surrogates of the same history again."""
        pairs = zip(self.spec.responses, self.surrogates, strict=True)
        return {response.observable: fit_of(surrogate) for response, surrogate in pairs}

    @property
    def is_linked(self) -> bool:
        """Whether another test's emulator helps with every response."""
        return all(s.link is not None for s in self.surrogates)

    def believe(self, xs: Collection[X]) -> Belief:
        u = to_unit(self.spec.space, xs)
        both = np.array([s.predict(u) for s in self.surrogates])
        means, sds = both[:, 0], both[:, 1]
        return Belief(means, sds, np.array(self.inflations)[:, None] * sds, self.crashes.ok_probability(u))

    def miss(self, belief: Belief) -> FloatArray:
        """E|f - target|, or E chi, with the inflated sd."""
        return self._miss(belief.means, belief.wides)

    def in_window(self, belief: Belief) -> FloatArray:
        """P(every response lies in its window)."""
        return self._all_inside(belief, [r.window for r in self.spec.responses])

    def near_target(self, belief: Belief, j: int = 0) -> FloatArray:
        """P(|f - target| <= tolerance) of response j."""
        r = self.spec.responses[j]
        zone = (r.target - r.tolerance, r.target + r.tolerance)
        return window_probability(belief.means[j], belief.wides[j], zone)

    def gain(self, belief: Belief) -> FloatArray:
        """The acquisition: EI of |f - target| (of chi) times P(all seeds of a winner run); sds not inflated.

        The incumbent is the smallest posterior expectation of the evaluated designs, never a lucky run.
        """
        seen = self.believe([g.x for g in self.evaluated()])
        incumbent = float(np.min(self._miss(seen.means, seen.sds)))
        if len(self.surrogates) == 1:
            target = self.spec.primary.target
            better = expected_improvement(belief.mean, belief.sd, target, incumbent)
        else:
            better = joint_improvement(belief.means, belief.sds, *self._goal(), incumbent)
        return np.asarray(better * self.usable(belief))

    def identifying(self, belief: Belief) -> FloatArray:
        """Posterior variance where the answer may lie: variance, in tau^2, times the design's posterior weight.

        The weight is P(ok) times the likelihood of the targets under N(mean, sd^2 + tau^2).
        """
        targets, taus = (v[:, None] for v in self._goal())
        total = belief.wides**2 + taus**2
        likelihood = np.exp(-0.5 * np.sum((belief.means - targets) ** 2 / total, axis=0))
        likelihood = likelihood / np.sqrt(np.prod(total / taus**2, axis=0))
        return np.asarray(belief.ok * likelihood * np.sum(belief.sds**2 / taus**2, axis=0))

    def usable(self, belief: Belief) -> FloatArray:
        """P(ok) to the power of the seeds a certificate will take: a winner has to run with each of them."""
        pairs = list(zip(self.spec.responses, self.surrogates, strict=True))
        seeds = max(seeds_for_certificate(s.hyper.noise_sd, r, len(pairs)) for r, s in pairs)
        return np.asarray(belief.ok ** max(self.spec.replicates, min(seeds, MOST_SEEDS)))

    @property
    def own_seeds(self) -> int:
        """Seeds that a certified design needs: those asked for, and enough that their mean alone has every
        response within its tolerance with the certificate's chance.

        The surrogate finds the design and shares in the figures, but its smoothness is an assumption: where runs
        scatter by 1.5 deg, certificates that leaned on neighbours were right within .5 deg in 6 to 8 of 10.
        """
        pairs = zip(self.spec.responses, self.surrogates, strict=True)
        return max(self.spec.replicates, *(seeds_within_tolerance(s.hyper.noise_sd, r) for r, s in pairs))

    def courses(self, belief: Belief) -> list[Course]:
        """What a certificate of each design has to overcome."""
        return [
            Course(r, belief.means[j], belief.sds[j], self.surrogates[j].hyper.noise_sd, self.inflations[j])
            for j, r in enumerate(self.spec.responses)
        ]

    def evaluated(self) -> tuple[Group, ...]:
        """The groups with at least one run that gave results."""
        return tuple(g for g in self.groups if g.runs)

    def with_runs(self, u: FloatArray, values: FloatArray) -> Outlook:
        """As if runs at u (k, d) had given `values` (responses, k)."""
        points = [tuple(point) for point in u.tolist()]
        known = [
            s.with_runs(zip(points, row.tolist(), strict=True))
            for s, row in zip(self.surrogates, values, strict=True)
        ]
        return replace(self, surrogates=tuple(known))

    def _goal(self) -> tuple[FloatArray, FloatArray]:
        responses = self.spec.responses
        return np.array([r.target for r in responses]), np.array([counting_sd(r) for r in responses])

    def _miss(self, means: FloatArray, sds: FloatArray) -> FloatArray:
        if len(self.surrogates) == 1:
            return expected_miss(means[0], sds[0], self.spec.primary.target)
        return joint_miss(means, sds, *self._goal())

    def _all_inside(self, belief: Belief, windows: list[tuple[float, float]]) -> FloatArray:
        inside = [
            window_probability(belief.means[j], belief.wides[j], window) for j, window in enumerate(windows)
        ]
        return np.asarray(np.prod(inside, axis=0))


def build_outlook(spec: StudySpec, history: History, fits: Mapping[str, Fit] | None = None) -> Outlook:
    """Fit the surrogates and the classifier; needs one run with results. `fits` repeats an earlier fit."""
    surrogates = []
    for response in spec.responses:
        data = data_of(spec.space, history.finished, response.observable)
        sources = _sources(spec, history, response)
        if fits is not None:
            surrogates.append(refitted(data, sources, fits[response.observable]))
            continue
        unit = unit_of(data, response.observable, response.tolerance)
        noise = noise_evidence(history, response.observable, SPREAD_IN_DEGREES * unit)
        helpers = [_source(spec, history, response, name) for name in sources]
        surrogates.append(best_surrogate(data, helpers, noise, unit))
    return Outlook(
        spec,
        tuple(surrogates),
        crash_classifier(spec, history),
        tuple(s.inflation for s in surrogates),
        history.groups(),
    )


def crash_classifier(spec: StudySpec, history: History) -> CrashClassifier:
    """From this study's runs and the coarse ones: a failure is a matter of the parameters, at any scale."""
    runs = (*history.finished, *history.coarse)
    ran = np.array([d.results is not None for d in runs], dtype=np.float64)
    return CrashClassifier(to_unit(spec.space, [d.x for d in runs]), ran)


def coarse_outlook(spec: StudySpec, history: History) -> Outlook | None:
    """What the coarse runs alone say of the responses; None before there are enough of them."""
    groups = grouped(history.coarse)
    if sum(g.runs > 0 for g in groups) < FEWEST_SOURCE:
        return None
    alone = History(history.coarse, noise=history.noise)
    return build_outlook(spec, alone)


def _tests(history: History) -> dict[str, tuple[Design, ...]]:
    """The other tests, the coarse runs first."""
    return {COARSE: history.coarse, **{f"study {w.study_id}": w.finished for w in history.warm}}


def _sources(spec: StudySpec, history: History, response: Response) -> dict[str, TrainingSet]:
    found = {
        name: data_of(spec.space, designs, response.observable) for name, designs in _tests(history).items()
    }
    return {name: data for name, data in found.items() if len(data.y) >= FEWEST_SOURCE}


def _source(spec: StudySpec, history: History, response: Response, name: str) -> Source:
    """The other test's own emulator: its noise is its own affair too."""
    alone = History(_tests(history)[name])
    emulator = own_emulator(spec.space, alone, response.observable, response.tolerance)
    return Source(name, emulator.surrogate)
