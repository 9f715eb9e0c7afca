"""Closed forms against the core: each case runs the real kernels and says what it expected, from which source.

`python -m demcore verify` prints the table; tests/verification runs the same cases. Expected values come from
physics.md section 3 (closed forms named there) or from Chung and Ooi 2011.

Notation: v speed m/s, w angular velocity rad/s, e restitution, mu friction, mu_r rolling resistance, R radius,
th angle of an incline or of incidence from the normal.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from demcore.case import Interaction, Stiffness, uniform_table
from demcore.contact.laws import hertz_mindlin_model, paper_model
from demcore.contact.model import ContactModel
from demcore.geometry.walls import Wall
from demcore.particles import spheres
from demcore.simulation import Simulation, wall_arrays
from demcore.time_step import hertz_time_step, time_step

E, NU, DENSITY = 1e7, 0.25, 2500.0
G = 9.81
SECTION_3 = "physics.md section 3"
CHUNG_OOI = "Chung and Ooi 2011"


@dataclass(frozen=True)
class Outcome:
    """One line of the table: passed when |got - expected| <= tolerance."""

    name: str
    source: str
    expected: float
    got: float
    tolerance: float

    @property
    def passed(self) -> bool:
        return bool(abs(self.got - self.expected) <= self.tolerance)


def _single(
    contact: Interaction,
    walls: list[Wall],
    position: tuple[float, float, float],
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    radius: float = 0.01,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    model: ContactModel | None = None,
    finer: float = 1.0,
    youngs: float = E,
) -> Simulation:
    """One sphere of the standard density and its walls, at the paper's time step divided by `finer`."""
    bed = spheres(
        np.array([position]),
        np.array([radius]),
        DENSITY,
        velocity=np.array([velocity]),
        spin=np.array([spin]),
    )
    dt = time_step(2.0 * radius, DENSITY, youngs, contact.restitution, "paper") / finer
    return Simulation(
        bed,
        wall_arrays(walls),
        model or paper_model(),
        uniform_table(Stiffness(youngs, NU), contact),
        dt,
        gravity=np.array(gravity),
    )


def _state(s: Simulation, column: int) -> float:
    return float(s.particles.state[0, column])


FLOOR = Wall("plane")


def normal_impact() -> Iterator[Outcome]:
    """Rebound, largest overlap and loading time of the hysteretic spring on a wall."""
    radius, v, residual = 0.01, 1.0, 0.001
    for e in (0.1, 0.2, 0.5, 0.9, 1.0):
        contact = Interaction(e, 0.0, 0.0, 0.0)
        s = _single(contact, [FLOOR], (0.0, 0.0, radius * 1.0001), (0.0, 0.0, -v), radius=radius)
        deepest, loaded_at = 0.0, 0.0
        for _ in range(400):
            s.advance(1)
            overlap = radius - _state(s, 2)
            if overlap > deepest:
                deepest, loaded_at = overlap, s.time
        w = math.sqrt(DENSITY * 4 / 3 * math.pi * radius**3 / (E * radius))
        rebound = math.sqrt(e * e + residual * (1 - e * e) ** 2)
        yield Outcome(f"normal impact, e = {e:g}: rebound", SECTION_3, rebound, _state(s, 6) / v, 0.003)
        yield Outcome(
            f"normal impact, e = {e:g}: largest overlap / m", SECTION_3, v * w, deepest, 0.01 * v * w
        )
        loading = math.pi / 2 * w + 1e-4 * radius / v
        yield Outcome(
            f"normal impact, e = {e:g}: loading time / s", SECTION_3, loading, loaded_at, 1.5 * s.dt
        )


def bounce_heights() -> Iterator[Outcome]:
    """A dropped sphere: h_k = R + e^(2k) (h0 - R)."""
    radius, e, h0 = 0.01, 0.8, 0.2
    s = _single(
        Interaction(e, 0.0, 0.0, 0.0),
        [FLOOR],
        (0.0, 0.0, h0),
        radius=radius,
        gravity=(0.0, 0.0, -G),
        finer=2.0,
    )
    heights: list[float] = []
    highest, rising = 0.0, False
    while len(heights) < 3:
        s.advance(5)
        z, vz = _state(s, 2), _state(s, 6)
        if vz > 0.0:
            highest, rising = max(highest, z), True
        elif rising:
            heights.append(highest)
            highest, rising = 0.0, False
    for k, height in enumerate(heights, start=1):
        expected = radius + e ** (2 * k) * (h0 - radius)
        yield Outcome(f"bounce height {k} / m", SECTION_3, expected, height, 0.01 * expected)


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
        s = _single(contact, [FLOOR], start, (vt, 0.0, -vn), radius=radius, finer=4.0, youngs=1e10)
        s.advance(1200)
        yield Outcome(f"gross sliding, {degrees} deg: e_t", SECTION_3, e_t, _state(s, 4) / vt, 0.004)
        # Sliding along +x turns the sphere about +y; the table counts the spin the other way round.
        yield Outcome(
            f"gross sliding, {degrees} deg: spin / rad/s", SECTION_3, omega, -_state(s, 9), 0.01 * abs(omega)
        )


