"""`study_report`: what a running or finished study says, as one plain-JSON record; a pure function.

    version           2 (1 had neither posterior.draws nor slices.pairs)
    designs           {finished, failed, with_results}
    enough            false: too few results to fit, and all below is left out; `text` says what is missing
    responses         by observable: {unit, target, target_sd, window, tolerance, noise_sd, inflation, designs,
                       scatter: {sd, freedom, is_measured, text}}: noise_sd as the surrogate was fitted with,
                       scatter pooled over replicates, or (freedom 0) what is expected of the observable
    posterior         {parameters: [{name, mean, sd, lower_90, upper_90, sd_ratio, label}],
                       correlations: matrix in that order,
                       combinations: [{coefficients by parameter in widths of the ranges, sd_ratio, label, text}],
                       share_within_2_sigma, effective_points, text: [a sentence each],
                       draws: {names, x as rows, means of the primary response}: equally weighted sets, few enough
                       to plot, to four digits}
    optimum           {x by parameter, window_probability, time_step_s, distance_to_literature, tied, rule}
    which_test_next   [{test, unit, meaning, lab_sd, expected, expected_sd, sd_ratios by parameter, overall,
                       source, text}], the most valuable first; `which_test_next_assumes`: a sentence
    ensemble          {members: [{x, window_probability, weight, predicted by observable {mean, sd}}], level, text}
    sensitivity       by observable: [{name, values, means, sds, swing, variance_share, variance_share_error,
                       variance_share_emulator_error, total_share, total_share_error, total_share_emulator_error,
                       rank_correlation, p_value}], errors are 90 % half-widths
    slices            of the primary response through the optimum: {along: [{names, axes, means, sds}],
                       over: {names, axes, means, sds as rows} or null, of the two variables that move it most,
                       pairs: the same of every two of the MOST_CROSSED that move it most, to four digits}

Numbers are finite or null; lengths of lists do not depend on the number of designs. Physical units throughout.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from service.domain.noise import run_noise
from service.domain.study import StudySpec
from worker.optimizer.acquisition import counting_sd
from worker.optimizer.design import FloatArray, to_unit
from worker.optimizer.history import History
from worker.optimizer.next_test import TestValue, which_test_next
from worker.optimizer.optimum import RULE, Ensemble, Optimum, Preferences, ensemble, optimum
from worker.optimizer.posterior import (
    IDENTIFIED_BELOW,
    POINTS,
    Beliefs,
    Posterior,
    Sample,
    beliefs,
    describe,
    draw,
    resample,
)
from worker.optimizer.sensitivity import Effect, Slice, effects, slice_along, slice_over

VERSION = 2
# Draws of the posterior that a report keeps, and the variables whose pairs are cut: 15 surfaces of 21 by 21.
DRAWS = 400
MOST_CROSSED = 6
# Sets in a report; the first n of them are the ensemble of n.
MEMBERS = 20
ASSUMED = (
    "The lab repeats the test on this rig at this fill level; the sd of its value is lab_sd, for tests of the "
    "pile the scatter between simulated runs. Emulator errors count as independent. Other fill levels, rigs or "
    "lifted cylinders are not weighed: no design of this study holds them."
)


def study_report(
    spec: StudySpec,
    history: History,
    like: Preferences | None = None,
    lab_sds: Mapping[str, float] | None = None,
    members: int = MEMBERS,
    level: float = 0.5,
    points: int = POINTS,
) -> dict[str, Any]:
    """The record above; the same arguments give the same record. `history.finished` may hold results of more
    observables than the study's responses: those are what further tests are weighed by."""
    counts = {
        "finished": len(history.finished),
        "failed": history.failures,
        "with_results": history.succeeded,
    }
    known = beliefs(spec, history)
    if known is None:
        text = "At least three designs with different results are needed before anything can be said."
        return {"version": VERSION, "designs": counts, "enough": False, "text": text}
    sample = draw(known, points)
    found = describe(spec.space, sample)
    tried = list(dict.fromkeys(d.x for d in history.finished if d.results is not None))
    best = optimum(known, sample, tried, like)
    sets = ensemble(known, sample, best, members, level)
    tests = which_test_next(known, sample, lab_sds)
    moved = {r.observable: effects(spec, known.emulators[r.observable]) for r in spec.responses}
    report: dict[str, Any] = plain(
        {
            "version": VERSION,
            "designs": counts,
            "enough": True,
            "responses": _responses(known, history),
            "posterior": {**_posterior(found), "draws": _draws(known, sample)},
            "optimum": {**asdict(best), "x": spec.space.as_dict(best.x), "rule": RULE},
            "which_test_next": [_test(test) for test in tests],
            "which_test_next_assumes": ASSUMED,
            "ensemble": _ensemble(known, sets),
            "sensitivity": {name: [asdict(e) for e in rows] for name, rows in moved.items()},
            "slices": _slices(known, best, moved[spec.primary.observable]),
        }
    )
    return report


