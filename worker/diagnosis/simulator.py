"""What the analyser asks of a simulation: one protocol, behind which the DEM sits, or the analytic stand-in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from service.domain.data_set.records import Condition

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Parameter:
    """A calibration parameter of a material: its box. Each material has its own value."""

    name: str
    lower: float
    upper: float


class Setting(NamedTuple):
    """One run: `parameters` in the simulator's order and physical units; amplitudes by effect key (library.py).

    Equal settings give equal bits, and so do an effect with amplitude 0 or out of its scope and no effect.
    """

    parameters: tuple[float, ...]
    effects: tuple[tuple[str, float], ...]
    seed: int


class Surfaces(NamedTuple):
    """Scanned surfaces of n runs at p points: azimuth (deg) and radius (m), both (p,), heights (n, p), m."""

    theta_deg: FloatArray
    r_m: FloatArray
    h_m: FloatArray


class Outcomes(NamedTuple):
    """Observables of n runs by name, each (n,) in the unit of its name, NaN where a run has none."""

    values: Mapping[str, FloatArray]
    surfaces: Surfaces | None = None


class Simulator(Protocol):
    """`version` names the model; a batch of runs is one call, so that a queue can spread it over workers."""

    @property
    def version(self) -> str: ...

    @property
    def parameters(self) -> tuple[Parameter, ...]: ...

    def cannot(self, condition: Condition) -> str | None:
        """Why the model cannot represent a condition; None where it can."""

    def run(self, condition: Condition, settings: Sequence[Setting]) -> Outcomes:
        """The outcomes of n runs of one condition."""
