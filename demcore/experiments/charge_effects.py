"""Physical extensions of a charge, each with one amplitude; at amplitude 0 the charge is unchanged.

The effects of the grains (grain_effects.py), and of the plant, as the design's library has them (diagnosis.md):

id              amplitude a                     what changes
liner_wear      added friction coefficient      mu' = mu + a between grains and the hopper's walls, 0 or more
belt_speed      share of the belt's speed       v' = v (1 + a); the feed stays, so the bed on the belt is thinner
belt_track      m, along the drum's axis        the belt runs so far off its middle, and the stream with it
deflector_shift m, away from the belt           the ridge stands so far beside its place
deflector_tilt  degrees                         added to the near face's pitch and taken from the far one's
deflector_wear  m                               the ridge has lost so much height; the faces' lower edges stay

Grains break in the fall from the drum to the middle of the hopper's depth. A bed that is shaken is a pile's only.
Raises of every effect: InputError where the amplitude leaves what the charge's records allow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

from demcore.allowed import choice, within
from demcore.errors import InputError
from demcore.experiments.charge_case import ChargeTest
from demcore.experiments.grain_effects import GRAIN_EFFECTS, Batch, GrainEffect
from demcore.plant.parts import Plant

Effect = Callable[[ChargeTest, float], ChargeTest]


def with_effect(test: ChargeTest, effect: str, amplitude: float) -> ChargeTest:
    """The charge with one effect of the library. Raises InputError for an unknown one and a wrong amplitude."""
    choice("effect", effect, tuple(EFFECTS))
    within(f"effect.{effect}", amplitude, -1e3, 1e3)
    return test if amplitude == 0.0 else EFFECTS[effect](test, amplitude)


def with_effects(test: ChargeTest, amplitudes: Mapping[str, float]) -> ChargeTest:
    """The charge with several, in the library's order: what changes the material comes before what reads it."""
    for name in amplitudes:
        choice("effect", name, tuple(EFFECTS))
    for name in EFFECTS:
        test = with_effect(test, name, amplitudes.get(name, 0.0))
    return test


def _of_grains(effect: GrainEffect) -> Effect:
    """The effect on the grains of a charge, which is the same mass of them."""

    def act(test: ChargeTest, a: float) -> ChargeTest:
        before = _batch(test)
        batch = effect(before, a)
        if batch is before:
            return test
        return replace(
            test,
            charge=replace(test.charge, material=batch.material, parameters=batch.parameters),
            numerics=replace(test.numerics, restitution_exponent=batch.restitution_exponent),
            water=batch.water,
            air=batch.air,
        )

    return act


def _batch(test: ChargeTest) -> Batch:
    exponent = test.numerics.restitution_exponent
    charge = test.charge
    return Batch(charge.material, charge.parameters, exponent, test.water, test.air, fall_height(test.plant))


def fall_height(plant: Plant) -> float:
    """m, from the belt's surface on the drum to the middle of the hopper's depth."""
    return plant.belt.tangent_point[2] + 0.5 * plant.hopper.seat_depth


def _liner_wear(test: ChargeTest, a: float) -> ChargeTest:
    return replace(test, liner_friction_added=test.liner_friction_added + a)


def _belt_speed(test: ChargeTest, a: float) -> ChargeTest:
    if not a > -1.0:
        raise InputError("effect.belt_speed", a, "more than -1: a belt that runs")
    belt = test.plant.belt
    return replace(test, plant=replace(test.plant, belt=replace(belt, speed=belt.speed * (1.0 + a))))


def _belt_track(test: ChargeTest, a: float) -> ChargeTest:
    belt = test.plant.belt
    return replace(test, plant=replace(test.plant, belt=replace(belt, drum_along=belt.drum_along - a)))


def _deflector_shift(test: ChargeTest, a: float) -> ChargeTest:
    return _deflector(test, ridge_across=test.plant.deflector.ridge_across + a)


def _deflector_tilt(test: ChargeTest, a: float) -> ChargeTest:
    d = test.plant.deflector
    return _deflector(test, near_pitch_deg=d.near_pitch_deg + a, far_pitch_deg=d.far_pitch_deg - a)


def _deflector_wear(test: ChargeTest, a: float) -> ChargeTest:
    """Each face turns about its lower edge and becomes shorter; both get one length, the mean of the two."""
    d = test.plant.deflector
    if a < 0.0:
        raise InputError("effect.deflector_wear", a, "0 m or more")
    pitches = [math.radians(p) for p in (d.near_pitch_deg, d.far_pitch_deg)]
    faces = [(d.face_length * math.cos(p), d.face_length * math.sin(p) - a) for p in pitches]
    near, far = (math.degrees(math.atan2(drop, run)) for run, drop in faces)
    return _deflector(
        test,
        ridge_height=d.ridge_height - a,
        near_pitch_deg=near,
        far_pitch_deg=far,
        face_length=math.fsum(math.hypot(*face) for face in faces) / len(faces),
    )


def _deflector(test: ChargeTest, **changes: float) -> ChargeTest:
    # A mesh that stands for the deflector has no pitches to change.
    if test.plant.replacement("deflector") is not None:
        raise InputError(
            "effect", "of the deflector", "a deflector by its numbers: a mesh stands for this one"
        )
    return replace(test, plant=replace(test.plant, deflector=replace(test.plant.deflector, **changes)))


# In the order in which several are applied: what changes the grains, then the plant.
EFFECTS: Mapping[str, Effect] = {
    **{name: _of_grains(effect) for name, effect in GRAIN_EFFECTS.items()},
    "liner_wear": _liner_wear,
    "belt_speed": _belt_speed,
    "belt_track": _belt_track,
    "deflector_shift": _deflector_shift,
    "deflector_tilt": _deflector_tilt,
    "deflector_wear": _deflector_wear,
}
