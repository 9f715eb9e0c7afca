"""The next deflector to try: expected improvement of a weighted objective, with another weight each time.

ParEGO (Knowles 2006): each step draws a weight, makes one number of the objectives by the augmented Tchebycheff
function, fits a Gaussian process to it and takes the point of largest expected improvement; over the steps the
weights walk along the Pareto front.
"""

from __future__ import annotations

import numpy as np

from worker.deflector.designs import STREAM, Space, candidates
from worker.deflector.pareto import pareto_set, tchebycheff
from worker.optimizer.acquisition import minimum_improvement
from worker.optimizer.design import FloatArray, generator
from worker.optimizer.noise import NoiseEvidence
from worker.optimizer.surrogate import Surrogate, fit_hyperparameters, training_set

# Weights of the first objective that the steps draw from, and what the noise of one run is worth before any is
# known: a twentieth of the range, like two replicates.
WEIGHTS = np.linspace(0.0, 1.0, 11)
NOISE_SHARE, NOISE_FREEDOM = 0.05, 2.0


def propose(space: Space, u: FloatArray, f: FloatArray, seed: int, number: int) -> tuple[float, ...]:
    """The design to try as `number`, from designs u (N, V) and objectives f (N, 2); it depends on these alone."""
    first = float(generator(STREAM, seed, number, 1).choice(WEIGHTS))
    value = tchebycheff(f, (first, 1.0 - first))
    spread = float(np.ptp(value)) or 1.0
    noise = NoiseEvidence(NOISE_FREEDOM, NOISE_FREEDOM * (NOISE_SHARE * spread) ** 2)
    data = training_set((tuple(row), float(v)) for row, v in zip(u.tolist(), value, strict=True))
    # The priors are written for a response that spreads over about five units.
    model = Surrogate(data, fit_hyperparameters(data, noise, unit=spread / 5.0))
    points = candidates(space, seed, number, u[pareto_set(f)])
    mean, sd = model.predict(points)
    gain = minimum_improvement(mean, np.maximum(sd, 1e-9), float(model.mean(u).min()))
    best = points[int(np.argmax(gain))]
    return tuple(float(v) for v in best)
