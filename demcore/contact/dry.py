"""No cohesion: dry grains, the default."""

from __future__ import annotations

from typing import NamedTuple

from demcore.contact.model import Pair
from demcore.jit import leaf


class Dry(NamedTuple):
    """No numerics."""


@leaf
def dry(law: Dry, pair: Pair, overlap: float) -> float:
    """No attraction: a constant, so that the compiler drops the subtraction (x - 0 is x, to the bit)."""
    return 0.0
