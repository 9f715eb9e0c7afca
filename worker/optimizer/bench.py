"""Ranks strategies on the synthetic study (synthetic.py):

    angle = 14.5 + 9 S(pp/.2) + 18 S(r/.25) S(pp/.3) + 1.5 S(pw/.3) - 3 (e - .1)/.5 exp(-r/.3)
    S(a) = 1 - exp(-a)

with noise of sd .5 deg; a run crashes with probability logistic((.435 - u_pp - u_r)/.03), u the unit-cube
values (10 % of the space). Targets and windows: coke 36.5 +- 1.5, sinter 31 +- 2, pellet 25.5 +- .5 deg.


Methods: `auto`; `auto_coarse`, with 16 runs of a coarse rig as a prior, which are not counted (they cost one
simulation together); `auto_warm`, started from a finished study of an earlier rig that had another target;
the rivals (rivals.py). Both rigs are synthetic.py's: 30 + shift + ratio (angle - 30) + .5 sin(6 u_r + 3 u_e) deg
with ratio 1.06, shift 1.5 (coarse) and .95, -1 (earlier), the same noise and the same crash region.

What each figure means, over the seeds of a case:
    certified_median, certified_q90
        simulations until the certificate, replicates and crashes counted; a study without one counts as
        infinite, and an infinite figure is null
    within_half_degree_when_certified
        share of certified studies whose recommended design is truly within .5 deg
    recommended_within
        share of studies whose recommendation after 12, 16, 20, 26 simulations (or at the study's earlier
        end) is truly within .3 and .5 deg of the target
    crash_share
        crashed runs over all runs
    coverage_90
        share of the designs with results, over all studies of the case, whose true angle lies in the final 90 %
        posterior interval there
    winner_coverage_90
        the same for the recommended design of each study alone: one trial a study, so 30 of them cannot tell .85
        from .95, and the winner is chosen for lying where the posterior wants it
    parameter_coverage_90
        the same for the parameters: chance that a design that truly meets the target (within .1 deg, weighted
        with its chance to run) lies in a parameter's 90 % interval
    first_feasible_median, first_feasible_q90
        simulations until the first angle inside the window
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from service.domain.study import CoarsePrior, StudySpec
from worker.optimizer.design import X, sobol
from worker.optimizer.history import Design, History, Pending, WarmStudy
from worker.optimizer.outlook import build_outlook
from worker.optimizer.posterior import posterior
from worker.optimizer.rivals import rivals
from worker.optimizer.stopping import Z_90, Stop, recommend
from worker.optimizer.strategies import BY_NAME, Strategy
from worker.optimizer.synthetic import (
    CASES,
    COARSE_RIG,
    COARSE_SCALE,
    EARLIER_RIG,
    SyntheticRig,
    crash_probability,
    study,
    true_angle,
)

BUDGET = 40
RIVALS_BUDGET = 26
CHECKPOINTS = (12, 16, 20, 26)
CLOSE_DEG = (0.3, 0.5)
COARSE_RUNS = 16
# The target that the earlier study of a warm start had.
EARLIER_CASE = {"coke": "sinter", "sinter": "coke", "pellet": "sinter"}
_STREAM_TRUTH = 300


@dataclass(frozen=True)
class Method:
    """A strategy with the help that it gets."""

    strategy: Strategy
    is_own: bool = False
    has_coarse: bool = False
    has_warm: bool = False


def methods() -> dict[str, Method]:
    """Every method that can run here."""
    auto = BY_NAME["auto"]
    own = {
        "auto": Method(auto, is_own=True),
        "auto_coarse": Method(auto, is_own=True, has_coarse=True),
        "auto_warm": Method(auto, is_own=True, has_warm=True),
    }
    return own | {name: Method(rival) for name, rival in rivals().items()}


@dataclass(frozen=True)
class Bench:
    """What to play: `seeds` studies of each case from `first_seed` on, on a rig with this noise."""

    seeds: int = 30
    first_seed: int = 1
    parallel: int = 1
    rig: SyntheticRig = field(default_factory=SyntheticRig)


@dataclass(frozen=True)
class Played:
    """One study, played to its end; `designs` are those at the study's own scale, in their order."""

    spec: StudySpec
    designs: tuple[Design, ...]
    stop: Stop
    certified: bool
    misses_deg: dict[int, float]
    final_miss_deg: float
    covered: tuple[bool, ...]
    winner_covered: bool | None
    parameters_covered: float | None


