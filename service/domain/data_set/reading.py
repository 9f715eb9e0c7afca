"""A data set from a folder of CSV tables or from one JSON with the same names; every bad cell is named.

Row by row here, across rows in copies.py. Values in another unit of the same kind are converted (pint).
"""

from __future__ import annotations

import re
from pathlib import Path

from service.domain.data_set.cells import (
    MOST_BAD_CELLS,
    NAME_ALLOWED,
    PSD_ALLOWED,
    BadCell,
    BadDataSet,
    Complaints,
    convert,
    parse_name,
    parse_number,
    parse_psd,
    units_allowed,
)
from service.domain.data_set.columns import (
    CONDITION_COLUMNS,
    CONDITIONS,
    NUMBERS_OF_A_CONDITION,
    OBSERVABLES_OF,
    OBSERVATION_COLUMNS,
    OBSERVATIONS,
    PROFILE_COLUMNS,
    PROFILE_NUMBERS,
    PROFILES,
    REMOVALS,
    REQUIRED_OF_A_CONDITION,
    REQUIRED_OF_AN_OBSERVATION,
    TESTS,
    Quantity,
)
from service.domain.data_set.copies import copied_replicates, copied_scans
from service.domain.data_set.records import Condition, DataSet, Observation, Profile
from service.domain.data_set.tables import (
    Layout,
    Row,
    lists_of_json,
    read_file,
    rows_of_csv,
    rows_of_list,
)

_LAYOUTS = {
    CONDITIONS: Layout("conditions", CONDITION_COLUMNS, REQUIRED_OF_A_CONDITION),
    OBSERVATIONS: Layout("observations", OBSERVATION_COLUMNS, REQUIRED_OF_AN_OBSERVATION),
    PROFILES: Layout("profiles", PROFILE_COLUMNS, PROFILE_COLUMNS),
}
Parsed = tuple[list[Row], Complaints]


def read_data_set(path: Path, planned: bool = False) -> DataSet:
    """Of a folder with conditions.csv, observations.csv and perhaps profiles.csv, or of one JSON file.

    `planned`: the folder's tests may still lie ahead, with conditions.csv alone. Raises BadDataSet with every cell
    that is wrong.
    """
    if not path.is_dir():
        return data_set_from_json(read_file(path), path.name)
    may_lack = (PROFILES, OBSERVATIONS) if planned else (PROFILES,)
    names = [name for name in _LAYOUTS if name not in may_lack or (path / name).exists()]
    return data_set_from_tables({name: read_file(path / name) for name in names}, planned)


def data_set_from_tables(texts: dict[str, str], planned: bool = False) -> DataSet:
    """Of the texts of the tables by file name (as an upload brings them), where it is `planned` perhaps of the
    conditions alone. Raises BadDataSet."""
    unknown = [name for name in texts if name not in _LAYOUTS]
    required = (CONDITIONS,) if planned and PROFILES not in texts else (CONDITIONS, OBSERVATIONS)
    missing = [name for name in required if name not in texts]
    wrong = [
        BadCell(name, None, "", "an unknown table", ", ".join(_LAYOUTS)) for name in unknown[:MOST_BAD_CELLS]
    ]
    wrong += [BadCell(name, None, "", "no such file", "a file of that name") for name in missing]
    if wrong:
        raise BadDataSet(wrong)
    parsed = {}
    for name, text in texts.items():
        complaints = Complaints(name)
        parsed[name] = (rows_of_csv(text, _LAYOUTS[name], complaints), complaints)
    return _build(parsed)


def data_set_from_json(text: str, file: str = "data_set.json") -> DataSet:
    """Of one JSON object with the lists conditions, observations and perhaps profiles. Raises BadDataSet."""
    members = lists_of_json(text, file)
    parsed = {}
    for name, layout in _LAYOUTS.items():
        if layout.table in members or name != PROFILES:
            complaints = Complaints(f"{file}:{layout.table}")
            rows = rows_of_list(members.get(layout.table), layout, complaints)
            parsed[name] = (rows, complaints)
    return _build(parsed)


