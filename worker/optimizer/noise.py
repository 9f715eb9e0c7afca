"""How far runs of one design scatter: what is believed before, and what replicates add.

Notation (one observable, in its unit)
    s       sd of one run about the noiseless observable
    s_0     prior of s, worth nu_0 degrees of freedom
    SS      sum of squares inside the groups of replicates, nu its degrees of freedom
    log p(s^2) = -(nu_0 + nu)/2 log s^2 - (nu_0 s_0^2 + SS)/(2 s^2)      scaled inverse chi-square, in log s^2

The surrogate's likelihood is added to this where it is fitted (surrogate.py): designs that lie about a smooth
surface tell of the noise too, long before the winner has its seeds. Replicates alone came too late for coarse
piles, whose angle scatters by 1.5 deg where 0.5 was expected.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from service.domain.observables import OBSERVABLES
from worker.optimizer.history import History

# What the prior of calibration.md (0.5 deg; the paper's repeats pool to 0.58) is worth in replicates: three seeds
# of one design. With twice as many, a noise of 1.5 deg was read as 1.2 to 1.3 when the study ended.
PRIOR_FREEDOM = 2.0
# Earlier replicates of the same test count one for one up to here: designs elsewhere may scatter otherwise.
MOST_FREEDOM = 20.0
# Of the spread of an observable whose noise nobody knows beforehand.
PRIOR_SHARE = 0.1


class NoiseEvidence(NamedTuple):
    """`freedom` = nu_0 + nu and `squares` = nu_0 s_0^2 + SS."""

    freedom: float
    squares: float

    @property
    def sd(self) -> float:
        """The most likely s without a surrogate."""
        return math.sqrt(self.squares / self.freedom)


def noise_evidence(history: History, observable: str, spread: float) -> NoiseEvidence:
    """`spread`: sd of the observable over the designs, for one that has no prior of its own."""
    known = history.noise.get(observable)
    if known is not None:
        prior, freedom = known.sd, min(float(known.freedom), MOST_FREEDOM)
    else:
        own = OBSERVABLES[observable].noise_sd
        prior, freedom = (PRIOR_SHARE * spread if own is None else own), PRIOR_FREEDOM
    squares, seen = history.scatter(observable)
    # A test that always gave the same number still has a rounding error; 0 would make the fit singular.
    prior = max(prior, 1e-3 * spread)
    return NoiseEvidence(freedom + seen, freedom * prior**2 + squares)
