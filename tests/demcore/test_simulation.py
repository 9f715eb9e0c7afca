"""Many particles: conservation, dissipation, weight, and the same bits however a run is cut up."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from demcore.case import Interaction
from demcore.contact.laws import hertz_mindlin_model, paper_model
from demcore.errors import BlowUp
from demcore.geometry.walls import Wall
from demcore.insertion import fill_cylinder
from tests.demcore.builders import bed, by_number

MODELS = {"paper": paper_model(), "hertz": hertz_mindlin_model()}


def same_bits(a, b):
    return by_number(a).tobytes() == by_number(b).tobytes()


@pytest.mark.parametrize("model", MODELS)
def test_free_collisions_keep_momentum_and_lose_energy(model):
    # physics.md section 3: momentum kept to 1e-12; energy never grows (frictional and inelastic)
    s = bed(
        150, contact=Interaction(0.6, 0.5, 0.45, 0.2), model=MODELS[model], walls=[], gravity=(0.0, 0.0, 0.0)
    )
    rng = np.random.default_rng(2)
    s.particles.state[:, 4:7] = rng.normal(size=(150, 3))
    mass = s.particles.state[:, 7:8]
    before = (mass * s.particles.state[:, 4:7]).sum(axis=0)
    scale = (mass * np.abs(s.particles.state[:, 4:7])).sum()
    angular_before = angular_momentum(s)
    energies = [s.kinetic_energy]
    for _ in range(20):
        s.advance(100)
        energies.append(s.kinetic_energy)
    after = (s.particles.state[:, 7:8] * s.particles.state[:, 4:7]).sum(axis=0)
    assert np.abs(after - before).max() < 1e-12 * scale
    assert np.abs(angular_momentum(s) - angular_before).max() < 2e-3 * np.abs(angular_before).max() + 1e-4
    # While two bodies are pressed together some energy rests in the springs, and comes back: 2 % of slack.
    assert all(b <= a * 1.02 for a, b in itertools.pairwise(energies))
    assert energies[-1] < 0.9 * energies[0]


def angular_momentum(s):
    state = s.particles.state
    return (state[:, 7:8] * np.cross(state[:, :3], state[:, 4:7]) + state[:, 11:12] * state[:, 8:11]).sum(
        axis=0
    )


def test_a_settled_bed_rests_on_its_floor_with_its_weight():
    s = bed(300)
    s.advance(int(1.0 / s.dt))
    weight = float(s.particles.state[:, 7].sum()) * 9.81
    # A frictionless tube carries nothing, so all of the weight stands on the floor. Averaged over ringing.
    free = bed(300, contact=Interaction(0.3, 0.0, 0.0, 0.0))
    free.advance(int(1.0 / free.dt))
    loads = []
    for _ in range(200):
        free.advance(20)
        near = free.near_walls
        loads.append(near.history[near.wall == 0, 0].sum())
    assert np.mean(loads) == pytest.approx(weight, rel=0.005)


@pytest.mark.parametrize("model", MODELS)
def test_threads_do_not_change_a_bit(model):
    runs = [bed(400, model=MODELS[model], threaded=threaded) for threaded in (False, True)]
    for s in runs:
        s.advance(6000)
    assert runs[0].searches > 10
    assert len(runs[0].neighbours.slab_start) > 3
    assert same_bits(*runs)


def test_the_length_of_the_chunks_does_not_change_a_bit():
    whole, pieces = bed(150), bed(150)
    whole.advance(5000)
    for steps in (1, 7, 992, 1500, 2500):
        pieces.advance(steps)
    assert whole.step == pieces.step == 5000
    assert same_bits(whole, pieces)


def test_another_seed_is_another_bed():
    a, b = bed(50, seed=1), bed(50, seed=2)
    assert not same_bits(a, b)


def test_turning_the_frame_turns_the_result():
    # Metamorphic: a quarter turn about z maps x to y and y to -x exactly, bit for bit.
    a, b = bed(60), bed(60)
    state = b.particles.state
    for c in (0, 4, 8):
        state[:, c], state[:, c + 1] = -state[:, c + 1].copy(), state[:, c].copy()
    for s in (a, b):
        s.advance(1500)
    turned = by_number(b)
    assert np.abs(turned[:, 1] - by_number(a)[:, 0]).max() < 1e-6
    assert np.abs(turned[:, 0] + by_number(a)[:, 1]).max() < 1e-6


def test_particles_below_the_floor_are_forgotten_and_logged():
    s = bed(100, walls=[])
    s.floor = -0.1
    s.advance(int(0.5 / s.dt))
    assert s.count == 0
    assert sorted(s.left.all().number) == list(range(100))


def test_a_number_that_is_not_finite_stops_the_run_with_its_particle():
    s = bed(50)
    s.advance(10)
    row = 7
    name = s.particles.number[row]
    s.particles.state[row, 4] = np.nan
    with pytest.raises(BlowUp, match=f"particle {name} is no longer finite"):
        s.advance(10)


def test_an_absurd_overlap_is_noticed():
    s = bed(50)
    s.particles.state[1, :3] = s.particles.state[0, :3] + [0.001, 0.0, 0.0]
    s.advance(1)
    with pytest.raises(BlowUp, match="overlaps"):
        s.check_overlaps()


@pytest.mark.parametrize(("pairs", "is_sound"), [(1, True), (2, False)])
def test_one_pair_in_a_thousand_may_be_pressed_past_its_surface(pairs, is_sound):
    s = bed(1500)
    for k in range(pairs):
        s.particles.state[2 * k + 1, :3] = s.particles.state[2 * k, :3] + [0.001, 0.0, 0.0]
    s.advance(1)
    if is_sound:
        assert s.check_overlaps() > 1.0
        return
    with pytest.raises(BlowUp, match="overlaps"):
        s.check_overlaps()


def test_a_travelling_wall_pushes():
    s = bed(80, walls=[Wall("plane", velocity=(0.0, 0.0, 0.2)), Wall("cylinder", radius=0.06, length=10.0)])
    s.advance(int(1.0 / s.dt))
    assert by_number(s)[:, 2].min() > 0.2


def test_a_fill_has_no_overlaps_and_stays_inside():
    rng = np.random.default_rng(4)
    radius = rng.uniform(0.002, 0.02, 500)
    x = fill_cylinder(radius, 0.1, rng)
    gap = np.sqrt(((x[:, None] - x[None]) ** 2).sum(axis=2)) - radius[:, None] - radius[None]
    assert gap[np.triu_indices(500, 1)].min() >= 0.0
    assert (np.hypot(x[:, 0], x[:, 1]) + radius).max() <= 0.1 + 1e-12
    assert (x[:, 2] - radius).min() >= 0.0
