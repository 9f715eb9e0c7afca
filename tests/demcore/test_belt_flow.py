"""Section and jet on synthetic streams."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from demcore.observables.belt_flow import BeltSection, JetEnvelope


def test_stratification_is_one_when_size_grows_with_height_and_zero_when_mixed():
    rng = np.random.default_rng(2)
    above = rng.uniform(0.0, 0.2, 4000)
    section = BeltSection(0.4, 0.3)
    section.add(rng.uniform(-0.3, 0.3, 4000), above, 0.01 + above, np.ones(4000))
    assert section.stratification() == pytest.approx(1.0)
    mixed = BeltSection(0.4, 0.3)
    mixed.add(np.zeros(4000), above, rng.uniform(0.01, 0.1, 4000), np.ones(4000))
    assert abs(mixed.stratification()) < 0.05
    assert math.isnan(BeltSection(0.4, 0.3).stratification())


def test_layers_have_their_shares_and_sizes():
    section = BeltSection(0.4, 0.1)
    section.add(np.array([0.0, 0.1]), np.array([0.01, 0.05]), np.array([0.02, 0.06]), np.array([1.0, 3.0]))
    heights, share, size = section.size_by_height()
    assert heights == pytest.approx([0.01, 0.03, 0.05, 0.07, 0.09])
    assert share == pytest.approx([0.25, 0.0, 0.75, 0.0, 0.0])
    assert size[[0, 2]] == pytest.approx([0.02, 0.06])
    assert math.isnan(size[1])
    section.add(np.array([0.0]), np.array([0.05]), np.array([0.06]), np.array([2.0]))
    assert section.mass_per_metre(0.5) == pytest.approx(6.0 / (2 * 0.5))


def test_what_is_saved_comes_back():
    section, jet = BeltSection(0.4, 0.1), JetEnvelope(np.array([0.0, 1.0]), -1.0, 1.0)
    section.add(np.array([0.0]), np.array([0.05]), np.array([0.06]), np.array([2.0]))
    jet.add(
        np.array([[0.1, 0.0, -0.01]]), np.array([[1.0, 0.0, -3.0]]), np.array([0.1]), np.array([2.0]), 0.01
    )
    again, jet_again = BeltSection(0.4, 0.1), JetEnvelope(np.array([0.0, 1.0]), -1.0, 1.0)
    again.restore(json.loads(json.dumps(section.numbers())))
    jet_again.restore(json.loads(json.dumps(jet.numbers())))
    assert (again.mass == section.mass).all() and (again.sums == section.sums).all()
    assert again.samples == 1
    assert (jet_again.mass == jet.mass).all() and jet.mass.sum() == 2.0


def test_every_grain_of_a_steady_fall_passes_each_level_once():
    """Grains in free flight, looked at every 10 ms: x at a level is that of the parabola."""
    rng = np.random.default_rng(4)
    start = np.column_stack([rng.uniform(-0.1, 0.1, 300), np.zeros(300), rng.uniform(1.9, 2.1, 300)])
    jet = JetEnvelope(np.array([0.5, 1.0]), -1.0, 2.0)
    for k in range(70):
        t = 0.01 * k
        position = start + np.array([1.5 * t, 0.0, -0.5 * 9.81 * t * t])
        velocity = np.tile([1.5, 0.0, -9.81 * t], (300, 1))
        jet.add(position, velocity, np.full(300, 0.05), np.full(300, 2.0), 0.01)
    assert jet.mass.sum(axis=1) == pytest.approx([600.0, 600.0], rel=0.01)
    fall = np.sqrt(2.0 * (start[:, 2] - 1.0) / 9.81)
    expected = np.quantile(start[:, 0] + 1.5 * fall, [0.05, 0.5, 0.95])
    assert jet.quantiles()[1] == pytest.approx(expected, abs=0.012)


def test_a_jet_is_followed_on_in_thought_below_where_it_is_read():
    """A grain that falls from rest at z = 2 m with 1.5 m/s across: read at .8 m, it would come to .5 m after
    sqrt(2 1.5 / g) s in all."""
    aim = JetEnvelope(np.array([0.8]), -1.0, 2.0, ahead=0.3)
    for k in range(60):
        t = 0.01 * k
        position, velocity = [1.5 * t, 0.0, 2.0 - 0.5 * 9.81 * t * t], [1.5, 0.0, -9.81 * t]
        aim.add(np.array([position]), np.array([velocity]), np.array([0.05]), np.array([2.0]), 0.01)
    assert aim.mass.sum() == 2.0
    assert aim.quantiles()[0, 1] == pytest.approx(1.5 * math.sqrt(2.0 * 1.5 / 9.81), abs=0.006)


def test_the_split_of_a_jet_beyond_a_place():
    jet = JetEnvelope(np.array([0.0]), -1.0, 1.0)
    position = np.array([[-0.5, 0.0, -0.001], [0.305, 0.0, -0.001], [0.405, 0.0, -0.001]])
    velocity = np.tile([0.0, 0.0, -5.0], (3, 1))
    jet.add(position, velocity, np.array([0.02, 0.04, 0.08]), np.array([1.0, 1.0, 2.0]), 0.01)
    far, near_size, far_size = jet.split(0, 0.0)
    assert far == pytest.approx(0.75)
    assert near_size == pytest.approx(0.02)
    assert far_size == pytest.approx((0.04 + 2 * 0.08) / 3.0)
    assert math.isnan(JetEnvelope(np.array([0.0]), -1.0, 1.0).split(0, 0.0)[0])
    assert np.isnan(JetEnvelope(np.array([0.0]), -1.0, 1.0).quantiles()).all()


def test_the_share_beyond_every_place_of_a_ridge():
    """1 kg at -.5 m, 1 at .305 and 2 at .405: 1 before them, 3/4 and 2/4 between, 0 beyond."""
    jet = JetEnvelope(np.array([0.0]), -1.0, 1.0)
    position = np.array([[-0.5, 0.0, -0.001], [0.305, 0.0, -0.001], [0.405, 0.0, -0.001]])
    velocity = np.tile([0.0, 0.0, -5.0], (3, 1))
    jet.add(position, velocity, np.full(3, 0.05), np.array([1.0, 1.0, 2.0]), 0.01)
    x, share = jet.beyond(0)
    assert (x[0], share[0]) == pytest.approx((-0.5, 1.0), abs=0.011)
    assert (x[-1], share[-1]) == pytest.approx((0.41, 0.0))
    assert np.interp([-0.2, 0.3, 0.35], x, share) == pytest.approx([0.75, 0.75, 0.5])
    assert all(len(column) == 0 for column in JetEnvelope(np.array([0.0]), -1.0, 1.0).beyond(0))
