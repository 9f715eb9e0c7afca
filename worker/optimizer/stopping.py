"""When a study ends, and what it recommends (calibration.md decisions 1, 4 and 5).

A certificate holds for one design: at least `replicates` seeds and as many as the tolerance takes at the noise
(`Outlook.own_seeds`), none failed, and with the inflated sds for every
response E|f - t| <= tolerance and P(|f - t| <= tolerance) >= .85, and P(all windows) >= .99. Every rule returns
its numbers, which are stored; a number's name ends with the response's unit.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from service.domain.outcome import judge
from service.domain.states import Verdict
from service.domain.study import Response, StudySpec
from worker.optimizer.acquisition import (
    TOLERANCE_PROBABILITY,
    WINDOW_PROBABILITY,
    counting_sd,
    expected_miss,
    window_probability,
)
from worker.optimizer.design import FloatArray, X
from worker.optimizer.history import Design, History
from worker.optimizer.outlook import Belief, Outlook, build_outlook

Z_90 = 1.6448536269514722  # Phi^-1(.95)

FAILURES_LOOKED_AT = 5
# A design counts as reachable while its chance to run is above this, and its response as possible within 3 sd.
LEAST_OK = 0.1
REACH_SD = 3.0
# Designs the study must have made near its extreme before it says that the target lies beyond: within 1.5 deg,
# or within this share of the response's spread over the designs.
EXPLORED_AT_EXTREME = 2
NEAR_EXTREME_DEG = 1.5
NEAR_EXTREME_SHARE = 0.3
FUTILE_CHANCE = 0.01
# Of the first response's tolerance (0.02 deg at the usual 0.5), or of its tolerance in units of chi.
FUTILE_GAIN_SHARE = 0.04


@dataclass(frozen=True)
class Stop:
    """`reason`: certified, budget, design_complete, target_unreachable, futile or too_many_failures.

    The last is no end: the study waits for a person, who looks at the failures and goes on or not.
    """

    reason: str
    text: str
    numbers: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Met:
    """One response of the recommended design, in its unit; `sd` and `half_width_90` are inflated."""

    observable: str
    unit: str
    target: float
    mean: float
    sd: float
    half_width_90: float
    expected_miss: float
    window_probability: float
    replicates: tuple[float, ...]


@dataclass(frozen=True)
class Recommendation:
    """The design the study would use now, with what is believed of every response there."""

    x: X
    numbers: tuple[int, ...]
    responses: tuple[Met, ...]
    window_probability: float
    certified: bool

    @property
    def primary(self) -> Met:
        return self.responses[0]

    def as_record(self) -> dict[str, Any]:
        """Plain JSON types but for x; the first response's figures under names that end with its unit."""
        first = self.primary
        return {
            "numbers": list(self.numbers),
            f"mean_{first.unit}": first.mean,
            f"sd_{first.unit}": first.sd,
            f"half_width_90_{first.unit}": first.half_width_90,
            f"expected_miss_{first.unit}": first.expected_miss,
            f"replicates_{first.unit}": list(first.replicates),
            "window_probability": self.window_probability,
            "certified": self.certified,
            "responses": {
                met.observable: {
                    "unit": met.unit,
                    "target": met.target,
                    "mean": met.mean,
                    "sd": met.sd,
                    "half_width_90": met.half_width_90,
                    "expected_miss": met.expected_miss,
                    "window_probability": met.window_probability,
                    "replicates": list(met.replicates),
                }
                for met in self.responses
            },
        }


class Prospect(NamedTuple):
    """What the rest of the budget could still bring, over all candidate designs."""

    chance: float
    gain: float


def recommend(spec: StudySpec, history: History) -> Recommendation | None:
    """The evaluated design with the smallest posterior miss, certified first; None before any result."""
    return recommended(build_outlook(spec, history)) if history.succeeded else None


def recommended(outlook: Outlook) -> Recommendation:
    """`recommend` for an outlook that is already fitted."""
    groups = outlook.evaluated()
    belief = outlook.believe([g.x for g in groups])
    miss, holds = outlook.miss(belief), _holds(outlook, belief)
    # Confirmed by its seeds before found by one lucky run, unless that costs half the tolerance.
    slack = float(np.min(miss)) + 0.5 * tolerance_of_miss(outlook)
    single = [g.runs < outlook.spec.replicates or miss[i] > slack for i, g in enumerate(groups)]
    # A design that would more likely crash than run is no recommendation while another exists.
    order = [
        (not holds[i], bool(belief.ok[i] < 0.5), bool(single[i]), float(miss[i]), i)
        for i in range(len(groups))
    ]
    best = min(order)[-1]
    group = groups[best]
    return Recommendation(
        x=group.x,
        numbers=group.numbers,
        responses=tuple(_met(outlook, belief, j, best) for j in range(len(outlook.surrogates))),
        window_probability=float(outlook.in_window(belief)[best]),
        certified=bool(holds[best]),
    )


