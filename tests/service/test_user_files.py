"""Files of users, damaged in every way that hypothesis finds: the documented error or a result, and nothing else.

A refused upload leaves no row and no file. What is absurdly large is refused in time and memory that grow with its
size, not with its square.
"""

from __future__ import annotations

import copy
import gzip
import io
import json
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import func, select

from service.db.models import DataSetRow, GeometryRow, StudyRow
from service.db.session import Database
from service.domain.data_set.cells import MOST_BAD_CELLS, BadDataSet, unit_factor
from service.domain.data_set.columns import CONDITIONS, OBSERVATIONS, PROFILE_COLUMNS, PROFILES
from service.domain.data_set.reading import data_set_from_json, data_set_from_tables
from service.domain.data_set.records import DataSet
from service.settings import Settings
from service.studies.export_study import export_study
from service.studies.study_file import content_hash
from tests.builders.diagnoses import tables
from tests.builders.mesh_files import FILES
from tests.builders.studies import a_finished_study

EXAMPLES = 60
many = settings(
    max_examples=EXAMPLES,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
# What breaks a parser more often than noise does.
NASTY = (
    *("", " ", "nan", "inf", "-0", "1e999", "1e-999", "1_000", "0x10", "1" * 5000, "٣", "1,5", "1;2", ":"),
    *(
        "\0",
        "\ufeff",
        "\ud800",
        "=1+1",
        '"',
        '"a',
        "\r",
        "\u2028",
        "a" * 140_000,
        "kg**9",
        "%",
        "°",
        "m/s*kg^-9",
    ),
)
cells = st.sampled_from(NASTY) | st.text(max_size=8) | st.floats().map(str) | st.integers().map(str)


def is_read_or_refused(read: Callable[[], DataSet]) -> None:
    try:
        data = read()
    except BadDataSet as error:
        refused = error
    else:
        assert data.conditions and data.observations
        return
    assert refused.cells
    assert str(refused)


@many
@given(
    edits=st.lists(st.tuples(st.sampled_from([CONDITIONS, OBSERVATIONS]), st.integers(0), cells), max_size=4),
    profile=st.lists(st.lists(cells, min_size=1, max_size=7), max_size=4),
)
def test_tables_with_odd_cells_are_read_or_refused(
    edits: list[tuple[str, int, str]], profile: list[list[str]]
) -> None:
    texts = tables()
    for name, place, cell in edits:
        lines = [line.split(",") for line in texts[name].splitlines()]
        row = lines[place % len(lines)]
        row[place // len(lines) % len(row)] = cell
        texts[name] = "\n".join(map(",".join, lines))
    if profile:
        texts[PROFILES] = "\n".join([",".join(PROFILE_COLUMNS), *map(",".join, profile)])
    is_read_or_refused(lambda: data_set_from_tables(texts))


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | cells,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(cells, inner, max_size=3),
    max_leaves=6,
)


@many
@given(
    conditions=json_values
    | st.lists(st.dictionaries(st.sampled_from(["condition", "test", "psd"]), json_values)),
    observations=json_values,
)
def test_json_with_odd_values_is_read_or_refused(conditions: Any, observations: Any) -> None:
    text = json.dumps({"conditions": conditions, "observations": observations})
    is_read_or_refused(lambda: data_set_from_json(text))


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        '{"conditions": ' + "[" * 900 + "]" * 900 + "}",
        '{"conditions": [{"test": ' + "1" * 5000 + "}]}",
    ],
    ids=["endless", "deep", "a number of 5,000 digits"],
)
def test_absurd_json_is_refused(text: str) -> None:
    with pytest.raises(BadDataSet):
        data_set_from_json(text)


