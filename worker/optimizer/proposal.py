"""The next design of a study by its surrogate, or why there is none: `auto` and `improve_surrogate`.

The order of thought of `propose`:
    1. the coarse prior's own runs first, if the study has one;
    2. stop if too many designs fail, if a design is certified, or if the budget is spent;
    3. the Sobol initial design, and further until three results are there to fit; with another test's emulator
       two shared designs instead, where that test's runs came nearest to the targets;
    4. fill pending designs with a posterior sample each;
    5. stop if a target is unreachable or going on is futile;
    6. replicate the winner if that is the shorter way to a certificate, or if the budget ends and it lacks
       seeds; else search by EI x P(ok), in the last third of the budget by what identifies the parameters.

Everything random is seeded by (spec.seed, number), so a proposal is a pure function of its arguments.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

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
from worker.optimizer.link import Fit
from worker.optimizer.outlook import Belief, Outlook, build_outlook
from worker.optimizer.proposed import Expected, Prediction, Proposal
from worker.optimizer.shared_designs import SHARED, is_helped, shared_designs
from worker.optimizer.stopping import (
    FUTILE_CHANCE,
    Prospect,
    Stop,
    certified,
    design_complete,
    futile,
    out_of_budget,
    target_unreachable,
    too_many_failures,
)

FEWEST_RESULTS = 3
# Plans longer than this are not told apart: the posterior will have changed before they end.
LONGEST_PLAN = 24
# From this share of the budget on a search is for what identifies the parameters (calibration.md decision 8).
# A study that can be certified has ended by then; what is left of the others is not worth another try at luck.
IDENTIFY_FROM = 2.0 / 3.0


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


class Place(NamedTuple):
    """Where in a study a proposal is: the design's number, its place on the budget, and what is left with it."""

    number: int
    position: int
    left: int


def propose(
    spec: StudySpec, history: History, number: int, fits: Mapping[str, Fit] | None = None
) -> Proposal | Stop:
    """Design `number` of the study by `auto`. `fits` repeats an earlier proposal from its stored surrogates."""
    early = _before_the_surrogate(spec, history, number)
    if early is not None:
        return early
    fitted = build_outlook(spec, history, fits) if history.succeeded else None
    if fitted is not None and (stop := certified(fitted)) is not None:
        return stop
    place = place_of(spec, history, number)
    if place.left < 1:
        return out_of_budget(fitted, spec)
    first = _first_design(spec, history, place)
    if first is not None:
        return first
    if fitted is None:
        return Stop("futile", "Every design of the grid was tried and none gave a result.")
    return _by_model(spec, history, place, fitted)


def improve_surrogate(
    spec: StudySpec, history: History, number: int, fits: Mapping[str, Fit] | None = None
) -> Proposal | Stop:
    """Design `number` where the surrogate knows least, weighted with P(ok); no certificate ends it."""
    early = _before_the_surrogate(spec, history, number)
    if early is not None:
        return early
    fitted = build_outlook(spec, history, fits) if history.succeeded else None
    place = place_of(spec, history, number)
    if place.left < 1:
        return design_complete(fitted, spec, history)
    first = _first_design(spec, history, place)
    if first is not None:
        return first
    if fitted is None:
        return design_complete(fitted, spec, history)
    outlook = _with_fantasies(fitted, history, number)
    visited = history.visited()
    search = [x for x in candidates(spec.space, spec.seed, number) if x not in visited]
    if not search:
        return design_complete(fitted, spec, history)
    belief = outlook.believe(search)
    amplitudes = np.array([[s.hyper.amplitude] for s in outlook.surrogates])
    unknown = np.sum((belief.sds / amplitudes) ** 2, axis=0) * belief.ok
    best = int(np.argmax(unknown))
    expected = _told(outlook, belief, best)
    reason = f"Where the surrogate knows least and runs succeed: {expected}."
    chosen = Chosen(search[best], "model", _prediction(outlook, belief, best), float(unknown[best]), reason)
    return _proposal(outlook, history, number, chosen)


def place_of(spec: StudySpec, history: History, number: int) -> Place:
    """Coarse runs and imported rows have numbers, but no place on the budget."""
    position = number - history.free
    return Place(number, position, spec.budget - position + 1)


def _before_the_surrogate(spec: StudySpec, history: History, number: int) -> Proposal | Stop | None:
    if (stop := too_many_failures(history)) is not None:
        return stop
    return _coarse(spec, history, number)


