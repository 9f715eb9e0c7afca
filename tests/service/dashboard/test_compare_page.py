"""Any two of a kind side by side: numbers with their noise, and refusals in words a reader understands."""

from __future__ import annotations

import re

import pytest
from fastapi.testclient import TestClient

from service.dashboard.comparison import Side, Table, Value, draw_outlines
from service.db.models import ModelVersionRow
from service.db.session import Database
from service.settings import Settings
from tests.builders import piles
from tests.builders.charges import a_summary, charges, finish_charge
from tests.builders.diagnoses import a_data_set, a_diagnosis
from tests.builders.studies import a_study, designs
from tests.service.dashboard.test_pages import check_page


def compared(client: TestClient, kind: str, a: object, b: object, status: int = 200) -> str:
    answer = client.get(f"/compare?kind={kind}&a={a}&b={b}")
    assert answer.status_code == status
    check_page(answer.text)
    return answer.text


def row_of(text: str, label: str) -> list[str]:
    """The cells of a number's row, as they are read."""
    for row in re.findall(r"<tr>(.*?)</tr>", text, flags=re.S):
        cells = [
            re.sub(r"<[^>]+>", "", cell).strip() for cell in re.findall(r"<t[hd].*?</t[hd]>", row, flags=re.S)
        ]
        if cells and cells[0] == label:
            return cells[1:]
    raise AssertionError(f"no row {label}")


def plain(value: float) -> str:
    return f"{value:g}"


@pytest.mark.parametrize(
    ("a", "b", "cells"),
    [
        # d = 3, its noise is sqrt(1 + 2.25) = 1.803, d is 1.66 of it; with half of the noise it is 3.3.
        (Value(1, 1.0), Value(4, 1.5), ("+3", "1.80278", "within the noise")),
        (Value(1, 0.5), Value(4, 0.75), ("+3", "0.901388", "stands out")),
        (Value(4, 0.5), Value(1, 0.0), ("−3", "0.5", "stands out")),
        (Value(2, 0.1), Value(2, 0.1), ("0", "0.141421", "within the noise")),
        (Value(1, None), Value(4, 0.75), ("+3", "–", "noise not known")),
        (Value(1, 0.5), Value(None), ("–", "–", "one has none")),
    ],
)
def test_a_difference_stands_beside_its_noise(a: Value, b: Value, cells: tuple[str, str, str]) -> None:
    table = Table(is_compared=True)
    table.add("x", "", [a, b], plain)
    (row,) = table.rows
    assert (row.difference, row.noise, row.word.text) == cells


def test_what_nobody_has_is_no_row_and_a_refused_table_tells_no_difference() -> None:
    table = Table(is_compared=False)
    table.add("none", "", [Value(None), Value(None)], plain)
    table.add("x", "", [Value(1, 0.1), Value(4, 0.1)], plain)
    assert [(row.first, row.difference, row.word.text) for row in table.rows] == [
        ("1\u00a0±\u00a00.1", "–", "not compared")
    ]


def test_outlines_have_one_scale_on_both_axes() -> None:
    side = Side("a", "/a", outline=([0.0, 0.5], [0.25, 0.0]))
    drawn = draw_outlines(side, Side("b", "/b", outline=([0.0, 0.4], [0.2, 0.0])))
    assert drawn is not None
    places = [tuple(map(float, place.split())) for place in re.split("[ML]", drawn.paths[0])[1:]]
    (x0, y0), (x1, y1) = places
    assert (x1 - x0) / 0.5 == pytest.approx((y1 - y0) / 0.25, rel=1e-3)
    assert draw_outlines(side, Side("b", "/b")) is None


def test_two_studies_of_one_goal(client: TestClient, sqlite_database: Database, settings: Settings) -> None:
    first = piles.a_finished_study(sqlite_database, certified=True, settings=settings)
    second = piles.a_searching_study(sqlite_database, settings)
    text = compared(client, "study", first, second)
    angle = row_of(text, "Repose angle of the scanned surface")
    assert angle[0] == "25.43°\u00a0±\u00a00.24°" and angle[1].startswith("25.40°")
    assert angle[2] == "−0.03°" and angle[4] == "within the noise"
    assert f'href="/studies/{first}"' in text and "data-sync" in text
    assert "in the terminal" not in text and "No differences" not in text


