"""Neighbour search against brute force, over a size ratio of 10, with and without threads."""

from __future__ import annotations

import numpy as np
import pytest

from demcore import neighbours
from demcore.block import LANES
from demcore.case import Interaction, Stiffness, uniform_table
from demcore.forces import touching_contacts
from demcore.geometry.wall_arrays import wall_arrays
from demcore.geometry.walls import Wall
from demcore.neighbours import arrange, carry, empty_neighbours, list_pairs, reaches
from demcore.particles import VX, VZ, R, spheres
from demcore.wall_list import empty_wall_list
from demcore.wall_search import list_walls
from demcore.wrench import HISTORY_WIDTH, material_tables

TABLES = material_tables(*uniform_table(Stiffness(1e7, 0.25), Interaction(0.5, 0.5, 0.45, 0.1)).arrays())

DT = 1e-4


def cloud(seed: int, count: int, smallest: float, largest: float, size: float):
    rng = np.random.default_rng(seed)
    position = rng.random((count, 3)) * size
    radius = np.exp(rng.uniform(np.log(smallest), np.log(largest), count))
    return spheres(position, radius, 1000.0)


def search(bed, before, skin, threaded=False):
    """Sorted particles, their list with the histories of the list before, and their rows before."""
    arranged = arrange(bed, skin, DT)
    lists = list_pairs(arranged, carry(before), np.zeros(len(arranged.order), np.uint8), TABLES, threaded)
    return arranged.particles, lists, arranged.order


def used_slots(lists):
    """Slots of the contacts, slab by slab."""
    slots = zip(lists.block_start[:-1] * LANES, lists.used, strict=True)
    return np.concatenate([np.arange(first, first + used) for first, used in slots])


def listed_pairs(lists):
    """Owner and partner of all pairs, contacts first, and the slab that lists them."""
    near = np.diff(lists.near_start)
    slab = np.concatenate(
        [np.repeat(np.arange(len(near)), lists.used), np.repeat(np.arange(len(near)), near)]
    )
    taken = used_slots(lists)
    owner = np.concatenate([lists.owner[taken], lists.near_owner])
    return owner, np.concatenate([lists.partner[taken], lists.near_partner]), slab


def named_pairs(particles, lists):
    owner, partner, _slab = listed_pairs(lists)
    a, b = particles.number[owner], particles.number[partner]
    return set(zip(np.minimum(a, b).tolist(), np.maximum(a, b).tolist(), strict=True)), len(a)


def brute_force(particles, skin):
    x, r = particles.state[:, :3], particles.state[:, 3]
    d = np.sqrt(((x[:, None] - x[None]) ** 2).sum(axis=2))
    i, j = np.nonzero(np.triu(d < r[:, None] + r[None] + skin, k=1))
    a, b = particles.number[i], particles.number[j]
    return set(zip(np.minimum(a, b).tolist(), np.maximum(a, b).tolist(), strict=True))


@pytest.mark.parametrize("threaded", [False, True])
@pytest.mark.parametrize(
    ("count", "smallest", "largest", "size"),
    [(800, 0.005, 0.05, 0.6), (500, 0.02, 0.02, 0.5), (1, 0.02, 0.02, 0.5), (300, 0.01, 0.03, 50.0)],
)
def test_every_pair_is_found_once(threaded, count, smallest, largest, size):
    bed = cloud(count, count, smallest, largest, size)
    skin = 0.3 * smallest
    after, lists, _order = search(bed, empty_neighbours(count), skin, threaded=threaded)
    pairs, listed = named_pairs(after, lists)
    assert pairs == brute_force(after, skin)
    assert listed == len(pairs)


@pytest.mark.parametrize("threaded", [False, True])
def test_fast_particles_find_each_other_from_afar(threaded):
    bed = cloud(3, 800, 0.005, 0.05, 0.6)
    bed.state[:, VX : VZ + 1] = np.random.default_rng(4).normal(size=(800, 3)) * 5.0
    bed.state[::2, VX : VZ + 1] *= 0.01
    after, lists, _order = search(bed, empty_neighbours(800), 0.0015, threaded=threaded)
    x, reach = after.state[:, :3], reaches(after.state, 0.0015, DT)
    away = np.sqrt(((x[:, None] - x[None]) ** 2).sum(axis=2))
    i, j = np.nonzero(np.triu(away < reach[:, None] + reach[None], k=1))
    owner, partner, _slab = listed_pairs(lists)
    assert sorted(zip(owner.tolist(), partner.tolist(), strict=True)) == sorted(
        zip(i.tolist(), j.tolist(), strict=True)
    )
    assert len(owner) > len(brute_force(after, 0.0015))