def _coarse(spec: StudySpec, history: History, number: int) -> Proposal | None:
    """The coarse prior's next run: the initial design's points, since the box is all that is known of it."""
    made = len(history.coarse) + len(history.coarse_pending)
    if spec.coarse is None or made >= spec.coarse.runs:
        return None
    tried = {d.x for d in history.coarse} | {p.x for p in history.coarse_pending}
    x = next((x for x in initial_design(spec.space, spec.seed, spec.coarse.runs) if x not in tried), None)
    if x is None:
        return None
    seed = simulation_seed(spec.seed, number, history.seeds_used(x))
    which = f"Coarse run {made + 1} of {spec.coarse.runs} at scale {spec.coarse.scale:g}"
    reason = f"{which}: cheap knowledge of the box."
    return Proposal(x, seed, "coarse", None, None, reason, history.training_hash, None, spec.coarse.scale)


def initial_count(spec: StudySpec) -> int:
    """Initial designs that are run: a small budget keeps its last runs for the winner's seeds."""
    return min(spec.initial_designs, max(FEWEST_RESULTS, spec.budget - spec.replicates + 1))


def _first_design(spec: StudySpec, history: History, place: Place) -> Proposal | None:
    """A design that no surrogate chooses; None once there are enough of them."""
    if is_helped(spec, history):
        if place.position <= SHARED or history.succeeded < SHARED:
            return _shared(spec, history, place)
        return None
    few = history.succeeded < min(FEWEST_RESULTS, initial_count(spec))
    return _initial(spec, history, place) if place.position <= initial_count(spec) or few else None


def _shared(spec: StudySpec, history: History, place: Place) -> Proposal | None:
    x = next((x for x in shared_designs(spec, history) if x not in history.visited()), None)
    if x is None:
        return _initial(spec, history, place)
    reason = (
        "Run elsewhere too, and among the nearest to the target there: it measures how the two tests differ."
    )
    seed = simulation_seed(spec.seed, place.number, history.seeds_used(x))
    return Proposal(x, seed, "doe", None, None, reason, history.training_hash, None, spec.scale)


def _initial(spec: StudySpec, history: History, place: Place) -> Proposal | None:
    visited = history.visited()
    count = max(spec.initial_designs, place.position) + len(visited)
    fresh = [x for x in initial_design(spec.space, spec.seed, count) if x not in visited]
    if not fresh:
        return None
    last = max(place.position, initial_count(spec))
    reason = f"Initial design {place.position} of {last}: spread over the box to learn its shape."
    seed = simulation_seed(spec.seed, place.number, history.seeds_used(fresh[0]))
    return Proposal(fresh[0], seed, "doe", None, None, reason, history.training_hash, None, spec.scale)


def _by_model(spec: StudySpec, history: History, place: Place, fitted: Outlook) -> Proposal | Stop:
    number, left = place.number, place.left
    outlook = _with_fantasies(fitted, history, number)
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
    if place.position > IDENTIFY_FROM * spec.budget:
        return _identify(outlook, history, number, options)
    return _search(outlook, history, number, options)


def _with_fantasies(fitted: Outlook, history: History, number: int) -> Outlook:
    """Pending designs take one joint posterior sample, noise included (calibration.md decision 6)."""
    if not history.pending:
        return fitted
    u = to_unit(fitted.spec.space, [p.x for p in history.pending])
    stream = generator(STREAM_FANTASY, fitted.spec.seed, number)
    values = []
    for surrogate in fitted.surrogates:
        mean, covariance = surrogate.covariance(u)
        # The noise on the diagonal also keeps the covariance of two seeds at one x positive definite.
        root = np.linalg.cholesky(covariance + surrogate.hyper.noise_sd**2 * np.eye(len(u)))
        values.append(mean + root @ stream.standard_normal(len(u)))
    return fitted.with_runs(u, np.array(values))


def _options(outlook: Outlook, history: History, number: int, left: int) -> Options:
    spec, visited = outlook.spec, history.visited()
    search = [x for x in candidates(spec.space, spec.seed, number) if x not in visited]
    if search:
        rough = outlook.gain(outlook.believe(search))
        near = around(spec.space, search[int(np.argmax(rough))], spec.seed, number)
        search = list(dict.fromkeys(search + [x for x in near if x not in visited]))
    groups = [g for g in outlook.evaluated() if not g.failures]
    belief = outlook.believe(search)
    need, chance = _effort(outlook, belief, np.full(len(search), float(outlook.own_seeds)), left)
    waiting = [p.x for p in history.pending]
    seeds = [g.runs + waiting.count(g.x) for g in groups]
    lacking = np.array([max(1.0, float(outlook.own_seeds - n)) for n in seeds])
    again, again_chance = _effort(outlook, outlook.believe([g.x for g in groups]), lacking, left)
    return Options(search, belief, outlook.gain(belief), need, chance, groups, again, again_chance)


