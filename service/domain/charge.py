"""What a charge of the hopper asks for: plant, material, scale, seed, contact numbers; validated whole.

The limits are demcore's: `charge_test` builds the very test that a worker runs, and a refusal there is one here.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from demcore.dormancy import Dormancy
from demcore.errors import InputError
from demcore.experiments.charge_case import ChargeTest, load_charge
from demcore.experiments.charge_effects import with_effects
from demcore.experiments.contact_parameters import LIMITS, ContactParameters
from demcore.geometry.mesh_file import UNITS
from demcore.plant.plant_file import change_plant, replace_part
from service.domain.errors import InvalidValue
from service.domain.model_use import ModelUse

# One set of numbers for all contacts of a mix, as the paper has it.
ALL = "all"
TOLD = "the request"
# Gives the file of an uploaded mesh, by the path that its row has.
MeshFile = Callable[[str], Path]
# Charges that one request may ask for: seeds times sets of contact numbers.
MOST_RUNS = 50
SHORTEST_FRAME, LONGEST_FRAME = 0.05, 1000.0
# Half the scale takes sixteen times as long, so a slip of the pen may ask for years: days must be asked for.
LONGEST_HOURS, MOST_HOURS = 24.0, 8760.0


@dataclass(frozen=True)
class PartMesh:
    """A mesh that stands for a part of the plant: an uploaded geometry, its file below the store, and its unit."""

    geometry: int
    file_name: str
    path: str
    units: str
    up: str = "z"

    def __post_init__(self) -> None:
        if self.units not in UNITS:
            raise InvalidValue("geometry.units", self.units, "one of " + ", ".join(UNITS))


@dataclass(frozen=True)
class ChargeSpec:
    """One charge. `plant` holds what differs from the shipped plant, by part and key of data/plant.toml; `meshes`
    stand for parts; `parameters` are contact numbers by material, or for ALL contacts, the paper's where empty,
    and `parameters_from` says where they come from. `frame_seconds`: simulated time between two frames of the
    series, None for none. `model`: a version of the model that the charge is simulated with."""

    charge: str
    scale: float = 4.0
    seed: int = 1
    rest_seconds: float = 10.0
    dormancy: bool = True
    frame_seconds: float | None = 2.0
    plant: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    meshes: Mapping[str, PartMesh] = field(default_factory=dict)
    parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    parameters_from: str = "paper, Table 5"
    model: ModelUse | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "plant", MappingProxyType(dict(self.plant)))
        object.__setattr__(self, "meshes", MappingProxyType(dict(self.meshes)))
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))
        if self.frame_seconds is not None and not SHORTEST_FRAME <= self.frame_seconds <= LONGEST_FRAME:
            allowed = f"{SHORTEST_FRAME:g} to {LONGEST_FRAME:g} s, or null for no frames"
            raise InvalidValue("frame_seconds", self.frame_seconds, allowed)
        if ALL in self.parameters and len(self.parameters) > 1:
            raise InvalidValue("parameters", sorted(self.parameters), f"{ALL} alone, or sets by material")

    def as_record(self) -> dict[str, Any]:
        """Plain JSON types only."""
        return {
            "charge": self.charge,
            "scale": self.scale,
            "seed": self.seed,
            "rest_seconds": self.rest_seconds,
            "dormancy": self.dormancy,
            "frame_seconds": self.frame_seconds,
            "plant": {part: dict(row) for part, row in self.plant.items()},
            "meshes": {part: asdict(mesh) for part, mesh in self.meshes.items()},
            "parameters": {name: dict(row) for name, row in self.parameters.items()},
            "parameters_from": self.parameters_from,
            **({} if self.model is None else {"model": self.model.as_record()}),
        }

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> ChargeSpec:
        """The spec that was stored: `from_record(as_record(s)) == s`."""
        meshes = {part: PartMesh(**row) for part, row in record["meshes"].items()}
        model = ModelUse(**record["model"]) if record.get("model") else None
        return cls(**{**record, "meshes": meshes, "model": model})


def charge_test(spec: ChargeSpec, mesh_file: MeshFile, time_step_factor: float = 1.0) -> ChargeTest:
    """The virtual charge; `mesh_file` gives uploaded meshes. Raises InvalidValue with demcore's own sentence."""
    try:
        plant = change_plant(spec.plant, TOLD)
        for part, mesh in spec.meshes.items():
            plant = replace_part(plant, part, mesh_file(mesh.path), mesh.units, mesh.up, mesh.file_name)
        ideal = ChargeTest(
            load_charge(spec.charge, contact_parameters(spec.parameters)),
            plant,
            scale=spec.scale,
            seed=spec.seed,
            rest_seconds=spec.rest_seconds,
            dormancy=Dormancy() if spec.dormancy else None,
            time_step_factor=float(time_step_factor),
        )
        return ideal if spec.model is None else with_effects(ideal, spec.model.effects)
    except InputError as error:
        raise InvalidValue(error.field, error.value, error.allowed) from error


