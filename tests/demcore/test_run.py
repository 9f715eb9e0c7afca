"""simulate(): how a run ends, what it reports, and that nothing but the case decides its bits."""

from __future__ import annotations

import itertools
import json
import math
import time
from dataclasses import replace

import numpy as np
import pytest

from demcore import run as run_module
from demcore.case_run import CaseRun
from demcore.errors import BlowUp, Cancelled, InputError
from demcore.geometry.walls import Wall
from demcore.material import MixPart
from demcore.region import Box, Cone, DiscInlet, cylinder
from demcore.result import finished
from demcore.run import drive, simulate
from tests.demcore.cases import TUBE, WALLS, a_case, a_feed, a_fill

# A hopper's worth of everything: a fill, two feeds of a mix, a floor that is left over the edge.
BUSY = a_case(
    fills=(a_fill(mass=0.3),),
    feeds=(a_feed(stop=0.3), a_feed(start=0.1, stop=0.3, seed=2, mix=(MixPart("sand"),), rate=0.5)),
    walls=(Wall("disc", radius=0.06), Wall("cylinder", (0.0, 0.0, 0.03), radius=TUBE, length=9.0)),
    domain=Box((-0.3, -0.3, -0.05), (0.3, 0.3, math.inf)),
    duration=0.4,
)


def same(a, b):
    """Everything that a result file would hold."""
    arrays = [(x.positions, x.velocities, x.spins, x.numbers, *x.departures) for x in (a, b)]
    bits = all(p.tobytes() == q.tobytes() for p, q in zip(*arrays, strict=True))
    rest = [(x.history, x.accounts, x.ended, x.time, x.steps, x.searches, x.particle_steps) for x in (a, b)]
    return bits and rest[0] == rest[1]


@pytest.fixture(scope="module")
def busy():
    return simulate(BUSY)


def test_a_fill_comes_to_rest_and_the_result_says_by_what_measure():
    result = simulate(a_case())
    assert result.ended == "rest"
    assert 0.2 < result.time < 3.0
    assert result.assumptions["rest"] == "rms speed below 0.005 sqrt(g d) for 0.1 s, d the mean diameter"
    assert result.numbers.tolist() == list(range(len(result.masses)))
    assert abs(result.masses.sum() - 0.5) <= result.masses.max()
    assert result.filled_kg == pytest.approx(result.masses.sum())
    assert np.hypot(result.positions[:, 0], result.positions[:, 1]).max() < TUBE
    assert (result.positions[:, 2] > 0.0).all()
    assert set(result.material_rows) == {1, 2}
    wall_share = np.bincount(result.material_rows, result.masses)[1] / result.masses.sum()
    assert wall_share == pytest.approx(0.25, abs=0.03)
    json.dumps(result.assumptions, allow_nan=False)


def test_energy_of_a_closed_case_never_grows_once_it_lies():
    result = simulate(a_case(rest=None, duration=1.2))
    assert result.ended == "duration"
    assert result.time == pytest.approx(1.2, abs=result.case.dt)
    energies = [r.kinetic_energy for r in result.history if r.time > 0.6]
    assert max(energies) < 1e-3 * max(r.kinetic_energy for r in result.history)
    assert all(r.mass == pytest.approx(result.filled_kg, rel=1e-12) for r in result.history)


def test_mass_is_kept_by_feeds_bed_and_departures(busy):
    born = busy.filled_kg + sum(a.born_kg for a in busy.accounts)
    assert busy.inserted_kg == pytest.approx(born)
    assert busy.masses.sum() + busy.departures.mass.sum() == pytest.approx(born, rel=1e-12)
    assert len(busy.departures.number) > 5
    everyone = np.concatenate([busy.numbers, busy.departures.number])
    assert sorted(everyone) == list(range(len(everyone)))
    for account, feed in zip(busy.accounts, BUSY.feeds, strict=True):
        assert abs(account.born_kg + account.waiting_kg - feed.total) <= busy.masses.max()


@pytest.mark.parametrize("seconds", [1e-9, 0.004, 5.0])
def test_the_length_of_the_chunks_decides_nothing(busy, seconds, monkeypatch):
    monkeypatch.setattr(run_module, "CHUNK_SECONDS", seconds)
    assert same(simulate(BUSY), busy)


def test_threads_decide_nothing(busy):
    assert same(simulate(BUSY, threads=2), busy)


