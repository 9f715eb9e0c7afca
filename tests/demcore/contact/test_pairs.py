"""Composed contact models through the real pair kernel: two particles of unlike size and material."""

from __future__ import annotations

import math

import numpy as np
import pytest

from demcore.case import Interaction, MaterialTable, Stiffness
from demcore.geometry.wall_arrays import wall_arrays
from demcore.particles import spheres
from demcore.simulation import Simulation
from tests.demcore.contact.registered import across, composed_models, generator, unit

MODELS = composed_models()
RADII = np.array([0.012, 0.005])
each_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)


def table():
    """Steel and two unlike grains; every pair of them touches in its own way."""
    a, b, c = (
        Interaction(e, mu, 0.9 * mu, mu_r)
        for e, mu, mu_r in ((0.9, 0.5, 0.1), (0.5, 0.3, 0.2), (0.7, 0.8, 0.3))
    )
    stiffness = (Stiffness(2e7, 0.3), Stiffness(1e7, 0.25), Stiffness(3e7, 0.2))
    return MaterialTable(stiffness, ((a, a, b), (a, b, c), (b, c, a)))


def pairs(model, position, velocity, spin, radius=RADII, dt=2e-6):
    """Any number of pairs: rows 2k and 2k + 1 are one, of materials 1 and 2."""
    count = len(position)
    return Simulation(
        spheres(
            position,
            np.resize(radius, count),
            np.resize([2500.0, 4000.0], count),
            np.resize([1, 2], count).astype(np.int32),
            velocity,
            spin,
        ),
        wall_arrays([]),
        model,
        table(),
        dt,
        gravity=np.zeros(3),
    )


def rows(s):
    return s.particles.state[np.argsort(s.particles.number)]


def one_pair(rng, gap):
    """Two spheres `gap` apart (m; negative: overlapping), approaching obliquely, both spinning."""
    n = unit(rng)
    position = np.array([[0.3, -0.2, 0.1], [0.3, -0.2, 0.1] + (RADII.sum() + gap) * n])
    velocity = np.array([0.5 * n + across(n, rng, 0.5), -0.5 * n + across(n, rng, 0.5)])
    return position, velocity, rng.normal(0.0, 50.0, (2, 3))


def momenta(state):
    mass = state[:, 7:8]
    spin = state[:, 11:12] * state[:, 8:11]
    return (mass * state[:, 4:7]).sum(axis=0), (mass * np.cross(state[:, :3], state[:, 4:7]) + spin).sum(
        axis=0
    )


@each_model
def test_forces_are_opposite_and_torques_agree_about_both_centres(model):
    # Newton's third law: neither momentum nor angular momentum of the pair changes, step by step.
    for seed in range(5):
        s = pairs(model, *one_pair(generator(seed), -1e-5))
        linear, angular = momenta(rows(s))
        start = rows(s).copy()
        for _ in range(200):
            s.advance(1)
            linear_now, angular_now = momenta(rows(s))
            assert np.abs(linear_now - linear).max() < 1e-14
            assert np.abs(angular_now - angular).max() < 1e-15
        changed = np.abs(rows(s) - start)
        assert changed[:, 4:7].max() > 1e-3
        assert changed[:, 8:11].max() > 1e-2


@each_model
def test_the_order_of_the_two_does_not_matter(model):
    position, velocity, spin = one_pair(generator(1), -1e-5)
    plain = pairs(model, position, velocity, spin)
    other = pairs(model, position, velocity, spin)
    p = other.particles
    other.particles = p._replace(
        state=p.state[::-1].copy(),
        material=p.material[::-1].copy(),
        number=p.number[::-1].copy(),
    )
    for s in (plain, other):
        s.advance(300)
    assert np.abs(rows(plain) - rows(other)).max() < 1e-9


