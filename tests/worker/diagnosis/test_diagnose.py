"""The whole pipeline on plants whose truth is the stand-in itself: what is hidden is named, nothing is not."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
import pytest

from service.domain.data_set.cells import BadDataSet
from service.domain.data_set.records import Condition, DataSet
from service.domain.effects import library
from service.domain.errors import InvalidValue
from tests.worker.diagnosis.plants import CHARGES, PILES, QUICK, diagnosed, measured, measured_of
from worker.diagnosis.cost import estimated_runs
from worker.diagnosis.diagnose import diagnose
from worker.diagnosis.gain import can_be_scored, confirmed, held_out_gain, with_gain
from worker.diagnosis.identifiability import Plan, identifiability
from worker.diagnosis.next_measurement import _checks, next_measurements
from worker.diagnosis.self_tests import run_self_tests
from worker.diagnosis.simulator import Outcomes, Setting
from worker.diagnosis.stand_in import StandIn
from worker.diagnosis.verdict import FLAGGED_AT

HIDDEN = ("belt_speed", -0.08)


def test_a_strong_effect_is_named_with_its_size() -> None:
    """An effect of some ten standard deviations, of the analyser's own world: this is not a matter of luck."""
    _, found = diagnosed(*HIDDEN)
    assert found.result.verdict in ("named", "named_with_remainder")
    claim = found.result.claims[0]
    assert claim.effect == "belt_speed" and claim.amplitude.unit == "1"
    assert claim.amplitude.value == pytest.approx(HIDDEN[1], rel=0.3)
    assert claim.amplitude.ci90[0] < claim.amplitude.value < claim.amplitude.ci90[1]
    assert (found.result.p_value or 1.0) <= 0.02


def test_limits_and_silent_effects_are_told_beside() -> None:
    _, found = diagnosed(*HIDDEN)
    limits = {limit.effect: limit.detectable_from for limit in found.result.limits}
    assert 0.0 < limits["belt_speed"] < 0.08
    assert found.power is not None
    cosines = found.power.cosines
    assert np.allclose(cosines, cosines.T) and np.all(np.abs(cosines) <= 1.0 + 1e-9)


def test_nothing_hidden_nothing_claimed() -> None:
    _, found = diagnosed("belt_speed", 0.0)
    assert found.result.claims == ()
    assert found.result.calibration is not None and len(found.result.calibration.statistics) == QUICK.plants


def test_without_a_misfit_nothing_is_refined() -> None:
    """The verdict stands on the screening's p value; refinement is a third of all runs."""
    (_, quiet), (_, loud) = diagnosed("belt_speed", 0.0), diagnosed(*HIDDEN)
    assert (quiet.result.p_value or 0.0) > FLAGGED_AT >= (loud.result.p_value or 1.0)
    assert quiet.result.cost["runs"] < 0.9 * loud.result.cost["runs"]
    assert quiet.result.limits and quiet.result.verdict == "no_misfit"


def test_piles_alone_cannot_test_what_acts_on_charges() -> None:
    found = diagnose(measured({}, piles_only=True), StandIn(), QUICK)
    assert {"belt_speed", "deflector_tilt", "liner_wear", "air_drag"} <= set(found.result.not_testable)
    assert "cohesion" not in found.result.not_testable


def test_the_verdict_does_not_see_the_held_out_block() -> None:
    data, found = diagnosed(*HIDDEN)
    held = {c.condition for c in data.conditions if c.holdout}
    changed = [
        dataclasses.replace(o, value=o.value * 1.5) if o.condition in held else o for o in data.observations
    ]
    again = diagnose(DataSet(data.conditions, tuple(changed)), StandIn(), QUICK)
    assert again.result.as_dict() == found.result.as_dict()


def test_a_stored_null_calibration_is_used_for_the_same_design_only() -> None:
    data, found = diagnosed(*HIDDEN)
    null = found.result.calibration
    assert null is not None
    again = diagnose(data, StandIn(), QUICK, {null.key: null})
    assert again.result.calibration is null
    fewer = DataSet(data.conditions, tuple(o for o in data.observations if o.replicate != "r3"))
    assert diagnose(fewer, StandIn(), QUICK, {null.key: null}).result.calibration is not null