def test_a_pair_never_reaches_beyond_the_next_slab():
    bed = cloud(5, 3000, 0.005, 0.02, 1.0)
    bed.state[::7, VX] = 2.0
    _after, lists, _order = search(bed, empty_neighbours(3000), 0.002)
    owner, partner, lister = listed_pairs(lists)
    slab = np.searchsorted(lists.slab_start, np.arange(3000), side="right") - 1
    assert (slab[owner] == lister).all()
    assert set((slab[partner] - slab[owner]).tolist()) == {0, 1}
    assert len(lists.slab_start) > 3


@pytest.mark.parametrize(("count", "slabs"), [(100, 1), (300, 2), (1500, 12)])
def test_few_particles_far_apart_lie_in_few_slabs(count, slabs, monkeypatch):
    monkeypatch.setattr(neighbours, "LEAST_IN_SLAB", 128)
    _after, lists, _order = search(cloud(2, count, 0.01, 0.03, 50.0), empty_neighbours(count), 0.003)
    assert 1 <= len(lists.used) <= slabs
    assert (np.diff(lists.slab_start)[:-1] >= 100).all()


def write_histories(lists, rows):
    """Rows (C, HISTORY_WIDTH) into the slots in use, slab by slab."""
    blocks = lists.history.reshape(-1, HISTORY_WIDTH, LANES)
    slots = used_slots(lists)
    blocks[slots // LANES, :, slots % LANES] = rows


def test_histories_survive_a_new_order_and_turn_with_the_owner():
    bed = cloud(9, 400, 0.01, 0.03, 0.3)
    walls = wall_arrays([Wall("plane")])
    after, lists, order = search(bed, empty_neighbours(400), 0.003)
    near = list_walls(after.state, after.state[:, R] + 0.003, walls, 0, 1e-4, order, empty_wall_list())
    slots = used_slots(lists)
    # A value that is antisymmetric in the pair's names, as a force on the owner is.
    a, b = after.number[lists.owner[slots]] + 1.0, after.number[lists.partner[slots]] + 1.0
    write_histories(lists, np.column_stack([*[a + b] * 4, *[a - b] * 6]))
    near.history[:] = np.repeat(after.number[near.owner], np.diff(near.start))[:, None] + 1.0
    shuffled = after.state.copy()
    shuffled[:, 0] = 0.3 - shuffled[:, 0]  # a mirror keeps all distances and turns the order round
    mirrored, again, order = search(after._replace(state=shuffled), lists, 0.003)
    reach = mirrored.state[:, R] + 0.003
    near_again = list_walls(mirrored.state, reach, walls, 0, 1e-4, order, near)
    owner, partner, history = touching_contacts(again)
    a, b = mirrored.number[owner] + 1.0, mirrored.number[partner] + 1.0
    assert len(owner) == len(slots) > 100
    assert (np.sign(a - b) != np.sign(a - b)[0]).any()
    assert (history == np.column_stack([*[a + b] * 4, *[a - b] * 6])).all()
    named = np.repeat(mirrored.number[near_again.owner], np.diff(near_again.start))
    assert len(named) > 0
    assert (near_again.history == named[:, None] + 1.0).all()


def test_particles_that_were_not_there_before_bring_no_history():
    bed = cloud(9, 400, 0.01, 0.03, 0.3)
    first = bed._replace(**{name: value[:300] for name, value in bed._asdict().items()})
    after, lists, _order = search(first, empty_neighbours(300), 0.003)
    write_histories(lists, np.ones((len(used_slots(lists)), HISTORY_WIDTH)))
    joined = type(bed)(*(np.concatenate([old, new[300:]]) for old, new in zip(after, bed, strict=True)))
    everyone, again, _order = search(joined, lists, 0.003)
    slots = used_slots(again)
    known = np.maximum(everyone.number[again.owner[slots]], everyone.number[again.partner[slots]]) < 300
    rows = again.history.reshape(-1, HISTORY_WIDTH, LANES)[slots // LANES, :, slots % LANES]
    assert 50 < known.sum() < len(slots) - 50
    assert (np.abs(rows[known]) == 1.0).all()
    assert (rows[~known] == 0.0).all()
