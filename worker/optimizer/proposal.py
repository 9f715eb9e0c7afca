"""The next design of a study, or why there is none: the optimizer's one entry.

The order of thought of `propose`:
    1. stop if too many designs fail, if a design is certified, or if the budget is spent;
    2. the Sobol initial design first, and further until three angles are there to fit;
    3. fill pending designs with a posterior sample each;
    4. stop if the target is unreachable or going on is futile;
    5. replicate the winner if that is the shorter way to a certificate, or if the budget ends and it lacks
       seeds; else search by EI x P(ok).

Everything random is seeded by (spec.seed, number), so a proposal is a pure function of its arguments.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from service.domain.study import StudySpec
from worker.optimizer.acquisition import effort
from worker.optimizer.design import (
    STREAM_FANTASY,
    FloatArray,
    X,
    around,
    candidates,
    generator,
    initial_design,
    simulation_seed,
    to_unit,
)
from worker.optimizer.history import Group, History
from worker.optimizer.outlook import Belief, Outlook, build_outlook
from worker.optimizer.stopping import (
    Prospect,
    Stop,
    certified,
    futile,
    out_of_budget,
    target_unreachable,
    too_many_failures,
)
from worker.optimizer.surrogate import Hyperparameters

FEWEST_ANGLES = 3
# Plans longer than this are not told apart: the posterior will have changed before they end.
LONGEST_PLAN = 24


@dataclass(frozen=True)
class Prediction:
    """What was believed of a design before it ran; `sd_deg` is inflated."""

    mean_deg: float
    sd_deg: float
    ok_probability: float
    window_probability: float
    expected_miss_deg: float


@dataclass(frozen=True)
class Proposal:
    """A design to run. `prediction`, `acquisition` and `hyperparameters` are None for the initial design."""

    x: X
    seed: int
    origin: str
    prediction: Prediction | None
    acquisition: float | None
    reason: str
    training_hash: str
    hyperparameters: dict[str, Any] | None
    scale: float


class Options(NamedTuple):
    """Unseen designs (`search`), and evaluated ones to replicate, each with belief, effort and chance."""

    search: list[X]
    belief: Belief
    gain: FloatArray
    effort: FloatArray
    chance: FloatArray
    groups: list[Group]
    again: FloatArray
    again_chance: FloatArray


def propose(
    spec: StudySpec, history: History, number: int, hyper: Hyperparameters | None = None
) -> Proposal | Stop:
    """Design `number` of the study. `hyper` repeats an earlier proposal from its stored hyper-parameters."""
    if (stop := too_many_failures(history)) is not None:
        return stop
    fitted = build_outlook(spec, history, hyper) if history.succeeded else None
    if fitted is not None and (stop := certified(fitted)) is not None:
        return stop
    if number > spec.budget:
        return out_of_budget(fitted, spec)
    initial = initial_count(spec)
    few = history.succeeded < min(FEWEST_ANGLES, initial)
    if number <= initial or few:
        first = _initial(spec, history, number)
        if first is not None:
            return first
    if fitted is None:
        return Stop("futile", "Every design of the grid was tried and none gave an angle.")
    return _by_model(spec, history, number, fitted)


def initial_count(spec: StudySpec) -> int:
    """Initial designs that are run: a small budget keeps its last runs for the winner's seeds."""
    return min(spec.initial_designs, max(FEWEST_ANGLES, spec.budget - spec.replicates + 1))


def _initial(spec: StudySpec, history: History, number: int) -> Proposal | None:
    visited = history.visited()
    count = max(spec.initial_designs, number) + len(visited)
    fresh = [x for x in initial_design(spec.space, spec.seed, count) if x not in visited]
    if not fresh:
        return None
    last = max(number, initial_count(spec))
    reason = f"Initial design {number} of {last}: spread over the box to learn its shape."
    seed = simulation_seed(spec.seed, number, history.seeds_used(fresh[0]))
    return Proposal(fresh[0], seed, "doe", None, None, reason, history.training_hash, None, spec.scale)


def _by_model(spec: StudySpec, history: History, number: int, fitted: Outlook) -> Proposal | Stop:
    outlook = _with_fantasies(fitted, history, number)
    left = spec.budget - number + 1
    options = _options(outlook, history, number, left)
    # Judged on finished designs alone: a fantasy is no evidence.
    evidence = _options(fitted, history, number, left) if history.pending else options
    stop = _hopeless(fitted, evidence, left)
    if stop is not None and stop.reason != "futile":
        return stop
    if stop is not None or left < spec.replicates:
        # The study ends here or with its budget: nobody should be handed an optimum that ran only once.
        winner = _unconfirmed(outlook, history, left)
        if winner is not None:
            return _confirm(outlook, history, number, winner)
    if stop is not None:
        return stop
    replicate = _best_replicate(options)
    if replicate is not None:
        return _replicate(outlook, history, number, replicate)
    return _search(outlook, history, number, options)


def _with_fantasies(fitted: Outlook, history: History, number: int) -> Outlook:
    """Pending designs take one joint posterior sample, noise included (calibration.md decision 6)."""
    if not history.pending:
        return fitted
    u = to_unit(fitted.spec.space, [p.x for p in history.pending])
    mean, covariance = fitted.surrogate.covariance(u)
    stream = generator(STREAM_FANTASY, fitted.spec.seed, number)
    noise = fitted.surrogate.hyper.noise_sd_deg
    # The noise on the diagonal also keeps the covariance of two seeds at one x positive definite.
    root = np.linalg.cholesky(covariance + noise**2 * np.eye(len(u)))
    angles = mean + root @ stream.standard_normal(len(u))
    rows = [(tuple(point), float(angle)) for point, angle in zip(u.tolist(), angles, strict=True)]
    return Outlook(
        fitted.spec, fitted.surrogate.with_runs(rows), fitted.crashes, fitted.inflation, fitted.groups
    )


