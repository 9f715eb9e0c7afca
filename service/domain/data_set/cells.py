"""One bad cell of a data set, all of them together, and the parsing of single cells."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache

from service.domain.data_set.columns import Quantity

# A name ends up in file names, in SQL and on pictures.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.:+ -]{0,63}")
NAME_ALLOWED = "1 to 64 letters, digits, spaces or _ . : + -, the first a letter or digit"
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
# Names of units with small powers between * and /: pint's parser evaluates arithmetic, and 9**9**9 would not end.
_UNIT = re.compile(r"[a-zA-Zµμ°%]+((\^|\*\*)?-?[1-9])?( ?[*/ ] ?[a-zA-Zµμ°%]+((\^|\*\*)?-?[1-9])?){0,3}")
# kg/m3 and m2 are written so as often as kg/m^3.
_BARE_POWER = re.compile(r"(?<=[a-zA-Zµμ])(?=-?[1-9])")
_RAISED = str.maketrans({"²": "2", "³": "3"})
# Only these: to pint an angle is a number, and 71 % would be 40.68 deg.
UNITS_OF_ANGLE = ("deg", "degree", "degrees", "°", "rad", "radian", "radians", "mrad")
_LONGEST_SHOWN = 80
# A table of which every cell is wrong would otherwise become ten times as much memory.
MOST_BAD_CELLS = 1_000


@dataclass(frozen=True)
class BadCell:
    """`row` counts a file's lines from 1 (its header) or a JSON list's places from 0; None: the whole file."""

    file: str
    row: int | None
    column: str
    value: str
    allowed: str

    def __str__(self) -> str:
        place = self.file if self.row is None else f"{self.file} row {self.row}"
        column = f", {self.column}" if self.column else ""
        return f"{place}{column}: got {self.value!r}, allowed is {self.allowed}"


class BadDataSet(ValueError):
    """Every cell that is wrong, in the order of the files."""

    def __init__(self, cells: Iterable[BadCell]) -> None:
        self.cells = tuple(cells)
        super().__init__("\n".join(str(cell) for cell in self.cells))


@dataclass
class Complaints:
    """What is wrong with one file, collected while it is read; with MOST_BAD_CELLS the reading ends."""

    file: str
    cells: list[BadCell] = field(default_factory=list)

    def add(self, row: int | None, column: str, value: object, allowed: str) -> None:
        """Raises BadDataSet when there are so many that more of them would help nobody."""
        text = "" if value is None else str(value)
        self.cells.append(BadCell(self.file, row, _shown(column), _shown(text), allowed))
        if len(self.cells) >= MOST_BAD_CELLS:
            rest = BadCell(
                self.file, None, "", "the rest was not read", f"fewer than {MOST_BAD_CELLS} bad cells"
            )
            raise BadDataSet([*self.cells, rest])


def _shown(text: str) -> str:
    return text if len(text) <= _LONGEST_SHOWN else text[:_LONGEST_SHOWN] + "..."


def parse_number(text: str) -> float | None:
    """A plain decimal number; None for anything else, among it nan, inf, 1_000 and a decimal comma."""
    if len(text) > _LONGEST_SHOWN or not _NUMBER.fullmatch(text):
        return None
    value = float(text)
    return value if math.isfinite(value) else None


def parse_name(text: str) -> str | None:
    """A name of a condition, replicate or material; None where it is not one."""
    return text if _NAME.fullmatch(text) else None


@lru_cache(maxsize=1024)
def unit_factor(unit: str, wanted: str) -> float | None:
    """What a value in `unit` is to be multiplied with to be in `wanted`; None where it cannot be converted.

    Only proportional units are converted (a temperature would need an offset, and no observable is one).
    """
    if unit == wanted:
        return 1.0
    unit = unit.translate(_RAISED)
    if len(unit) > _LONGEST_SHOWN or not _UNIT.fullmatch(unit):
        return None
    if wanted == "deg" and unit not in UNITS_OF_ANGLE:
        return None
    unit = _BARE_POWER.sub("^", unit)
    # pint takes half a second to load, and a data set in the right units never needs it.
    import pint

    try:
        factor = _registry().Quantity(1.0, unit).to(wanted).magnitude
    except (pint.errors.PintError, ValueError, TypeError, AttributeError):
        return None
    return (
        float(factor) if isinstance(factor, int | float) and math.isfinite(factor) and factor > 0.0 else None
    )


@lru_cache(maxsize=1)
def _registry():  # type: ignore[no-untyped-def]
    import pint

    return pint.UnitRegistry()


def units_allowed(quantity: Quantity) -> str:
    """In words."""
    if quantity.unit == "deg":
        return ", ".join(UNITS_OF_ANGLE[:-1]) + f" or {UNITS_OF_ANGLE[-1]}"
    return f"{quantity.unit}, or a unit that converts to it"


def convert(value: float, unit: str, quantity: Quantity) -> float | None:
    """`value` in the quantity's own unit; None where `unit` is no unit of that kind."""
    factor = unit_factor(unit, quantity.unit)
    return None if factor is None else value * factor


def parse_psd(text: str) -> tuple[tuple[float, float], ...] | None:
    """`size_m:mass_share;...` as pairs by growing size, shares summing to 1 within 1 %; None where it is not."""
    pairs = []
    for part in text.strip().rstrip(";").split(";"):
        size, _, share = part.partition(":")
        numbers = parse_number(size.strip()), parse_number(share.strip())
        if numbers[0] is None or numbers[1] is None:
            return None
        pairs.append((numbers[0], numbers[1]))
    sizes = {size for size, _ in pairs}
    total = math.fsum(share for _, share in pairs)
    fine = len(sizes) == len(pairs) and all(0.0 < size <= 1.0 and share >= 0.0 for size, share in pairs)
    if not fine or not math.isclose(total, 1.0, abs_tol=0.01):
        return None
    return tuple((size, share / total) for size, share in sorted(pairs))


PSD_ALLOWED = "size_m:mass_share;... with sizes above 0 to 1 m, each once, and shares that sum to 1"
