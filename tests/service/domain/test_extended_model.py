"""Effects of a version of the model, and of one that extends another."""

from __future__ import annotations

import math
from typing import Any

import pytest

from service.domain.extended_model import amplitudes_of, extended


def effect(value: float, low: float, high: float, **more: Any) -> dict[str, Any]:
    return {"value": value, "unit": "1", "ci90": [low, high], "level": "named", **more}


def test_the_child_has_the_parents_effects_and_its_own() -> None:
    cohesion, density = effect(0.3, 0.2, 0.4, level="claim"), effect(-0.05, -0.08, -0.02)
    assert extended({"cohesion": cohesion}, {"density": density}) == {
        "cohesion": cohesion,
        "density": density,
    }


def test_an_amplitude_of_both_is_the_sum_with_the_interval_that_was_found() -> None:
    found = extended({"density": effect(0.1, 0.0, 0.2)}, {"density": effect(-0.04, -0.06, -0.02)})
    assert found["density"]["value"] == pytest.approx(0.06)
    assert found["density"]["ci90"] == pytest.approx([0.04, 0.08])


def test_directions_add_as_vectors() -> None:
    """0.03 along x and 0.04 along y are 0.05 between them."""
    along = ({"feed_offcentre@0": 0.03}, {"feed_offcentre@0": 0.0, "feed_offcentre@90": 0.04})
    parent = {"feed_offcentre": effect(0.03, 0.02, 0.04, along=along[0])}
    found = extended(parent, {"feed_offcentre": effect(0.04, 0.01, 0.07, along=along[1])})["feed_offcentre"]
    assert found["value"] == pytest.approx(math.hypot(0.03, 0.04))
    assert found["ci90"] == pytest.approx([0.02, 0.08])
    assert amplitudes_of("feed_offcentre", found) == {"feed_offcentre@0": 0.03, "feed_offcentre@90": 0.04}


def test_a_direction_that_was_not_kept_is_unknown() -> None:
    assert amplitudes_of("feed_offcentre", effect(0.03, 0.02, 0.04)) is None
    assert amplitudes_of("density", effect(0.03, 0.02, 0.04)) == {"density": 0.03}
