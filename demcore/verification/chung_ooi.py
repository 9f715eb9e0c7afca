"""The eight benchmark tests of Chung and Ooi 2011, Hertz-Mindlin: elastic, damped, oblique and spinning impacts.

Source: Chung and Ooi, "Benchmark tests for verifying discrete element modelling codes at particle impact
level", Granular Matter 13, 2011. Tests 5 to 8 compare rigid-body theory in gross sliding, which holds for any
stiffness; their materials are the paper's kind, the normalised numbers do not depend on them.

Notation: V_n, V_st speed of approach and tangential speed of the surfaces at the contact, primes after the
impact; mu friction; e restitution; R radius; x = V_st/(mu V_n); kappa = 3.5 mu (1 + e) V_n/V_st.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from demcore.case import Interaction, MaterialTable, Stiffness
from demcore.contact.laws import hertz_mindlin_model
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.particles import VX, VZ, WX, Floats, M, spheres
from demcore.simulation import Simulation
from demcore.time_step import hertz_time_step
from demcore.verification.impact import clamped_restitution
from demcore.verification.outcome import Outcome, share_of
from demcore.verification.single_sphere import FLOOR

SOURCE = "Chung and Ooi 2011"
# Share of the Rayleigh time: an impact takes about a thousand steps.
FINE = 0.005


class Grain(NamedTuple):
    """Young's modulus, Pa; Poisson ratio; density, kg/m3."""

    youngs: float
    poisson: float
    density: float


GLASS = Grain(48e9, 0.20, 2800.0)
LIMESTONE = Grain(20e9, 0.25, 2500.0)
AL_ALLOY = Grain(70e9, 0.30, 2699.0)
MG_ALLOY = Grain(40e9, 0.35, 1800.0)
AL_OXIDE = Grain(380e9, 0.23, 4000.0)


class Collision(NamedTuple):
    """Velocities and spins, (bodies, 3), after; force N, overlap m and duration s of the contact."""

    velocity: Floats
    spin: Floats
    force: float
    overlap: float
    duration: float


def collide(
    grain: Grain,
    contact: Interaction,
    radii: tuple[float, ...],
    velocity: Floats,
    spin: Floats,
    stiffer: float = 1.0,
    limit_force: bool = False,
) -> Collision:
    """One impact along z: of the first sphere on a plane, `stiffer` times its modulus, or on the second sphere."""
    body = Stiffness(grain.youngs, grain.poisson)
    wall = Stiffness(stiffer * grain.youngs, grain.poisson)
    gap = 1e-9
    position = np.zeros((len(radii), 3))
    position[0, 2] = radii[0] + gap
    walls: list[Wall] = [FLOOR]
    if len(radii) == 2:
        position[1, 2], walls = -radii[1], []
    s = Simulation(
        spheres(position, np.array(radii), grain.density, velocity=velocity, spin=spin),
        wall_arrays(walls),
        hertz_mindlin_model(limit_force),
        MaterialTable((wall, body), ((contact, contact), (contact, contact))),
        hertz_time_step(2 * min(radii), grain.density, grain.youngs, grain.poisson, FINE),
        gravity=np.zeros(3),
    )
    mass = _rows(s)[0, M]
    force = overlap = duration = 0.0
    before = _rows(s)[0, VZ]
    for _ in range(100_000):
        s.advance(1)
        rows = _rows(s)
        # From the plane z = 0 or from the second sphere's centre.
        centre = rows[0, :3] - (rows[1, :3] if len(rows) == 2 else [rows[0, 0], rows[0, 1], 0.0])
        depth = sum(radii) - math.sqrt(centre @ centre)
        force = max(force, abs(rows[0, VZ] - before) / s.dt * mass)
        before, overlap = rows[0, VZ], max(overlap, depth)
        duration += s.dt if depth > 0.0 else 0.0
        if duration > 0.0 and depth <= 0.0:
            break
    rows = _rows(s)
    return Collision(rows[:, VX : VZ + 1], rows[:, WX : WX + 3], force, overlap, duration)