def _holds(outlook: Outlook, belief: Belief) -> FloatArray:
    """Whether the evaluated designs fulfil the certificate."""
    groups, responses = outlook.evaluated(), outlook.spec.responses
    good = np.array([g.runs >= outlook.own_seeds and not g.failures for g in groups])
    good &= outlook.in_window(belief) >= WINDOW_PROBABILITY
    for j, r in enumerate(responses):
        good &= expected_miss(belief.means[j], belief.wides[j], r.target) <= r.tolerance
        good &= outlook.near_target(belief, j) >= TOLERANCE_PROBABILITY
    return good


def _met(outlook: Outlook, belief: Belief, j: int, i: int) -> Met:
    response = outlook.spec.responses[j]
    mean, wide = belief.means[j, i : i + 1], belief.wides[j, i : i + 1]
    inside = float(window_probability(mean, wide, response.window)[0])
    return Met(
        observable=response.observable,
        unit=response.meaning.unit,
        target=response.target,
        mean=float(mean[0]),
        sd=float(wide[0]),
        half_width_90=Z_90 * float(wide[0]),
        expected_miss=float(expected_miss(mean, wide, response.target)[0]),
        window_probability=inside,
        replicates=outlook.evaluated()[i].values(response.observable),
    )


def tolerance_of_miss(outlook: Outlook) -> float:
    """The first response's tolerance, or the smallest in units of chi, as `Outlook.miss` counts."""
    responses = outlook.spec.responses
    if len(responses) == 1:
        return responses[0].tolerance
    return min(r.tolerance / counting_sd(r) for r in responses)


def too_many_failures(history: History) -> Stop | None:
    """More than half of at least five designs, coarse ones too, ended in error, since a person last looked."""
    judged = [d for d in (*history.finished, *history.coarse) if d.number > history.accepted]
    finished, failed = len(judged), sum(d.results is None for d in judged)
    if finished < FAILURES_LOOKED_AT or 2 * failed <= finished:
        return None
    text = f"{failed} of {finished} simulations ended in error; look at their causes or move the bounds."
    return Stop("too_many_failures", text, {"failed": float(failed), "finished": float(finished)})


def certified(outlook: Outlook) -> Stop | None:
    """The certificate of the recommended design, if it has one."""
    best = recommended(outlook)
    if not best.certified:
        return None
    found = "; ".join(
        f"{_value(met.mean, met)} certified within +-{_value(met.half_width_90, met)} (90 %), "
        f"expected miss {met.expected_miss:.2g} {met.unit}"
        for met in best.responses
    )
    text = (
        f"{found}; from {len(best.primary.replicates)} seeds of design {best.numbers[0]}, "
        f"{100 * best.window_probability:.1f} % inside the window{'s' if len(best.responses) > 1 else ''}."
    )
    return Stop("certified", text, _numbers(best, outlook))


def _value(value: float, met: Met) -> str:
    return f"{value:.1f} {met.unit}" if met.unit == "deg" else f"{value:.3g} {met.unit}"


def out_of_budget(outlook: Outlook | None, spec: StudySpec) -> Stop:
    """The budget is spent without a certificate."""
    if outlook is None:
        nothing = f"All {spec.budget} simulations are spent and none gave a result."
        return Stop("budget", nothing, {"budget": float(spec.budget)})
    best = recommended(outlook)
    inside = 100 * best.window_probability
    misses = " and ".join(f"{met.expected_miss:.2g} {met.unit}" for met in best.responses)
    asked = " and ".join(f"{r.tolerance:g} {r.meaning.unit}" for r in spec.responses)
    text = (
        f"All {spec.budget} simulations are spent. The best design is expected to miss by {misses} and is "
        f"inside the window with {inside:.0f} %; a certificate asks for {asked}, 99 % and "
        f"{spec.replicates} seeds."
    )
    return Stop("budget", text, {**_numbers(best, outlook), "budget": float(spec.budget)})


def design_complete(outlook: Outlook | None, spec: StudySpec, history: History) -> Stop:
    """A design that was fixed beforehand has run: what came out, by verdict, and the emulator's best."""
    # As the study's counters: what a table knew before is no simulation.
    counts = verdict_counts(spec.responses, (d for d in history.finished if d.origin != "import"))
    told = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    numbers = {verdict: float(count) for verdict, count in counts.items()}
    if outlook is None:
        return Stop("design_complete", f"The design has run: {told}.", numbers)
    best = recommended(outlook)
    misses = " and ".join(f"{met.expected_miss:.2g} {met.unit}" for met in best.responses)
    text = (
        f"The design has run: {told}. By the emulator over all results design {best.numbers[0]} is best; it is "
        f"expected to miss by {misses}."
    )
    return Stop("design_complete", text, {**_numbers(best, outlook), **numbers})


