"""The parts of a study's request: what to reach, what to vary, what is known already. Only shapes."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from service.domain.errors import InvalidValue
from service.domain.observables import OBSERVABLES
from service.domain.search_space import PARAMETERS
from service.domain.study import TableRow

STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
MOST_ROWS = 1_000

ModelVersion = Annotated[
    str | None,
    Field(description="name of a version that a diagnosis extended; default: the baseline without effects"),
]
Moisture = Annotated[float, Field(description="of the burden; only a model version's cohesion feels it")]
Window = Annotated[list[float] | None, Field(min_length=2, max_length=2)]


class ObjectiveBody(BaseModel):
    """The repose angle to reach. Left out: the material's own angle and window."""

    model_config = STRICT

    target_deg: Annotated[float | None, Field(description="default: the material's")] = None
    window_deg: Annotated[
        list[float] | None,
        Field(min_length=2, max_length=2, description="default: the material's, moved along with the target"),
    ] = None
    tolerance_deg: Annotated[float, Field(description="expected miss that the certificate allows")] = 0.5


class ResponseBody(BaseModel):
    """One measured number to reach, in the unit that its name carries."""

    model_config = STRICT

    observable: Annotated[str, Field(description="one of " + ", ".join(OBSERVABLES), examples=["angle_deg"])]
    target: Annotated[float | None, Field(description="angle_deg: the material's; else required")] = None
    window: Annotated[Window, Field(description="default: the target and twice the tolerance about it")] = (
        None
    )
    tolerance: Annotated[float | None, Field(description="angle_deg: .5; else 5 % of the target")] = None
    uncertainty: Annotated[float, Field(description="standard deviation of the lab's value")] = 0.0


class VariableBody(BaseModel):
    """The range of one searched parameter. Left out: its default."""

    model_config = STRICT

    lower: float | None = None
    upper: float | None = None
    step: Annotated[
        float | None,
        Field(
            description="resolution of the designs; null: none. Default .01, none where that is too coarse"
        ),
    ] = 0.01


class CoarseBody(BaseModel):
    """Cheap runs with larger particles before the first design; they cost no budget."""

    model_config = STRICT

    scale: Annotated[float, Field(description="larger than the study's")]
    runs: Annotated[int, Field(description="3 to 200")] = 6


class TableRowBody(BaseModel):
    """A design of one's own; with its results it is known, without them the strategy `table` runs it."""

    model_config = STRICT

    x: dict[str, float]
    results: Annotated[dict[str, float] | None, Field(description="by observable")] = None

    def to_row(self) -> TableRow:
        return TableRow(self.x, self.results)


def rows_of_csv(text: str) -> tuple[TableRow, ...]:
    """A table with a header: a column for each variable, and one for each observable that is known.

    A row without any result is a design to run. Raises InvalidValue, naming line and column.
    """
    lines = list(csv.reader(io.StringIO(text.removeprefix("\ufeff"), newline="")))
    if not lines or not lines[0]:
        raise InvalidValue("table_csv", "nothing", "a header with the names of the variables")
    header = [name.strip() for name in lines[0]]
    for name in header:
        if name not in PARAMETERS and name not in OBSERVABLES:
            raise InvalidValue("table_csv.header", name, "a parameter or an observable")
        if header.count(name) > 1:
            raise InvalidValue("table_csv.header", name, "each column once")
    rows = [
        (number, cells) for number, cells in enumerate(lines[1:], start=2) if any(c.strip() for c in cells)
    ]
    if len(rows) > MOST_ROWS:
        raise InvalidValue("table_csv", f"{len(rows)} rows", f"at most {MOST_ROWS} rows")
    return tuple(_row(number, header, cells) for number, cells in rows)


def _row(number: int, header: Sequence[str], cells: Sequence[str]) -> TableRow:
    if len(cells) != len(header):
        raise InvalidValue(
            f"table_csv.{number}", f"{len(cells)} cells", f"{len(header)} cells, as the header has"
        )
    values = {
        name: _number(f"table_csv.{number}.{name}", cell)
        for name, cell in zip(header, cells, strict=True)
        if cell.strip()
    }
    results = {name: value for name, value in values.items() if name in OBSERVABLES}
    return TableRow({name: value for name, value in values.items() if name in PARAMETERS}, results or None)


def _number(field: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InvalidValue(field, cell, "a finite number with a decimal point")
    return value
