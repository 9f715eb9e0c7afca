"""The block loop over pairs: against the laws one contact at a time, and against pairs that never sleep."""

from __future__ import annotations

import numpy as np
import pytest

from demcore.block import LANES
from demcore.case import Interaction, MaterialTable, Stiffness
from demcore.contact.laws import hertz_mindlin_model, paper_model
from demcore.contact.model import History, Vec3
from demcore.dormant import nobody_dormant
from demcore.forces import NEVER, slab_forces, touching_contacts
from demcore.geometry.wall_arrays import wall_arrays
from demcore.neighbours import arrange, carry, empty_neighbours, list_pairs
from demcore.particles import spheres
from demcore.simulation import Simulation
from demcore.wrench import contact_wrench, material_tables, series_stiffness, touching_pair

DT = 1e-5
ROWS = tuple(
    tuple(Interaction(0.3 + 0.05 * (i + j), 0.4 + 0.01 * i * j, 0.3, 0.1 + 0.02 * (i + j)) for j in range(3))
    for i in range(3)
)
TABLE = MaterialTable((Stiffness(1e7, 0.25), Stiffness(3e6, 0.2), Stiffness(2e7, 0.3)), ROWS)


def moving_cloud(count: int, seed: int = 1):
    """Overlapping spheres of two materials, all moving and spinning."""
    rng = np.random.default_rng(seed)
    side = round(count ** (1.0 / 3.0)) + 1
    lattice = np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 3)[:count]
    return spheres(
        lattice * 0.019 + rng.uniform(-0.0005, 0.0005, (count, 3)),
        rng.uniform(0.0085, 0.0105, count),
        1000.0,
        rng.integers(1, 3, count).astype(np.int32),
        rng.normal(0.0, 0.1, (count, 3)),
        rng.normal(0.0, 5.0, (count, 3)),
    )


def one_at_a_time(model, particles, tables, steps):
    """Forces (N, 6) after `steps` steps at standstill, contact by contact with the scalar laws."""
    state, count = particles.state, len(particles.number)
    force = np.zeros((count, 6))
    zero = Vec3(0.0, 0.0, 0.0)
    for i in range(count):
        for j in range(i + 1, count):
            arm = state[i, :3] - state[j, :3]
            d = np.sqrt((arm**2).sum())
            reach = state[i, 3] + state[j, 3]
            if d >= reach:
                continue
            n, s = arm / d, reach - d
            arm_i, arm_j = state[i, 3] - s / 2, state[j, 3] - s / 2
            v = state[i, 4:7] - state[j, 4:7]
            v = v - np.cross(arm_i * state[i, 8:11] + arm_j * state[j, 8:11], n)
            a, b = particles.material[i], particles.material[j]
            mass = state[i, 7] * state[j, 7] / (state[i, 7] + state[j, 7])
            stiffness = series_stiffness(tables.youngs[a], tables.youngs[b], 2 * state[i, 3], 2 * state[j, 3])
            pair = touching_pair(tables.pair, a, b, stiffness, mass, state[i, 3] * state[j, 3] / reach)
            history = History(0.0, 0.0, 0.0, 0.0, zero, zero)
            total = np.zeros(9)
            for _ in range(steps):
                spin = Vec3(*(state[i, 8:11] - state[j, 8:11]))
                wrench = contact_wrench(model, pair, s, Vec3(*n), Vec3(*v), spin, history, DT)
                history = wrench.history
                total += np.array([*wrench.force, *wrench.tangential, *wrench.couple])
            turn = np.cross(n, total[3:6])
            force[i] += np.array([*total[:3], *(total[6:] - arm_i * turn)])
            force[j] -= np.array([*total[:3], *(total[6:] + arm_j * turn)])
    return force


@pytest.mark.parametrize("model", [paper_model(), hertz_mindlin_model()], ids=["paper", "hertz"])
def test_blocks_give_the_sum_of_the_laws_one_contact_at_a_time(model):
    tables = material_tables(*TABLE.arrays())
    bed = moving_cloud(150)
    arranged = arrange(bed, 0.002, DT)
    particles, nobody = arranged.particles, nobody_dormant(150)
    lists = list_pairs(arranged, carry(empty_neighbours(150)), nobody.state, tables)
    assert lists.used.sum() > 3 * LANES
    for _ in range(3):
        for slab in range(len(lists.used)):
            slab_forces(slab, particles, lists, nobody, model, tables, DT)
    expected = one_at_a_time(model, particles, tables, 3)
    scale = np.abs(expected).max(axis=0)
    assert np.abs(particles.force / scale - expected / scale).max() < 1e-12


def run(awake: bool, steps: int) -> Simulation:
    simulation = Simulation(moving_cloud(600), wall_arrays([]), paper_model(), TABLE, DT)
    for _ in range(steps):
        simulation.advance(1)
        if awake:
            wake = simulation.neighbours.wake
            wake[wake < NEVER] = -1.0
    return simulation


def test_a_sleeping_pair_misses_no_contact():
    steps = 400
    asleep, awake = run(False, steps), run(True, steps)
    assert asleep.particles.state.tobytes() == awake.particles.state.tobytes()
    assert asleep.searches > 3
    # Pairs did sleep, and contacts did begin between searches.
    assert (asleep.neighbours.wake > asleep.neighbours.way.max()).mean() > 0.1
    assert (asleep.neighbours.wake == NEVER).any()


def test_reading_the_contacts_leaves_open_ones_out():
    simulation = run(False, 200)
    owner, partner, history = touching_contacts(simulation.neighbours)
    state = simulation.particles.state
    assert 0 < len(owner) < simulation.neighbours.used.sum()
    # The stored overlap is that of the positions before the last move.
    before = state[:, :3] - state[:, 4:7] * DT
    d = np.sqrt(((before[owner] - before[partner]) ** 2).sum(axis=1))
    assert history[:, 1] == pytest.approx(state[owner, 3] + state[partner, 3] - d, abs=1e-12)
