"""The paper's Table 7 beside ours: the repose angle at its optimum (Table 5), repeated.

Source: Degrassi et al. 2021, Tables 5 and 7. Table 7's first row is the run that the optimization ended with, the
other two repeat it; the paper does not say what differed between them, ours differ in their seed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from demcore.case import RestCriterion
from demcore.errors import InputError
from demcore.experiments.contact_parameters import ContactParameters
from demcore.experiments.pile_case import PileTest
from demcore.material import SizeClass, SizeDistribution, load_material
from demcore.rig import coarsest_scale, load_rig

# Table 5: particle-particle and particle-wall friction, restitution, rolling resistance.
TABLE_5 = {
    "coke": (0.50, 0.80, 0.24, 0.48),
    "sinter": (0.40, 0.40, 0.40, 0.24),
    "pellet": (0.40, 0.40, 0.20, 0.20),
    "sinter65_pellet35": (0.40, 0.40, 0.30, 0.22),
}
# Table 7: repose angles, degrees.
TABLE_7 = {
    "coke": (37.7, 37.1, 36.6),
    "sinter": (31.5, 32.5, 31.5),
    "pellet": (25.6, 25.0, 24.4),
}


@dataclass(frozen=True)
class Trial:
    """A pile test with a name that is its own: its file is called so. `choice` is what differs from the rest."""

    name: str
    choice: str
    test: PileTest


def optimum_test(material: str, scale: float | None, seed: int) -> PileTest:
    """The paper's optimum; without a scale at the coarsest one that the angle does not feel (physics.md 4).

    Raises InputError for a material that Table 5 lacks, and whatever PileTest refuses.
    """
    if material not in TABLE_5:
        raise InputError("material", material, "one of " + ", ".join(TABLE_5))
    grains, rig = load_material(material), load_rig(material)
    chosen = coarsest_scale(rig, grains.sizes.mean_diameter) if scale is None else scale
    return PileTest(grains, rig, ContactParameters(*TABLE_5[material]), scale=chosen, seed=seed)


def table_7_trials(scales: Mapping[str, float | None], seeds: Sequence[int]) -> list[Trial]:
    """Every material of `scales` with every seed."""
    tests = [optimum_test(material, scale, seed) for material, scale in scales.items() for seed in seeds]
    return [Trial(trial_name(test), "", test) for test in tests]


def trial_name(test: PileTest, suffix: str = "") -> str:
    """Material, scale and seed, with what else tells a trial from its neighbours."""
    return f"{test.material.name}-scale{test.scale:g}{suffix}-seed{test.seed}"


# What the paper leaves open, one change each. A name, what it says, and the changed test.
Change = Callable[[PileTest], PileTest]


def _field(**values: object) -> Change:
    return lambda test: dataclasses.replace(test, **values)  # type: ignore[arg-type]


def _material(**values: object) -> Change:
    def change(test: PileTest) -> PileTest:
        return dataclasses.replace(test, material=dataclasses.replace(test.material, **values))  # type: ignore[arg-type]

    return change


def _numerics(**values: float) -> Change:
    return lambda test: dataclasses.replace(test, numerics=dataclasses.replace(test.numerics, **values))  # type: ignore[arg-type]


def _one_size(test: PileTest) -> PileTest:
    mean = test.material.sizes.mean_diameter
    return _material(sizes=SizeDistribution((SizeClass(mean, mean, 1.0),)))(test)


def _uniform_sizes(test: PileTest) -> PileTest:
    sizes = test.material.sizes
    return _material(sizes=SizeDistribution((SizeClass(sizes.smallest, sizes.largest, 1.0),)))(test)


def _finer(test: PileTest) -> PileTest:
    return dataclasses.replace(test, scale=round(test.scale / 1.25, 3))


CHANGES: dict[str, tuple[str, Change]] = {
    "fill75": ("cylinder filled to 75 %", _field(fill_level=0.75)),
    "fill50": ("cylinder filled to 50 %", _field(fill_level=0.5)),
    "phi55": ("packing fraction .55: heavier particles, fewer of them", _material(packing_fraction=0.55)),
    "phi64": ("packing fraction .64: lighter particles, more of them", _material(packing_fraction=0.64)),
    "undamped": ("no long-term damping", _material(long_term_damping=0.0)),
    "damped": ("long-term damping 1", _material(long_term_damping=1.0)),
    "dynamic": ("dynamic friction as high as static", _material(dynamic_friction_ratio=1.0)),
    "kt7": ("tangential over normal stiffness .7", _numerics(stiffness_ratio=0.7)),
    "kt3": ("tangential over normal stiffness .3", _numerics(stiffness_ratio=0.3)),
    "residual": ("residual force of unloading 10 times as large", _numerics(residual=0.01)),
    "rest": ("at rest only at a fifth of the speed", _field(rest=RestCriterion(speed_share=0.001))),
    "lift": ("cylinder lifted at 30 mm/s", _field(lift_speed=0.03)),
    "dt": ("time step by the paper's preset", _field(time_step="paper")),
    "one-size": ("all particles of the mean size", _one_size),
    "uniform": ("sizes uniform by mass between the limits", _uniform_sizes),
    "finer": ("particles 1.25 times smaller", _finer),
}


def sensitivity_trials(material: str, scale: float | None, seeds: Sequence[int]) -> list[Trial]:
    """The optimum, and with one unpublished choice changed at a time, where that is a change."""
    trials = []
    for seed in seeds:
        base = optimum_test(material, scale, seed)
        trials.append(Trial(trial_name(base), "", base))
        for key, (told, change) in CHANGES.items():
            changed = change(base)
            if changed != base:
                trials.append(Trial(trial_name(base, f"-{key}"), told, changed))
    return trials


@dataclass(frozen=True)
class Angles:
    """Repose angles of equal trials but for the seed, degrees; nan for one that failed."""

    values: tuple[float, ...]

    @property
    def sound(self) -> tuple[float, ...]:
        return tuple(v for v in self.values if math.isfinite(v))

    @property
    def mean(self) -> float:
        return sum(self.sound) / len(self.sound) if self.sound else math.nan

    @property
    def scatter(self) -> float:
        """Standard deviation between seeds; nan with fewer than two."""
        sound = self.sound
        if len(sound) < 2:
            return math.nan
        return math.sqrt(sum((v - self.mean) ** 2 for v in sound) / (len(sound) - 1))


def pooled_scatter(groups: Sequence[Angles]) -> float:
    """Standard deviation between seeds over all groups, degrees: sum of squares over sum of freedoms."""
    squares = sum((len(g.sound) - 1) * g.scatter**2 for g in groups if len(g.sound) > 1)
    freedoms = sum(len(g.sound) - 1 for g in groups if len(g.sound) > 1)
    return math.sqrt(squares / freedoms) if freedoms else math.nan


def noise_of_difference(a: Angles, b: Angles, scatter: float) -> float:
    """Standard error of the difference of two means, degrees, under one scatter between seeds."""
    if not a.sound or not b.sound:
        return math.nan
    return scatter * math.sqrt(1.0 / len(a.sound) + 1.0 / len(b.sound))
