"""Hides causes in data sets: draws designs, parameters, effects at a wanted signal-to-noise ratio, and noise.

SNR is the length of what the cause changes in the means of the training replicates, in units of their noise, after
what the truth's own calibration parameters could absorb is projected out. Imports the data format and the truth.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from service.domain.data_set.records import Condition, DataSet, Observation
from tests.diagnosis.truth import EFFECTS, SCATTER, Amplitudes, Array, Theta, correlation, natural, observe

KINDS = ("null", "decoy", "single", "pair", "outside", "left_out")
_SHARE = {"null": 0.26, "decoy": 0.07, "single": 0.40, "pair": 0.09, "outside": 0.09, "left_out": 0.09}
_SINGLE_SNR = (3.0, 5.0, 8.0, 12.0)
_OUTSIDE_SNR = (8.0, 12.0)
ALIKE, MIMIC = 0.85, 0.6
_OF_ONE_DESIGN = 8
_WALL = {"base_rough", "liner_wear"}
_AZIMUTHS = {"feed_offcentre", "sensor_tilt"}

# Causes that the library does not have: the amplitude's direction of growth, and the blocks that are its place.
OUTSIDE: Mapping[str, frozenset[str]] = {
    "clock": frozenset(
        ["summary:pile.ln_t90", "summary:charge.ln_t25", "summary:charge.ln_t50", "summary:charge.ln_t100"]
    ),
    "gauge": frozenset(["summary:charge.ln_belt_depth"]),
    "one_mass": frozenset(),  # one condition had another mass than was written down
    "one_angle": frozenset(),  # the angle of one material is read too high
    "one_time": frozenset(),  # the stop-watch of one condition
}


@dataclass(frozen=True)
class Case:
    """A data set and, for the scorer alone, what is hidden in it.

    `unknown` is left out of the analyser's library. `identifiable`: no other effect looks like it; `mimicked`: an
    effect of the library looks like the outside cause. `places`: blocks where an outside cause sits.
    """

    number: int
    kind: str
    snr: float
    data: DataSet
    hidden: Mapping[str, float]
    unknown: str | None = None
    identifiable: bool = True
    mimicked: bool = False
    places: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Design:
    """Conditions, replicates of each, and the seed of which cells are missing."""

    conditions: tuple[Condition, ...]
    replicates: int
    missing: int

    @property
    def training(self) -> tuple[Condition, ...]:
        return tuple(c for c in self.conditions if not c.holdout)


@dataclass(frozen=True)
class Plan:
    """A design with the parameters of each material."""

    design: Design
    theta: Mapping[str, Theta]

    @cached_property
    def ruler(self) -> Ruler:
        return _ruler(self)


def cases(count: int, seed: int) -> Iterator[Case]:
    """About `count` cases of all kinds in the shares above; eight in a row are of one design, with parameters,
    cause and noise of their own. What a library lacks comes last."""
    wanted = []
    for kind, share in _SHARE.items():
        levels = {"single": _SINGLE_SNR, "pair": (8.0,), "outside": _OUTSIDE_SNR, "left_out": _OUTSIDE_SNR}
        snrs = levels.get(kind, (0.0,))
        wanted += [(kind, snrs[k % len(snrs)]) for k in range(max(round(count * share), 1))]
    order = np.random.default_rng(np.random.SeedSequence([seed, 0])).permutation(len(wanted))
    wanted = sorted((wanted[k] for k in order), key=lambda w: w[0] == "left_out")
    for number, (kind, snr) in enumerate(wanted):
        of_design = np.random.default_rng(np.random.SeedSequence([seed, 1, number // _OF_ONE_DESIGN]))
        stream = np.random.default_rng(np.random.SeedSequence([seed, 2, number]))
        yield draw(number, kind, snr, draw_design(of_design), stream)


def draw(number: int, kind: str, snr: float, design: Design, stream: np.random.Generator) -> Case:
    """One case of a design; a cause that cannot reach the SNR within its range is drawn again."""
    while True:
        plan = Plan(design, {c.material: _theta(stream, kind == "decoy") for c in design.conditions})
        if kind in ("null", "decoy"):
            return Case(number, kind, 0.0, measure(plan, [], stream), {})
        found = _outside(plan, snr, stream) if kind == "outside" else _inside(plan, kind, snr, stream)
        if found is not None:
            causes, hidden, facts = found
            return Case(number, kind, snr, measure(plan, causes, stream), hidden, **facts)  # type: ignore[arg-type]


def draw_design(stream: np.random.Generator, replicates: int | None = None) -> Design:
    """Nine piles and three charges to train on, three and two held out; moisture follows mass in one of five."""
    covarying = stream.random() < 0.2
    materials = ("coke", str(stream.choice(["sinter", "pellet"])))
    piles = []
    for k in range(12):
        mass = float(np.round(np.exp(stream.uniform(np.log(60.0), np.log(900.0))), 1))
        moisture = float(np.round(max(0.0, 2.5 * np.log(mass / 120.0)), 1))
        if not covarying:
            moisture = float(np.round(stream.uniform(1.0, 7.0), 1)) if k % 3 == 1 else 0.0
        piles.append(
            Condition(
                f"P{k}",
                "pile",
                materials[k % 2],
                mass,
                moisture_percent=moisture,
                base_diameter_m=1.5,
                cylinder_height_m=float(stream.choice([0.8, 1.6])),
                removal="lift" if k % 4 < 2 else "instant",
                lift_speed_m_s=float(np.round(stream.uniform(0.05, 0.2), 3)),
                drop_height_m=float(stream.choice([0.0, 0.3, 1.0, 2.0])),
                holdout=k >= 9,
            )
        )
    charges = [
        Condition(
            f"C{k}",
            "charge",
            materials[k % 2],
            float(np.round(stream.uniform(2500.0, 9000.0), 0)),
            moisture_percent=float(np.round(stream.uniform(1.0, 6.0), 1)) if k == 2 else 0.0,
            feed_rate_kg_s=float(np.round(stream.uniform(35.0, 90.0), 1)),
            belt_speed_m_s=float(np.round(stream.uniform(1.5, 2.2), 2)),
            deflector_ridge_across_m=float(np.round(stream.uniform(-0.25, -0.11), 3)),
            drop_height_m=float(stream.choice([0.0, 0.5, 1.0])),
            holdout=k >= 3,
        )
        for k in range(5)
    ]
    n = int(stream.integers(4, 6)) if replicates is None else replicates
    return Design((*piles, *charges), n, int(stream.integers(2**31)))


def _theta(stream: np.random.Generator, strong: bool) -> Theta:
    """`strong`: friction 30 % above the usual, which re-calibration must absorb."""
    low, high = (0.25, 0.32, 0.25, 0.2), (0.6, 0.40, 0.7, 0.45)
    drawn = [float(stream.uniform(a, b)) for a, b in zip(low, high, strict=True)]
    drawn[1] = float(stream.uniform(0.12, 0.38))
    if strong:
        drawn[0] *= 1.3
    return Theta(*drawn)


@dataclass(frozen=True)
class Cause:
    """Amplitudes, and the condition (or material) that alone has them; None: all."""

    amplitudes: Amplitudes
    only: str | None = None
    mass_factor: float = 1.0
    observable: str | None = None
    shift: float = 0.0

    def acts_on(self, c: Condition) -> bool:
        return self.only is None or self.only in (c.condition, c.material)


def expected(c: Condition, theta: Theta, causes: list[Cause]) -> dict[str, float]:
    """Noiseless natural observables of one condition."""
    amplitudes: dict[str, float] = {}
    here = [cause for cause in causes if cause.acts_on(c)]
    for cause in here:
        amplitudes |= cause.amplitudes
        c = replace(c, mass_kg=c.mass_kg * cause.mass_factor)
    values = natural(observe(c, theta, amplitudes))
    for cause in here:
        if cause.observable in values:
            values[str(cause.observable)] += cause.shift
    return values


def signature(plan: Plan, causes: list[Cause]) -> Array:
    """The change by the causes in whitened training means, calibration projected out."""
    deltas = []
    for c, (names, base, L) in zip(plan.design.training, plan.ruler.scales, strict=True):
        with_causes = expected(c, plan.theta[c.material], causes)
        deltas.append(np.linalg.solve(L, np.array([with_causes[n] for n in names]) - base))
    delta, Q = np.concatenate(deltas), plan.ruler.absorbed
    return np.asarray(delta - Q @ (Q.T @ delta))


class Ruler(NamedTuple):
    """Of each training condition the observables, their values without a cause and the root of the means' noise;
    and an orthonormal basis of what the truth's own calibration parameters absorb."""

    scales: list[tuple[list[str], Array, Array]]
    absorbed: Array


