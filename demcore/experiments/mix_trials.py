"""Pile tests of a mix by every way to give it parameters.

Source: the paper's section 2.2, which averages the two calibrated sets "being aware this is a risky choice";
`python -m demcore mix` shows what the choice does to the angle.
"""

from __future__ import annotations

from collections.abc import Sequence

from demcore.allowed import choice
from demcore.errors import InputError
from demcore.experiments.contact_parameters import (
    MIXING_RULES,
    ContactParameters,
    PairwiseParameters,
    Parameters,
    PartParameters,
    averaged,
)
from demcore.experiments.paper_tables import TABLE_5, Trial, trial_name
from demcore.experiments.pile_case import PileTest
from demcore.material import Material, load_material
from demcore.rig import coarsest_scale, load_rig


def pairwise_optimum(mix: Material, unlike: str) -> PairwiseParameters:
    """Each part of a mix at the paper's optimum for it. Raises InputError for a part that Table 5 lacks."""
    if not mix.parts:
        raise InputError("material", mix.name, "a mix: a pure material has no pairs of unlike grains")
    for part in mix.mix:
        choice("parts.material", part.material, tuple(TABLE_5))
    sets = tuple(PartParameters(p.material, ContactParameters(*TABLE_5[p.material])) for p in mix.mix)
    return PairwiseParameters(sets, unlike)


def mix_trials(name: str, scale: float | None, seeds: Sequence[int]) -> list[Trial]:
    """A mix by every way to give it parameters, beside its parts alone in the mix's rig.

    `average` is the paper's plain mean of Table 5 (its last column), `average-mass` the mean by mass share, then
    pair by pair with each rule for unlike parts. All at one scale.
    Raises InputError for a material that is no mix, and whatever PileTest refuses.
    """
    mix = load_material(name)
    rig = load_rig(name)
    chosen = coarsest_scale(rig, mix.sizes.mean_diameter) if scale is None else scale
    ways: dict[str, tuple[str, Parameters]] = {
        f"pairs-{rule}": (f"pair by pair, unlike parts by the {rule}", pairwise_optimum(mix, rule))
        for rule in MIXING_RULES
    }
    sets = [ContactParameters(*TABLE_5[part.material]) for part in mix.mix]
    shares = [part.mass_share for part in mix.mix]
    ways = {
        "average": ("one set: the paper's plain mean of Table 5", averaged(sets)),
        "average-mass": ("one set: mean by mass share", averaged(sets, shares)),
        **ways,
    }
    trials = []
    for seed in seeds:
        for key, (told, parameters) in ways.items():
            test = PileTest(mix, rig, parameters, scale=chosen, seed=seed)
            trials.append(Trial(trial_name(test, f"-{key}"), told, test))
        for grain, parameters in zip(mix.grains, sets, strict=True):
            test = PileTest(grain, rig, parameters, scale=chosen, seed=seed)
            trials.append(Trial(trial_name(test, "-alone"), f"{grain.name} alone, in the same rig", test))
    return trials
