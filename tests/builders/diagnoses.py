"""Measured tables for tests: piles of pellet, three replicates each, one condition held out."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from sqlalchemy import select

from service.db.models import DataSetRow, DiagnosisRow, JobRow
from service.db.session import Database
from service.domain.data_set.columns import CONDITION_COLUMNS, NOT_OF, OBSERVABLES_OF, OBSERVATION_COLUMNS
from service.domain.data_set.reading import data_set_from_tables
from service.domain.data_set.records import DataSet, Psd
from service.domain.diagnosis import DiagnosisSpec
from service.studies.create_diagnosis import create_diagnosis
from service.studies.store_data_set import store_data_set

CONDITIONS = "conditions.csv"
OBSERVATIONS = "observations.csv"
MASSES = {"small": 20.0, "middle": 45.0, "large": 80.0, "held": 60.0}


def tables(
    replicates: int = 3, held: Sequence[str] = ("held",), masses: Mapping[str, float] = MASSES, **more: str
) -> dict[str, str]:
    """The texts; `more`: further columns of every condition."""
    head = ["condition", "test", "material", "mass_kg", "holdout", *more]
    rows = [
        ",".join([name, "pile", "pellet", f"{mass:g}", str(int(name in held)), *more.values()])
        for name, mass in masses.items()
    ]
    observed = []
    for k, (name, mass) in enumerate(masses.items()):
        for i in range(replicates):
            noise = 0.37 * ((7 * i + 3 * k) % 5 - 2)
            observed.append(f"{name},r{i + 1},repose_angle_deg,{25.0 + noise:.3f},deg,")
            observed.append(f"{name},r{i + 1},mass_on_base_kg,{0.4 * mass * (1 + 0.01 * noise):.4f},kg,")
    return {
        CONDITIONS: "\n".join([",".join(head), *rows]) + "\n",
        OBSERVATIONS: "\n".join(["condition,replicate,observable,value,unit,sensor_sd", *observed]) + "\n",
    }


def a_data_set(database: Database, texts: Mapping[str, str] | None = None) -> int:
    """The id of a stored data set."""
    with database.writing() as session:
        return store_data_set(session, "lab", data_set_from_tables(dict(texts or tables())))[0].id


def a_diagnosis(database: Database, data_set: int, **changes: Any) -> int:
    """The id of a new diagnosis, with its job queued."""
    with database.writing() as session:
        return create_diagnosis(session, DiagnosisSpec(data_set, **changes))[0].id


def diagnosis(database: Database, diagnosis_id: int) -> DiagnosisRow:
    with database.reading() as session:
        return session.get_one(DiagnosisRow, diagnosis_id)


def data_set(database: Database, data_set_id: int) -> DataSetRow:
    with database.reading() as session:
        return session.get_one(DataSetRow, data_set_id)


def job_of_diagnosis(database: Database, diagnosis_id: int) -> str:
    with database.reading() as session:
        return session.scalars(select(JobRow.id).where(JobRow.diagnosis_id == diagnosis_id)).one()


def as_tables(data: DataSet) -> dict[str, str]:
    """A data set as the CSV texts that an engineer would upload: without what a condition's test has not."""
    columns = list(CONDITION_COLUMNS)
    rows = []
    for c in data.conditions:
        given = {**asdict(c), "holdout": int(c.holdout), "psd": _sizes(c.psd)}
        ignored = {*NOT_OF[c.test], *([] if c.removal == "lift" else ["lift_speed_m_s"])}
        rows.append(["" if given[name] is None or name in ignored else str(given[name]) for name in columns])
    units = {name: quantity.unit for test in OBSERVABLES_OF.values() for name, quantity in test.items()}
    observed = [
        [o.condition, o.replicate, o.observable, repr(o.value), units[o.observable],
         "" if o.sensor_sd is None else repr(o.sensor_sd)]
        for o in data.observations
    ]  # fmt: skip
    return {CONDITIONS: _csv(columns, rows), OBSERVATIONS: _csv(list(OBSERVATION_COLUMNS), observed)}


def _sizes(psd: Psd | None) -> str | None:
    return None if psd is None else ";".join(f"{size!r}:{share!r}" for size, share in psd)


def _csv(columns: list[str], rows: list[list[str]]) -> str:
    text = io.StringIO()
    csv.writer(text).writerows([columns, *rows])
    return text.getvalue()
