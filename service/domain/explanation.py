"""Why this point? What was predicted of a design before it ran, why it was chosen, and what came out.

z = (y - m) / sqrt(s^2 + noise^2)      y measured, m and s of the prediction, noise between runs
inside_90 = |z| <= 1.645               the measured value lies in the central 90 % interval
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from service.domain.observables import ANGLE, OBSERVABLES

Z_90 = 1.6448536269514722  # Phi^-1(.95)


@dataclass(frozen=True)
class Comparison:
    """One response, in its unit. `sd` is of the mean; `interval_90` holds a single run's value with 90 %.

    `measured`, `z` and `inside_90` are None before the result, and for a run that gave none.
    """

    observable: str
    unit: str
    mean: float
    sd: float
    noise_sd: float | None
    interval_90: tuple[float, float]
    measured: float | None
    z: float | None
    inside_90: bool | None


def compare(
    prediction: Mapping[str, Any] | None,
    hyperparameters: Mapping[str, Any] | None,
    responses: Mapping[str, Any] | None,
) -> tuple[Comparison, ...]:
    """Each predicted response beside what came out; nothing where nothing was predicted."""
    found = []
    for name, (mean, sd) in _predicted(prediction or {}).items():
        noise = _noise(hyperparameters or {}, name)
        spread = math.hypot(sd, noise or 0.0)
        measured = (responses or {}).get(name)
        z = (measured - mean) / spread if measured is not None and spread > 0.0 else None
        unit = OBSERVABLES[name].unit if name in OBSERVABLES else ""
        interval = (mean - Z_90 * spread, mean + Z_90 * spread)
        inside = None if z is None else abs(z) <= Z_90
        found.append(Comparison(name, unit, mean, sd, noise, interval, measured, z, inside))
    return tuple(found)


def _predicted(prediction: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Mean and sd by observable; predictions of the first version are of the angle alone."""
    by_name = prediction.get("responses")
    if isinstance(by_name, Mapping):
        return {name: (float(told["mean"]), float(told["sd"])) for name, told in by_name.items()}
    if prediction.get("mean_deg") is None or prediction.get("sd_deg") is None:
        return {}
    return {ANGLE: (float(prediction["mean_deg"]), float(prediction["sd_deg"]))}


def _noise(hyperparameters: Mapping[str, Any], name: str) -> float | None:
    """The noise that the surrogate was fitted with: of this response, or (first version) of the angle alone."""
    mine = hyperparameters.get(name)
    value = mine.get("noise_sd") if isinstance(mine, Mapping) else hyperparameters.get("noise_sd_deg")
    return float(value) if isinstance(value, int | float) else None