@many
@given(
    unit=st.from_regex(
        r"[a-zA-Zµ°%]{1,6}(\^|\*\*)?-?[1-9]?( ?[*/ ] ?[a-zA-Zµ°%]{1,4}-?[1-9]?){0,3}", fullmatch=True
    )
)
def test_every_text_is_a_unit_or_none(unit: str) -> None:
    factor = unit_factor(unit, "kg")
    assert factor is None or factor > 0.0


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    "texts",
    [
        {OBSERVATIONS: "condition,replicate,observable,value,unit\n" + "x\n" * 300_000},
        {OBSERVATIONS: ",".join(map(str, range(300_000)))},
        {CONDITIONS: "condition,test,material\n" + "?,?,?\n" * 400},
        {f"{n}.csv": "" for n in range(50_000)},
    ],
    ids=["bad rows", "unknown columns", "bad conditions", "unknown tables"],
)
def test_a_table_of_nothing_but_mistakes_is_refused_with_some_of_them(texts: dict[str, str]) -> None:
    with pytest.raises(BadDataSet) as caught:
        data_set_from_tables({**tables(), **texts})
    assert 0 < len(caught.value.cells) <= 3 * (MOST_BAD_CELLS + 1)


@pytest.mark.timeout(60)
def test_as_many_replicates_of_one_value_as_a_table_may_have_are_read_in_time() -> None:
    """Looking for copies pair by pair would take hours."""
    texts = tables()
    head = texts[OBSERVATIONS].splitlines()[0]
    rows = [f"held,r{n},repose_angle_deg,25,deg," for n in range(20_000)]
    found = data_set_from_tables({**texts, OBSERVATIONS: "\n".join([head, *rows])})
    assert len(found.observations) == len(rows)


@pytest.fixture
def exported(sqlite_database: Database) -> dict[str, Any]:
    study_id = a_finished_study(sqlite_database)
    with sqlite_database.reading() as session:
        found = export_study(session, study_id, "0.1.0")
    assert found is not None
    return json.loads(json.dumps(found))


def rows_of(database: Database) -> tuple[int, ...]:
    with database.reading() as session:
        return tuple(
            session.scalar(select(func.count()).select_from(row)) or 0
            for row in (StudyRow, DataSetRow, GeometryRow)
        )


def damage(value: Any, path: list[int], odd: Any) -> Any:
    """`value` with `odd` in the place that `path` leads to."""
    if not path or not isinstance(value, dict | list) or not value:
        return odd
    keys = sorted(value) if isinstance(value, dict) else range(len(value))
    key = keys[path[0] % len(keys)]
    changed = copy.copy(value)
    changed[key] = damage(value[key], path[1:], odd)  # type: ignore[call-overload]
    return changed


def test_a_damaged_study_file_is_read_in_or_refused_and_then_leaves_nothing(
    client: TestClient, sqlite_database: Database, exported: dict[str, Any]
) -> None:
    @many
    @given(path=st.lists(st.integers(0, 50), min_size=1, max_size=6), odd=json_values)
    def send(path: list[int], odd: Any) -> None:
        file = {**exported, "study": damage(exported["study"], path, odd)}
        with suppress(ValueError):  # numbers that JSON does not have
            file["content_sha256"] = content_hash(file["study"])
        before = rows_of(sqlite_database)
        answer = client.post(
            "/v1/studies/import", content=json.dumps(file), headers={"Content-Type": "application/json"}
        )
        assert answer.status_code in (200, 201, 422), answer.text
        if answer.status_code == 422:
            assert answer.headers["content-type"] == "application/problem+json"
            assert rows_of(sqlite_database) == before
        else:
            # What was read in can be looked at: every page and export of it.
            number = answer.json()["id"]
            for address in ("/studies/{}", "/v1/studies/{}/export", "/v1/studies/{}/designs.parquet"):
                assert client.get(address.format(number)).status_code == 200, file

    send()


