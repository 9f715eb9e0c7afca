"""Whether a version of the model fits the pile of a study, and what it is simulated with there.

A version is found on measured piles and says of which material, with which contact law and how coarse they were
simulated; used elsewhere its amplitudes mean something else, so it is refused there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from demcore.errors import InputError
from demcore.experiments.pile_case import ContactParameters, PileTest
from demcore.experiments.pile_effects import EFFECTS, with_effects
from demcore.material import load_material
from demcore.rig import load_rig
from service.domain.data_set.records import Condition
from service.domain.effects import library
from service.domain.errors import InvalidValue
from service.domain.measured_pile import acting_effects
from service.domain.model_use import FIELD, ModelUse
from service.domain.search_space import default_values

# The law of a study's pile tests.
CONTACT_MODEL = "paper"
# An amplitude holds for grains about as coarse as those of the diagnosis: up to twice as coarse or as fine.
FARTHEST_SCALE = 2.0


@dataclass(frozen=True)
class FoundOn:
    """Where a version comes from: materials, contact law and scales of the piles behind it, and its amplitudes by
    effect (posterior means)."""

    materials: frozenset[str]
    contact_model: str
    scales: tuple[float, float]
    amplitudes: Mapping[str, float]


def fitted(use: ModelUse, found: FoundOn, material: str, scale: float, fill_level: float) -> ModelUse:
    """The use with its effects. Raises InvalidValue, in one sentence, where the version does not fit the pile."""
    if material not in found.materials:
        allowed = f"a version found on {material}: this one was found on {', '.join(sorted(found.materials))}"
        raise InvalidValue(FIELD, use.name, allowed)
    if found.contact_model != CONTACT_MODEL:
        allowed = (
            f"a version found with {CONTACT_MODEL} contacts, as a study simulates: this one was found with "
        )
        raise InvalidValue(FIELD, use.name, allowed + f"{found.contact_model} contacts")
    coarsest, finest = found.scales[1] * FARTHEST_SCALE, found.scales[0] / FARTHEST_SCALE
    if not finest <= scale <= coarsest:
        allowed = f"a version for scale {scale:g}: this one holds from {finest:.3g} to {coarsest:.3g}"
        raise InvalidValue(FIELD, use.name, allowed)
    effects = _simulated(use, material, found.amplitudes)
    try:
        plain = PileTest(
            load_material(material),
            load_rig(material),
            ContactParameters(**default_values()),
            scale=scale,
            fill_level=fill_level,
        )
        with_effects(plain, effects)
    except InputError as error:
        raise InvalidValue(FIELD, use.name, f"one that this pile test can have: {error}") from error
    return ModelUse(use.name, use.moisture_percent, effects)


def _simulated(use: ModelUse, material: str, amplitudes: Mapping[str, float]) -> dict[str, float]:
    known = library()
    # A study's ideal test: the cylinder vanishes; the filled mass is in no effect's scope.
    pile = Condition("study", "pile", material, 1.0, moisture_percent=use.moisture_percent)
    keys = {}
    for name, amplitude in amplitudes.items():
        if name not in known or (name not in EFFECTS and not known[name].is_reading):
            raise InvalidValue(FIELD, use.name, f"effects that a pile is simulated with: {name} is none")
        effect = known[name]
        if effect.is_reading:
            allowed = (
                f"effects of the grains or the test: {name} is a fault of the measurement, so correct that"
            )
            raise InvalidValue(FIELD, use.name, allowed)
        if not effect.acts_on(pile):
            wet = " (state its moisture_percent)" if name == "cohesion" else ""
            allowed = f"effects that act on a study's pile: {name} has nothing to act on there{wet}"
            raise InvalidValue(FIELD, use.name, allowed)
        # Of an effect with a direction, any serves: a study's responses do not tell directions.
        keys[effect.keys[0]] = amplitude
    return acting_effects(known, pile, keys)
