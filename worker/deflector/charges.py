"""The charge over a device, as the study asks for it.

Not in `__main__`: a process that is spawned does not import a package's `__main__`, and finds nothing of it.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

from demcore.errors import SimulationError
from demcore.experiments.charge_case import ChargeTest, load_charge
from demcore.plant.parts import Plant
from worker.deflector.designs import Space
from worker.evaluate import plain

_log = logging.getLogger(__name__)


def charge_of(plant: Plant, material: str, scale: float, seed: int) -> dict[str, Any]:
    """The summary of a charge as plain JSON; empty where it came to no end."""
    from demcore.experiments.charge_test import run_charge

    try:
        result = run_charge(ChargeTest(load_charge(material), plant, scale=scale, seed=seed))
    except SimulationError as error:
        _log.warning("%s, seed %s: %s", material, seed, error)
        return {}
    found: dict[str, Any] = plain(result.summary() | {"findings": result.findings()})
    return found


@dataclass(frozen=True)
class Evaluation:
    """The summary of a charge over the device at `u`. A record, so that it can be handed to another process."""

    space: Space
    scale: float

    def __call__(self, u: tuple[float, ...], material: str, seed: int) -> dict[str, Any]:
        return charge_of(self.space.plant_of(u), material, self.scale, seed)
