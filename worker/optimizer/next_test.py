"""Which test next: how much each further measurement would narrow the parameters, before it is made.

Preposterior analysis (Raiffa and Schlaifer 1961). Notation (k points drawn from the posterior, d variables)
    u       parameters, unit cube, equally weighted                                     (k, d)
    m, s    what the test would show at them, and the emulator's sd of that             (k,)
    tau     sd of the lab's value
    y       one possible outcome: m_i of one of the points plus noise N(0, s_i^2 + tau^2)
    v(y)    variance of each parameter under weights N(y; m_j, s_j^2 + tau^2)           (d,)

The expected posterior sd is sqrt(mean over outcomes of v(y)); the shrinkage is one less its ratio to today's sd.

Assumed, and said with every answer: the lab's sd of an observable of the pile equals the scatter between
simulated runs; direct tests on steel or of single grains have the sd and the relation named in DIRECT_TESTS;
errors of emulators are independent from point to point (the shrinkage of a poorly emulated test is an
understatement). Another fill level, rig or cylinder is not weighed: a study's designs hold one only, so no
emulator of it exists.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from service.domain.observables import OBSERVABLES
from service.domain.study import StudySpec
from worker.optimizer.design import FloatArray, generator
from worker.optimizer.posterior import Beliefs, Sample

DRAWS = 1500
OUTCOMES = 96
_STREAM = 102

Values = Mapping[str, FloatArray]


@dataclass(frozen=True)
class DirectTest:
    """A test whose result follows from the parameters alone: `relation` of their values (k,) by name."""

    unit: str
    meaning: str
    lab_sd: float
    needs: tuple[str, ...]
    relation: Callable[[Values], FloatArray]


def _wall_angle(values: Values) -> FloatArray:
    """A layer of grains in a frame slides down a tilted plate at tan(angle) = mu (Coulomb)."""
    return np.asarray(np.degrees(np.arctan(values["particle_wall_static_friction"])))


def _rolling_angle(values: Values) -> FloatArray:
    """One grain leaves its place on a tilted plate: it rolls at tan(angle) = mu_r, or slides at mu_s before
    (physics.md section 3: at rest iff mu_r >= tan th)."""
    rolling = values.get("particle_wall_rolling_resistance", values["rolling_resistance"])
    return np.asarray(np.degrees(np.arctan(np.minimum(rolling, values["particle_wall_static_friction"]))))


def _rebound(values: Values) -> FloatArray:
    """A grain dropped on a fixed grain rises to e^2 of its height (physics.md section 3)."""
    return np.asarray(values["particle_particle_restitution"] ** 2)


DIRECT_TESTS: Mapping[str, DirectTest] = {
    "wall_friction_angle_deg": DirectTest(
        "deg",
        "tilt at which a framed layer of grains slides on a steel plate",
        1.0,
        ("particle_wall_static_friction",),
        _wall_angle,
    ),
    "rolling_angle_deg": DirectTest(
        "deg",
        "tilt at which a single grain leaves its place on a steel plate",
        2.0,
        ("rolling_resistance", "particle_wall_static_friction"),
        _rolling_angle,
    ),
    "rebound_height_ratio": DirectTest(
        "1",
        "height of rebound over height of fall of a grain on a fixed grain",
        0.03,
        ("particle_particle_restitution",),
        _rebound,
    ),
}


@dataclass(frozen=True)
class TestValue:
    """What a test is expected to do. `sd_ratios`: expected posterior sd over today's, by parameter.

    `overall` is one less their geometric mean; `expected` and `expected_sd`: the outcome as predicted today.
    """

    __test__ = False  # not a test class, whatever pytest reads in the name

    test: str
    unit: str
    meaning: str
    lab_sd: float
    expected: float
    expected_sd: float
    sd_ratios: Mapping[str, float]
    overall: float
    source: str

    @property
    def best(self) -> str:
        """The parameter that gains most."""
        return min(self.sd_ratios, key=lambda name: self.sd_ratios[name])


def which_test_next(
    known: Beliefs, sample: Sample, lab_sds: Mapping[str, float] | None = None
) -> tuple[TestValue, ...]:
    """Every test that can be weighed, the most valuable first. `lab_sds`: known sds of the lab, by test."""
    spec, lab = known.spec, lab_sds or {}
    rng = generator(_STREAM, spec.seed)
    u = sample.u[rng.choice(len(sample.u), DRAWS, p=sample.w)]
    today = u.std(axis=0)
    asked = {r.observable for r in spec.responses}
    found = []
    for name, emulator in known.emulators.items():
        if name in asked:
            continue
        sd = lab.get(name, emulator.noise_sd)
        shown = emulator.predict(u)
        meaning = OBSERVABLES[name].meaning
        source = f"emulator of {emulator.designs} designs"
        found.append(_value(spec, name, (emulator.unit, meaning, sd, source), u, today, shown))
    values = parameter_values(spec, u)
    for name, test in DIRECT_TESTS.items():
        if not set(test.needs) <= set(values) or not set(test.needs) & _free(spec):
            continue
        shown = (test.relation(values), np.zeros(len(u)))
        about = (test.unit, test.meaning, lab.get(name, test.lab_sd), "closed form")
        found.append(_value(spec, name, about, u, today, shown))
    return tuple(sorted(found, key=lambda value: (-value.overall, value.test)))


def parameter_values(spec: StudySpec, u: FloatArray) -> dict[str, FloatArray]:
    """Every parameter that the study says, searched, fixed or derived: values (k,) by name."""
    rows = [spec.parameters_of(tuple(x)) for x in _physical(spec, u)]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _physical(spec: StudySpec, u: FloatArray) -> list[list[float]]:
    lower = np.array([v.lower for v in spec.space.variables])
    width = np.array([v.upper - v.lower for v in spec.space.variables])
    found: list[list[float]] = (lower + width * u).tolist()
    return found


def _free(spec: StudySpec) -> set[str]:
    return set(spec.space.names) | set(spec.derived)


def _value(
    spec: StudySpec,
    name: str,
    about: tuple[str, str, float, str],
    u: FloatArray,
    today: FloatArray,
    shown: tuple[FloatArray, FloatArray],
) -> TestValue:
    unit, meaning, lab_sd, source = about
    mean, sd = shown
    sigma = np.hypot(sd, lab_sd)
    after = expected_sds(u, mean, sigma, generator(_STREAM, spec.seed, 1))
    # Outcomes are few: what noise makes larger than today is no loss of knowledge.
    ratios = np.minimum(after / np.maximum(today, 1e-12), 1.0)
    return TestValue(
        test=name,
        unit=unit,
        meaning=meaning,
        lab_sd=lab_sd,
        expected=float(mean.mean()),
        expected_sd=float(math.hypot(mean.std(), math.sqrt(np.mean(sigma**2)))),
        sd_ratios=dict(zip(spec.space.names, ratios.tolist(), strict=True)),
        overall=1.0 - float(np.exp(np.mean(np.log(np.maximum(ratios, 1e-9))))),
        source=source,
    )


def expected_sds(
    u: FloatArray, mean: FloatArray, sigma: FloatArray, rng: np.random.Generator, outcomes: int = OUTCOMES
) -> FloatArray:
    """Expected posterior sd (d,) of equally weighted points u (k, d) after a test that shows N(mean, sigma^2).

    Outcomes are stratified over what is predicted: one from each of `outcomes` slices of the sorted means.
    """
    order = np.argsort(mean, kind="stable")
    slices = (np.arange(outcomes) + rng.random(outcomes)) / outcomes * len(mean)
    drawn = order[slices.astype(np.int64)]
    y = mean[drawn] + sigma[drawn] * rng.standard_normal(outcomes)
    log_w = -0.5 * ((y[:, None] - mean) / sigma) ** 2 - np.log(sigma)
    w = np.exp(log_w - log_w.max(axis=1, keepdims=True))
    w /= w.sum(axis=1, keepdims=True)
    centre = u - u.mean(axis=0)
    first, second = w @ centre, w @ centre**2
    variance = np.maximum(second - first**2, 0.0).mean(axis=0)
    return np.asarray(np.sqrt(variance))