def _ruler(plan: Plan) -> Ruler:
    scales, slopes = [], []
    for c in plan.design.training:
        theta = plan.theta[c.material]
        values = expected(c, theta, [])
        names, base = list(values), np.array(list(values.values()))
        sd = np.array([SCATTER[n].sd for n in names]) / np.sqrt(plan.design.replicates)
        L = np.linalg.cholesky(correlation(names) * np.outer(sd, sd))
        scales.append((names, base, L))
        J = np.zeros((len(names), 4 * len(plan.theta)))
        place = 4 * list(plan.theta).index(c.material)
        for j in range(4):
            up = expected(c, theta._replace(**{Theta._fields[j]: theta[j] + 0.01}), [])
            J[:, place + j] = (np.array([up[n] for n in names]) - base) / 0.01
        slopes.append(np.linalg.solve(L, J))
    return Ruler(scales, np.linalg.qr(np.vstack(slopes))[0])


def _scaled(plan: Plan, make: object, largest: float, snr: float) -> float | None:
    """The amplitude at which a cause has the wanted SNR; None where its range is too short."""

    def length(a: float) -> float:
        return float(np.linalg.norm(signature(plan, [make(a)])))  # type: ignore[operator]

    if length(largest) < snr:
        return None
    low, high = 0.0, largest
    for _ in range(18):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if length(middle) < snr else (low, middle)
    return high


