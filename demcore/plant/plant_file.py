"""The plant from TOML: the shipped data/plant.toml, changed by a file of one's own that names only what differs.

A number carries its unit in its key and its reason beside it: `width_mm = { value = 800.0, why = "..." }`; a file
of one's own may give the bare number. A part is replaced by a mesh in the plant's frame with

    [deflector]
    stl = "mine.stl"      # beside the file; STL, OBJ or PLY
    stl_units = "mm"      # m, mm, cm or inch: a mesh file does not say
    stl_up = "z"          # optional: which axis of the mesh is up
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import fields, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from demcore.errors import InputError
from demcore.geometry.mesh import TriangleMesh
from demcore.geometry.mesh_file import UNITS, load_mesh
from demcore.plant.parts import (
    REPLACEABLE,
    Bell,
    Belt,
    Deflector,
    Feeder,
    Hatch,
    Hopper,
    Lid,
    Plant,
    Replacement,
    Rod,
)
from demcore.plant.surfaces import plant_walls
from demcore.toml_file import number, read_toml, refuse_unknown

CLASSES: dict[str, type] = {
    "belt": Belt,
    "feeder": Feeder,
    "hatch": Hatch,
    "lid": Lid,
    "hopper": Hopper,
    "bell": Bell,
    "rod": Rod,
    "deflector": Deflector,
}
PLAIN = ("rollers", "head_room")
SPEEDS = ("speed", "fall_speed")
MESH_KEYS = ("stl", "stl_units", "stl_up")
# A mesh this many times larger or smaller than the part it stands for was read in a wrong unit.
SIZE_RATIO = 10.0

Numbers = dict[str, dict[str, tuple[float, str]]]


def key_of(name: str) -> tuple[str, float]:
    """A field's key in the file, with its unit, and what its number is multiplied by for SI."""
    if name.endswith("_deg") or name in PLAIN:
        return name, 1.0
    return (f"{name}_m_s", 1.0) if name in SPEEDS else (f"{name}_mm", 1e-3)


def load_plant(path: Path | None = None) -> Plant:
    """The shipped plant, changed by the file at `path`.

    Raises InputError for a file that cannot be read, a part or key that is unknown or lacks its unit, a value that
    is no number, a mesh that cannot be read or has a wrong size, and whatever the parts refuse.
    """
    if path is None:
        return change_plant({}, "")
    return change_plant(read_toml("plant_file", path), path.name, path.parent)


def change_plant(changes: Mapping[str, Any], told: str, folder: Path | None = None) -> Plant:
    """The shipped plant with changes in the form of its file, by part and key; `told` says where they come from.
    Meshes are looked for in `folder`; without one there are none. Raises InputError as load_plant."""
    shipped = files("demcore").joinpath("data/plant.toml").read_text(encoding="utf-8")
    numbers, _ = _numbers(tomllib.loads(shipped), "the shipped plant")
    changed, meshes = _numbers(changes, told)
    for part, values in changed.items():
        numbers[part] |= values
    plant = build_plant(numbers)
    if not meshes:
        return plant
    if folder is None:
        part, table = next(iter(meshes.items()))
        raise InputError(f"{part}.stl", table.get("stl"), "no file here: only numbers")
    replacements = tuple(_replacement(plant, part, table, folder) for part, table in meshes.items())
    return build_plant(numbers, replacements)


def build_plant(numbers: Numbers, replacements: tuple[Replacement, ...] = ()) -> Plant:
    """The plant of numbers with their reasons, by part and key."""
    parts: dict[str, Any] = {}
    for part, kind in CLASSES.items():
        values = {}
        for f in fields(kind):
            key, factor = key_of(f.name)
            value = numbers[part][key][0]
            # Divided, so that 800 mm are .8 m to the last bit.
            values[f.name] = value / round(1.0 / factor) if factor != 1.0 else value
        parts[part] = kind(**values)
    sources = tuple((f"{part}.{key}", why) for part, row in numbers.items() for key, (_, why) in row.items())
    head_room = numbers["plant"]["head_room"][0]
    return Plant(**parts, head_room=head_room, replacements=replacements, sources=sources)


