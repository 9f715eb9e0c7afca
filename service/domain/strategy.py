"""How a study chooses its designs, by name, and the least budget with which each makes sense."""

from __future__ import annotations

from collections.abc import Mapping

STRATEGIES: Mapping[str, str] = {
    "auto": "a design of experiments, then the surrogate's expected improvement, replicates and a certificate",
    "improve_surrogate": "where the surrogate knows least, weighted with the chance that a run succeeds",
    "sobol": "scrambled Sobol points",
    "latin_hypercube": "a Latin hypercube, optimised for even spread",
    "factorial": "every combination of as many even levels as the budget pays for",
    "taguchi": "the largest standard orthogonal array that the budget pays for",
    "table": "the designs of a table, in its order",
}

# These propose by the surrogate, so that coarse runs and earlier studies can help them.
MODEL_BASED = ("auto", "improve_surrogate")

# The two-level arrays L4, L8, L12 and L16: runs, and the factors that they take.
_TWO_LEVEL_ARRAYS = ((4, 3), (8, 7), (12, 11), (16, 15))


def least_budget(strategy: str, dimension: int) -> int:
    """Simulations below which the strategy cannot make its design for so many variables."""
    if strategy == "factorial":
        return int(2**dimension)
    if strategy == "taguchi":
        return next((runs for runs, factors in _TWO_LEVEL_ARRAYS if factors >= dimension), 2 * dimension)
    return 1
