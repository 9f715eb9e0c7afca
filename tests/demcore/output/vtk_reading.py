"""Reads a VTKHDF file as pyvista and ParaView do: with VTK's own reader, step by step."""

from __future__ import annotations

from pathlib import Path

import pyvista


def read_steps(path: Path) -> list[tuple[float, pyvista.PolyData]]:
    """Time and poly data of every step."""
    reader = pyvista.get_reader(str(path)).reader
    reader.UpdateInformation()
    key = reader.GetExecutive().TIME_STEPS()
    times = reader.GetOutputInformation(0).Get(key) or ()
    if not times:
        # VTK announces no times for a series of a single step, and reads that one.
        reader.Update()
        return [(0.0, pyvista.wrap(reader.GetOutput()).copy())]
    steps = []
    for time in times:
        reader.UpdateTimeStep(time)
        steps.append((time, pyvista.wrap(reader.GetOutput()).copy()))
    return steps
