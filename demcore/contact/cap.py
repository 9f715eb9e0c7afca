"""The limit that friction and rolling resistance share: a vector may not exceed a length."""

from __future__ import annotations

import math

from demcore.jit import leaf


@leaf
def cap_share(x: float, y: float, z: float, limit: float) -> float:
    """The factor, at most 1, that brings (x, y, z) down to the length `limit`; without a branch around it."""
    squared = x * x + y * y + z * z
    if squared > limit * limit:
        return limit / math.sqrt(squared)
    return 1.0
