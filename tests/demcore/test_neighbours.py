"""Neighbour search against brute force, over a size ratio of 10, with and without threads."""

from __future__ import annotations

import numpy as np
import pytest

from demcore.geometry.walls import Wall
from demcore.neighbours import empty_neighbours, search
from demcore.particles import spheres
from demcore.simulation import wall_arrays
from demcore.wall_search import empty_wall_list, list_walls


def cloud(seed: int, count: int, smallest: float, largest: float, size: float):
    rng = np.random.default_rng(seed)
    position = rng.random((count, 3)) * size
    radius = np.exp(rng.uniform(np.log(smallest), np.log(largest), count))
    return spheres(position, radius, 1000.0)


def named_pairs(particles, lists):
    owner = np.repeat(np.arange(len(particles.number)), np.diff(lists.start))
    a, b = particles.number[owner], particles.number[lists.partner]
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


def test_a_pair_never_reaches_beyond_the_next_slab():
    bed = cloud(5, 3000, 0.005, 0.02, 1.0)
    _after, lists, _order = search(bed, empty_neighbours(3000), 0.002)
    owner = np.repeat(np.arange(3000), np.diff(lists.start))
    slab = np.searchsorted(lists.slab_start, np.arange(3000), side="right")
    assert (slab[lists.partner] - slab[owner]).max() <= 1
    assert len(lists.slab_start) > 3


def test_histories_survive_a_new_order_and_turn_with_the_owner():
    bed = cloud(9, 400, 0.01, 0.03, 0.3)
    walls = wall_arrays([Wall("plane")])
    after, lists, order = search(bed, empty_neighbours(400), 0.003)
    near = list_walls(after.state, walls, 0.003, order, empty_wall_list())
    owner = np.repeat(np.arange(400), np.diff(lists.start))
    # A value that is antisymmetric in the pair's names, as a force on the owner is.
    a, b = after.number[owner].astype(float), after.number[lists.partner].astype(float)
    lists.history[:] = np.column_stack([*[a + b] * 4, *[a - b] * 6])
    near.history[:] = np.repeat(after.number[near.owner], np.diff(near.start))[:, None] + 1.0
    shuffled = after.state.copy()
    shuffled[:, 0] = 0.3 - shuffled[:, 0]  # a mirror keeps all distances and turns the order round
    mirrored, again, order = search(after._replace(state=shuffled), lists, 0.003)
    near_again = list_walls(mirrored.state, walls, 0.003, order, near)
    owner = np.repeat(np.arange(400), np.diff(again.start))
    x, r = mirrored.state[:, :3], mirrored.state[:, 3]
    touching = ((x[owner] - x[again.partner]) ** 2).sum(axis=1) < (r[owner] + r[again.partner]) ** 2
    a, b = mirrored.number[owner].astype(float), mirrored.number[again.partner].astype(float)
    assert touching.sum() > 100
    assert (again.history[touching] == np.column_stack([*[a + b] * 4, *[a - b] * 6])[touching]).all()
    assert (again.history[~touching] == 0.0).all()
    named = np.repeat(mirrored.number[near_again.owner], np.diff(near_again.start))
    assert len(named) > 0
    assert (near_again.history == named[:, None] + 1.0).all()