def test_the_held_out_gain_of_the_right_effect_makes_a_claim() -> None:
    data, found = diagnosed(*HIDDEN)
    gain = held_out_gain(data, StandIn(), found, QUICK)
    assert set(gain.by_condition) == {c.condition for c in data.conditions if c.holdout}
    assert gain.log_score == pytest.approx(sum(gain.by_condition.values()))
    assert gain.log_score > max(gain.null_95, 4.0) and gain.rmse_after < gain.rmse_before
    assert 0.6 < gain.coverage_90 <= 1.0
    assert [c.level for c in with_gain(found.result, gain).claims][:1] == ["claim"]
    weak = dataclasses.replace(gain, log_score=-1.0)
    assert with_gain(found.result, weak).claims[0].level == "named"


def test_a_later_experiment_that_agrees_makes_a_claim_strong() -> None:
    data, found = diagnosed(*HIDDEN)
    claimed = with_gain(found.result, held_out_gain(data, StandIn(), found, QUICK))
    assert confirmed(claimed, found.result).claims[0].level == "strong claim"
    assert confirmed(found.result, found.result).claims[0].level == "named"
    first = found.result.claims[0]
    far = dataclasses.replace(first.amplitude, ci90=(0.1, 0.2))
    other = dataclasses.replace(found.result, claims=(dataclasses.replace(first, amplitude=far),))
    assert confirmed(claimed, other).claims[0].level == "claim"


def test_no_gain_of_a_model_that_names_nothing() -> None:
    data, found = diagnosed("belt_speed", 0.0)
    with pytest.raises(InvalidValue, match="gain"):
        held_out_gain(data, StandIn(), found, QUICK)


def test_next_measurements_are_worth_their_cost() -> None:
    for amplitude in (HIDDEN[1], 0.0):
        _, found = diagnosed("belt_speed", amplitude)
        assert found.analysis is not None and found.measured is not None
        proposals = next_measurements(found.analysis, found.measured)
        worth = [p.information / p.cost for p in proposals]
        assert worth == sorted(worth, reverse=True) and len(proposals) <= 5
        assert all(p.information > 0.0 and p.cost > 0.0 and p.what for p in proposals)


def test_no_check_of_what_acts_on_no_condition_is_proposed() -> None:
    """A tachometer on the belt tells nothing of a pile."""
    found = diagnose(measured({}, piles_only=True), StandIn(), QUICK)
    assert found.analysis is not None and found.measured is not None
    checks = {p.kind.removeprefix("check:") for p in _checks(found.analysis.ranking, found.measured)}
    assert "cohesion" in checks and "weigh_gain" in checks
    assert not checks & {"belt_speed", "belt_track", "liner_wear", "deflector_tilt"}


def test_thin_data_are_refused_in_words() -> None:
    two = diagnose(measured({}, replicates=2), StandIn(), QUICK).result
    assert two.verdict == "refused" and "replicates" in two.sentences[0]
    data = measured({})
    one = diagnose(data.restricted(["P0"]), StandIn(), QUICK).result
    assert one.verdict == "refused" and "one training condition" in one.sentences[-1]


def test_without_scatter_or_a_common_observable_there_is_nothing_to_compare() -> None:
    data = measured({})
    still = DataSet(data.conditions, tuple(dataclasses.replace(o, value=1.0) for o in data.observations))
    refused = diagnose(still, StandIn(), QUICK).result
    assert refused.verdict == "refused" and "scatters" in refused.sentences[-1]
    with pytest.raises(InvalidValue, match="none that the model gives"):
        diagnose(data, Mute(), QUICK)


class Mute(StandIn):
    """A model that gives no observable of the tests."""

    def run(self, condition: Condition, settings: Sequence[Setting]) -> Outcomes:
        return Outcomes(
            {name: np.full(len(settings), np.nan) for name in super().run(condition, settings).values}
        )


def test_a_condition_that_the_model_cannot_represent_is_named() -> None:
    data = measured({})
    strange = [dataclasses.replace(c, material="slag") if c.condition == "P2" else c for c in data.conditions]
    with pytest.raises(BadDataSet, match=r"P2.*slag"):
        diagnose(DataSet(tuple(strange), data.observations), StandIn(), QUICK)


