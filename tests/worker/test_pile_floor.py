"""The floor of the DEM's piles: estimated from effect-free pairs, kept in a file, scaled to a base, or assumed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from service.domain.data_set.records import Condition
from service.domain.errors import InvalidValue
from tests.diagnosis.hider import effect_free
from worker import pile_floor
from worker.diagnosis.floor import KEYS, Floor
from worker.diagnosis.stand_in import StandIn
from worker.estimate_floor import _keep, estimate, lines
from worker.pile_floor import ASSUMED, LENGTHS, PileFloor, assumed, from_record

# Few grains enough to be simulated at their real size.
LUMPS = ((0.05, 1.0),)
PILE = Condition("lab", "pile", "pellet", 40.0, base_diameter_m=0.6, psd=LUMPS)
ANGLE, TOE = KEYS.index(("pile", "angle")), KEYS.index(("pile", "toe"))


@pytest.fixture(scope="module")
def estimated() -> PileFloor:
    """Between the analytic truth and the stand-in, from piles alone."""
    data = [d.restricted(c.condition for c in d.conditions if c.test == "pile") for d in effect_free(6, 4711)]
    return estimate(data, StandIn(), wave=32)


def test_it_is_coherent_and_positive(estimated: PileFloor) -> None:
    for table in (estimated.floor.shared, estimated.floor.own):
        assert np.linalg.eigvalsh(table).min() > -1e-9
    shared = estimated.floor.shared
    off = shared - np.diag(np.diag(shared))
    # Two worlds that differ in laws differ in many summaries at once.
    assert np.abs(off).max() > 0.0
    assert len(lines(estimated)) == sum(test == "pile" for test, _ in KEYS)


def test_lengths_grow_with_the_base_and_few_pairs_widen(estimated: PileFloor) -> None:
    small, large = estimated.on(0.3), estimated.on(0.6)
    sd = [np.sqrt(np.diag(f.shared)) for f in (small, large)]
    for k, (_, name) in enumerate(KEYS):
        assert sd[1][k] == pytest.approx(sd[0][k] * (2.0 if name in LENGTHS else 1.0))
    plain = estimated.floor.shared[ANGLE, ANGLE]
    assert small.shared[ANGLE, ANGLE] == pytest.approx(plain * 6 / 4)  # t with 6 degrees of freedom


def test_what_is_kept_comes_back(estimated: PileFloor, tmp_path: Path) -> None:
    path = tmp_path / "floor.json"
    _keep(path, "paper", estimated.as_record())
    _keep(path, "hertz_mindlin", estimated.as_record())
    found = json.loads(path.read_text())["contact_models"]
    assert sorted(found) == ["hertz_mindlin", "paper"]
    again = from_record(found["paper"])
    assert again.pairs == estimated.pairs
    np.testing.assert_allclose(again.floor.own, estimated.floor.own, rtol=1e-4, atol=1e-12)


def test_a_floor_of_few_pairs_is_none() -> None:
    nothing = np.zeros((len(KEYS), len(KEYS)))
    with pytest.raises(InvalidValue, match="at least 4"):
        PileFloor(Floor(nothing, nothing), 0.3, 3)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"material": "coke", "psd": None, "base_diameter_m": None}, "of coke"),
        ({"psd": None}, "of grains 2.83 times"),
        ({"psd": LUMPS}, ""),
    ],
)
def test_elsewhere_the_floor_is_no_smaller_than_assumed(
    monkeypatch: pytest.MonkeyPatch, estimated: PileFloor, changed: dict[str, object], words: str
) -> None:
    """Estimated on pellets of their real size; coke, and grains simulated coarser, nobody has compared."""
    tight = Floor(estimated.floor.shared / 1e4, estimated.floor.own / 1e4)
    of_pellets = replace(estimated, floor=tight, materials=("pellet",))
    monkeypatch.setattr(pile_floor, "_stored", lambda: {"hertz_mindlin": of_pellets})
    there = replace(PILE, **changed)
    found = pile_floor.pile_floor("hertz_mindlin", (PILE, there), 320)
    assert words in found.sentence and bool(words) == bool(found.sentence)
    sd = np.sqrt(found.floor.shared[ANGLE, ANGLE])
    assert (sd >= ASSUMED["angle"] * (1.0 - 1e-9)) == bool(words)
    assert np.linalg.eigvalsh(found.floor.shared).min() > -1e-9


def test_a_contact_model_that_was_never_compared_says_so(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, estimated: PileFloor
) -> None:
    path = tmp_path / "floor.json"
    _keep(path, "hertz_mindlin", estimated.as_record())
    monkeypatch.setattr(pile_floor, "FILE", path)
    pile_floor._stored.cache_clear()
    try:
        of_pellets = replace(estimated, materials=("pellet",))
        _keep(path, "hertz_mindlin", of_pellets.as_record())
        assert pile_floor.pile_floor("hertz_mindlin", (PILE,), 320).sentence == ""
        found = pile_floor.pile_floor("paper", (PILE,), 320)
    finally:
        pile_floor._stored.cache_clear()
    assert "never estimated for paper contacts" in found.sentence
    sd = np.sqrt(np.diag(found.floor.shared))
    assert sd[ANGLE] == pytest.approx(ASSUMED["angle"])
    assert sd[TOE] == pytest.approx(ASSUMED["toe"] * 0.3 / 0.375)
    assert assumed().on(0.375).shared[TOE, TOE] == pytest.approx(ASSUMED["toe"] ** 2)
