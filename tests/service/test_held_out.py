"""A held-out block opens once, whatever else of its data set was changed and uploaded again, on both databases."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

import pytest
from sqlalchemy import update

from service.db.models import DataSetRow, DiagnosisRow
from service.db.queries import Lease
from service.db.session import Database
from service.studies.open_held_out import open_held_out
from tests.builders.diagnoses import (
    CONDITIONS,
    OBSERVATIONS,
    a_data_set,
    a_diagnosis,
    data_set,
    job_of_diagnosis,
    tables,
)
from tests.builders.studies import claimed


def renamed(old: str, new: str, table: str = OBSERVATIONS) -> dict[str, str]:
    texts = tables()
    assert old in texts[table]
    return {**texts, table: texts[table].replace(old, new)}


def asked(database: Database, texts: Mapping[str, str]) -> tuple[int, Lease]:
    """A data set, and a running diagnosis of it."""
    number = a_data_set(database, texts)
    return number, claimed(database, job_of_diagnosis(database, a_diagnosis(database, number))).lease


def opened(database: Database, lease: Lease) -> bool:
    with database.writing() as session:
        return open_held_out(session, lease)


@pytest.mark.parametrize(
    "again",
    [
        renamed("small,r1,", "small,first,"),
        renamed("held,r1,", "held,first,"),
        renamed("small,pile,pellet,20,", "small,pile,pellet,21,", CONDITIONS),
        {name: text.replace("held,", "kept,") for name, text in tables().items()},
    ],
)
def test_the_same_block_in_another_data_set_stays_closed(database: Database, again: dict[str, str]) -> None:
    first, lease = asked(database, tables())
    other, late = asked(database, again)
    assert first != other
    assert opened(database, lease)
    assert not opened(database, late)
    assert opened(database, lease), "after a restart its owner may look again"
    assert data_set(database, other).opened_by is None


@pytest.mark.parametrize(
    "another",
    [renamed("held,pile,pellet,60,", "held,pile,pellet,61,", CONDITIONS), tables(held=("small",))],
)
def test_another_block_opens(database: Database, another: dict[str, str]) -> None:
    leases = [asked(database, texts)[1] for texts in (tables(), another)]
    assert all(opened(database, lease) for lease in leases)


def test_nothing_held_out_is_nothing_seen(database: Database) -> None:
    texts = [
        tables(held=()),
        {**tables(held=()), OBSERVATIONS: renamed("small,r1,", "small,a,")[OBSERVATIONS]},
    ]
    assert all(opened(database, asked(database, t)[1]) for t in texts)


def test_projects_do_not_close_each_others_blocks(database: Database) -> None:
    first, other = (asked(database, texts) for texts in (tables(), renamed("small,r1,", "small,a,")))
    with database.writing() as session:
        session.execute(update(DataSetRow).where(DataSetRow.id == other[0]).values(project="other"))
        session.execute(
            update(DiagnosisRow).where(DiagnosisRow.data_set_id == other[0]).values(project="other")
        )
    assert opened(database, first[1]) and opened(database, other[1])


def test_of_two_that_ask_at_once_one_looks(database: Database) -> None:
    names = ("one", "two", "three", "four")
    leases = [asked(database, renamed("small,r1,", f"small,{name},"))[1] for name in names]
    with ThreadPoolExecutor(len(leases)) as pool:
        found = list(pool.map(lambda lease: opened(database, lease), leases))
    assert sum(found) == 1
