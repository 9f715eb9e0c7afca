"""What a diagnosis keeps of its calibration holds the parameters that the data were made with."""

from __future__ import annotations

import numpy as np

from tests.diagnosis.hider import effect_free
from worker.diagnosis.calibrated import kept_baseline, kept_extension
from worker.diagnosis.calibration import linearise
from worker.diagnosis.diagnose import Options, diagnose
from worker.diagnosis.stand_in import StandIn


def test_the_posterior_is_that_of_the_calibration() -> None:
    """Without effects it is the linearised problem's own; told in physical units, and narrower than the box."""
    (data,) = effect_free(1, 7)
    found = diagnose(data, StandIn(), Options(first_wave=32, second_wave=24, plants=100, refined=False))
    kept = kept_baseline(StandIn(), found)
    assert kept is not None and found.analysis is not None and found.setup is not None
    problem = found.analysis.problem
    assert np.allclose(kept["covariance"], problem.posterior)
    assert found.measured is not None
    again = linearise(
        found.setup.model, found.measured.y, found.measured.S + found.setup.floor, problem.theta
    )
    theta = again.shifted(np.zeros(len(again.r)))
    sd = np.sqrt(np.diag(again.posterior))
    assert len(kept["rows"]) == len(theta)
    for row, u, s in zip(kept["rows"], theta, sd, strict=True):
        material, name = row.rsplit(" ", 1)
        lower, upper = kept["box"][name]
        told = kept["parameters"][material][name]
        assert np.isclose(told["value"], lower + u * (upper - lower))
        ends = lower + np.clip([u - 1.6449 * s, u + 1.6449 * s], 0.0, 1.0) * (upper - lower)
        assert np.allclose(told["ci90"], ends)
    assert np.all(np.diag(problem.posterior) <= 1.0 / 12.0)
    assert found.result.claims or kept_extension(StandIn(), found) is None