def _rows(s: Simulation) -> Floats:
    """State in the order of the particles' names."""
    return s.particles.state[np.argsort(s.particles.number)]


def elastic_normal() -> Iterator[Outcome]:
    """Tests 1 and 2: elastic normal impact: force, overlap, contact time."""
    cases = (
        ("1: glass, two spheres", GLASS, 0.01, 10.0, 2, 10696.9, 274.1e-6, 40.35e-6),
        ("1: limestone, two spheres", LIMESTONE, 0.01, 10.0, 2, 7108.2, 368.3e-6, 54.21e-6),
        ("2: Al alloy on a plane", AL_ALLOY, 0.1, 0.2, 1, 11369.9, 49.72e-6, 731.8e-6),
        ("2: Mg alloy on a plane", MG_ALLOY, 0.1, 0.2, 1, 7232.7, 52.12e-6, 767.2e-6),
    )
    contact = Interaction(1.0, 0.0, 0.0, 0.0)
    for name, grain, radius, v, bodies, force, overlap, duration in cases:
        velocity = np.array([[0.0, 0.0, -v], [0.0, 0.0, v]])[:bodies]
        hit = collide(
            grain, contact, (radius,) * bodies, velocity, 0.0 * velocity, 1.0 if bodies == 2 else 1000.0
        )
        yield share_of(f"test {name}: force / N", SOURCE, force, hit.force, 0.01)
        yield share_of(f"test {name}: overlap / m", SOURCE, overlap, hit.overlap, 0.01)
        yield share_of(f"test {name}: contact time / s", SOURCE, duration, hit.duration, 0.01)


def damped_normal() -> Iterator[Outcome]:
    """Test 3: measured restitution equals the one asked for, from .05 (the least that demcore takes) to 1."""
    for e in (0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0):
        velocity = np.array([[0.0, 0.0, -3.9]])
        hit = collide(AL_OXIDE, Interaction(e, 0.0, 0.0, 0.0), (0.0025,), velocity, 0.0 * velocity)
        yield Outcome(f"test 3: Al oxide, e = {e:g}", SOURCE, e, hit.velocity[0, 2] / 3.9, 0.005)


# Angle from the normal, deg: tangential restitution and spin, rad/s.
TEST_4 = {5: (0.948, -19.0), 10: (0.687, -213.0), 15: (0.624, -378.0), 20: (0.616, -511.0),
          25: (0.634, -599.0), 30: (0.684, -617.0), 35: (0.737, -582.0)}  # fmt: skip


def oblique() -> Iterator[Outcome]:
    """Test 4: Al oxide at 5 to 35 degrees, through sticking into sliding; 2.5 % of each curve's largest value."""
    v, mu = 3.9, 0.092
    for degrees, (e_t, omega) in TEST_4.items():
        th = math.radians(degrees)
        velocity = v * np.array([[math.sin(th), 0.0, -math.cos(th)]])
        hit = collide(AL_OXIDE, Interaction(0.98, mu, mu, 0.0), (0.0025,), velocity, 0.0 * velocity)
        got = hit.velocity[0, 0] / velocity[0, 0]
        yield Outcome(f"test 4: {degrees} deg: e_t", SOURCE, e_t, got, 0.025 * 0.948)
        yield Outcome(f"test 4: {degrees} deg: spin / rad/s", SOURCE, omega, -hit.spin[0, 1], 0.025 * 617.0)