@dataclass(frozen=True)
class Row:
    """One line of the bench; see the module's docstring."""

    method: str
    case: str
    seeds: int
    certified_median: float | None
    certified_q90: float | None
    within_half_degree_when_certified: float | None
    recommended_within: dict[str, dict[str, float]]
    crash_share: float
    coverage_90: float | None
    winner_coverage_90: float | None
    parameter_coverage_90: float | None
    first_feasible_median: float | None
    first_feasible_q90: float | None

    def as_dict(self) -> dict[str, Any]:
        return asdict(self)


def seen_by(
    designs: Iterable[Design], number: int, spec: StudySpec, warm: tuple[WarmStudy, ...] = ()
) -> History:
    """What a proposal for design `number` may see: results up to number - parallel, the others pending."""
    made = tuple(designs)
    position = number - sum(d.scale != spec.scale for d in made)
    known = number - spec.parallel if position <= spec.budget else number
    done = tuple(d for d in made if d.number <= known)
    rest = tuple(Pending(d.number, d.x, d.seed, d.origin, d.scale) for d in made if d.number > known)
    return History(
        finished=tuple(d for d in done if d.scale == spec.scale),
        pending=tuple(p for p in rest if p.scale == spec.scale),
        coarse=tuple(d for d in done if d.scale != spec.scale),
        coarse_pending=tuple(p for p in rest if p.scale != spec.scale),
        warm=warm,
    )


def play(
    strategy: Strategy, spec: StudySpec, rig: SyntheticRig, warm: tuple[WarmStudy, ...] = ()
) -> tuple[tuple[Design, ...], Stop]:
    """Run a study to its end; runs still in flight then finish and are counted."""
    designs: list[Design] = []
    while True:
        number = len(designs) + 1
        answer = strategy.propose(spec, seen_by(designs, number, spec, warm), number)
        if isinstance(answer, Stop):
            return tuple(designs), answer
        results = (rig if answer.scale == spec.scale else COARSE_RIG).run(answer.x, answer.seed)
        designs.append(Design(number, answer.x, answer.seed, results, answer.origin, answer.scale))


def score(method: Method, case: str, seed: int, bench: Bench) -> Played:
    """Play one study and compare it with the truth."""
    warm = (_earlier(case, seed),) if method.has_warm else ()
    help_given = {
        "coarse": CoarsePrior(COARSE_SCALE, COARSE_RUNS) if method.has_coarse else None,
        "warm_start": tuple(w.study_id for w in warm),
    }
    budget = BUDGET if method.is_own else RIVALS_BUDGET
    spec = study(case, seed, budget, bench.parallel, **help_given)
    designs, stop = play(method.strategy, spec, bench.rig, warm)
    coarse = tuple(d for d in designs if d.scale != spec.scale)
    fine = tuple(d for d in designs if d.scale == spec.scale)
    misses = {
        n: _miss(method.strategy, spec, History(fine[:n], coarse=coarse, warm=warm))
        for n in {min(n, len(fine)) for n in (*CHECKPOINTS, len(fine))}
    }
    history = History(fine, coarse=coarse, warm=warm)
    return Played(
        spec=spec,
        designs=fine,
        stop=stop,
        certified=stop.reason == "certified",
        misses_deg={n: misses[min(n, len(fine))] for n in CHECKPOINTS},
        final_miss_deg=misses[len(fine)],
        covered=_designs_covered(spec, history) if method.is_own else (),
        winner_covered=_winner_covered(spec, history) if method.is_own else None,
        parameters_covered=_parameters_covered(spec, history) if method.is_own else None,
    )


def _earlier(case: str, seed: int) -> WarmStudy:
    """A finished study of the earlier rig, with the target of another case."""
    spec = study(EARLIER_CASE[case], seed, BUDGET)
    return WarmStudy(1, play(BY_NAME["auto"], spec, EARLIER_RIG)[0])


def _miss(strategy: Strategy, spec: StudySpec, history: History) -> float:
    x = strategy.recommend(spec, history)
    return math.inf if x is None else abs(_truth(x) - spec.primary.target)


def _truth(x: X) -> float:
    return float(true_angle(np.array([x]))[0])


def _designs_covered(spec: StudySpec, history: History) -> tuple[bool, ...]:
    outlook = build_outlook(spec, history)
    tried = [g.x for g in outlook.evaluated()]
    belief = outlook.believe(tried)
    return tuple((np.abs(true_angle(np.array(tried)) - belief.mean) <= Z_90 * belief.wide).tolist())


