"""Normal impacts of the hysteretic spring: rebound, overlap, force and times, against a wall and in pairs.

Notation: v speed of approach, m/s; e restitution; w = sqrt(m*/K_l), s; lam the floor of the unloading branch.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from demcore.case import Interaction, Stiffness, uniform_table
from demcore.contact.laws import hertz_mindlin_model, paper_model
from demcore.contact.model import ContactModel
from demcore.contact.velocity_hysteretic_spring import VelocityHystereticSpring
from demcore.geometry.wall_arrays import wall_arrays
from demcore.particles import VX, VZ, M, R, X, Z, spheres
from demcore.simulation import Simulation
from demcore.time_step import hertz_time_step, time_step
from demcore.verification.outcome import SECTION_1, SECTION_3, Outcome, share_of
from demcore.verification.single_sphere import (
    DENSITY,
    FLOOR,
    POISSON,
    YOUNGS,
    G,
    single,
    sphere_mass,
    state,
)

# An odd direction, so that a mistake in one component of the normal shows.
SLANTED = np.array([1.0, 2.0, 2.0]) / 3.0
RESTITUTIONS = (0.1, 0.2, 0.5, 0.9, 1.0)


class Impact(NamedTuple):
    """What one impact did. Times in s from the first touch: largest overlap, end of unloading, opening."""

    rebound: float
    deepest: float
    force: float
    loaded: float
    unloaded: float
    residual: float
    opened: float


def wall_impact(radius: float, v: float, e: float, model: ContactModel, dt: float) -> Simulation:
    """A sphere that touches the floor within its first step, at v m/s."""
    contact = Interaction(e, 0.0, 0.0, 0.0)
    s = single(contact, [FLOOR], (0.0, 0.0, radius), (0.0, 0.0, -v), radius=radius, model=model)
    s.dt = dt
    return s


def pair_impact(radii: tuple[float, float], v: float, e: float, model: ContactModel, dt: float) -> Simulation:
    """Two spheres, the heavier one slower, that touch within the first step at v m/s; centre of mass at rest."""
    mass = np.array([sphere_mass(r) for r in radii])
    speed = v * mass[::-1] / mass.sum()
    position = np.array([[0.0, 0.0, 0.0], sum(radii) * SLANTED])
    velocity = np.array([speed[0] * SLANTED, -speed[1] * SLANTED])
    return Simulation(
        spheres(position, np.array(radii), DENSITY, velocity=velocity),
        wall_arrays([]),
        model,
        uniform_table(Stiffness(YOUNGS, POISSON), Interaction(e, 0.0, 0.0, 0.0)),
        dt,
        gravity=np.zeros(3),
    )


def approach(s: Simulation) -> tuple[float, float, float]:
    """Overlap (m), speed of approach (m/s) and effective mass (kg) of the two bodies of an impact."""
    rows = s.particles.state[np.argsort(s.particles.number)]
    if len(rows) == 1:
        return float(rows[0, R] - rows[0, Z]), float(-rows[0, VZ]), float(rows[0, M])
    away = rows[1, X : Z + 1] - rows[0, X : Z + 1]
    distance = float(np.sqrt(away @ away))
    speed = float((rows[0, VX : VZ + 1] - rows[1, VX : VZ + 1]) @ away) / distance
    mass = float(rows[0, M] * rows[1, M] / (rows[0, M] + rows[1, M]))
    return float(rows[0, R] + rows[1, R]) - distance, speed, mass


def follow(s: Simulation, v: float, floor_share: float = 0.0) -> Impact:
    """Step through an impact. Unloading ends where the force falls below `floor_share` of the largest.

    The force is read from the change of speed, as an observer outside the code would.
    """
    deepest = loaded = force = unloaded = residual = speed = 0.0
    before = v
    for _ in range(200_000):
        s.advance(1)
        overlap, speed, mass = approach(s)
        now = (before - speed) * mass / s.dt
        if overlap > deepest:
            deepest, loaded = overlap, s.time
        elif unloaded == 0.0 and now <= floor_share * force:
            unloaded, residual = s.time, overlap
        force, before = max(force, now), speed
        if overlap <= 0.0:
            break
    # An elastic contact unloads until it opens.
    unloaded = unloaded or s.time
    return Impact(-speed / v, deepest, force, loaded, unloaded, residual, s.time)


def normal_impact() -> Iterator[Outcome]:
    """Rebound, overlap, force and times of the hysteretic spring on a wall and between two spheres."""
    radius, v, residual = 0.01, 1.0, paper_model().normal.residual
    for e in RESTITUTIONS:
        # K_l = E L / 2 on a wall, which takes the particle's size, and between two equal spheres.
        for body, mass in (("wall", sphere_mass(radius)), ("pair", sphere_mass(radius) / 2.0)):
            w = math.sqrt(mass / (YOUNGS * radius))
            dt = time_step(2.0 * radius, DENSITY, YOUNGS, e, "paper")
            rebound = math.sqrt(e * e + residual * (1 - e * e) ** 2)
            coarse = _impact(body, radius, v, e, dt)
            name = f"hysteretic impact on a {body}, e = {e:g}"
            yield Outcome(f"{name}: rebound at the paper's step", SECTION_3, rebound, coarse.rebound, 0.003)
            fine = _impact(body, radius, v, e, dt / 20.0)
            yield share_of(f"{name}: largest overlap / m", SECTION_3, v * w, fine.deepest, 0.005)
            yield share_of(f"{name}: largest force / N", SECTION_3, v * mass / w, fine.force, 0.005)
            yield share_of(f"{name}: loading time / s", SECTION_3, math.pi / 2 * w, fine.loaded, 0.01)
            unloading = fine.unloaded - fine.loaded
            yield share_of(f"{name}: unloading time / s", SECTION_3, e * math.pi / 2 * w, unloading, 0.02)
            left = (1 - e * e) * v * w
            yield Outcome(f"{name}: residual overlap / m", SECTION_3, left, fine.residual, 0.01 * v * w)


def _impact(body: str, radius: float, v: float, e: float, dt: float) -> Impact:
    model = paper_model()
    if body == "wall":
        return follow(wall_impact(radius, v, e, model, dt), v, 2.0 * model.normal.residual)
    return follow(pair_impact((radius, radius), v, e, model, dt), v, 2.0 * model.normal.residual)


def restitution_by_speed() -> Iterator[Outcome]:
    """Rebound of the spring whose restitution falls with the speed: e (v / 1 m/s)^-p, at most 1."""
    e, exponent, radius = 0.5, 0.25, 0.01
    model = paper_model()
    kept = model.normal.residual
    model = model._replace(normal=VelocityHystereticSpring(exponent=exponent))
    dt = time_step(2.0 * radius, DENSITY, YOUNGS, 0.3, "paper") / 20.0
    for v in (0.03, 0.2, 1.0, 5.0):
        expected = min(e * v**-exponent, 1.0)
        rebound = math.sqrt(expected**2 + kept * (1.0 - expected**2) ** 2)
        for body, impact in (
            ("wall", wall_impact(radius, v, e, model, dt)),
            ("pair", pair_impact((radius, radius), v, e, model, dt)),
        ):
            name = f"hysteretic impact on a {body} at {v:g} m/s, e(v) = .5 v^-.25: rebound"
            yield Outcome(
                name, "velocity_hysteretic_spring.py", rebound, follow(impact, v, 2.0 * kept).rebound, 0.005
            )


def unlike_pair() -> Iterator[Outcome]:
    """Two spheres of unlike size: stiffness in series, effective mass; both families."""
    radii, v, e = (0.004, 0.01), 1.0, 0.5
    mass = math.prod(sphere_mass(r) for r in radii) / sum(sphere_mass(r) for r in radii)
    stiffness = YOUNGS * 2.0 * radii[0] * radii[1] / sum(radii)
    dt = time_step(2.0 * radii[0], DENSITY, YOUNGS, e, "paper") / 20.0
    hit = follow(pair_impact(radii, v, e, paper_model(), dt), v)
    w = math.sqrt(mass / stiffness)
    yield share_of("hysteretic impact, radii 4 and 10 mm: overlap / m", SECTION_3, v * w, hit.deepest, 0.005)
    yield Outcome("hysteretic impact, radii 4 and 10 mm: rebound", SECTION_3, 0.5, hit.rebound, 0.003)
    elastic = follow(pair_impact(radii, v, 1.0, hertz_mindlin_model(), dt / 4.0), v)
    youngs, radius = YOUNGS / (2.0 * (1.0 - POISSON**2)), radii[0] * radii[1] / sum(radii)
    # Energy: 1/2 m v^2 = 8/15 E sqrt(R) s^(5/2).
    deepest = (15.0 / 16.0 * mass * v * v / (youngs * math.sqrt(radius))) ** 0.4
    yield share_of(
        "Hertz impact, radii 4 and 10 mm: overlap / m", "Hertz 1882", deepest, elastic.deepest, 0.005
    )
    force = 4.0 / 3.0 * youngs * math.sqrt(radius) * deepest**1.5
    yield share_of("Hertz impact, radii 4 and 10 mm: force / N", "Hertz 1882", force, elastic.force, 0.005)
    half = elastic.opened / 2.0
    yield share_of("Hertz impact, e = 1: unloads as it loads / s", "Hertz 1882", half, elastic.loaded, 0.01)


def clamped_restitution(e: float) -> float:
    """Restitution when the damped Hertz force may not attract. Source: Schwager and Poeschel 2007, eq. 21, for the
    linear dashpot; Tsuji's damping makes Hertz the same oscillator in u = s^(5/4).
    """
    log_e = math.log(e)
    b = -log_e / math.sqrt(log_e * log_e + math.pi * math.pi)
    w = math.sqrt(1.0 - b * b)
    return math.exp(-b / w * math.atan2(2.0 * b * w, b * b - w * w))


def hertz_clamped() -> Iterator[Outcome]:
    """With `limit_force` a rebound is faster than the restitution asked for, by a known amount."""
    for e in (0.24, 0.5, 0.9):
        dt = hertz_time_step(0.02, DENSITY, YOUNGS, POISSON, 0.002)
        hit = follow(wall_impact(0.01, 1.0, e, hertz_mindlin_model(limit_force=True), dt), 1.0)
        yield Outcome(
            f"Hertz impact that never attracts, e = {e:g}: rebound",
            "Schwager and Poeschel 2007",
            clamped_restitution(e),
            hit.rebound,
            0.003,
        )


def bounce_heights() -> Iterator[Outcome]:
    """A dropped sphere: h_k = R + e^(2k) (h0 - R)."""
    radius, e, h0 = 0.01, 0.8, 0.2
    s = single(
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
        z, vz = state(s, Z), state(s, VZ)
        if vz > 0.0:
            highest, rising = max(highest, z), True
        elif rising:
            heights.append(highest)
            highest, rising = 0.0, False
    for k, height in enumerate(heights, start=1):
        expected = radius + e ** (2 * k) * (h0 - radius)
        yield share_of(f"bounce height {k} / m", SECTION_3, expected, height, 0.01)


def damping_spares_impacts() -> Iterator[Outcome]:
    """The long-term damping must not alter the restitution of a single impact."""
    for e in (0.05, 0.24, 0.9):
        dt = time_step(0.02, DENSITY, YOUNGS, e, "paper")
        speeds = [follow(wall_impact(0.01, 1.0, e, paper_model(z), dt), 1.0).rebound for z in (0.0, 0.5)]
        yield Outcome(f"aged damping leaves an impact alone, e = {e:g}", SECTION_1, speeds[0], speeds[1], 0.0)
