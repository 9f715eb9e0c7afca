"""The stand-in keeps the promises of a Simulator: nested effects to the bit, scopes, seeds, scatter."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from service.domain.effects import library
from tests.worker.diagnosis.plants import CHARGES, PILES, THETA
from worker.diagnosis.simulator import Setting
from worker.diagnosis.stand_in import StandIn

CONDITIONS = (PILES[1], PILES[4], CHARGES[1], CHARGES[2])


def runs(condition: object, *effects: tuple[str, float], seeds: int = 3) -> dict[str, np.ndarray]:  # type: ignore[type-arg]
    settings = [Setting(THETA, effects, k) for k in range(seeds)]
    return dict(StandIn().run(condition, settings).values)  # type: ignore[arg-type]


@pytest.mark.parametrize("effect", library().effects, ids=lambda e: e.id)
def test_an_effect_is_nested_and_keeps_to_its_scope(effect) -> None:  # type: ignore[no-untyped-def]
    changed_somewhere = False
    for condition in CONDITIONS:
        plain = runs(condition)
        for key in effect.keys:
            zero, strong = runs(condition, (key, 0.0)), runs(condition, (key, effect.scale))
            assert all(np.array_equal(plain[name], zero[name]) for name in plain)
            same = all(np.array_equal(plain[name], strong[name]) for name in plain)
            assert same is not effect.acts_on(condition)
            changed_somewhere |= not same
    assert changed_somewhere


def test_runs_depend_on_the_seed_alone_and_not_on_the_batch() -> None:
    one = runs(PILES[0], seeds=5)
    other = StandIn().run(PILES[0], [Setting(THETA, (), 3)]).values
    assert all(one[name][3] == other[name][0] for name in one)
    assert len(set(one["repose_angle_deg"].tolist())) == 5


def test_the_name_and_the_split_of_a_condition_change_nothing() -> None:
    renamed = dataclasses.replace(PILES[0], condition="other", holdout=True)
    assert np.array_equal(runs(PILES[0])["apex_height_m"], runs(renamed)["apex_height_m"])


def test_scatter_of_the_angle_is_half_a_degree() -> None:
    """Two normals of .35 deg each, so sd .495; 4,000 runs know it to 1.2 %."""
    angles = runs(PILES[0], seeds=4000)["repose_angle_deg"]
    assert np.std(angles) == pytest.approx(0.495, rel=0.05)


def test_an_unknown_material_needs_its_sizes_and_density() -> None:
    strange = dataclasses.replace(PILES[0], material="slag")
    assert "slag" in (StandIn().cannot(strange) or "")
    with pytest.raises(ValueError, match="slag"):
        StandIn().run(strange, [Setting(THETA, (), 1)])
    given = dataclasses.replace(strange, psd=((0.02, 0.5), (0.04, 0.5)), particle_density_kg_m3=2500.0)
    assert StandIn().cannot(given) is None
    assert runs(given)["d50_on_base_m"].mean() == pytest.approx(np.sqrt(0.02 * 0.04), rel=0.1)