def _effort(
    outlook: Outlook, belief: Belief, missing: FloatArray, left: int
) -> tuple[FloatArray, FloatArray]:
    need, chance = effort(outlook.courses(belief), missing, min(left, LONGEST_PLAN))
    return need / outlook.usable(belief), chance * belief.ok


def _hopeless(fitted: Outlook, options: Options, left: int) -> Stop | None:
    if (stop := target_unreachable(fitted, options.belief)) is not None:
        return stop
    chance = max(np.max(options.chance, initial=0.0), np.max(options.again_chance, initial=0.0))
    return futile(fitted, Prospect(float(chance), float(np.max(options.gain, initial=0.0))), left)


def _best_replicate(options: Options) -> Group | None:
    """The evaluated design with the least effort, unless searching promises a shorter way, or its seeds no way:
    where no plan has a chance, the fewest missing seeds say nothing."""
    if not options.groups:
        return None
    best = int(np.argmin(options.again))
    if options.again_chance[best] < FUTILE_CHANCE:
        return None
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


class Chosen(NamedTuple):
    """A design, and all that is told about why."""

    x: X
    origin: str
    prediction: Prediction
    acquisition: float | None
    reason: str


def _confirm(outlook: Outlook, history: History, number: int, group: Group) -> Proposal:
    prediction = _prediction(outlook, outlook.believe([group.x]), 0)
    reason = (
        f"Another seed of design {group.numbers[0]}, the best so far: the last runs show how far its "
        f"results scatter."
    )
    return _proposal(outlook, history, number, Chosen(group.x, "replicate", prediction, None, reason))


def _replicate(outlook: Outlook, history: History, number: int, group: Group) -> Proposal:
    belief = outlook.believe([group.x])
    reason = (
        f"Another seed of design {group.numbers[0]}, the shortest way to a certificate: "
        f"{_told(outlook, belief, 0)} from {group.runs} so far."
    )
    prediction = _prediction(outlook, belief, 0)
    return _proposal(outlook, history, number, Chosen(group.x, "replicate", prediction, None, reason))


def _search(outlook: Outlook, history: History, number: int, options: Options) -> Proposal:
    best = int(np.argmax(options.gain))
    reason = (
        f"Largest expected gain on the best design so far: {_told(outlook, options.belief, best)} expected"
    )
    return _unseen(outlook, history, number, options, (best, float(options.gain[best]), reason))


def _identify(outlook: Outlook, history: History, number: int, options: Options) -> Proposal:
    worth = outlook.identifying(options.belief)
    best = int(np.argmax(worth))
    reason = (
        f"The last third of the budget tells which parameters the target allows: here it may be met, and "
        f"{_told(outlook, options.belief, best)} is known least"
    )
    return _unseen(outlook, history, number, options, (best, float(worth[best]), reason))


def _unseen(
    outlook: Outlook, history: History, number: int, options: Options, found: tuple[int, float, str]
) -> Proposal:
    best, acquisition, reason = found
    prediction = _prediction(outlook, options.belief, best)
    told = f"{reason}, {100 * prediction.ok_probability:.0f} % likely to run."
    chosen = Chosen(options.search[best], "model", prediction, acquisition, told)
    return _proposal(outlook, history, number, chosen)


def _told(outlook: Outlook, belief: Belief, i: int) -> str:
    """Every response of a design as `30.1 +- 0.4 deg`."""
    parts = []
    for j, response in enumerate(outlook.spec.responses):
        unit = response.meaning.unit
        figures = ".1f" if unit == "deg" else ".3g"
        parts.append(f"{belief.means[j, i]:{figures}} +- {belief.wides[j, i]:{figures}} {unit}")
    return ", ".join(parts)


def _prediction(outlook: Outlook, belief: Belief, i: int) -> Prediction:
    return Prediction(
        responses={
            r.observable: Expected(r.meaning.unit, float(belief.means[j, i]), float(belief.wides[j, i]))
            for j, r in enumerate(outlook.spec.responses)
        },
        ok_probability=float(belief.ok[i]),
        window_probability=float(outlook.in_window(belief)[i]),
        expected_miss=float(outlook.miss(belief)[i]),
    )


def _proposal(outlook: Outlook, history: History, number: int, chosen: Chosen) -> Proposal:
    x, origin, prediction, acquisition, reason = chosen
    seed = simulation_seed(outlook.spec.seed, number, history.seeds_used(x))
    fits = {name: fit.as_dict() for name, fit in outlook.fits.items()}
    return Proposal(
        x, seed, origin, prediction, acquisition, reason, history.training_hash, fits, outlook.spec.scale
    )
