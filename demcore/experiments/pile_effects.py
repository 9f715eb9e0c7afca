"""Physical extensions of the pile test, each with one amplitude; at amplitude 0 the test is unchanged.

The library of effects of the design (diagnosis.md), as far as a pile can show them and a simulation makes them:
those of the grains (grain_effects.py), and what was done with them. Faults of sensors change readings and belong
to whoever reads; deflector and belt are the charge's (charge_effects.py). Where an effect has nothing to act on
(its scope), the test comes back unchanged too.

id              amplitude a                          law
lift_speed      ln of true over stated speed         of a cylinder that is lifted; one that vanishes has no speed
base_rough      added friction coefficient           mu' = mu + a between grains and base, 0 or more
feed_offcentre  m                                    the cylinder stands so far off the base's centre
vibration       largest acceleration of the base, g  sine of 30 Hz for 1 s from the removal on

An effect with a direction takes its azimuth, degrees from x, behind an @: `feed_offcentre@90`.
Raises of every effect: InputError where the amplitude leaves what the test's records allow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

from demcore.allowed import choice, within
from demcore.errors import InputError
from demcore.experiments.grain_effects import GRAIN_EFFECTS, Batch, GrainEffect
from demcore.experiments.pile_case import PileTest
from demcore.experiments.pile_setting import Vibration

Effect = Callable[[PileTest, float], PileTest]


def with_effect(test: PileTest, effect: str, amplitude: float) -> PileTest:
    """The test with one effect of the library. Raises InputError for an unknown one and a wrong amplitude."""
    name, at, azimuth = effect.partition("@")
    choice("effect", name, tuple(EFFECTS))
    within(f"effect.{name}", amplitude, -1e3, 1e3)
    if amplitude == 0.0:
        return test
    if not at:
        return EFFECTS[name](test, amplitude)
    return _towards(test, name, amplitude, azimuth)


def with_effects(test: PileTest, amplitudes: Mapping[str, float]) -> PileTest:
    """The test with several, in the library's order: what changes the material comes before what reads it."""
    order = list(EFFECTS)
    for key in amplitudes:
        choice("effect", key.partition("@")[0], order)
    for key in sorted(amplitudes, key=lambda k: (order.index(k.partition("@")[0]), k)):
        test = with_effect(test, key, amplitudes[key])
    return test


def _towards(test: PileTest, name: str, amplitude: float, azimuth: str) -> PileTest:
    try:
        angle = math.radians(float(azimuth))
    except ValueError:
        angle = math.nan
    if name != "feed_offcentre" or not math.isfinite(angle):
        raise InputError("effect", f"{name}@{azimuth}", "feed_offcentre@AZIMUTH, degrees from x")
    return _off_centre(test, amplitude * math.cos(angle), amplitude * math.sin(angle))


def _of_grains(effect: GrainEffect) -> Effect:
    """The effect on the grains of a pile test. The filled mass stays: the lab weighs what it fills in."""

    def act(test: PileTest, a: float) -> PileTest:
        before = _batch(test)
        batch = effect(before, a)
        if batch is before:
            return test
        return replace(
            test,
            material=batch.material,
            parameters=batch.parameters,
            fill_level=test.fill_level * (test.material.bulk_density / batch.material.bulk_density),
            numerics=replace(test.numerics, restitution_exponent=batch.restitution_exponent),
            setting=replace(test.setting, water=batch.water, air=batch.air),
        )

    return act


def _batch(test: PileTest) -> Batch:
    s = test.setting
    exponent = test.numerics.restitution_exponent
    return Batch(test.material, test.parameters, exponent, s.water, s.air, s.drop_height)


def _lift_speed(test: PileTest, a: float) -> PileTest:
    return test if test.lift_speed is None else replace(test, lift_speed=test.lift_speed * math.exp(a))


def _base_rough(test: PileTest, a: float) -> PileTest:
    return _set(test, base_friction_added=test.setting.base_friction_added + a)


def _feed_offcentre(test: PileTest, a: float) -> PileTest:
    return _off_centre(test, a, 0.0)


def _off_centre(test: PileTest, along_x: float, along_y: float) -> PileTest:
    x, y = test.setting.cylinder_offset
    return _set(test, cylinder_offset=(x + along_x, y + along_y))


def _vibration(test: PileTest, a: float) -> PileTest:
    return _set(test, vibration=Vibration(a))


def _set(test: PileTest, **changes: object) -> PileTest:
    return replace(test, setting=replace(test.setting, **changes))  # type: ignore[arg-type]


# In the order in which several are applied: what changes the grains, then what was done with them.
EFFECTS: Mapping[str, Effect] = {
    **{name: _of_grains(effect) for name, effect in GRAIN_EFFECTS.items()},
    "lift_speed": _lift_speed,
    "base_rough": _base_rough,
    "feed_offcentre": _feed_offcentre,
    "vibration": _vibration,
}