def _options(outlook: Outlook, history: History, number: int, left: int) -> Options:
    spec, visited = outlook.spec, history.visited()
    search = [x for x in candidates(spec.space, spec.seed, number) if x not in visited]
    if search:
        rough = outlook.gain(outlook.believe(search))
        near = around(spec.space, search[int(np.argmax(rough))], spec.seed, number)
        search = list(dict.fromkeys(search + [x for x in near if x not in visited]))
    groups = [g for g in outlook.evaluated() if not g.failures]
    belief = outlook.believe(search)
    need, chance = _effort(outlook, belief, np.full(len(search), float(spec.replicates)), left)
    waiting = [p.x for p in history.pending]
    seeds = [g.runs + waiting.count(g.x) for g in groups]
    lacking = np.array([max(1.0, float(spec.replicates - n)) for n in seeds])
    again, again_chance = _effort(outlook, outlook.believe([g.x for g in groups]), lacking, left)
    return Options(search, belief, outlook.gain(belief), need, chance, groups, again, again_chance)


def _effort(
    outlook: Outlook, belief: Belief, missing: FloatArray, left: int
) -> tuple[FloatArray, FloatArray]:
    sigma, most = outlook.surrogate.hyper.noise_sd_deg, min(left, LONGEST_PLAN)
    response = outlook.spec.primary
    need, chance = effort(belief.mean, belief.sd, missing, most, sigma, outlook.inflation, response)
    return need / outlook.usable(belief), chance * belief.ok


def _hopeless(fitted: Outlook, options: Options, left: int) -> Stop | None:
    if (stop := target_unreachable(fitted, options.belief)) is not None:
        return stop
    chance = max(np.max(options.chance, initial=0.0), np.max(options.again_chance, initial=0.0))
    return futile(fitted, Prospect(float(chance), float(np.max(options.gain, initial=0.0))), left)


def _best_replicate(options: Options) -> Group | None:
    """The evaluated design with the least effort, unless searching promises a shorter way."""
    if not options.groups:
        return None
    best = int(np.argmin(options.again))
    if options.search and np.min(options.effort) < options.again[best]:
        return None
    return options.groups[best]


def _unconfirmed(outlook: Outlook, history: History, left: int) -> Group | None:
    """The best of the designs that `left` runs can give their seeds, if it lacks any (decision 4)."""
    replicates = outlook.spec.replicates
    waiting = [p.x for p in history.pending]
    able = [g for g in outlook.evaluated() if not g.failures]
    lacking = {g.x: replicates - g.runs - waiting.count(g.x) for g in able}
    able = [g for g in able if lacking[g.x] <= left]
    if not able:
        return None
    miss = outlook.miss(outlook.believe([g.x for g in able]))
    winner = able[int(np.argmin(miss))]
    return winner if lacking[winner.x] > 0 else None


def _confirm(outlook: Outlook, history: History, number: int, group: Group) -> Proposal:
    prediction = _prediction(outlook, outlook.believe([group.x]), 0)
    reason = (
        f"Another seed of design {group.numbers[0]}, the best so far: the last runs show how far its "
        f"angle scatters."
    )
    return _proposal(outlook, history, number, group.x, "replicate", prediction, None, reason)


def _replicate(outlook: Outlook, history: History, number: int, group: Group) -> Proposal:
    belief = outlook.believe([group.x])
    prediction = _prediction(outlook, belief, 0)
    reason = (
        f"Another seed of design {group.numbers[0]}, the shortest way to a certificate: "
        f"{prediction.mean_deg:.1f} +- {prediction.sd_deg:.1f} deg from {group.runs} so far."
    )
    return _proposal(outlook, history, number, group.x, "replicate", prediction, None, reason)


def _search(outlook: Outlook, history: History, number: int, options: Options) -> Proposal:
    best = int(np.argmax(options.gain))
    prediction = _prediction(outlook, options.belief, best)
    reason = (
        f"Largest expected gain on the best design so far: "
        f"{prediction.mean_deg:.1f} +- {prediction.sd_deg:.1f} deg expected, "
        f"{100 * prediction.ok_probability:.0f} % likely to run."
    )
    gain = float(options.gain[best])
    return _proposal(outlook, history, number, options.search[best], "model", prediction, gain, reason)


def _prediction(outlook: Outlook, belief: Belief, i: int) -> Prediction:
    return Prediction(
        mean_deg=float(belief.mean[i]),
        sd_deg=float(belief.wide[i]),
        ok_probability=float(belief.ok[i]),
        window_probability=float(outlook.in_window(belief)[i]),
        expected_miss_deg=float(outlook.miss(belief)[i]),
    )


def _proposal(
    outlook: Outlook,
    history: History,
    number: int,
    x: X,
    origin: str,
    prediction: Prediction,
    acquisition: float | None,
    reason: str,
) -> Proposal:
    seed = simulation_seed(outlook.spec.seed, number, history.seeds_used(x))
    hyper = outlook.surrogate.hyper.as_dict()
    return Proposal(
        x, seed, origin, prediction, acquisition, reason, history.training_hash, hyper, outlook.spec.scale
    )