def _build(parsed: dict[str, Parsed]) -> DataSet:
    conditions = _conditions(*parsed[CONDITIONS])
    known = {c.condition: c for c in conditions}
    # A row whose condition is itself wrong is not blamed for it a second time.
    named = {row.get("condition") for row in parsed[CONDITIONS][0]}
    is_measured = OBSERVATIONS in parsed
    observations, places = _observations(*parsed[OBSERVATIONS], known, named) if is_measured else ([], {})
    profiles, scanned = _profiles(*parsed[PROFILES], known, named) if PROFILES in parsed else ([], {})
    for place, text in copied_replicates(observations):
        parsed[OBSERVATIONS][1].add(places[place], "replicate", place[1], text)
    for place, text in copied_scans(profiles):
        parsed[PROFILES][1].add(scanned[place], "replicate", place[1], text)
    wrong = [cell for _, found in parsed.values() for cell in found.cells]
    if wrong:
        raise BadDataSet(wrong)
    return DataSet(tuple(conditions), tuple(observations), tuple(profiles))


def _conditions(rows: list[Row], complaints: Complaints) -> list[Condition]:
    if not rows and not complaints.cells:
        complaints.add(None, "", "no rows", "at least one condition")
    found: list[Condition] = []
    seen: set[str] = set()
    for row in rows:
        before = len(complaints.cells)
        name = row.get("condition")
        if name in seen:
            complaints.add(row.number, "condition", name, "each condition once")
        seen.add(name)
        values = _texts(row, complaints) | _numbers(row, complaints)
        if len(complaints.cells) == before:
            found.append(Condition(**values))  # type: ignore[arg-type]
    return found


def _texts(row: Row, complaints: Complaints) -> dict[str, object]:
    """The cells of a condition that are no numbers."""
    for column in ("condition", "material"):
        if parse_name(row.get(column)) is None:
            complaints.add(row.number, column, row.get(column), NAME_ALLOWED)
    test, removal = row.get("test"), row.get("removal") or REMOVALS[0]
    if test not in TESTS:
        complaints.add(row.number, "test", test, " or ".join(TESTS))
    if removal not in REMOVALS:
        complaints.add(row.number, "removal", removal, " or ".join(REMOVALS))
    holdout = row.get("holdout") or "0"
    if holdout not in ("0", "1"):
        complaints.add(row.number, "holdout", holdout, "0 or 1")
    psd = parse_psd(row.get("psd")) if row.get("psd") else None
    if row.get("psd") and psd is None:
        complaints.add(row.number, "psd", row.get("psd"), PSD_ALLOWED)
    names = {"condition": row.get("condition"), "test": test, "material": row.get("material")}
    return {**names, "removal": removal, "holdout": holdout == "1", "psd": psd}


def _numbers(row: Row, complaints: Complaints) -> dict[str, object]:
    """The numbers of a condition that are given; the others keep their defaults."""
    found: dict[str, object] = {}
    for column, quantity in NUMBERS_OF_A_CONDITION.items():
        if row.get(column):
            found[column] = _number(row, column, quantity, complaints)
        elif column in REQUIRED_OF_A_CONDITION:
            complaints.add(row.number, column, "", quantity.allowed)
    return found


def _number(row: Row, column: str, quantity: Quantity, complaints: Complaints) -> float | None:
    value = parse_number(row.get(column))
    if value is None or not quantity.allows(value):
        complaints.add(row.number, column, row.get(column), quantity.allowed)
        return None
    return value


def _check_condition(row: Row, named: set[str], complaints: Complaints) -> None:
    if named and row.get("condition") not in named:  # a table without rows was complained of itself
        complaints.add(row.number, "condition", row.get("condition"), f"a condition of {CONDITIONS}")
    if parse_name(row.get("replicate")) is None:
        complaints.add(row.number, "replicate", row.get("replicate"), NAME_ALLOWED)


