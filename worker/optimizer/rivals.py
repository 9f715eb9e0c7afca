"""The methods that `auto` is measured against, behind the same interface as the service's strategies.

They have no certificate and recommend the best observed design, as is usual.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np

from service.domain.study import StudySpec
from worker.optimizer.acquisition import minimum_improvement
from worker.optimizer.crashes import CrashClassifier
from worker.optimizer.design import X, candidates, generator, initial_design, simulation_seed, to_unit
from worker.optimizer.history import History
from worker.optimizer.noise import NoiseEvidence
from worker.optimizer.proposed import Proposal
from worker.optimizer.stopping import Stop
from worker.optimizer.strategies import Strategy
from worker.optimizer.surrogate import Surrogate, fit_hyperparameters, training_set

_STREAM_RANDOM, _STREAM_OPTUNA = 200, 201
# The squared error is scaled to this sd, which suits the surrogate's priors; its noise is taken as a tenth.
_ERROR_SD, _ERROR_NOISE = 5.0, NoiseEvidence(1e4, 1e4 * 0.5**2)


class Rival:
    """A method that only chooses the next x; the rest is common to all rivals."""

    def __init__(self, name: str, choose: Callable[[StudySpec, History, int], X]) -> None:
        self.name, self._choose = name, choose

    def propose(self, spec: StudySpec, history: History, number: int) -> Proposal | Stop:
        if number > spec.budget:
            return Stop("budget", f"All {spec.budget} simulations are spent.", {"budget": float(spec.budget)})
        x = self._choose(spec, history, number)
        seed = simulation_seed(spec.seed, number, history.seeds_used(x))
        origin = "doe" if number <= spec.initial_designs else "model"
        return Proposal(
            x, seed, origin, None, None, f"Chosen by {self.name}.", history.training_hash, None, spec.scale
        )

    def recommend(self, spec: StudySpec, history: History) -> X | None:
        ran = [d for d in history.finished if d.results is not None]
        return min(ran, key=lambda d: squared_error(spec, d.angle_deg or 0.0)).x if ran else None


def squared_error(spec: StudySpec, angle_deg: float) -> float:
    """(angle - target)^2, what the rivals minimise."""
    return (angle_deg - spec.primary.target) ** 2


def _random(spec: StudySpec, _: History, number: int) -> X:
    stream = generator(_STREAM_RANDOM, spec.seed, number)
    return spec.space.from_unit(stream.random(spec.space.dimension).tolist())


def _kriging_of_squared_error(spec: StudySpec, history: History, number: int) -> X:
    """The same design, surrogate, classifier and candidates as `auto`; only what is modelled differs."""
    ran = [d for d in history.finished if d.results is not None]
    visited = history.visited()
    if number <= spec.initial_designs or len(ran) < 3:
        initial = initial_design(spec.space, spec.seed, number + len(visited))
        return next(x for x in initial if x not in visited)
    errors = np.array([squared_error(spec, d.angle_deg or 0.0) for d in ran])
    scale = max(float(np.std(errors)), 1e-6) / _ERROR_SD
    rows = [(spec.space.to_unit(d.x), float(e)) for d, e in zip(ran, errors / scale, strict=True)]
    data = training_set(rows)
    surrogate = Surrogate(data, fit_hyperparameters(data, _ERROR_NOISE))
    options = [x for x in candidates(spec.space, spec.seed, number) if x not in visited]
    u = to_unit(spec.space, options)
    mean, sd = surrogate.predict(u)
    tried = to_unit(spec.space, [d.x for d in history.finished])
    ok = CrashClassifier(tried, np.array([float(d.results is not None) for d in history.finished]))
    gain = minimum_improvement(mean, sd, float(np.min(data.y))) * ok.ok_probability(u)
    return options[int(np.argmax(gain))]


def _optuna(sampler: Callable[[Any, int], Any]) -> Callable[[StudySpec, History, int], X]:
    """Optuna told the whole history anew for every design; a failed run is a failed trial."""

    def choose(spec: StudySpec, history: History, number: int) -> X:
        optuna: Any = importlib.import_module("optuna")
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        seed = int(generator(_STREAM_OPTUNA, spec.seed, number).integers(2**31))
        study = optuna.create_study(sampler=sampler(optuna.samplers, seed))
        box = {v.name: optuna.distributions.FloatDistribution(v.lower, v.upper) for v in spec.space.variables}
        states = optuna.trial.TrialState
        for d in history.finished:
            failed = d.results is None
            study.add_trial(
                optuna.trial.create_trial(
                    params=spec.space.as_dict(d.x),
                    distributions=box,
                    value=None if failed else squared_error(spec, d.angle_deg or 0.0),
                    state=states.FAIL if failed else states.COMPLETE,
                )
            )
        asked = study.ask(box).params
        return spec.space.from_unit(spec.space.to_unit([asked[name] for name in spec.space.names]))

    return choose


def _tpe(samplers: Any, seed: int) -> Any:
    return samplers.TPESampler(seed=seed, n_startup_trials=6)


def _gp_sampler(samplers: Any, seed: int) -> Any:
    return samplers.GPSampler(seed=seed, n_startup_trials=6)


def rivals() -> dict[str, Strategy]:
    """Those that can run here; Optuna's only where it (and, for its GP, torch) is installed."""
    found: list[Strategy] = [
        Rival("squared_error", _kriging_of_squared_error),
        Rival("random", _random),
    ]
    if importlib.util.find_spec("optuna"):
        found.append(Rival("optuna_tpe", _optuna(_tpe)))
        if importlib.util.find_spec("torch"):
            found.append(Rival("optuna_gp", _optuna(_gp_sampler)))
    return {strategy.name: strategy for strategy in found}
