"""A study's designs as one table, in SI units unless a name says otherwise, as CSV and as Parquet.

One definition of the columns for both. A column is wholly numbers, whole numbers or texts; None where a design
has no such value.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from arro3.core import Array, DataType, Table
from arro3.io import write_parquet

from service.db.read_models import DesignView, StudyPage

# What a spreadsheet takes for the start of a formula (OWASP, "CSV injection").
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")


@dataclass(frozen=True)
class Column:
    """`kind`: float, int or str. A number outside SI says so in its name."""

    name: str
    kind: type
    values: Sequence[Any]


DesignTable = Sequence[Column]


def design_table(page: StudyPage, wall_s: Mapping[str, float]) -> DesignTable:
    """A row for each design in the order of the numbers. `wall_s`: the time of all attempts, by job."""
    views = page.designs
    rows = [view.design for view in views]
    return [
        Column("number", int, [row.number for row in rows]),
        Column("state", str, [row.state.value for row in rows]),
        Column("verdict", str, [row.verdict.value if row.verdict else None for row in rows]),
        Column("origin", str, [row.origin for row in rows]),
        Column("scale", float, [row.scale for row in rows]),
        Column("seed", int, [row.seed for row in rows]),
        *(Column(name, float, [row.x.get(name) for row in rows]) for name in page.study.spec["variables"]),
        *_by_name("", [row.responses for row in rows]),
        Column("angle_standard_error_deg", float, [row.angle_sd_deg for row in rows]),
        *_by_name("predicted_", [row.prediction for row in rows]),
        Column("acquisition", float, [row.acquisition for row in rows]),
        Column("reason", str, [row.reason for row in rows]),
        Column("failure_class", str, [row.failure_class for row in rows]),
        Column("failure_text", str, [row.failure_text for row in rows]),
        Column("wall_s", float, [_wall(view, wall_s) for view in views]),
    ]


def _wall(view: DesignView, wall_s: Mapping[str, float]) -> float | None:
    return None if view.job is None else wall_s.get(view.job.id)


def _by_name(prefix: str, records: Sequence[Mapping[str, Any] | None]) -> list[Column]:
    """A column for each number that any of the records has, nested ones with their names joined."""
    flat = [_numbers(prefix, record or {}) for record in records]
    names = dict.fromkeys(name for record in flat for name in record)
    return [Column(name, float, [record.get(name) for record in flat]) for name in names]


def _numbers(prefix: str, record: Mapping[str, Any]) -> dict[str, float]:
    found = dict[str, float]()
    for name, value in record.items():
        if isinstance(value, Mapping):
            found |= _numbers(f"{prefix}{name}_", value)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            found[f"{prefix}{name}"] = float(value)
    return found


def to_csv(table: DesignTable) -> bytes:
    """RFC 4180 in UTF-8 with a header. Numbers as Python writes them, so that they read back the same."""
    out = io.StringIO(newline="")
    writer = csv.writer(out)
    writer.writerow([escape_formula(column.name) for column in table])
    for cells in zip(*(column.values for column in table), strict=True):
        writer.writerow([escape_formula(cell) if isinstance(cell, str) else cell for cell in cells])
    return out.getvalue().encode()


def escape_formula(text: str) -> str:
    """An apostrophe before what a spreadsheet would otherwise run."""
    return f"'{text}" if text.startswith(FORMULA_STARTS) else text


def to_parquet(table: DesignTable) -> bytes:
    """The same columns with their types."""
    kinds = {float: DataType.float64(), int: DataType.int64(), str: DataType.string()}
    arrays = [Array(list(column.values), kinds[column.kind]) for column in table]
    out = io.BytesIO()
    write_parquet(Table.from_arrays(arrays, names=[column.name for column in table]), out)
    return out.getvalue()
