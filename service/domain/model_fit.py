"""Whether a version of the model fits the pile of a study, or a charge, and what it is simulated with there.

A version is found on measured piles and says of which material, with which contact law and how coarse they were
simulated; used elsewhere its amplitudes mean something else, so it is refused there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from demcore.errors import InputError
from demcore.experiments import charge_effects
from demcore.experiments.charge_case import ChargeTest
from demcore.experiments.pile_case import ContactParameters, PileTest
from demcore.experiments.pile_effects import with_effects
from demcore.material import load_material
from demcore.rig import load_rig
from service.domain.data_set.records import Condition
from service.domain.effects import Effect, library
from service.domain.errors import InvalidValue
from service.domain.measured_pile import SIMULATED, acting_effects, pile_scale
from service.domain.model_use import FIELD, ModelUse
from service.domain.search_space import default_values

# The law of a study's pile tests.
CONTACT_MODEL = "paper"
# An amplitude holds for grains about as coarse as those of the diagnosis: up to twice as coarse or as fine.
FARTHEST_SCALE = 2.0
# What an effect of the lab's pile is called in a charge.
IN_A_CHARGE: Mapping[str, str] = {"base_rough": "liner_wear"}
WHERE: Mapping[str, str] = {"pile": "a study's pile", "charge": "a charge"}


@dataclass(frozen=True)
class FoundOn:
    """Where a version comes from: materials, contact law and scales of the piles behind it, its amplitudes by
    effect (posterior means), and the same by effect key, None of a direction that was not kept."""

    materials: frozenset[str]
    contact_model: str
    scales: tuple[float, float]
    amplitudes: Mapping[str, float]
    keys: Mapping[str, Mapping[str, float] | None] = field(default_factory=dict)


def fitted(use: ModelUse, found: FoundOn, material: str, scale: float, fill_level: float) -> ModelUse:
    """The use with its effects. Raises InvalidValue, in one sentence, where the version does not fit the pile."""
    _check(use, found, material, scale)
    effects = _simulated(use, "pile", material, found.amplitudes)
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


def fitted_charge(use: ModelUse, found: FoundOn, test: ChargeTest) -> ModelUse:
    """The same for a charge. What was found of the base of the lab is taken for the hopper's liner: they are one
    class of the library, and no pile tells them apart."""
    _check(use, found, test.charge.material.name, test.scale)
    amplitudes = {IN_A_CHARGE.get(name, name): amplitude for name, amplitude in found.amplitudes.items()}
    effects = _simulated(use, "charge", test.charge.material.name, amplitudes)
    try:
        charge_effects.with_effects(test, effects)
    except InputError as error:
        raise InvalidValue(FIELD, use.name, f"one that this charge can have: {error}") from error
    return ModelUse(use.name, use.moisture_percent, effects)


def fitted_diagnosis(
    use: ModelUse, found: FoundOn, conditions: Sequence[Condition], grains: int, contact_model: str
) -> ModelUse:
    """The same for the piles of a diagnosis, with its amplitudes as they are stated: water and scope are each
    condition's own, and here a direction counts."""
    for condition in conditions:
        scale = pile_scale(condition, grains)
        _check(use, found, condition.material, scale, contact_model, "this diagnosis")
    keys: dict[str, float] = {}
    for name in found.amplitudes:
        effect = _simulated_effect(use, "pile", name)
        if not any(effect.acts_on(condition) for condition in conditions):
            raise InvalidValue(FIELD, use.name, f"effects that act on these conditions: {name} acts on none")
        along = found.keys[name]
        if along is None:
            allowed = f"a version that keeps the direction of {name}: diagnose its data once more"
            raise InvalidValue(FIELD, use.name, allowed)
        keys |= along
    return replace(use, effects=keys)


def _check(
    use: ModelUse,
    found: FoundOn,
    material: str,
    scale: float,
    contact_model: str = CONTACT_MODEL,
    who: str = "a study",
) -> None:
    if material not in found.materials:
        allowed = f"a version found on {material}: this one was found on {', '.join(sorted(found.materials))}"
        raise InvalidValue(FIELD, use.name, allowed)
    if found.contact_model != contact_model:
        allowed = (
            f"a version found with {contact_model} contacts, as {who} simulates: this one was found with "
        )
        raise InvalidValue(FIELD, use.name, allowed + f"{found.contact_model} contacts")
    coarsest, finest = found.scales[1] * FARTHEST_SCALE, found.scales[0] / FARTHEST_SCALE
    if not finest <= scale <= coarsest:
        allowed = f"a version for scale {scale:g}: this one holds from {finest:.3g} to {coarsest:.3g}"
        raise InvalidValue(FIELD, use.name, allowed)


def _simulated(use: ModelUse, kind: str, material: str, amplitudes: Mapping[str, float]) -> dict[str, float]:
    """Of an ideal test: the cylinder of a pile vanishes; the mass is in no effect's scope."""
    known = library()
    test = Condition("ideal", kind, material, 1.0, moisture_percent=use.moisture_percent)
    keys = {}
    for name, amplitude in amplitudes.items():
        effect = _simulated_effect(use, kind, name)
        if not effect.acts_on(test):
            wet = " (state its moisture_percent)" if name == "cohesion" else ""
            allowed = f"effects that act on {WHERE[kind]}: {name} has nothing to act on there{wet}"
            raise InvalidValue(FIELD, use.name, allowed)
        # Of an effect with a direction, any serves: a study's responses do not tell directions.
        keys[effect.keys[0]] = amplitude
    return acting_effects(known, test, keys)


def _simulated_effect(use: ModelUse, kind: str, name: str) -> Effect:
    known = library()
    if name not in known or (name not in SIMULATED[kind] and not known[name].is_reading):
        raise InvalidValue(FIELD, use.name, f"effects that a {kind} is simulated with: {name} is none")
    if known[name].is_reading:
        allowed = f"effects of the grains or the test: {name} is a fault of the measurement, so correct that"
        raise InvalidValue(FIELD, use.name, allowed)
    return known[name]