def test_a_run_saved_and_resumed_all_along_gives_the_same_bits(busy, tmp_path, monkeypatch):
    monkeypatch.setattr(run_module, "REPORT_SECONDS", 0.0)
    monkeypatch.setattr(run_module, "CHUNK_SECONDS", 0.02)
    path = tmp_path / "c"
    for stop in (0.0, 0.05, 0.13, 0.3):
        with pytest.raises(Cancelled, match="checkpoint"):
            simulate(BUSY, lambda p, stop=stop: p.time_s <= stop, checkpoint_path=path)
    seen = []
    result = simulate(
        BUSY, lambda p: seen.append(p.time_s) or True, checkpoint_path=path, checkpoint_seconds=0.0
    )
    assert seen[0] > 0.3
    assert same(result, busy)


class Frames:
    def __init__(self, interval):
        self.interval, self.times, self.states = interval, [], []

    def frame(self, time, simulation):
        self.times.append(time)
        self.states.append(simulation.particles.state[np.argsort(simulation.particles.number)].tobytes())

    def rewind(self, time):
        kept = sum(t <= time for t in self.times)
        del self.times[kept:], self.states[kept:]


def test_a_recorder_gets_its_frames_and_changes_nothing(busy, tmp_path, monkeypatch):
    whole = Frames(0.05)
    assert same(simulate(BUSY, recorder=whole), busy)
    assert whole.times[0] == 0.0
    assert whole.times[-1] == busy.time
    assert np.diff(whole.times)[:-1] == pytest.approx(0.05, abs=BUSY.dt)
    # Cut off between two frames: the series of the resumed run is the same one.
    monkeypatch.setattr(run_module, "REPORT_SECONDS", 0.0)
    monkeypatch.setattr(run_module, "CHUNK_SECONDS", 0.02)
    cut = Frames(0.05)
    path = tmp_path / "c"
    with pytest.raises(Cancelled):
        simulate(BUSY, lambda p: p.time_s < 0.22, checkpoint_path=path, recorder=cut)
    cut.times.append(0.24)  # a frame that was written after the checkpoint
    cut.states.append(b"")
    simulate(BUSY, checkpoint_path=path, recorder=cut)
    assert cut.times == whole.times
    assert cut.states == whole.states


def test_progress_is_reported_a_few_times_a_second_and_ends_whole():
    seen = []
    started = time.monotonic()
    simulate(a_case(), lambda p: seen.append(p) or True)
    assert len(seen) <= 2 + (time.monotonic() - started) / run_module.REPORT_SECONDS
    assert all(a.time_s < b.time_s for a, b in itertools.pairwise(seen))
    assert all(p.particles > 100 and p.kinetic_energy_j >= 0.0 for p in seen)
    assert seen[-1].particle_steps_per_s > 0.0
    assert 0.0 < seen[0].fraction <= seen[-1].fraction <= 1.0


def test_no_answer_is_no_wish_to_stop():
    assert simulate(a_case(duration=0.05), lambda p: None).ended == "duration"


def test_a_large_bed_hears_a_cancel_within_two_seconds():
    case = a_case(
        fills=(a_fill(region=cylinder((0.0, 0.0, 0.0), 0.45, 3.0), mass=60.0, mix=(MixPart("sand"),)),),
        walls=(Wall("plane"), Wall("cylinder", radius=0.45, length=9.0)),
    )
    run = CaseRun(case)
    assert run.simulation.count > 80_000
    told = []

    def stop(progress):
        told.append(time.monotonic())
        return False

    run.simulation.advance(1)  # compiled and searched
    started = time.monotonic()
    with pytest.raises(Cancelled):
        drive(run, stop)
    assert told[0] - started < 2.0


def test_nothing_left_ends_a_run():
    result = simulate(a_case(walls=(), domain=Box((-1.0, -1.0, -0.1), (1.0, 1.0, 2.0))))
    assert result.ended == "empty"
    assert len(result.numbers) == 0
    assert abs(result.departures.mass.sum() - result.filled_kg) < 1e-12


def test_rest_is_not_called_while_a_feed_is_still_to_come():
    late = a_feed(start=1.5, stop=1.6)
    result = simulate(a_case(feeds=(late,)))
    assert result.ended == "rest"
    assert result.time > 1.6
    assert result.accounts[0].born > 0


def test_a_feed_into_an_empty_space_starts_by_itself():
    result = simulate(a_case(fills=(), feeds=(a_feed(start=0.2, stop=0.3),), duration=0.5, rest=None))
    assert abs(result.masses.sum() - 0.1) <= result.masses.max()