def contact_parameters(
    sets: Mapping[str, Mapping[str, float]],
) -> ContactParameters | dict[str, ContactParameters] | None:
    """As demcore's load_charge takes them. Raises InvalidValue for an unknown name, or one of the four missing."""
    found = {name: _one_set(name, values) for name, values in sets.items()}
    return (found.get(ALL) or found) if found else None


def _one_set(name: str, values: Mapping[str, float]) -> ContactParameters:
    for key in values:
        if key not in LIMITS:
            raise InvalidValue(f"parameters.{name}.{key}", values[key], "one of " + ", ".join(LIMITS))
    for key in tuple(LIMITS)[:4]:
        if key not in values:
            raise InvalidValue(f"parameters.{name}.{key}", None, "required")
    return ContactParameters(**values)


def request_hash(specs: list[ChargeSpec]) -> str:
    """sha256 of a whole request."""
    text = json.dumps([spec.as_record() for spec in specs], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class SetSource:
    """Where the contact numbers of a material come from: given `values`, or a `study`, whose recommendation is
    taken, or so many `members` of its newest ensemble."""

    values: Mapping[str, float] | None = None
    study: int | None = None
    members: int = 1

    def __post_init__(self) -> None:
        if (self.values is None) == (self.study is None):
            raise InvalidValue("parameters", self.study, "either values or a study")
        if not 1 <= self.members <= MOST_RUNS:
            raise InvalidValue("parameters.members", self.members, f"1 to {MOST_RUNS}")


@dataclass(frozen=True)
class ChargeRequest:
    """What one request asks for: a charge for every seed and every set of contact numbers. `spec` is what they
    share; `geometries` are uploaded meshes with their unit and up axis, by part. A charge that is expected to take
    longer than `longest_hours` is refused."""

    spec: ChargeSpec
    seeds: tuple[int, ...] = (1,)
    sources: Mapping[str, SetSource] = field(default_factory=dict)
    geometries: Mapping[str, tuple[int, str, str]] = field(default_factory=dict)
    longest_hours: float = LONGEST_HOURS

    def __post_init__(self) -> None:
        if not 0.0 < self.longest_hours <= MOST_HOURS:
            raise InvalidValue("longest_hours", self.longest_hours, f"above 0, at most {MOST_HOURS:g}")
        if not self.seeds or len(set(self.seeds)) < len(self.seeds):
            raise InvalidValue("seeds", list(self.seeds), "at least one, each once")
        members = {source.members for source in self.sources.values() if source.study is not None}
        if len(members) > 1:
            raise InvalidValue("parameters.members", sorted(members), "the same number for all materials")
        if len(self.seeds) * max(members, default=1) > MOST_RUNS:
            raise InvalidValue("seeds", list(self.seeds), f"at most {MOST_RUNS} charges in one request")
