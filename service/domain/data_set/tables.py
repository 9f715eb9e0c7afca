"""Rows of a table as text, from a CSV file or from the lists of one JSON."""

from __future__ import annotations

import csv
import io
import json
import stat
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from service.domain.data_set.cells import BadCell, BadDataSet, Complaints

LARGEST_FILE_BYTES = 64 * 2**20
MOST_ROWS = {"conditions": 500, "observations": 200_000, "profiles": 1_000_000}


class Row(NamedTuple):
    """Cells by column, stripped; an absent column is an empty cell."""

    number: int
    cells: Mapping[str, str]

    def get(self, column: str) -> str:
        return self.cells.get(column, "")


class Layout(NamedTuple):
    """What a table is called, the columns it may have and those it must have."""

    table: str
    columns: Sequence[str]
    required: Sequence[str]


def read_file(path: Path) -> str:
    """The text of a file. Raises BadDataSet where it is missing, too large or not UTF-8."""
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):  # a pipe or a device may never end
            raise _whole_file(path, "no regular file", "a file")
        if found.st_size > LARGEST_FILE_BYTES:
            raise _whole_file(path, f"{found.st_size} bytes", f"at most {LARGEST_FILE_BYTES} bytes")
        return path.read_bytes().decode("utf-8-sig")
    except (FileNotFoundError, NotADirectoryError):
        raise _whole_file(path, "no such file", "a file of that name") from None
    except UnicodeDecodeError as error:
        raise _whole_file(path, f"byte {error.start}: {error.reason}", "text in UTF-8") from None
    except OSError as error:
        raise _whole_file(path, error.strerror or str(error), "a readable file") from None


def _whole_file(path: Path, value: str, allowed: str) -> BadDataSet:
    return BadDataSet([BadCell(path.name, None, "", value, allowed)])


def rows_of_csv(text: str, layout: Layout, complaints: Complaints) -> list[Row]:
    """All rows with a cell in them; wrong headers and rows of a wrong length are complained of."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    found: list[Row] = []
    try:
        header = [name.strip() for name in next(reader, [])]
        _check_header(header, layout, complaints)
        if complaints.cells:
            return []
        for cells in reader:
            if not any(cell.strip() for cell in cells):
                continue
            if len(cells) != len(header):
                allowed = f"{len(header)} cells, as the header has"
                complaints.add(reader.line_num, "", f"{len(cells)} cells", allowed)
                continue
            stripped = (cell.strip() for cell in cells)
            found.append(Row(reader.line_num, dict(zip(header, stripped, strict=True))))
            if len(found) > MOST_ROWS[layout.table]:
                complaints.add(None, "", "more rows", f"at most {MOST_ROWS[layout.table]} rows")
                return []
    except csv.Error as error:
        complaints.add(reader.line_num, "", str(error), "comma-separated values")
    return found


def _check_header(header: list[str], layout: Layout, complaints: Complaints) -> None:
    if not header:
        complaints.add(1, "", "an empty file", f"a header with {', '.join(layout.required)}")
        return
    for name, count in Counter(header).items():
        if count > 1:
            complaints.add(1, name, f"{count} columns", "each column once")
        if name not in layout.columns:
            complaints.add(1, name, "an unknown column", ", ".join(layout.columns))
    for name in layout.required:
        if name not in header:
            complaints.add(1, name, "no such column", "a column of that name")


def lists_of_json(text: str, file: str) -> Mapping[str, object]:
    """The members of one JSON object. Raises BadDataSet where it is not one."""
    try:
        members = json.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError alone: a number of over 4,300 digits
        raise BadDataSet([BadCell(file, None, "", str(error), "JSON")]) from None
    if not isinstance(members, dict):
        raise BadDataSet([BadCell(file, None, "", type(members).__name__, "an object of tables")])
    unknown = sorted(set(members) - set(MOST_ROWS))
    if unknown:
        allowed = ", ".join(MOST_ROWS)
        complaints = Complaints(file)
        for name in unknown:
            complaints.add(None, name, "an unknown table", allowed)
        raise BadDataSet(complaints.cells)
    return members


def rows_of_list(given: object, layout: Layout, complaints: Complaints) -> list[Row]:
    """Rows of a JSON list of objects, their values as text; null is an empty cell."""
    if not isinstance(given, list):
        complaints.add(None, "", type(given).__name__, "a list of objects")
        return []
    if len(given) > MOST_ROWS[layout.table]:
        complaints.add(None, "", f"{len(given)} rows", f"at most {MOST_ROWS[layout.table]} rows")
        return []
    found = []
    for number, item in enumerate(given):
        if not isinstance(item, dict):
            complaints.add(number, "", type(item).__name__, "an object")
            continue
        for name in item:
            if name not in layout.columns:
                complaints.add(number, str(name), "an unknown column", ", ".join(layout.columns))
        found.append(Row(number, {name: _as_text(value) for name, value in item.items()}))
    return found


def _as_text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "1" if value else "0"
    if isinstance(value, list | dict):
        return "[...]" if isinstance(value, list) else "{...}"  # neither a name nor a number, however deep
    return value.strip() if isinstance(value, str) else repr(value)