def test_a_level_fills_to_that_height_once_it_lies():
    case = a_case(fills=(a_fill(mass=None, level=0.12),))
    # bulk density times the volume below the level
    result = simulate(case)
    assert abs(result.masses.sum() - 1500.0 * math.pi * TUBE**2 * 0.12) <= result.masses.max()
    top = np.quantile(result.positions[:, 2] + result.radii, 0.95)
    assert top == pytest.approx(0.12, rel=0.12)


def test_fills_share_a_region_without_overlaps_and_are_numbered_on():
    region = Cone((0.0, 0.0, 0.0), 0.5, 0.02, TUBE)
    run = CaseRun(a_case(fills=(a_fill(region=region, mass=0.3), a_fill(region=region, mass=0.2, seed=1))))
    x, r = run.simulation.particles.state[:, :3], run.simulation.particles.state[:, 3]
    gap = np.sqrt(((x[:, None] - x[None]) ** 2).sum(axis=2)) - r[:, None] - r[None]
    assert gap[np.triu_indices(len(r), 1)].min() >= 0.0
    assert run.simulation.particles.number.tolist() == list(range(len(r)))
    assert run.filled_kg == pytest.approx(0.5, abs=2 * run.simulation.particles.state[:, 7].max())


def test_a_fill_without_room_is_refused_before_anything_runs():
    with pytest.raises(InputError) as caught:
        simulate(a_case(fills=(a_fill(mass=50.0),)))
    assert caught.value.field == "fill.region"


def test_hertz_mindlin_runs_by_name():
    result = simulate(a_case(contact_model="hertz_mindlin", duration=0.3, rest=None))
    assert result.assumptions["laws"]["normal"] == {"clamp": 0.0}
    assert (result.positions[:, 2] > 0.0).all()


def spoil_state(simulation, column, value):
    simulation.particles.state[7, column] = value


def push_together(simulation):
    """The first pair that is near, a millimetre apart."""
    state, lists = simulation.particles.state, simulation.neighbours
    state[lists.near_owner[0], :3] = state[lists.near_partner[0], :3] + 1e-3


def explode(run, change):
    """Drive a run whose bed is spoiled at 0.2 s by `change`."""
    act = run.act

    def spoil():
        act()
        if abs(run.simulation.time - 0.2) < 0.5 * run.check_steps * run.simulation.dt:
            change(run.simulation)

    run.act = spoil


@pytest.mark.parametrize(
    ("spoil", "what"),
    [
        (lambda s: spoil_state(s, 4, math.nan), "no longer finite"),
        (lambda s: spoil_state(s, 9, math.inf), "no longer finite"),
        (lambda s: spoil_state(s, 6, 900.0), "more than half its radius in a step"),
        (push_together, "overlaps"),
    ],
)
def test_a_blow_up_names_particle_time_and_the_last_good_checkpoint(spoil, what, tmp_path):
    run = CaseRun(a_case())
    path = tmp_path / "c"
    explode(run, spoil)
    with pytest.raises(BlowUp, match=what) as caught:
        drive(run, checkpoint_path=path, checkpoint_seconds=0.0)
    assert caught.value.particle in set(run.simulation.particles.number)
    assert 0.19 < caught.value.time < 0.23
    assert caught.value.checkpoint == path
    assert str(path) in str(caught.value)
    # What was saved last is sound, and goes on to the end.
    assert same(simulate(a_case(), checkpoint_path=path), simulate(a_case()))


def test_without_a_checkpoint_a_blow_up_names_none():
    run = CaseRun(a_case())
    explode(run, lambda s: spoil_state(s, 0, math.nan))
    with pytest.raises(BlowUp) as caught:
        drive(run)
    assert caught.value.checkpoint is None


def test_the_result_of_a_run_says_what_it_assumed(busy):
    assert busy.assumptions["pairs_by_that_rule"] == ["gravel and sand"]
    assert busy.assumptions["density_from"] == {"gravel": "bulk density / packing fraction", "sand": "given"}
    assert busy.assumptions["time_step_s"] == BUSY.dt
    assert busy.wall_s > 0.0
    assert busy.particle_steps_per_s > 0.0
    assert finished(CaseRun(BUSY)).identity == busy.identity
    assert replace(BUSY, seed=9) != BUSY
    assert DiscInlet((0.0, 0.0, 0.4), 0.04) == BUSY.feeds[0].inlet
    assert len(WALLS) == 2