def zip_bomb() -> bytes:
    """50 MB of zeros in 50 kB."""
    into = io.BytesIO()
    with zipfile.ZipFile(into, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("conditions.csv", b"\0" * 50_000_000)
    return into.getvalue()


DEEP = b'{"name": ' + b"[" * 940 + b"]" * 940 + b"}"
BODIES = {
    "zip bomb": zip_bomb(),
    "gzip bomb": gzip.compress(b"\0" * 50_000_000),
    "deep": DEEP,
    "endless": b"[" * 500_000,
    "half a character": b'{"name": "\\ud800", "tables": {"\\ud800.csv": ""}, "\\udfff": 1}',
    "no text": b'{"name": "\\u0000", "tables": {"conditions.csv": "\\ud800,b", "observations.csv": "\\u0000"}}',
    "not UTF-8": b"\xff\xfe{\x00}",
    "long names": b'{"' + b"a" * 500_000 + b'": 1, "tables": {"' + b"b" * 300_000 + b'": ""}, "name": "x"}',
    "5,000 digits": b'{"name": ' + b"1" * 5_000 + b', "tables": {}}',
}
UPLOADS = (
    "/v1/measurements",
    "/v1/studies/import",
    "/v1/studies",
    "/v1/charges",
    "/v1/geometries?file_name=a.stl",
)


def files_in(folder: Path) -> set[str]:
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file() and "talus.db" not in path.name
    }


@pytest.mark.parametrize("kind", [None, "gzip"], ids=["plain", "said to be gzip"])
@pytest.mark.parametrize("name", BODIES)
def test_a_malformed_upload_is_a_clear_refusal_and_leaves_nothing(
    client: TestClient, sqlite_database: Database, settings: Settings, name: str, kind: str | None
) -> None:
    before = rows_of(sqlite_database), files_in(settings.data_dir)
    encoding = {} if kind is None else {"Content-Encoding": kind}
    for address in UPLOADS:
        is_mesh = "geometries" in address
        media_type = "application/octet-stream" if is_mesh else "application/json"
        headers = {"Content-Type": media_type, **encoding}
        answer = client.post(address, content=BODIES[name], headers=headers)
        assert 400 <= answer.status_code < 500, (address, answer.text[:300])
        assert answer.headers["content-type"] == "application/problem+json", address
        assert len(answer.content) < 100_000, "a refusal is no second upload"
        assert answer.json()["errors"], address
    assert (rows_of(sqlite_database), files_in(settings.data_dir)) == before


@pytest.mark.parametrize("address", UPLOADS)
def test_a_huge_upload_is_a_clear_refusal_and_leaves_nothing(
    sqlite_database: Database, tmp_path: Path, address: str
) -> None:
    from service.app import create_app

    small = Settings(
        data_dir=tmp_path, database_url=sqlite_database.url, max_body_bytes=1_000, max_import_bytes=20_000
    )
    with TestClient(create_app(small), raise_server_exceptions=False) as client:
        answer = client.post(address, content=b" " * 30_000, headers={"Content-Type": "application/json"})
    assert answer.status_code == 422
    assert "at most" in answer.json()["detail"]
    assert rows_of(sqlite_database) == (0, 0, 0)


@pytest.mark.parametrize(
    "name", ["%00.stl", "a%0A.stl", "..%2F..%2Fa.stl", "%F0%9F%92%A9.stl", "a.stl%00.png"]
)
def test_a_mesh_under_an_odd_name_is_stored_under_its_content_or_refused(
    client: TestClient, settings: Settings, name: str
) -> None:
    answer = client.post(
        f"/v1/geometries?file_name={name}",
        content=FILES["binary.stl"],
        headers={"Content-Type": "application/octet-stream"},
    )
    assert answer.status_code in (201, 422), answer.text
    for path in files_in(settings.data_dir):
        assert path.removeprefix("geometries/").removesuffix(".stl").isalnum(), path


def test_a_mesh_whose_size_is_no_number_is_refused(client: TestClient) -> None:
    content = FILES["box.obj"].replace(b"v 1 ", b"v 1e308 ").replace(b"v 0 ", b"v -1e308 ")
    answer = client.post(
        "/v1/geometries?file_name=a.obj",
        content=content,
        headers={"Content-Type": "application/octet-stream"},
    )
    assert answer.status_code == 422, answer.text