def test_studies_of_two_scales_stand_beside_each_other_without_a_difference(
    client: TestClient, sqlite_database: Database
) -> None:
    a, b = (a_study(sqlite_database, scale=scale) for scale in (4.0, 2.0))
    text = compared(client, "study", a, b)
    assert "coarse-grained by 4 and 2" in text and "studies of one scale only" in text
    assert row_of(text, "Simulations used")[2:] == ["–", "–", "not compared"]


def test_two_piles_of_a_study(client: TestClient, sqlite_database: Database, settings: Settings) -> None:
    study = piles.a_finished_study(sqlite_database, certified=True, settings=settings)
    first, second = designs(sqlite_database, study)[:2]
    text = compared(client, "design", first.id, second.id)
    angle = row_of(text, "Repose angle of the scanned surface")
    # Three seeds of the second design, 25.4, 25.6 and 25.3: their standard deviation is .153.
    assert angle[:3] == ["22.40°\u00a0±\u00a00.15°", "25.40°\u00a0±\u00a00.15°", "+3.00°"]
    assert angle[3:] == ["0.22°", "stands out"]
    assert 'class="outline first"' in text and f'data-scene="/designs/{first.id}/scene"' in text


def test_piles_of_two_rigs_are_not_compared(client: TestClient, sqlite_database: Database) -> None:
    studies = [a_study(sqlite_database, material=name, parallel=1) for name in ("pellet", "coke")]
    for study in studies:
        piles.add_pile(sqlite_database, study, 30.0)
    ids = [designs(sqlite_database, study)[0].id for study in studies]
    assert "different rigs (pellet and coke)" in compared(client, "design", *ids)


def test_two_charges_beside_the_scatter_of_their_series(
    client: TestClient, sqlite_database: Database, settings: Settings
) -> None:
    series = charges(sqlite_database, seeds=(1, 2))
    for number, height in zip(series, (1.5, 1.7), strict=True):
        finish_charge(sqlite_database, number, settings, far_height_m=height)
    (alone,) = charges(sqlite_database, charge="iron")
    waiting = compared(client, "charge", series[0], alone)
    assert (
        f"Charge {alone} has no results" in waiting and f"Charge {alone} ran with one seed alone" in waiting
    )
    other = charges(sqlite_database, charge="iron", seeds=(3, 4))
    for number, height in zip(other, (2.5, 2.6), strict=True):
        finish_charge(sqlite_database, number, settings, results=a_summary("iron"), far_height_m=height)
    text = compared(client, "charge", series[0], other[1])
    # The two seeds of each series: sd .141 and .0707; sqrt of the sum of their squares .158.
    far = row_of(text, "Far pile")
    assert [cell.replace("\u202f", " ") for cell in far[2:4]] == ["+1.10 m", "0.158 m"]
    assert far[4] == "stands out"


def test_two_versions_of_the_model(client: TestClient, sqlite_database: Database) -> None:
    diagnosis = a_diagnosis(sqlite_database, a_data_set(sqlite_database))
    effects = {"value": 0.10, "unit": "1", "ci90": [0.0671, 0.1329]}
    rows = [
        ModelVersionRow(name=name, diagnosis_id=diagnosis, base=base, effects=found)
        for name, base, found in (
            ("baseline+density", "demcore-paper-400", {"density": effects}),
            ("baseline", "demcore-paper-400", {}),
            ("elsewhere", "demcore-hertz-400", {}),
        )
    ]
    with sqlite_database.writing() as session:
        session.add_all(rows)
        session.flush()
        ids = [row.id for row in rows]
    text = compared(client, "model", ids[0], ids[1])
    # Half of the interval over 1.645 is .02.
    assert row_of(text, "density")[:2] == ["0.100\u00a0±\u00a00.0200", "0\u00a0±\u00a00"]
    assert row_of(text, "density")[4] == "stands out"
    assert "different simulators" in compared(client, "model", ids[0], ids[2])


def test_what_cannot_be_compared_is_told_on_the_page(client: TestClient, sqlite_database: Database) -> None:
    study = a_study(sqlite_database)
    assert "There are not two studies yet" in client.get("/compare").text
    assert "Both are the same study" in compared(client, "study", study, study)
    assert "There is no study 999" in compared(client, "study", study, 999, status=404)
    assert "There is no charge 8" in compared(client, "charge", 8, 9, status=404)
    assert "no ids" in compared(client, "design", "x", "-1")
    assert "no &lt;b&gt; to compare" in compared(client, "<b>", 1, 2)
    a_study(sqlite_database)
    offered = client.get("/compare?kind=study&a=1").text
    assert offered.count('<option value="2"') == 2 and '<option value="1" selected>' in offered
