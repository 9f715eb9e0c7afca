"""Materials from a TOML file: one table a material, every number with its unit in its name.

The file that ships with demcore, data/materials.toml, is the example. Importable without numba.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from demcore.errors import InputError
from demcore.material import Material, MaterialPart, load_material, material_from_row, mixed
from demcore.toml_file import number, read_toml, refuse_unknown

NUMBERS = (
    "bulk_density_kg_m3",
    "packing_fraction",
    "youngs_modulus_pa",
    "poisson_ratio",
    "long_term_damping",
    "dynamic_friction_ratio",
)
LISTS = {"sizes": ("lower_mm", "upper_mm", "mass_share"), "wall_restitution": ("value", "mass_share")}
# For a calibration; a simulation runs without.
AIMS = ("target_deg", "window_deg", "constraints")


def read_material(path: Path, name: str) -> Material:
    """The material `name` of a file.

    Raises InputError for a file that cannot be read, an unknown material, a key that is missing, unknown or lacks
    its unit, a value that is no number, and whatever `Material` refuses.
    """
    table = read_toml("material_file", path)
    row = table.get(name)
    if not isinstance(row, dict):
        raise InputError("material", name, f"one of {', '.join(table) or 'none'} in {path.name}")
    return _mix(name, row, table) if "parts" in row else _pure(name, row)


def _mix(name: str, row: dict[str, Any], table: dict[str, Any]) -> Material:
    """A mix of materials of the same file, or of shipped ones; its aims are the parts' unless it has its own."""
    _check_keys(name, row, ("parts",), AIMS)
    if not isinstance(row["parts"], list) or not all(isinstance(part, dict) for part in row["parts"]):
        raise InputError(f"{name}.parts", row["parts"], "a list of tables with material, mass_share")
    parts = []
    for k, part in enumerate(row["parts"]):
        field = f"{name}.parts[{k}]"
        _check_keys(field, part, ("material", "mass_share"), ())
        parts.append(
            MaterialPart(_part(part["material"], table), number(f"{field}.mass_share", part["mass_share"]))
        )
    mix = mixed(name, parts)
    aims = _aims(name, row, mix.target_deg, list(mix.window_deg))
    return replace(mix, target_deg=aims["target_deg"], window_deg=tuple(aims["window_deg"]))


def _part(name: Any, table: dict[str, Any]) -> Material:
    row = table.get(name) if isinstance(name, str) else None
    return load_material(name) if row is None else _pure(name, row)


def _pure(name: str, row: dict[str, Any]) -> Material:
    _check_keys(name, row, (*NUMBERS, *LISTS), AIMS)
    numbers = {key: number(f"{name}.{key}", row[key]) for key in NUMBERS}
    lists = {key: _rows(f"{name}.{key}", row[key], columns) for key, columns in LISTS.items()}
    return material_from_row(name, {**numbers, **lists, **_aims(name, row, 45.0, [0.0, 90.0])})


def _aims(name: str, row: dict[str, Any], target: float, window: list[float]) -> dict[str, Any]:
    """What a calibration is for; left out: as given here."""
    window = row.get("window_deg", window)
    if not isinstance(window, list) or len(window) != 2:
        raise InputError(f"{name}.window_deg", window, "two angles in degrees")
    constraints = row.get("constraints", [])
    if not isinstance(constraints, list):
        raise InputError(f"{name}.constraints", constraints, "a list of sentences")
    return {
        "target_deg": number(f"{name}.target_deg", row.get("target_deg", target)),
        "window_deg": [number(f"{name}.window_deg", angle) for angle in window],
        "constraints": [str(text) for text in constraints],
    }


def _check_keys(field: str, row: dict[str, Any], needed: tuple[str, ...], optional: tuple[str, ...]) -> None:
    for key, value in row.items():
        refuse_unknown(field, key, value, (*needed, *optional))
    for key in needed:
        if key not in row:
            raise InputError(f"{field}.{key}", None, "a value: it is missing")


def _rows(field: str, value: Any, columns: tuple[str, ...]) -> list[dict[str, float]]:
    if not isinstance(value, list) or not all(isinstance(row, dict) for row in value):
        raise InputError(field, value, "a list of tables with " + ", ".join(columns))
    rows = []
    for k, row in enumerate(value):
        _check_keys(f"{field}[{k}]", row, columns, ())
        rows.append({name: number(f"{field}[{k}].{name}", row[name]) for name in columns})
    return rows