def test_a_plan_says_what_it_could_show() -> None:
    """The design's own finding: one repose angle names nothing; piles say nothing of the belt, a charge does."""
    data = measured({})
    piles = tuple(c for c in data.conditions if c.test == "pile")
    angle = identifiability(StandIn(), Plan(piles[:1], 4, frozenset(["angle"])), QUICK)
    assert {o.verdict for o in angle.effects} == {"silent"}
    plan = identifiability(StandIn(), Plan(piles, 4, None, CHARGES[:1]), QUICK)
    verdicts = {o.effect: o.verdict for o in plan.effects}
    assert verdicts["belt_speed"] == "silent" and verdicts["cohesion"] == "nameable"
    assert "belt_speed" in plan.adds["C0"]
    for outlook in plan.effects:
        if outlook.nameable_from is not None:
            assert outlook.detectable_from is not None and outlook.nameable_from >= outlook.detectable_from


def test_a_plan_needs_conditions_and_replicates() -> None:
    with pytest.raises(InvalidValue):
        Plan(())
    with pytest.raises(InvalidValue):
        Plan(CHARGES, 2)
    with pytest.raises(InvalidValue, match="at least one of C0"):
        identifiability(StandIn(), Plan(CHARGES, 4, frozenset(["angle"])), QUICK)


def test_the_cost_was_estimated_and_is_counted() -> None:
    data, found = diagnosed(*HIDDEN)
    estimate = estimated_runs(data.conditions, QUICK.known, QUICK.first_wave, QUICK.second_wave)
    assert estimate["emulator"] == 8 * (48 + 40)
    runs = found.result.as_dict()["cost"]["runs"]
    assert sum(estimate.values()) - estimate["refinement"] < runs <= sum(estimate.values())


class Stepping(StandIn):
    """The stand-in with too large a time step: a smaller one raises every angle by `shift` degrees."""

    def __init__(self, shift: float) -> None:
        super().__init__()
        self._shift = shift

    def run(self, condition: Condition, settings: Sequence[Setting]) -> Outcomes:
        values = dict(super().run(condition, settings).values)
        moved = np.array([dict(s.effects).get("self_time_step", 0.0) for s in settings]) * self._shift
        if "repose_angle_deg" in values:
            values["repose_angle_deg"] = values["repose_angle_deg"] + moved
        return Outcomes(values)


@pytest.mark.parametrize(("shift", "passes"), [(0.0, True), (4.0, False)])
def test_the_simulations_own_errors_come_first(shift: float, passes: bool) -> None:
    _, found = diagnosed(*HIDDEN)
    assert found.setup is not None and found.measured is not None and found.analysis is not None
    model, theta = found.setup.model, found.analysis.problem.theta
    outcomes = run_self_tests(Stepping(shift), library(), model, found.measured, theta, 5)
    by_id = {o.id: o for o in outcomes}
    assert by_id["self_time_step"].passed is passes
    assert passes or by_id["self_time_step"].cell.endswith("angle")
    assert len(outcomes) == 4


class Failing(StandIn):
    """Grains that hardly roll against anything make no pile, nor does now and then another run."""

    def run(self, condition: Condition, settings: Sequence[Setting]) -> Outcomes:
        found = super().run(condition, settings)
        lost = np.array([s.parameters[1] < 0.15 or s.seed % 11 == 0 for s in settings])
        return Outcomes({name: np.where(lost, np.nan, v) for name, v in found.values.items()}, found.surfaces)


def test_runs_that_make_no_pile_are_left_out() -> None:
    """Of a DEM some always fail; the verdict is that of the others."""
    data = measured(dict([HIDDEN]))
    found = diagnose(data, Failing(), QUICK)
    assert found.setup is not None
    for emulator in found.setup.model.emulators:
        assert 10 <= len(emulator.u) < QUICK.first_wave + QUICK.second_wave
        assert np.isfinite(emulator.left_out).all()
    assert [claim.effect for claim in found.result.claims] == ["belt_speed"]
    assert found.result.claims[0].amplitude.value == pytest.approx(HIDDEN[1], rel=0.3)
    gain = held_out_gain(data, Failing(), found, QUICK)
    assert np.isfinite(gain.log_score) and np.isfinite(gain.null_95)


