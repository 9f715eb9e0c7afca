"""Feeds: the mass that came follows the rate to one particle, nobody is lost, nothing depends on the chunks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from demcore.case_run import CaseRun
from demcore.charge import Feed
from demcore.errors import InputError
from demcore.feeding import Feeder
from demcore.geometry.wall_arrays import wall_arrays
from demcore.interaction import grain_rows
from demcore.material import MixPart, SizeClass, SizeDistribution
from demcore.particles import VX, VZ, M, R, X, Z, nothing
from demcore.region import DiscInlet, RectangleInlet
from tests.demcore.cases import GRAVEL, SAND, a_case, a_feed

GRAINS = (GRAVEL, SAND)
NO_WALLS = wall_arrays([])
GRAVITY = np.array([0.0, 0.0, -9.81])


def feeder(feed, until=10.0, seed=(1,)):
    return Feeder(feed, GRAINS, grain_rows(GRAINS, 1), until, seed)


def run_dry(f, interval=0.002):
    """All births into an inlet that is always free: (time, particles) of every round."""
    rounds = []
    for step in range(20_000):
        born = f.births(step, interval, nothing(), NO_WALLS, GRAVITY)
        if born is not None:
            rounds.append((step * interval, born))
        if f.is_done:
            return rounds
    raise AssertionError("the feed never ended")


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("rate", [0.05, 0.7, 3.0, 7.77])
def test_the_total_is_right_to_one_particle(rate, seed):
    # physics.md section 6: one code let 714 come for 700
    f = feeder(a_feed(inlet=DiscInlet((0.0, 0.0, 0.0), 2.0), rate=rate, stop=0.7, seed=seed))
    born = np.concatenate([p.state[:, M] for _, p in run_dry(f)])
    assert abs(born.sum() - rate * 0.7) <= born.max()
    account = f.account()
    assert account.asked_kg == pytest.approx(rate * 0.7)
    assert account.born_kg == pytest.approx(born.sum())
    assert (account.born, account.waiting) == (len(born), 0)


def test_the_mass_follows_the_rate_all_along():
    f = feeder(a_feed(inlet=DiscInlet((0.0, 0.0, 0.0), 2.0), rate=2.0, start=0.1, stop=1.1))
    came = 0.0
    for time, born in run_dry(f):
        came += born.state[:, M].sum()
        assert abs(came - 2.0 * (time - 0.1)) <= f.draw.mass.max() + 2.0 * 0.002


def test_a_mass_ends_a_feed_and_the_end_of_the_run_does_too():
    assert feeder(a_feed(stop=math.inf, mass=0.25)).asked == 0.25
    assert feeder(a_feed(stop=9.0, rate=2.0, start=1.0), until=3.0).asked == pytest.approx(4.0)


def test_a_particle_is_born_where_it_has_flown_to():
    feed = a_feed(inlet=RectangleInlet((0.0, 0.0, 1.0), (0.5, 0.0, 0.0), (0.0, 0.5, 0.0)), rate=5.0)
    f = feeder(feed)
    born = f.births(100, 0.0001, nothing(), NO_WALLS, GRAVITY)
    flown = 0.01 - f.due[: len(born.number)]
    assert len(born.number) > 3
    # v = 1 m/s downwards, then free fall
    assert born.state[:, Z] == pytest.approx(1.0 - flown - 0.5 * 9.81 * flown**2)
    assert born.state[:, VZ] == pytest.approx(-1.0 - 9.81 * flown)
    assert (born.state[:, VX] == 0.0).all()


def test_between_two_rounds_no_particle_flies_farther_than_its_radius():
    f = feeder(a_feed(velocity=(0.0, 0.0, -3.0)))
    t = f.longest_interval(GRAVITY)
    assert 3.0 * t + 0.5 * 9.81 * t * t == pytest.approx(f.draw.radius.min(), rel=1e-6)
    assert feeder(a_feed(velocity=(0.0, 0.0, 0.0))).longest_interval(np.zeros(3)) == 0.01


def test_who_finds_no_place_waits_and_is_reported_and_comes_when_there_is_room():
    even = replace(GRAVEL, sizes=SizeDistribution((SizeClass(0.015, 0.016, 1.0),)))
    narrow = a_feed(inlet=DiscInlet((0.0, 0.0, 0.0), 0.0085), mix=(MixPart("gravel"),), rate=2.0, stop=0.02)
    narrow = replace(narrow, velocity=(0.0, 0.0, 0.0))
    f = Feeder(narrow, (even,), grain_rows((even,), 1), 10.0, (1,))
    bed = f.births(10, 0.002, nothing(), NO_WALLS, np.zeros(3))
    assert len(bed.number) == 1  # at rest in a narrow inlet: the first one blocks it
    account = f.account()
    assert account.waiting == len(f.due) - 1
    assert account.waiting_kg + account.born_kg == pytest.approx(f.draw.mass.sum())
    assert f.births(11, 0.002, bed, NO_WALLS, np.zeros(3)) is None
    assert not f.is_done
    came = 1
    for step in range(12, 100):
        born = f.births(step, 0.002, nothing(), NO_WALLS, GRAVITY)
        came += 0 if born is None else len(born.number)
    assert came == len(f.due)
    assert f.is_done


def test_nobody_is_born_into_a_wall_or_into_the_bed():
    run = CaseRun(a_case(fills=(), feeds=(a_feed(rate=4.0, inlet=DiscInlet((0.0, 0.0, 0.03), 0.04)),)))
    worst = 0.0
    s = run.simulation
    while s.time < 0.4:
        before = s.count
        s.advance(run.steps_to_event())
        run.act()
        if s.count > before:
            fresh = s.particles.state[before:]
            x, r = s.particles.state[:, X : Z + 1], s.particles.state[:, R]
            gap = np.sqrt(((fresh[:, None, :3] - x[None]) ** 2).sum(axis=2)) - fresh[:, None, R] - r[None]
            gap[np.arange(len(fresh)), before + np.arange(len(fresh))] = 1.0
            worst = min(worst, gap.min(), (fresh[:, Z] - fresh[:, R]).min())
    assert worst >= 0.0
    assert run.accounts[0].waiting > 0, "the inlet lies in the bed, so some must wait"
    assert s.count == run.accounts[0].born


def test_each_feed_has_a_stream_of_its_own():
    a, b = feeder(a_feed(seed=1)), feeder(a_feed(seed=2))
    assert a.draw.radius.tobytes() != b.draw.radius.tobytes()
    assert a.draw.radius.tobytes() == feeder(a_feed(seed=1)).draw.radius.tobytes()
    assert a.draw.radius.tobytes() != feeder(a_feed(seed=1), seed=(2,)).draw.radius.tobytes()


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"rate": 0.0}, "feed.rate"),
        ({"rate": math.nan}, "feed.rate"),
        ({"start": -1.0}, "feed.start"),
        ({"stop": 0.0}, "feed.stop"),
        ({"stop": math.inf}, "feed.stop"),
        ({"mass": -1.0}, "feed.mass"),
        ({"velocity": (0.0, math.nan, 0.0)}, "feed.velocity"),
        ({"seed": -1}, "feed.seed"),
        ({"mix": ()}, "feed.mix"),
        ({"mix": (MixPart("gravel", 0.5),)}, "feed.mix.mass_share"),
        ({"mix": (MixPart("gravel", 0.5), MixPart("gravel", 0.5))}, "feed.mix"),
    ],
)
def test_bad_feeds_are_refused(change, field):
    with pytest.raises(InputError) as caught:
        replace(a_feed(), **change)
    assert caught.value.field == field
    assert isinstance(a_feed(), Feed)
