"""The DEM behind the diagnosis' simulator: settings become pile tests, their heaps the observables.

Charges are refused here; they have no cheap coarse run. Surfaces are read on 24 sectors times 10 annuli.
Lengths m.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from demcore.errors import BlowUp, InputError, NeverSettles, NoResult
from demcore.experiments.contact_parameters import ContactParameters
from demcore.experiments.pile_case import PileTest
from demcore.experiments.pile_effects import with_effect, with_effects
from demcore.experiments.pile_result import PileResult
from demcore.experiments.pile_test import run_pile_test
from demcore.identity import identity
from demcore.observables.repose_angle import scan_heights
from demcore.run import OnProgress
from service.domain.data_set.records import Condition
from service.domain.effects import Library, library
from service.domain.measured_pile import acting_effects, cannot_simulate, measured_pile, rig_of
from service.domain.model_use import ModelUse
from service.domain.search_space import default_space
from worker.diagnosis.sensors import is_sensor, misread, misread_surface
from worker.diagnosis.simulator import FloatArray, Outcomes, Parameter, Setting, Surfaces

SECTORS, RINGS = 24, 10
GRAINS = 600

OBSERVABLES: Mapping[str, str] = {
    "repose_angle_deg": "angle_deg",
    "apex_height_m": "heap_height_m",
    "mass_on_base_kg": "mass_on_base_kg",
    "discharge_t90_s": "discharge_t90_s",
    "bulk_density_kg_m3": "filled_bulk_density_kg_m3",
    "heap_offset_x_m": "heap_offset_x_m",
    "heap_offset_y_m": "heap_offset_y_m",
    "d50_on_base_m": "d50_on_base_m",
}


class PileReading(NamedTuple):
    """What one pile test tells: observables by the names of the data format, heights (SECTORS * RINGS,) m, volume
    of the heap m3. All NaN where the test made no pile."""

    values: Mapping[str, float]
    heights: FloatArray
    volume: float


Runner = Callable[[Sequence[PileTest]], list[PileReading]]


def polar_points(base_radius: float) -> tuple[FloatArray, FloatArray]:
    """Azimuth, deg, and radius, m, of the middle of each cell, ring after ring."""
    theta = (np.arange(SECTORS) + 0.5) * 360.0 / SECTORS
    r = (np.arange(RINGS) + 0.5) * base_radius / RINGS
    return np.tile(theta, RINGS), np.repeat(r, SECTORS)


def read_pile(result: PileResult) -> PileReading:
    """Observables and the mean scanned height in every polar cell."""
    found = {o.name: o.value for o in result.observables()}
    base = result.test.rig.base_radius
    field = scan_heights(result.positions, result.radii, base)
    x, y = np.meshgrid(field.axis, field.axis, indexing="ij")
    r, theta = np.hypot(x, y).ravel(), np.arctan2(y, x).ravel() % (2.0 * np.pi)
    on = r < base
    ring = np.minimum((r[on] / base * RINGS).astype(int), RINGS - 1)
    sector = np.minimum((theta[on] / (2.0 * np.pi) * SECTORS).astype(int), SECTORS - 1)
    cell = ring * SECTORS + sector
    height = field.height.ravel()[on]
    count = np.bincount(cell, minlength=SECTORS * RINGS)
    with np.errstate(invalid="ignore"):
        heights = np.bincount(cell, height, SECTORS * RINGS) / count
    side = float(field.axis[1] - field.axis[0])
    values = {name: found[source] for name, source in OBSERVABLES.items()}
    return PileReading(values, heights, float(height.sum()) * side**2)


NOTHING = PileReading(dict.fromkeys(OBSERVABLES, math.nan), np.full(SECTORS * RINGS, np.nan), math.nan)


def run_pile(test: PileTest, on_progress: OnProgress | None = None) -> PileReading:
    """One test in this process; one that makes no pile gives no numbers. Raises Cancelled."""
    try:
        return read_pile(run_pile_test(test, on_progress))
    except (NoResult, NeverSettles, BlowUp):
        return NOTHING


def reading_as_record(reading: PileReading) -> dict[str, Any]:
    """As JSON, which has no NaN."""
    return {
        "values": {name: _finite(value) for name, value in reading.values.items()},
        "heights": [_finite(h) for h in reading.heights.tolist()],
        "volume": _finite(reading.volume),
    }


def reading_of(record: Mapping[str, Any]) -> PileReading:
    """What reading_as_record made."""
    values = {name: _number(value) for name, value in record["values"].items()}
    return PileReading(values, np.array([_number(h) for h in record["heights"]]), _number(record["volume"]))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _number(value: float | None) -> float:
    return math.nan if value is None else value


@dataclass(frozen=True)
class PileSimulator:
    """demcore's pile test as a Simulator. `grains` about which a pile is made of; `contact_model` as demcore's;
    `known` is the library whose scopes hold; `model` a version in place of the baseline, to whose effects
    those of a setting are added."""

    runner: Runner
    grains: int = GRAINS
    contact_model: str = "paper"
    known: Library = field(default_factory=library)
    model: ModelUse | None = None

    @property
    def version(self) -> str:
        """Of the model: the code, its contact model and its coarseness; before an @ the version with a hash of its
        effects, since another project may have another one of that name."""
        simulator = f"demcore-{identity(())[:12]}-{self.contact_model}-{self.grains}"
        if self.model is None:
            return simulator
        return f"{self.model.name}:{identity(self.model.effects)[:8]}@{simulator}"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The paper's four, in the box of a study that names none."""
        return tuple(Parameter(v.name, v.lower, v.upper) for v in default_space().variables)

    def cannot(self, condition: Condition) -> str | None:
        """Why this test cannot be made."""
        effects = None if self.model is None else self.model.effects
        return cannot_simulate(condition, self.grains, self.contact_model, effects)

    def run(self, condition: Condition, settings: Sequence[Setting]) -> Outcomes:
        """See Simulator. Raises ValueError for a condition that it cannot represent."""
        why = self.cannot(condition)
        if why is not None:
            raise ValueError(f"{condition.condition}: {why}")
        tests = [self._possible_test(condition, s) for s in settings]
        made = iter(self.runner([test for test in tests if test is not None]))
        readings = [NOTHING if test is None else next(made) for test in tests]
        base = 0.5 * rig_of(condition).base_diameter
        theta, r = polar_points(base)
        faults = [{k: a for k, a in s.effects if is_sensor(k)} for s in settings]
        told = [misread(p.values, f, base, p.volume) for p, f in zip(readings, faults, strict=True)]
        heights = [misread_surface(p.heights, theta, r, f) for p, f in zip(readings, faults, strict=True)]
        values = {name: np.array([t[name] for t in told]) for name in OBSERVABLES}
        return Outcomes(values, Surfaces(theta, r, np.array(heights).reshape(len(settings), -1)))

    def _possible_test(self, condition: Condition, setting: Setting) -> PileTest | None:
        """None where an effect leaves no test (lumps wider than the cylinder): a run without a pile."""
        try:
            return self.pile_test(condition, setting)
        except InputError:
            if not setting.effects and self.model is None:
                raise
            return None

    def pile_test(self, condition: Condition, setting: Setting) -> PileTest:
        """The test of one run. Raises demcore's InputError for what cannot be."""
        numbers = dict(zip((p.name for p in self.parameters), setting.parameters, strict=True))
        own = self._amplitudes(setting)
        finer = math.exp(3.0 * own.get("self_coarse_graining", 0.0))
        grains = round(self.grains * finer * (1.0 - own.get("self_particle_number", 0.0)))
        ideal = measured_pile(
            condition, ContactParameters(**numbers), grains, self.contact_model, setting.seed
        )
        ideal = replace(ideal, time_step_factor=math.exp(-own.get("self_time_step", 0.0)))
        ideal = with_effect(ideal, "soft_stiffness", own.get("self_stiffness", 0.0))
        return with_effects(ideal, acting_effects(self.known, condition, own))

    def _amplitudes(self, setting: Setting) -> dict[str, float]:
        """By effect key: the model's, and the setting's added."""
        found = {} if self.model is None else dict(self.model.effects)
        for key, amplitude in setting.effects:
            found[key] = found[key] + amplitude if key in found else amplitude
        return found