def plain(value: Any) -> Any:
    """Plain JSON: tuples and arrays as lists, what is not finite as None."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def _responses(known: Beliefs, history: History) -> dict[str, Any]:
    rows = {}
    for response in known.spec.responses:
        name = response.observable
        emulator = known.emulators[name]
        scatter = run_noise(response, [g.values(name) for g in history.groups()], history.noise.get(name))
        rows[name] = {
            "unit": emulator.unit,
            "target": response.target,
            "target_sd": counting_sd(response),
            "window": response.window,
            "tolerance": response.tolerance,
            "noise_sd": emulator.noise_sd,
            "inflation": emulator.inflation,
            "designs": emulator.designs,
            "scatter": {
                "sd": scatter.sd,
                "freedom": scatter.freedom,
                "is_measured": scatter.is_measured,
                "text": scatter.text,
            },
        }
    return rows


def _posterior(found: Posterior) -> dict[str, Any]:
    combinations = [{**asdict(c), "text": c.text} for c in found.combinations]
    return {**asdict(found), "combinations": combinations, "text": sentences(found)}


def sentences(found: Posterior) -> list[str]:
    """What is identified, what is not, and which combinations are where their members are not."""
    told = []
    for p in found.parameters:
        known = f"{p.name} is {p.label}: {p.lower_90:.3g} to {p.upper_90:.3g} (90 %)"
        told.append(f"{known}, {100 * p.sd_ratio:.0f} % of the spread before.")
    single = {p.name for p in found.parameters if p.sd_ratio < IDENTIFIED_BELOW}
    for c in found.combinations:
        members = set(c.taking_part)
        if c.sd_ratio < IDENTIFIED_BELOW and len(members) > 1 and not members <= single:
            told.append(
                f"Identified only as a combination: {c.text}, {100 * c.sd_ratio:.0f} % of the spread before."
            )
    return told


def _test(test: TestValue) -> dict[str, Any]:
    unit = "" if test.unit == "1" else f" {test.unit}"
    text = (
        f"{test.meaning} (+-{test.lab_sd:.2g}{unit}): the spread of {test.best} is expected to shrink to "
        f"{100 * test.sd_ratios[test.best]:.0f} % of today's."
    )
    return {**asdict(test), "text": text[0].upper() + text[1:]}


def _ensemble(known: Beliefs, sets: Ensemble) -> dict[str, Any]:
    u = to_unit(known.spec.space, [m.x for m in sets.members])
    shown = {r.observable: known.emulators[r.observable].predict(u) for r in known.spec.responses}
    members = [
        {
            **asdict(m),
            "x": known.spec.space.as_dict(m.x),
            "predicted": {name: {"mean": mean[i], "sd": sd[i]} for name, (mean, sd) in shown.items()},
        }
        for i, m in enumerate(sets.members)
    ]
    return {"members": members, "level": sets.level, "text": sets.text}


def _slices(known: Beliefs, best: Optimum, moved: tuple[Effect, ...]) -> dict[str, Any]:
    space, emulator = known.spec.space, known.emulators[known.spec.primary.observable]
    along = [slice_along(emulator, space, best.x, j) for j in range(space.dimension)]
    # Over the two variables that move the response most.
    order = sorted(range(len(moved)), key=lambda j: (-moved[j].total_share, j))
    crossed = itertools.combinations(order[:MOST_CROSSED], 2)
    over = [slice_over(emulator, space, best.x, pair) for pair in crossed]
    return {
        "along": [_slice(s) for s in along],
        "over": _slice(over[0]) if over else None,
        "pairs": [_slice(replace(s, means=_short(s.means), sds=_short(s.sds))) for s in over],
    }


def _draws(known: Beliefs, sample: Sample) -> dict[str, Any]:
    """Sets as likely as each other, in physical units, with the mean of the primary response."""
    space, chosen = known.spec.space, resample(sample, DRAWS)
    lower = np.array([v.lower for v in space.variables])
    width = np.array([v.upper - v.lower for v in space.variables])
    means = sample.means[known.spec.primary.observable][chosen]
    return {"names": space.names, "x": _short(lower + width * sample.u[chosen]), "means": _short(means)}


def _short(values: FloatArray) -> FloatArray:
    """To four digits, for what is only drawn: a third of the bytes."""
    return np.array([float(f"{value:.4g}") for value in values.ravel()]).reshape(values.shape)


def _slice(cut: Slice) -> dict[str, Any]:
    return {"names": cut.names, "axes": cut.axes, "means": cut.means, "sds": cut.sds}