def verdict_counts(responses: tuple[Response, ...], designs: Iterable[Design]) -> dict[str, int]:
    """How many designs are feasible, unfeasible and errors (the paper's Table 6)."""
    counts = dict.fromkeys((v.value for v in Verdict), 0)
    for design in designs:
        verdict = Verdict.ERROR if design.results is None else judge(responses, design.results)
        counts[verdict.value] += 1
    return counts


def _numbers(best: Recommendation, outlook: Outlook) -> dict[str, float]:
    numbers = {"window_probability": best.window_probability, "seeds": float(len(best.primary.replicates))}
    for j, met in enumerate(best.responses):
        # The first response's names are as short as when there is no other.
        of = "" if j == 0 else f"{met.observable}_"
        noise = outlook.surrogates[j].hyper.noise_sd
        numbers |= {
            f"{of}mean_{met.unit}": met.mean,
            f"{of}sd_{met.unit}": met.sd,
            f"{of}expected_miss_{met.unit}": met.expected_miss,
            f"{of}half_width_90_{met.unit}": met.half_width_90,
            f"{of}noise_sd_{met.unit}": noise,
            f"{of}inflation": outlook.inflations[j],
        }
    return numbers


def goal_zone(response: Response) -> tuple[float, float]:
    """Values that a certified design could have: inside the window and within the tolerance of the target."""
    t, tol, (lo, hi) = response.target, response.tolerance, response.window
    return max(lo, t - tol), min(hi, t + tol)


def target_unreachable(outlook: Outlook, belief: Belief) -> Stop | None:
    """No design that might run comes near one response's target, and the study has looked where it comes nearest.

    The reach of a design is its mean +- 3 inflated sd. The extreme counts as explored when at least two
    designs with results are believed to lie near the most extreme mean in the box.
    """
    possible = belief.ok >= LEAST_OK
    if not np.any(possible):
        return None
    seen = outlook.believe([g.x for g in outlook.evaluated()])
    for j in range(len(outlook.surrogates)):
        mean, wide = belief.means[j][possible], belief.wides[j][possible]
        if (stop := _out_of_reach(outlook.spec.responses[j], mean, wide, seen.means[j])) is not None:
            return stop
    return None


def _out_of_reach(response: Response, mean: FloatArray, wide: FloatArray, seen: FloatArray) -> Stop | None:
    low, high = goal_zone(response)
    lowest, highest = float(np.min(mean - REACH_SD * wide)), float(np.max(mean + REACH_SD * wide))
    above, below = highest < low, lowest > high
    if not (above or below):
        return None
    unit = response.meaning.unit
    near = NEAR_EXTREME_DEG if unit == "deg" else NEAR_EXTREME_SHARE * float(np.std(seen))
    gap = np.max(mean) - seen if above else seen - np.min(mean)
    if np.count_nonzero(gap <= near) < EXPLORED_AT_EXTREME:
        return None
    figures = "{:.1f} to {:.1f}" if unit == "deg" else "{:.3g} to {:.3g}"
    text = (
        f"The target {response.target:g} {unit} lies outside what this space reaches: about "
        f"{figures.format(np.min(mean), np.max(mean))} {unit} where simulations run "
        f"(at the utmost {figures.format(lowest, highest)})."
    )
    numbers = {
        f"reachable_lower_{unit}": float(np.min(mean)),
        f"reachable_upper_{unit}": float(np.max(mean)),
        f"utmost_lower_{unit}": lowest,
        f"utmost_upper_{unit}": highest,
    }
    return Stop("target_unreachable", text, numbers)


def futile(outlook: Outlook, prospect: Prospect, left: int) -> Stop | None:
    """Neither a certificate nor a noticeably better design is to be expected from what is left."""
    noticed = FUTILE_GAIN_SHARE * tolerance_of_miss(outlook)
    if prospect.chance >= FUTILE_CHANCE or prospect.gain >= noticed:
        return None
    best = recommended(outlook)
    misses = " and ".join(f"{met.expected_miss:.2g} {met.unit}" for met in best.responses)
    text = (
        f"Going on is futile: {left} more simulations would certify a design with a chance under "
        f"{100 * FUTILE_CHANCE:.0f} %, and the best design (expected miss {misses}) would improve by less than "
        f"{100 * FUTILE_GAIN_SHARE:.0f} % of the tolerance."
    )
    numbers = {**_numbers(best, outlook), "chance": prospect.chance, "gain": prospect.gain}
    return Stop("futile", text, {**numbers, "left": float(left)})
