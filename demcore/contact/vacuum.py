"""No field: nothing but gravity and contacts acts on a grain, the default."""

from __future__ import annotations

from typing import NamedTuple

from demcore.contact.model import Body, FieldWrench, Vec3
from demcore.jit import leaf

# Negative zero is what changes no number when it is added, not even the sign of a zero: the compiler drops it.
NOTHING = -0.0


class Vacuum(NamedTuple):
    """No numerics."""


@leaf
def vacuum(law: Vacuum, body: Body) -> FieldWrench:
    """No force and no torque."""
    return FieldWrench(Vec3(NOTHING, NOTHING, NOTHING), Vec3(NOTHING, NOTHING, NOTHING))