def sliding_normalised() -> Iterator[Outcome]:
    """Test 5: e = 1, mu = .3, any material: V'_st/(mu V'_n) = x - 7 and R w'/(mu V_n) = -5 for x >= 7."""
    mu, v, radius = 0.3, 0.2, 0.1
    for name, grain in (("Al alloy", AL_ALLOY), ("Mg alloy", MG_ALLOY)):
        for x in (7.5, 10.0, 15.0, 25.0):
            velocity = np.array([[x * mu * v, 0.0, -v]])
            hit = collide(grain, Interaction(1.0, mu, mu, 0.0), (radius,), velocity, 0.0 * velocity)
            surface = hit.velocity[0, 0] - radius * hit.spin[0, 1]
            got = surface / (mu * hit.velocity[0, 2])
            yield Outcome(f"test 5: {name}, x = {x:g}: surface speed", SOURCE, x - 7.0, got, 0.07)
            spin = -radius * hit.spin[0, 1] / (mu * v)
            yield Outcome(f"test 5: {name}, x = {x:g}: spin", SOURCE, -5.0, spin, 0.05)


def spinning_sphere() -> Iterator[Outcome]:
    """Test 6: a spinning sphere falls on a plane: beta = -V'_st/V_st = -1 + kappa while it slides.

    The force may not attract (limit_force), so kappa takes the restitution that follows from that.
    """
    mu, e, v, radius = 0.4, 0.5, 0.2, 0.1
    for kappa in (0.2, 0.5, 0.9):
        w = 3.5 * mu * (1.0 + clamped_restitution(e)) * v / (kappa * radius)
        velocity, spin = np.array([[0.0, 0.0, -v]]), np.array([[0.0, w, 0.0]])
        contact = Interaction(e, mu, mu, 0.0)
        hit = collide(AL_ALLOY, contact, (radius,), velocity, spin, limit_force=True)
        surface = hit.velocity[0, 0] - radius * hit.spin[0, 1]
        yield Outcome(f"test 6: kappa = {kappa:g}: beta", SOURCE, -1.0 + kappa, surface / (radius * w), 0.01)


def opposite_spins() -> Iterator[Outcome]:
    """Test 7: two like spheres with opposite spins have no slip: no tangential speed, the spins stay."""
    mu, e, v, radius = 0.4, 0.5, 0.2, 0.1
    for w in (0.5, 5.0, 50.0):
        velocity = np.array([[0.0, 0.0, -v], [0.0, 0.0, v]])
        # Surfaces at the contact: w x (-R z) above and -w x (R z) below, the same velocity.
        spin = np.array([[0.0, w, 0.0], [0.0, -w, 0.0]])
        hit = collide(AL_ALLOY, Interaction(e, mu, mu, 0.0), (radius,) * 2, velocity, spin)
        yield Outcome(f"test 7: w = {w:g}: tangential speed / m/s", SOURCE, 0.0, hit.velocity[0, 0], 1e-9)
        yield Outcome(f"test 7: w = {w:g}: spin / rad/s", SOURCE, w, hit.spin[0, 1], 1e-6 * w)


def unlike_spheres() -> Iterator[Outcome]:
    """Test 8: a spinning sphere hits one of another size: beta = -1 + kappa while they slide."""
    mu, e, v = 0.4, 0.5, 0.2
    radii = (0.1, 0.04)
    for kappa in (0.2, 0.5, 0.9):
        surface_before = 3.5 * mu * (1.0 + clamped_restitution(e)) * v / kappa
        velocity = np.array([[0.0, 0.0, -v], [0.0, 0.0, 0.0]])
        spin = np.array([[0.0, -surface_before / radii[0], 0.0], [0.0, 0.0, 0.0]])
        contact = Interaction(e, mu, mu, 0.0)
        hit = collide(AL_ALLOY, contact, radii, velocity, spin, limit_force=True)
        # The contact lies below the first centre and above the second: w x (-R z) and w x (R z).
        surface = (hit.velocity[0, 0] - radii[0] * hit.spin[0, 1]) - (
            hit.velocity[1, 0] + radii[1] * hit.spin[1, 1]
        )
        got = -surface / surface_before
        yield Outcome(
            f"test 8: radii 100 and 40 mm, kappa = {kappa:g}: beta", SOURCE, -1.0 + kappa, got, 0.01
        )