Place = tuple[str, str]


def _observations(
    rows: list[Row], complaints: Complaints, known: dict[str, Condition], named: set[str]
) -> tuple[list[Observation], dict[Place, int]]:
    """Observations, and the first row of each replicate."""
    if not rows and not complaints.cells:
        complaints.add(None, "", "no rows", "at least one observation")
    found: list[Observation] = []
    places: dict[Place, int] = {}
    seen: dict[tuple[str, ...], int] = {}
    for row in rows:
        _check_condition(row, named, complaints)
        key = (row.get("condition"), row.get("replicate"), row.get("observable"))
        if key in seen:
            complaints.add(row.number, "observable", key[2], f"once a replicate; row {seen[key]} has it too")
            continue
        seen[key] = row.number
        places.setdefault(key[:2], row.number)
        condition = known.get(key[0])
        if condition is not None:
            found += _observation(row, condition, complaints)
    return found, places


def _observation(row: Row, condition: Condition, complaints: Complaints) -> list[Observation]:
    """The row's observation, or nothing where it is wrong or its value is an empty cell (missing is normal)."""
    observables = OBSERVABLES_OF[condition.test]
    name, unit = row.get("observable"), row.get("unit")
    quantity = observables.get(name)
    if quantity is None:
        allowed = f"an observable of a {condition.test}: {_brief(list(observables))}"
        complaints.add(row.number, "observable", name, allowed)
        return []
    if convert(1.0, unit or "none", quantity) is None:
        complaints.add(row.number, "unit", unit, units_allowed(quantity))
        return []
    if not row.get("value"):
        return []
    value = _converted(row, "value", quantity, complaints)
    sd = _converted(row, "sensor_sd", _sd_of(quantity), complaints) if row.get("sensor_sd") else None
    if value is None or (sd is None and row.get("sensor_sd")):
        return []
    return [Observation(condition.condition, row.get("replicate"), name, value, sd)]


def _sd_of(quantity: Quantity) -> Quantity:
    return Quantity(quantity.unit, 0.0, quantity.highest)


def _converted(row: Row, column: str, quantity: Quantity, complaints: Complaints) -> float | None:
    """A number given in the row's unit, in the quantity's own."""
    number = parse_number(row.get(column))
    value = None if number is None else convert(number, row.get("unit"), quantity)
    if value is None or not quantity.allows(value):
        given = f"{row.get(column)} {row.get('unit')}"
        complaints.add(row.number, column, given, quantity.allowed)
        return None
    return value


def _brief(names: list[str]) -> str:
    """Names in a line, the 24 sectors as one."""
    sectors = re.compile(r"(.*)_(\d\d)$")
    short = [sectors.sub(r"\1_01 to _24", name) for name in names]
    return ", ".join(dict.fromkeys(short))


def _profiles(
    rows: list[Row], complaints: Complaints, known: dict[str, Condition], named: set[str]
) -> tuple[list[Profile], dict[Place, int]]:
    """Profiles, and the first row of each."""
    places: dict[Place, int] = {}
    points: dict[Place, list[tuple[float, ...]]] = {}
    seen: dict[tuple[object, ...], int] = {}
    for row in rows:
        _check_condition(row, named, complaints)
        values = [_number(row, column, quantity, complaints) for column, quantity in PROFILE_NUMBERS.items()]
        place = (row.get("condition"), row.get("replicate"))
        if any(value is None for value in values):
            continue
        at = (*place, *values[:2])
        if at in seen:
            complaints.add(
                row.number, "theta_deg, r_m", f"{values[0]}, {values[1]}", f"once; row {seen[at]} has it"
            )
            continue
        seen[at] = row.number
        if place[0] in known:
            places.setdefault(place, row.number)
            points.setdefault(place, []).append(tuple(v for v in values if v is not None))
    return [Profile(*place, *zip(*listed, strict=True)) for place, listed in points.items()], places