class Flat(StandIn):
    """Never makes a pile, of any material."""

    def run(self, condition: Condition, settings: Sequence[Setting]) -> Outcomes:
        found = super().run(condition, settings)
        return Outcomes({name: np.full(len(settings), np.nan) for name in found.values})


def test_a_simulation_that_makes_no_pile_at_all_is_refused() -> None:
    with pytest.raises(InvalidValue):
        diagnose(measured({}), Flat(), QUICK)


def test_two_effects_have_the_sizes_that_they_have_beside_each_other() -> None:
    """Fitted alone, each takes over what the other does."""
    hidden = {"density": 0.15, "wide_psd": 0.3}
    analysis = diagnose(measured(hidden), StandIn(), QUICK).analysis
    assert analysis is not None
    known = [effect.id for effect in analysis.evidence.known.effects]
    both = [known.index(name) for name in hidden]
    fitted = analysis.evidence.together(both)
    assert dict(zip(hidden, fitted.mode.tolist(), strict=True)) == pytest.approx(hidden, rel=0.2)
    assert np.all(np.sqrt(np.diag(fitted.covariance)) < fitted.mode)
    alone = analysis.ranking.amplitude[both]
    assert np.all(alone > 1.25 * fitted.mode)


def test_what_would_be_beyond_the_possible_is_not_named() -> None:
    """A sample's median that is 2.2 times too large is a slip of a unit, not a bias of sampling."""
    found = diagnose(measured({"sample_bias": 1.2}), StandIn(), QUICK).result
    assert found.verdict == "unexplained" and not found.claims and found.unexplained
    assert found.also_possible[0].effect == "sample_bias"
    assert any("beyond what is possible (-0.5 to 0.5)" in sentence for sentence in found.sentences)


def test_a_reading_that_judges_nothing_is_told() -> None:
    """Of one replicate nobody knows the scatter; and an apex height that never varies has none."""
    data = measured(dict([HIDDEN]))
    kept = tuple(
        dataclasses.replace(o, value=0.3) if o.observable == "apex_height_m" else o
        for o in data.observations
        if o.observable != "bulk_density_kg_m3" or o.replicate == "r0"
    )
    told = diagnose(DataSet(data.conditions, kept), StandIn(), QUICK).result.sentences
    assert [s for s in told if "apex height" in s and "bulk density" in s and "Not used" in s]


def two_materials(replicates: Mapping[str, int]) -> DataSet:
    """Piles of coke and pellet, held out ones of both; `replicates` of the held-out conditions by material."""
    pellet = ("P1", "P3", "P5", "P7")
    conditions = tuple(
        dataclasses.replace(c, material="pellet" if c.condition in pellet else "coke") for c in PILES
    )
    data = measured_of(conditions, {"cohesion": 1.2})
    most = {c.condition: replicates.get(c.material, 0) if c.holdout else 4 for c in conditions}
    kept = tuple(o for o in data.observations if int(o.replicate[1:]) < most[o.condition])
    return DataSet(conditions, kept)


def test_held_out_piles_of_one_of_two_materials_judge() -> None:
    data = two_materials({"coke": 4})
    found = diagnose(data, StandIn(), QUICK)
    assert [c.effect for c in found.result.claims] == ["cohesion"]
    assert found.usable is not None and can_be_scored(found.usable, found)
    gain = held_out_gain(found.usable, StandIn(), found, QUICK)
    assert set(gain.by_condition) == {"P6"} and np.isfinite(gain.null_95)


@pytest.mark.parametrize("replicates", [{}, {"coke": 1}, {"coke": 2, "pellet": 1}])
def test_held_out_piles_that_were_set_aside_judge_nothing(replicates: Mapping[str, int]) -> None:
    found = diagnose(two_materials(replicates), StandIn(), QUICK)
    assert found.result.claims and found.usable is not None
    assert not can_be_scored(found.usable, found)
    assert any("named but not claimed" in sentence for sentence in found.result.sentences)