@each_model
def test_a_pair_turns_with_its_frame(model):
    rng = generator(2)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    given = one_pair(rng, -1e-5)
    plain, other = pairs(model, *given), pairs(model, *(a @ turn.T for a in given))
    for s in (plain, other):
        s.advance(300)
    for c in (0, 4, 8):
        assert np.abs(rows(plain)[:, c : c + 3] @ turn.T - rows(other)[:, c : c + 3]).max() < 1e-8


@each_model
def test_bodies_apart_feel_nothing(model):
    position, velocity, spin = one_pair(generator(3), 1e-6)
    s = pairs(model, position, -velocity, spin)
    s.advance(500)
    assert rows(s)[:, 4:7].tobytes() == (-velocity).tobytes()
    assert rows(s)[:, 8:11].tobytes() == spin.tobytes()


@each_model
def test_a_contact_that_opened_is_forgotten(model):
    position, velocity, spin = one_pair(generator(4), 1e-6)
    # Fast enough that no cohesion holds them together.
    s = pairs(model, position, 4.0 * velocity, spin)
    start = rows(s).copy()
    for _ in range(60):
        s.advance(100)
        if apart(rows(s))[0] > 1e-4:
            break
    first = rows(s).copy()
    assert apart(first)[0] > 0.0
    assert np.abs(first[:, 8:11] - spin).max() > 1.0
    taken = s.step
    s.particles.state[np.argsort(s.particles.number)] = start
    s.stale = True
    s.advance(taken)
    assert rows(s).tobytes() == first.tobytes()


def apart(state):
    """Gap of each pair, m."""
    between = state[1::2, :3] - state[::2, :3]
    return np.sqrt((between**2).sum(axis=1)) - state[1::2, 3] - state[::2, 3]


def energies(state):
    """Kinetic energy of each pair, J."""
    each = 0.5 * (
        state[:, 7] * (state[:, 4:7] ** 2).sum(axis=1) + state[:, 11] * (state[:, 8:11] ** 2).sum(axis=1)
    )
    return each[::2] + each[1::2]


@each_model
def test_no_impact_gains_energy(model):
    rng = generator(5)
    made = [one_pair(rng, 1e-6) for _ in range(60)]
    # A metre between pairs.
    position = np.concatenate([p + np.array([float(k), 0.0, 0.0]) for k, (p, _, _) in enumerate(made)])
    velocity, spin = (np.concatenate([m[c] for m in made]) for c in (1, 2))
    s = pairs(model, position, velocity, spin)
    before = energies(rows(s))
    s.advance(4000)
    after = energies(rows(s))
    assert (after <= before * (1.0 + 1e-6)).all()
    # An impact with e = .7 and friction takes a good part of what is not common to both.
    assert after.sum() < 0.95 * before.sum()
    if not any(word in type(model.cohesion).__name__ for word in ("Cohesion", "Bridge")):
        assert (apart(rows(s)) > 0.0).all()


@each_model
def test_friction_never_passes_coulomb_in_the_kernel(model):
    position, velocity, spin = one_pair(generator(6), -1e-5)
    s = pairs(model, position, velocity, spin)
    mass = rows(s)[0, 7]
    pull = model.cohesion
    slid = 0
    for _ in range(300):
        before = rows(s).copy()
        s.advance(1)
        after = rows(s)
        n = before[0, :3] - before[1, :3]
        n /= math.sqrt(n @ n)
        force = mass * (after[0, 4:7] - before[0, 4:7]) / s.dt
        along = force @ n
        across_n = force - along * n
        # What presses is the sum and the attraction; an upper bound of the attraction will do here.
        pressing = along + (0.0 if type(pull).__name__ == "Dry" else 5.0)
        if apart(before)[0] < 0.0 and pressing > 0.0:
            assert math.sqrt(across_n @ across_n) <= 0.8 * pressing * (1.0 + 1e-6) + 1e-6
            slid += math.sqrt(across_n @ across_n) > 0.7 * pressing
    if type(pull).__name__ == "Dry":
        assert slid > 0