def _effect(name: str, a: float, sign: float, azimuth: float) -> Cause:
    extra = {"azimuth": azimuth} if name in _AZIMUTHS else {}
    return Cause({name: sign * a, **extra})


def _inside(plan: Plan, kind: str, snr: float, stream: np.random.Generator):  # type: ignore[no-untyped-def]
    names = list(stream.choice(sorted(EFFECTS), 2, replace=False))[: 2 if kind == "pair" else 1]
    if set(names) == _WALL or set(names) == _AZIMUTHS:
        return None
    causes, hidden = [], {}
    for name in map(str, names):
        largest, both = EFFECTS[name]
        sign = -1.0 if both and stream.random() < 0.5 else 1.0
        azimuth = float(stream.uniform(0.0, 360.0))
        a = _scaled(plan, lambda x, n=name, s=sign, z=azimuth: _effect(n, x, s, z), largest, snr)
        if a is None or (kind == "left_out" and name in _WALL):  # its other half would rightly be named
            return None
        causes.append(_effect(name, a, sign, azimuth))
        hidden[name] = sign * a
    cosine = max(_likeness(plan, cause, set(hidden)) for cause in causes)
    if kind == "left_out":
        name = next(iter(hidden))
        return causes, {}, {"unknown": name, "mimicked": cosine >= MIMIC, "identifiable": False}
    return causes, hidden, {"identifiable": cosine < ALIKE}


