"""What a diagnosis keeps of its calibration: the parameters and their posterior, to be shown and used again.

Notation (M materials, d parameters each, D = M d, k named effects)
    baseline    theta without any effect, its covariance Q: gain.py's fit without effects     (D, D)
    extended    theta beside the amplitudes of the named effects, Q of both                   (D + k, D + k)
    averaged    theta averaged over all models by how probable each is (analysis.expected_theta), where the
                self-tests ran

The first two are linear about the parameters of the last analysis, in the unit boxes; values and intervals are
told in the parameters' own units, intervals cut at the box.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from worker.diagnosis.analysis import expected_theta
from worker.diagnosis.diagnose import Diagnosis
from worker.diagnosis.gain import Fit, fit_linear, named_directions
from worker.diagnosis.model import Model, physical
from worker.diagnosis.simulator import FloatArray, Simulator

_NORMAL_90 = 1.6449


def kept_baseline(simulator: Simulator, found: Diagnosis) -> dict[str, Any] | None:
    """The baseline as plain JSON types; None where nothing was calibrated.

    `parameters`: by material and name value, ci90 and averaged; `box`: lower and upper by name; `rows`: what the
    rows of `covariance` are, in units of the box.
    """
    if found.setup is None or found.analysis is None:
        return None
    model, fit = found.setup.model, fit_linear(found, ())
    kept = _kept(simulator, model, fit, ())
    averaged = _by_name(simulator, model, expected_theta(found.analysis))
    for material, parameters in kept["parameters"].items():
        for name, parameter in parameters.items():
            parameter["averaged"] = averaged[material][name]
    return kept


def kept_extension(simulator: Simulator, found: Diagnosis) -> dict[str, Any] | None:
    """The same for the model with the named effects, without `averaged`; None where nothing is named.

    The last rows of `covariance` are the amplitudes along their named directions, in the effects' units.
    """
    if found.setup is None or not found.result.claims:
        return None
    fit = fit_linear(found, tuple(named_directions(found)))
    effects = tuple(claim.effect for claim in found.result.claims)
    return _kept(simulator, found.setup.model, fit, effects)


def _kept(simulator: Simulator, model: Model, fit: Fit, effects: tuple[str, ...]) -> dict[str, Any]:
    reach = _NORMAL_90 * np.sqrt(np.diag(fit.Q)[: len(fit.theta)])
    value, low, high = (_by_name(simulator, model, fit.theta + step) for step in (0.0, -reach, reach))
    names = [p.name for p in simulator.parameters]
    return {
        "parameters": {
            material: {
                name: {"value": value[material][name], "ci90": [low[material][name], high[material][name]]}
                for name in names
            }
            for material in model.materials
        },
        "box": {p.name: [p.lower, p.upper] for p in simulator.parameters},
        "rows": [*(f"{material} {name}" for material in model.materials for name in names), *effects],
        "covariance": fit.Q.tolist(),
    }


def _by_name(simulator: Simulator, model: Model, theta: FloatArray) -> dict[str, dict[str, float]]:
    """theta (D,), cut at the box, by material and name in the parameters' units."""
    points = physical(simulator, theta.reshape(len(model.materials), model.dimension))
    names = [p.name for p in simulator.parameters]
    return {m: dict(zip(names, point, strict=True)) for m, point in zip(model.materials, points, strict=True)}