def _numbers(table: Mapping[str, Any], file: str) -> tuple[Numbers, dict[str, dict[str, Any]]]:
    """The numbers of a file by part and key, with their reasons, and its meshes by part."""
    numbers: Numbers = {}
    meshes: dict[str, dict[str, Any]] = {}
    for part, row in table.items():
        if part == "head_room":
            numbers["plant"] = {part: _number(part, row, file)}
            continue
        if part not in CLASSES or not isinstance(row, dict):
            raise InputError(f"plant.{part}", row, "a part: " + ", ".join(CLASSES) + ", or head_room")
        known = {key_of(f.name)[0] for f in fields(CLASSES[part])}
        mesh = {key: value for key, value in row.items() if key in MESH_KEYS}
        for key in row:
            if key not in MESH_KEYS:
                refuse_unknown(part, key, row[key], sorted(known))
        numbers[part] = {k: _number(f"{part}.{k}", v, file) for k, v in row.items() if k in known}
        if mesh:
            if part not in REPLACEABLE:
                raise InputError(f"{part}.stl", mesh.get("stl"), "a mesh for " + ", ".join(REPLACEABLE))
            meshes[part] = mesh
    return numbers, meshes


def _number(field: str, value: Any, file: str) -> tuple[float, str]:
    why = f"given in {file}"
    if isinstance(value, dict) and set(value) <= {"value", "why"} and "value" in value:
        value, why = value["value"], str(value.get("why", why))
    return number(field, value, ", or { value = a number, why = a reason }"), why


def _replacement(plant: Plant, part: str, table: Mapping[str, Any], folder: Path) -> Replacement:
    for key in ("stl", "stl_units"):
        if not isinstance(table.get(key), str):
            allowed = "the mesh file's name" if key == "stl" else "one of " + ", ".join(UNITS)
            raise InputError(f"{part}.{key}", table.get(key), allowed)
    path = folder / table["stl"]
    return read_part(plant, part, path, table["stl_units"], table.get("stl_up", "z"), path.name)


def read_part(plant: Plant, part: str, path: Path, units: str, up: str, file: str) -> Replacement:
    """The mesh at `path` to stand for a part; `file` is what it is called. Raises InputError for a mesh that
    cannot be read, or that has a wrong size for the part."""
    if part not in REPLACEABLE:
        raise InputError(f"{part}.stl", file, "a mesh for " + ", ".join(REPLACEABLE))
    mesh, _ = load_mesh(path, units, up)
    _check_size(plant, part, mesh, f"{file} read in {units}")
    return Replacement(part, mesh, file)


def replace_part(plant: Plant, part: str, path: Path, units: str, up: str, file: str) -> Plant:
    """The plant with the mesh at `path` in the place of a part. Raises InputError as read_part."""
    found = read_part(plant, part, path, units, up, file)
    return replace(plant, replacements=(*(r for r in plant.replacements if r.part != part), found))


def _check_size(plant: Plant, part: str, mesh: TriangleMesh, told: str) -> None:
    """Raises InputError for a mesh whose size says that its unit is wrong."""
    extent = np.ptp(mesh.vertices, axis=0)
    size, usual = float(np.sqrt((extent**2).sum())), part_size(plant, part)
    if not usual / SIZE_RATIO <= size <= usual * SIZE_RATIO:
        allowed = (
            f"about {usual:.3g} m across, like the {part} it stands for, not {size:.3g} m: "
            "is its unit another one?"
        )
        raise InputError(f"{part}.stl_units", told, allowed)


def part_size(plant: Plant, part: str) -> float:
    """Diagonal of the box around a part as its own numbers make it, m."""
    corners = []
    for wall in plant_walls(plant):
        if wall.name.split()[0] != part:
            continue
        if wall.mesh is not None:
            corners += [wall.mesh.vertices.min(axis=0), wall.mesh.vertices.max(axis=0)]
        else:
            wide = max(wall.radius, wall.end_radius)
            x, y, z = wall.centre
            corners += [
                np.array([x - wide, y - wide, z]),
                np.array([x + wide, y + wide, z + wall.length]),
            ]
    extent = np.ptp(np.array(corners), axis=0)
    return float(np.sqrt((extent**2).sum()))
