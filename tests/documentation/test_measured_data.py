"""The page about measured data: it names what is read, and its example is taken."""

from __future__ import annotations

import re
from pathlib import Path

from service.domain.data_set.columns import (
    CONDITION_COLUMNS,
    NUMBERS_OF_A_CONDITION,
    OBSERVABLES_OF,
    OBSERVATION_COLUMNS,
    PROFILE_COLUMNS,
)
from service.domain.data_set.reading import read_data_set
from service.domain.data_set.suitability import suitability

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_the_page_names_every_column_and_observable_and_no_other() -> None:
    named = set(re.findall(r"`([a-z0-9_]+)`", (DOCS / "measured-data.md").read_text(encoding="utf-8")))
    for name in (*CONDITION_COLUMNS, *OBSERVATION_COLUMNS, *PROFILE_COLUMNS):
        assert name in named
    observables = {name for of_test in OBSERVABLES_OF.values() for name in of_test}
    assert {name for name in observables if not re.search(r"_\d\d$", name)} <= named
    units = re.compile(r"_(m|kg|s|deg|kg_m3|m_s|kg_s|percent)$")
    known = observables | set(NUMBERS_OF_A_CONDITION) | set(PROFILE_COLUMNS)
    assert {name for name in named if units.search(name)} <= known


def test_the_defaults_of_the_page_are_those_of_the_columns() -> None:
    page = (DOCS / "measured-data.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| `")]
    for name, quantity in NUMBERS_OF_A_CONDITION.items():
        (row,) = (line for line in rows if f"`{name}`" in line)
        if quantity.default is not None:
            assert f"{quantity.default:g}" in row.split("|")[4], name


def test_the_example_can_be_diagnosed_with_nothing_to_complain_of() -> None:
    judged = suitability(read_data_set(DOCS / "measurements" / "example"))
    assert not judged.is_refused
    assert judged.sentences == ()