def _winner_covered(spec: StudySpec, history: History) -> bool | None:
    best = recommend(spec, history)
    return None if best is None else abs(_truth(best.x) - best.primary.mean) <= best.primary.half_width_90


def _parameters_covered(spec: StudySpec, history: History) -> float | None:
    found = posterior(spec, history, points=8192)
    if found is None:
        return None
    box = np.array([[v.lower, v.upper] for v in spec.space.variables])
    x = box[:, 0] + sobol(spec.space.dimension, 16384, _STREAM_TRUTH) * (box[:, 1] - box[:, 0])
    x = x[np.abs(true_angle(x) - spec.primary.target) <= 0.1]
    runs = 1.0 - crash_probability(x)
    inside = [(p.lower_90 <= x[:, j]) & (x[:, j] <= p.upper_90) for j, p in enumerate(found.parameters)]
    return float(np.mean([np.average(hit, weights=runs) for hit in inside]))


def summarise(method: str, case: str, played: list[Played]) -> Row:
    """The figures of one method and case."""
    sure = [p for p in played if p.certified]
    counts = [float(len(p.designs)) if p.certified else math.inf for p in played]
    first = [_first_feasible(p) for p in played]
    runs = sum(len(p.designs) for p in played)
    return Row(
        method=method,
        case=case,
        seeds=len(played),
        certified_median=_quantile(counts, 0.5),
        certified_q90=_quantile(counts, 0.9),
        within_half_degree_when_certified=_share(p.final_miss_deg <= 0.5 for p in sure),
        recommended_within={
            str(n): {str(c): float(np.mean([p.misses_deg[n] <= c for p in played])) for c in CLOSE_DEG}
            for n in CHECKPOINTS
        },
        crash_share=sum(d.results is None for p in played for d in p.designs) / runs,
        coverage_90=_share(hit for p in played for hit in p.covered),
        winner_coverage_90=_share(p.winner_covered for p in played if p.winner_covered is not None),
        parameter_coverage_90=_share(
            p.parameters_covered for p in played if p.parameters_covered is not None
        ),
        first_feasible_median=_quantile(first, 0.5),
        first_feasible_q90=_quantile(first, 0.9),
    )


def _first_feasible(played: Played) -> float:
    hits = (
        k
        for k, d in enumerate(played.designs, start=1)
        if d.angle_deg is not None and played.spec.primary.contains(d.angle_deg)
    )
    return float(next(hits, math.inf))


def _quantile(values: list[float], q: float) -> float | None:
    value = float(np.quantile(values, q, method="inverted_cdf" if q > 0.5 else "higher"))
    return value if math.isfinite(value) else None


def _share(values: Iterable[float]) -> float | None:
    listed = list(values)
    return float(np.mean(listed)) if listed else None


def bench(options: Bench, names: Iterable[str] | None = None) -> Iterable[Row]:
    """One row after the other, as they are ready."""
    known = methods()
    for name in names or known:
        for case in CASES:
            seeds = range(options.first_seed, options.first_seed + options.seeds)
            yield summarise(name, case, [score(known[name], case, seed, options) for seed in seeds])


HEADER = (
    f"{'method':14} {'case':7} {'seeds':>5} {'feasible':>9} {'certified':>10} {'in .5':>6} "
    f"{'.3/.5 deg at 12':>16} {'16':>9} {'20':>9} {'26':>9} {'crash':>6} {'cover':>6} {'winner':>6} {'param':>6}"
)


def as_line(row: Row) -> str:
    """A row for the terminal: medians with their 90 % quantile behind a slash, shares in parts of one."""
    near = [f"{v['0.3']:.2f}/{v['0.5']:.2f}" for v in row.recommended_within.values()]
    return (
        f"{row.method:14} {row.case:7} {row.seeds:5d} "
        f"{_pair(row.first_feasible_median, row.first_feasible_q90):>9} "
        f"{_pair(row.certified_median, row.certified_q90):>10} "
        f"{_cell(row.within_half_degree_when_certified):>6} "
        f"{near[0]:>16} {near[1]:>9} {near[2]:>9} {near[3]:>9} "
        f"{row.crash_share:6.3f} {_cell(row.coverage_90):>6} {_cell(row.winner_coverage_90):>6} "
        f"{_cell(row.parameter_coverage_90):>6}"
    )


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _pair(median: float | None, q90: float | None) -> str:
    return "/".join("-" if v is None else f"{v:.0f}" for v in (median, q90))
