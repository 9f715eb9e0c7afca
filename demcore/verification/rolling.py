"""Sliding and rolling of one sphere on a plane: gross sliding, the start of rolling, decay, inclines.

Notation: v speed m/s, e restitution, mu friction, mu_r rolling resistance, R radius, th angle of an incline or
of incidence from the normal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from demcore.case import Interaction
from demcore.particles import VX, WX, X
from demcore.verification.outcome import SECTION_3, Outcome, share_of
from demcore.verification.single_sphere import FLOOR, G, on_floor, single, state

WY = WX + 1

SLIDING = {40: (0.7829, -544.2), 50: (0.8471, -456.7), 60: (0.8948, -355.2), 70: (0.9337, -243.0),
           80: (0.9679, -123.4), 85: (0.9841, -61.9)}  # fmt: skip


def gross_sliding() -> Iterator[Outcome]:
    """Oblique impact in gross sliding (table of physics.md): tangential restitution and spin."""
    mu, e, v, radius = 0.092, 0.98, 3.9, 0.0025
    contact = Interaction(e, mu, mu, 0.0)
    for degrees, (e_t, omega) in SLIDING.items():
        th = math.radians(degrees)
        vt, vn = v * math.sin(th), v * math.cos(th)
        # Stiff, because the closed form neglects the overlap beside the radius.
        start = (0.0, 0.0, radius * 1.00001)
        s = single(contact, [FLOOR], start, (vt, 0.0, -vn), radius=radius, finer=4.0, youngs=1e10)
        s.advance(1200)
        yield Outcome(f"gross sliding, {degrees} deg: e_t", SECTION_3, e_t, state(s, VX) / vt, 0.004)
        # Sliding along +x turns the sphere about +y; the table counts the spin the other way round.
        yield share_of(f"gross sliding, {degrees} deg: spin / rad/s", SECTION_3, omega, -state(s, WY), 0.01)


def sliding_to_rolling() -> Iterator[Outcome]:
    """A sphere set sliding at v0 rolls from t* = 2 v0/(7 mu g) on with 5/7 v0."""
    mu, v0, radius = 0.3, 1.0, 0.02
    s = on_floor(Interaction(0.5, mu, mu, 0.0), radius, velocity=(v0, 0.0, 0.0))
    expected = 2.0 * v0 / (7.0 * mu * G)
    while s.time < 3 * expected and state(s, VX) - state(s, WY) * radius > 1e-3 * v0:
        s.advance(20)
    yield share_of("sliding sphere starts to roll: t* / s", SECTION_3, expected, s.time, 0.03)
    s.advance(int(0.1 / s.dt))
    yield share_of("sliding sphere starts to roll: v_f / m/s", SECTION_3, 5 / 7 * v0, state(s, VX), 0.01)


def rolling_decay() -> Iterator[Outcome]:
    """Pure rolling slows with a = (5/7) mu_r g."""
    radius, v0 = 0.02, 1.0
    for mu_r in (0.02, 0.05, 0.10):
        s = on_floor(
            Interaction(0.5, 0.5, 0.5, mu_r), radius, velocity=(v0, 0.0, 0.0), spin=(0.0, v0 / radius, 0.0)
        )
        s.advance(int(0.05 / s.dt))
        v, t = state(s, VX), s.time
        s.advance(int(0.5 / s.dt))
        expected = 5 / 7 * mu_r * G
        got = (v - state(s, VX)) / (s.time - t)
        yield share_of(f"rolling decay, mu_r = {mu_r:g} / m/s2", SECTION_3, expected, got, 0.01)


def rolling_incline() -> Iterator[Outcome]:
    """Rolling down 20 degrees: a = (5/7) g (sin th - mu_r cos th)."""
    radius, th = 0.02, math.radians(20.0)
    for mu_r, expected in ((0.0, 2.3966), (0.1, 1.7381), (0.3, 0.4212)):
        s = on_floor(Interaction(0.5, 0.8, 0.8, mu_r), radius, th)
        s.advance(int(0.1 / s.dt))
        v, t = state(s, VX), s.time
        s.advance(int(0.4 / s.dt))
        got = (state(s, VX) - v) / (s.time - t)
        yield share_of(f"rolling down 20 deg, mu_r = {mu_r:g} / m/s2", SECTION_3, expected, got, 0.01)


def rolling_threshold() -> Iterator[Outcome]:
    """At rest iff mu_r >= tan th: creep under 1e-3 R in 5 s.

    mu_r = .35 holds at 19 degrees and lets go at 20 (tan 20 deg = .364); the same 2 % around other angles.
    """
    cases = [(0.35, 19.0, 1.0), (0.35, 20.0, 0.0)]
    for degrees in (5.0, 12.0, 30.0):
        limit = math.tan(math.radians(degrees))
        cases += [(1.02 * limit, degrees, 1.0), (0.98 * limit, degrees, 0.0)]
    for mu_r, degrees, stays in cases:
        held = 1.0 if _creep(mu_r, degrees, 0.02) < 1e-3 * 0.02 else 0.0
        yield Outcome(
            f"type 3 threshold, mu_r = {mu_r:.4f}, {degrees:g} deg: holds", SECTION_3, stays, held, 0.0
        )


def _creep(mu_r: float, degrees: float, radius: float) -> float:
    """How far a sphere creeps in 5 s, m, once its couple has wound up and stopped ringing (a second)."""
    s = on_floor(Interaction(0.5, 0.9, 0.9, mu_r), radius, math.radians(degrees))
    s.advance(int(1.0 / s.dt))
    x = state(s, X)
    s.advance(int(5.0 / s.dt))
    return state(s, X) - x