def _on_floor(
    contact: Interaction,
    radius: float,
    th: float = 0.0,
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Simulation:
    """A sphere at its resting overlap on a plane; gravity is turned by `th` instead of the plane."""
    load = DENSITY * 4 / 3 * math.pi * radius**3 * G * math.cos(th)
    overlap = load / (E * radius)
    gravity = (G * math.sin(th), 0.0, -G * math.cos(th))
    return _single(
        contact, [FLOOR], (0.0, 0.0, radius - overlap), velocity, spin, radius=radius, gravity=gravity
    )


def sliding_to_rolling() -> Iterator[Outcome]:
    """A sphere set sliding at v0 rolls from t* = 2 v0/(7 mu g) on with 5/7 v0."""
    mu, v0, radius = 0.3, 1.0, 0.02
    s = _on_floor(Interaction(0.5, mu, mu, 0.0), radius, velocity=(v0, 0.0, 0.0))
    expected = 2.0 * v0 / (7.0 * mu * G)
    while s.time < 3 * expected and _state(s, 4) - _state(s, 9) * radius > 1e-3 * v0:
        s.advance(20)
    yield Outcome("sliding sphere starts to roll: t* / s", SECTION_3, expected, s.time, 0.03 * expected)
    s.advance(int(0.1 / s.dt))
    yield Outcome("sliding sphere starts to roll: v_f / m/s", SECTION_3, 5 / 7 * v0, _state(s, 4), 0.01 * v0)


def rolling_decay() -> Iterator[Outcome]:
    """Pure rolling slows with a = (5/7) mu_r g."""
    radius, v0 = 0.02, 1.0
    for mu_r in (0.02, 0.05, 0.10):
        s = _on_floor(
            Interaction(0.5, 0.5, 0.5, mu_r), radius, velocity=(v0, 0.0, 0.0), spin=(0.0, v0 / radius, 0.0)
        )
        s.advance(int(0.05 / s.dt))
        v, t = _state(s, 4), s.time
        s.advance(int(0.5 / s.dt))
        expected = 5 / 7 * mu_r * G
        got = (v - _state(s, 4)) / (s.time - t)
        yield Outcome(f"rolling decay, mu_r = {mu_r:g} / m/s2", SECTION_3, expected, got, 0.01 * expected)


def rolling_incline() -> Iterator[Outcome]:
    """Rolling down 20 degrees: a = (5/7) g (sin th - mu_r cos th)."""
    radius, th = 0.02, math.radians(20.0)
    for mu_r, expected in ((0.0, 2.3966), (0.1, 1.7381), (0.3, 0.4212)):
        s = _on_floor(Interaction(0.5, 0.8, 0.8, mu_r), radius, th)
        s.advance(int(0.1 / s.dt))
        v, t = _state(s, 4), s.time
        s.advance(int(0.4 / s.dt))
        got = (_state(s, 4) - v) / (s.time - t)
        yield Outcome(
            f"rolling down 20 deg, mu_r = {mu_r:g} / m/s2", SECTION_3, expected, got, 0.01 * expected
        )


def rolling_threshold() -> Iterator[Outcome]:
    """mu_r = .35 holds at 19 degrees (creep under 1e-3 R in 5 s) and lets go at 20 (tan 20 deg = .364)."""
    radius = 0.02
    for degrees, stays in ((19.0, 1.0), (20.0, 0.0)):
        s = _on_floor(Interaction(0.5, 0.8, 0.8, 0.35), radius, math.radians(degrees))
        # The couple has to wind up first; its ringing is over after a second.
        s.advance(int(1.0 / s.dt))
        x = _state(s, 0)
        s.advance(int(5.0 / s.dt))
        held = 1.0 if _state(s, 0) - x < 1e-3 * radius else 0.0
        yield Outcome(f"type 3 threshold, mu_r = .35, {degrees:g} deg: holds", SECTION_3, stays, held, 0.0)


def belt_drop() -> Iterator[Outcome]:
    """A free sphere on a belt at v ends at 2/7 v, spinning backwards, when mu_r = 0."""
    radius, v = 0.02, 1.79
    belt = Wall("plane", surface_velocity=(v, 0.0, 0.0))
    load = DENSITY * 4 / 3 * math.pi * radius**3 * G
    s = _single(
        Interaction(0.2, 0.5, 0.45, 0.0),
        [belt],
        (0.0, 0.0, radius - load / (E * radius)),
        radius=radius,
        gravity=(0.0, 0.0, -G),
    )
    s.advance(int(1.0 / s.dt))
    yield Outcome("sphere on a belt: speed / m/s", SECTION_3, 2 / 7 * v, _state(s, 4), 0.01 * v)
    yield Outcome(
        "sphere on a belt: spin / rad/s", SECTION_3, -5 / 7 * v / radius, _state(s, 9), 0.01 * v / radius
    )


def damping_spares_impacts() -> Iterator[Outcome]:
    """The long-term damping must not alter the restitution of a single impact."""
    contact = Interaction(0.24, 0.0, 0.0, 0.0)
    speeds = []
    for damping in (0.0, 0.5):
        s = _single(contact, [FLOOR], (0.0, 0.0, 0.010001), (0.0, 0.0, -1.0), model=paper_model(damping))
        s.advance(400)
        speeds.append(_state(s, 6))
    yield Outcome(
        "aged damping leaves one impact alone / m/s", "physics.md section 1", speeds[0], speeds[1], 0.0
    )


def chung_ooi_normal() -> Iterator[Outcome]:
    """Tests 1 and 2 of Chung and Ooi: elastic normal impact, Hertz: force, overlap, contact time."""
    cases = (
        ("glass, two spheres", 48e9, 0.20, 2800.0, 0.01, 10.0, True, 10696.9, 274.1e-6, 40.35e-6),
        ("limestone, two spheres", 20e9, 0.25, 2500.0, 0.01, 10.0, True, 7108.2, 368.3e-6, 54.21e-6),
        ("Al alloy on a plane", 70e9, 0.30, 2699.0, 0.1, 0.2, False, 11369.9, 49.72e-6, 731.8e-6),
        ("Mg alloy on a plane", 40e9, 0.35, 1800.0, 0.1, 0.2, False, 7232.7, 52.12e-6, 767.2e-6),
    )
    for name, youngs, nu, density, radius, v, twin, force, overlap, duration in cases:
        grain = Stiffness(youngs, nu)
        table = uniform_table(grain, Interaction(1.0, 0.0, 0.0, 0.0))
        if not twin:
            table = type(table)((Stiffness(1000.0 * youngs, nu), grain), table.interaction)
        dt = hertz_time_step(2 * radius, density, youngs, nu, 0.002)
        gap = 1e-9
        if twin:
            position = np.array([[-radius - gap / 2, 0, 0], [radius + gap / 2, 0, 0]])
            velocity = np.array([[v, 0, 0], [-v, 0, 0]])
            walls: list[Wall] = []
        else:
            position, velocity = np.array([[0, 0, radius + gap]]), np.array([[0, 0, -v]])
            walls = [FLOOR]
        bed = spheres(position, np.full(len(position), radius), density, velocity=velocity)
        s = Simulation(bed, wall_arrays(walls), hertz_mindlin_model(), table, dt, gravity=np.zeros(3))
        mass = float(bed.state[0, 7])
        deepest = pull = touching = 0.0
        column = 4 if twin else 6
        before = _state(s, column)
        for _ in range(20000):
            s.advance(1)
            state = s.particles.state
            s_now = 2 * radius - abs(state[1, 0] - state[0, 0]) if twin else radius - state[0, 2]
            now = _state(s, column)
            deepest, pull = max(deepest, s_now), max(pull, abs(now - before) / dt * mass)
            touching += dt if s_now > 0 else 0.0
            before = now
            if touching and s_now <= 0:
                break
        yield Outcome(f"{name}: force / N", CHUNG_OOI, force, pull, 0.01 * force)
        yield Outcome(f"{name}: overlap / m", CHUNG_OOI, overlap, deepest, 0.01 * overlap)
        yield Outcome(f"{name}: contact time / s", CHUNG_OOI, duration, touching, 0.01 * duration)


CASES: tuple[Callable[[], Iterator[Outcome]], ...] = (
    normal_impact,
    bounce_heights,
    gross_sliding,
    sliding_to_rolling,
    rolling_decay,
    rolling_incline,
    rolling_threshold,
    belt_drop,
    damping_spares_impacts,
    chung_ooi_normal,
)