def _likeness(plan: Plan, cause: Cause, own: set[str]) -> float:
    """Largest cosine of a cause with an effect of the library that is not its own, nor of its class."""
    mine = signature(plan, [cause])
    own = own | (_WALL if own & _WALL else set())
    largest = 0.0
    for name, (reach, _) in EFFECTS.items():
        if name in own:
            continue
        azimuths = (0.0, 90.0) if name in _AZIMUTHS else (0.0,)
        parts = np.stack([signature(plan, [_effect(name, 0.1 * reach, 1.0, z)]) for z in azimuths])
        Q, R = np.linalg.qr(parts.T)
        held = Q[:, np.abs(np.diag(R)) > 1e-9]
        largest = max(largest, float(np.linalg.norm(held.T @ mine) / max(np.linalg.norm(mine), 1e-12)))
    return largest


def _outside(plan: Plan, snr: float, stream: np.random.Generator):  # type: ignore[no-untyped-def]
    name = str(stream.choice(sorted(OUTSIDE)))
    pile = str(stream.choice([c.condition for c in plan.design.training if c.test == "pile"]))
    material = str(stream.choice(list(plan.theta)))
    sign = float(stream.choice([-1.0, 1.0]))
    places = OUTSIDE[name]
    if name == "one_mass":
        make, largest = (lambda a: Cause({}, pile, mass_factor=float(np.exp(sign * a)))), 1.0
        places = frozenset([f"condition:{pile}"])
    elif name == "one_angle":
        make, largest = (lambda a: Cause({}, material, observable="repose_angle_deg", shift=sign * a)), 15.0
        places = frozenset(["summary:pile.angle", f"material:{material}"])
    elif name == "one_time":
        make, largest = (lambda a: Cause({}, pile, observable="discharge_t90_s", shift=sign * a)), 1.0
        places = frozenset([f"condition:{pile}", "summary:pile.ln_t90"])
    else:
        make, largest = (lambda a: Cause({name: sign * a})), 0.5
    a = _scaled(plan, make, largest, snr)
    if a is None:
        return None
    mimicked = _likeness(plan, make(a), set()) >= MIMIC
    return [make(a)], {}, {"mimicked": mimicked, "identifiable": False, "places": places}


def measure(plan: Plan, causes: list[Cause], stream: np.random.Generator, clean: bool = False) -> DataSet:
    """Replicates with heavy tails (Student's t with 5 degrees of freedom); unless `clean` with 1 % of the values
    four to six sd off, and 3 % missing."""
    observations = []
    absent = np.random.default_rng(plan.design.missing)
    for c in plan.design.conditions:
        mean = expected(c, plan.theta[c.material], causes)
        names = list(mean)
        sd = np.array([SCATTER[n].sd for n in names])
        L = np.linalg.cholesky(correlation(names))
        for k in range(plan.design.replicates):
            noise = L @ stream.standard_normal(len(names)) / np.sqrt(stream.chisquare(5.0) / 3.0)
            kept = np.ones(len(names), dtype=bool)
            if not clean:
                far = stream.random(len(names)) < 0.01
                noise[far] += stream.choice([-1.0, 1.0], far.sum()) * stream.uniform(4.0, 6.0, far.sum())
                kept = absent.random(len(names)) >= 0.03
            for name, e, s in np.array(list(zip(names, noise, sd, strict=True)), dtype=object)[kept]:
                value = mean[name] + s * e
                value = float(np.exp(value)) if SCATTER[name].is_relative else float(value)
                observations.append(Observation(c.condition, f"r{k}", name, value))
    return DataSet(plan.design.conditions, tuple(observations))


def effect_free(count: int, seed: int) -> Iterator[DataSet]:
    """Data sets of the same world without any cause, ten clean replicates each: what a floor is estimated from."""
    for k in range(count):
        stream = np.random.default_rng(np.random.SeedSequence([seed, 3, k]))
        design = draw_design(stream, replicates=10)
        theta = {c.material: _theta(stream, False) for c in design.conditions}
        yield measure(Plan(design, theta), [], stream, clean=True)
