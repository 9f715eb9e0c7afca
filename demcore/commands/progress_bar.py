"""A running simulation as one live line on the terminal; silent where the output is no terminal."""

from __future__ import annotations

import math
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar

from demcore.run import Progress


class ProgressBar:
    """Use as a context; call `show` with every report of the run."""

    def __init__(self) -> None:
        self._bar = Bar(
            TextColumn("{task.fields[phase]:<9}"),
            BarColumn(24),
            TextColumn("{task.percentage:>3.0f}%  {task.fields[told]}"),
            console=Console(stderr=True),
            # Drawn when the run reports, not by a thread of its own that competes with the kernels.
            auto_refresh=False,
            disable=not Console(stderr=True).is_terminal,
        )
        self._task = self._bar.add_task("", total=1.0, phase="fill", told="")

    def show(self, progress: Progress) -> None:
        """Bring the line up to date."""
        left = "" if math.isnan(progress.seconds_left) else f", {duration(progress.seconds_left)} left"
        told = (
            f"{progress.time_s:.2f} s simulated, {progress.particles} particles, "
            f"{progress.particle_steps_per_s:.2e} particle-steps/s{left}"
        )
        self._bar.update(
            self._task, completed=progress.fraction, phase=progress.phase, told=told, refresh=True
        )

    def __enter__(self) -> ProgressBar:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()


def duration(seconds: float) -> str:
    """45 s, 12 min 30 s, 3 h 05 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
