"""When a study ends, and what it recommends (calibration.md decisions 1, 4 and 5).

A certificate holds for one design: at least `replicates` seeds, none failed, and with the inflated sd
E|f - t| <= tolerance, P(|f - t| <= tolerance) >= .85 and P(window) >= .99. Every rule returns its numbers,
which are stored.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from service.domain.study import Response, StudySpec
from worker.optimizer.acquisition import TOLERANCE_PROBABILITY, WINDOW_PROBABILITY
from worker.optimizer.design import X
from worker.optimizer.history import History
from worker.optimizer.outlook import Belief, Outlook, build_outlook

Z_90 = 1.6448536269514722  # Phi^-1(.95)

FAILURES_LOOKED_AT = 5
# A design counts as reachable while its chance to run is above this, and its angle as possible within 3 sd.
LEAST_OK = 0.1
REACH_SD = 3.0
# Designs the study must have made near its extreme before it says that the target lies beyond.
EXPLORED_AT_EXTREME = 2
NEAR_EXTREME_DEG = 1.5
FUTILE_CHANCE = 0.01
FUTILE_GAIN_DEG = 0.02


@dataclass(frozen=True)
class Stop:
    """`reason`: certified, budget, target_unreachable, futile or too_many_failures."""

    reason: str
    text: str
    numbers: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Recommendation:
    """The design the study would use now; `sd_deg` and `half_width_90_deg` are inflated."""

    x: X
    numbers: tuple[int, ...]
    mean_deg: float
    sd_deg: float
    expected_miss_deg: float
    window_probability: float
    replicates_deg: tuple[float, ...]
    certified: bool
    half_width_90_deg: float


class Prospect(NamedTuple):
    """What the rest of the budget could still bring, over all candidate designs."""

    chance: float
    gain_deg: float


def recommend(spec: StudySpec, history: History) -> Recommendation | None:
    """The evaluated design with the smallest posterior E|f - t|, certified first; None before any angle."""
    return recommended(build_outlook(spec, history)) if history.succeeded else None


def recommended(outlook: Outlook) -> Recommendation:
    """`recommend` for an outlook that is already fitted."""
    groups = outlook.evaluated()
    belief = outlook.believe([g.x for g in groups])
    miss, inside = outlook.miss(belief), outlook.in_window(belief)
    near = outlook.near_target(belief)
    holds = [
        g.runs >= outlook.spec.replicates
        and not g.failures
        and miss[i] <= outlook.spec.primary.tolerance
        and inside[i] >= WINDOW_PROBABILITY
        and near[i] >= TOLERANCE_PROBABILITY
        for i, g in enumerate(groups)
    ]
    # Confirmed by its seeds before found by one lucky run, unless that costs half the tolerance.
    slack = float(np.min(miss)) + 0.5 * outlook.spec.primary.tolerance
    single = [g.runs < outlook.spec.replicates or miss[i] > slack for i, g in enumerate(groups)]
    # A design that would more likely crash than run is no recommendation while another exists.
    order = [
        (not holds[i], bool(belief.ok[i] < 0.5), bool(single[i]), float(miss[i]), i)
        for i in range(len(groups))
    ]
    best = min(order)[-1]
    group, wide = groups[best], float(belief.wide[best])
    return Recommendation(
        x=group.x,
        numbers=group.numbers,
        mean_deg=float(belief.mean[best]),
        sd_deg=wide,
        expected_miss_deg=float(miss[best]),
        window_probability=float(inside[best]),
        replicates_deg=group.values(outlook.spec.primary.observable),
        certified=bool(holds[best]),
        half_width_90_deg=Z_90 * wide,
    )


def too_many_failures(history: History) -> Stop | None:
    """More than half of at least five designs ended in error, of those after the last forgiven one."""
    judged = [d for d in history.finished if d.number > history.accepted]
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
    text = (
        f"{best.mean_deg:.1f} deg from {len(best.replicates_deg)} seeds of design {best.numbers[0]}: "
        f"certified within +-{best.half_width_90_deg:.1f} deg (90 %), "
        f"expected miss {best.expected_miss_deg:.2f} deg, "
        f"{100 * best.window_probability:.1f} % inside the window."
    )
    return Stop("certified", text, _numbers(best, outlook))


def out_of_budget(outlook: Outlook | None, spec: StudySpec) -> Stop:
    """The budget is spent without a certificate."""
    if outlook is None:
        nothing = f"All {spec.budget} simulations are spent and none gave an angle."
        return Stop("budget", nothing, {"budget": float(spec.budget)})
    best = recommended(outlook)
    inside = 100 * best.window_probability
    text = (
        f"All {spec.budget} simulations are spent. The best design is expected to miss by "
        f"{best.expected_miss_deg:.2f} deg and is inside the window with {inside:.0f} %; a certificate "
        f"asks for {spec.primary.tolerance:g} deg, 99 % and {spec.replicates} seeds."
    )
    return Stop("budget", text, {**_numbers(best, outlook), "budget": float(spec.budget)})


def _numbers(best: Recommendation, outlook: Outlook) -> dict[str, float]:
    return {
        "mean_deg": best.mean_deg,
        "sd_deg": best.sd_deg,
        "expected_miss_deg": best.expected_miss_deg,
        "window_probability": best.window_probability,
        "seeds": float(len(best.replicates_deg)),
        "half_width_90_deg": best.half_width_90_deg,
        "noise_sd_deg": outlook.surrogate.hyper.noise_sd_deg,
        "inflation": outlook.inflation,
    }


def goal_zone(response: Response) -> tuple[float, float]:
    """Angles that a certified design could have: inside the window and within the tolerance of the target."""
    t, tol, (lo, hi) = response.target, response.tolerance, response.window
    return max(lo, t - tol), min(hi, t + tol)


def target_unreachable(outlook: Outlook, belief: Belief) -> Stop | None:
    """No design that might run comes near the target, and the study has looked where it comes nearest.

    The reach of a design is its mean +- 3 inflated sd. The extreme counts as explored when at least two
    designs with an angle are believed to lie within 1.5 deg of the most extreme mean in the box.
    """
    low, high = goal_zone(outlook.spec.primary)
    possible = belief.ok >= LEAST_OK
    if not np.any(possible):
        return None
    mean, wide = belief.mean[possible], belief.wide[possible]
    lowest, highest = float(np.min(mean - REACH_SD * wide)), float(np.max(mean + REACH_SD * wide))
    above, below = highest < low, lowest > high
    if not (above or below):
        return None
    seen = outlook.believe([g.x for g in outlook.evaluated()]).mean
    gap = np.max(mean) - seen if above else seen - np.min(mean)
    if np.count_nonzero(gap <= NEAR_EXTREME_DEG) < EXPLORED_AT_EXTREME:
        return None
    numbers = {"reachable_lower_deg": float(np.min(mean)), "reachable_upper_deg": float(np.max(mean))}
    text = (
        f"The target {outlook.spec.primary.target:g} deg lies outside what this space reaches: about "
        f"{np.min(mean):.1f} to {np.max(mean):.1f} deg where simulations run "
        f"(at the utmost {lowest:.1f} to {highest:.1f})."
    )
    numbers |= {"utmost_lower_deg": lowest, "utmost_upper_deg": highest}
    return Stop("target_unreachable", text, numbers)


def futile(outlook: Outlook, prospect: Prospect, left: int) -> Stop | None:
    """Neither a certificate nor a noticeably better design is to be expected from what is left."""
    if prospect.chance >= FUTILE_CHANCE or prospect.gain_deg >= FUTILE_GAIN_DEG:
        return None
    best = recommended(outlook)
    text = (
        f"Going on is futile: {left} more simulations would certify a design with a chance under "
        f"{100 * FUTILE_CHANCE:.0f} %, and the best design (expected miss {best.expected_miss_deg:.2f} deg) "
        f"would improve by less than {FUTILE_GAIN_DEG:g} deg."
    )
    numbers = {**_numbers(best, outlook), "chance": prospect.chance, "gain_deg": prospect.gain_deg}
    return Stop("futile", text, {**numbers, "left": float(left)})
