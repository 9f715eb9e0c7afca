"""A data set as plain JSON and back, exactly: what is stored of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from service.domain.data_set.records import Condition, DataSet, Observation, Profile


def as_record(data: DataSet) -> dict[str, Any]:
    """Lists of objects by table, numbers in the units of columns.py."""
    return {
        "conditions": [asdict(c) for c in data.conditions],
        "observations": [asdict(o) for o in data.observations],
        "profiles": [asdict(p) for p in data.profiles],
    }


def from_record(record: Mapping[str, Any]) -> DataSet:
    """Raises InvalidValue for a record that as_record did not make."""
    return DataSet(
        tuple(Condition(**{**c, "psd": _pairs(c["psd"])}) for c in record["conditions"]),
        tuple(Observation(**o) for o in record["observations"]),
        tuple(Profile(**{name: _tuple(value) for name, value in p.items()}) for p in record["profiles"]),
    )


def _pairs(psd: list[list[float]] | None) -> tuple[tuple[float, float], ...] | None:
    return None if psd is None else tuple((size, share) for size, share in psd)


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
