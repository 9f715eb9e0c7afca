"""The plan of a pile test: fill, settle, remove the cylinder at once or lift it, discharge, rest.

Source: the paper's section 2.1.3 (instant removal, limited base, Table 2's rigs). What the paper leaves open is
a named choice: the fill is by mass (bulk density times the cylinder's volume times `fill_level`), the
cylinder's wall goes on upwards to hold the loose column while it falls in, and a bed is at rest by
case.RestCriterion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from demcore.case_run import CaseRun
from demcore.errors import NeverSettles
from demcore.experiments.pile_case import BASE, CYLINDER, LONGEST_SETTLE, PileTest
from demcore.particles import R, Z
from demcore.rest import RestWatch

# Rest is not looked for so soon after the cylinder went: the pile must first begin to move, s.
LEAST_DISCHARGE = 0.3
# Simulated seconds that settling (beyond the fall) and discharge usually take; for the time left only.
USUAL_SETTLE, USUAL_DISCHARGE = 0.5, 3.0
SETTLE, DISCHARGE = "settle", "discharge"


class PilePlan:
    """Two phases, `settle` and `discharge`; steps at which they began, and how high the bed stood in between."""

    NUMBERS = ("removed_at", "fill_height", "cylinder_gone")

    def __init__(self, test: PileTest) -> None:
        self.test = test
        self.phase = SETTLE
        self.removed_at = 0
        self.fill_height = 0.0
        self.cylinder_gone = False
        self.watch = RestWatch(test.rest, test.case.strength_of_gravity)

    def numbers(self) -> dict[str, Any]:
        """State to save."""
        return {name: getattr(self, name) for name in self.NUMBERS} | {"rest_since": self.watch.since}

    def restore(self, numbers: Mapping[str, Any]) -> None:
        """State from a checkpoint."""
        for name in self.NUMBERS:
            setattr(self, name, numbers[name])
        self.watch.since = numbers["rest_since"]

    def phase_time(self, run: CaseRun) -> float:
        """Seconds since the fill, or since the cylinder vanished or began to rise."""
        start = 0 if self.phase == SETTLE else self.removed_at
        return (run.simulation.step - start) * run.simulation.dt

    def check(self, run: CaseRun) -> str | None:
        """Rest ends a phase; a phase that never rests is an error and no angle."""
        if self.phase == SETTLE:
            if self.watch.look(run.simulation):
                self._open(run)
            elif self.phase_time(run) > self.test.fall_seconds + LONGEST_SETTLE:
                raise NeverSettles(f"the filled bed still moves after {self.phase_time(run):.1f} s")
            return None
        self._clear(run)
        least = max(LEAST_DISCHARGE, self.test.setting.shaking_seconds)
        may_rest = self.cylinder_gone and self.phase_time(run) >= least
        if self.watch.look(run.simulation, may_rest):
            return "rest"
        if self.phase_time(run) > self.test.lift_seconds + self.test.longest_discharge:
            raise NeverSettles(f"the pile still moves {self.phase_time(run):.1f} s after the cylinder went")
        return None

    def _open(self, run: CaseRun) -> None:
        s = run.simulation
        state = s.particles.state
        # Level of the bed: its surface is rough, so the 95 % quantile of the tops rather than the highest one.
        self.fill_height = float(np.quantile(state[:, Z] + state[:, R], 0.95)) if len(state) else 0.0
        if self.test.lift_speed is None:
            s.remove_wall(CYLINDER)
            self.cylinder_gone = True
        else:
            lift = (0.0, 0.0, self.test.lift_speed)
            s.replace_wall(CYLINDER, replace(run.case.walls[CYLINDER], velocity=lift, moves_from=s.time))
        self._shake(run)
        self.phase, self.removed_at, self.watch.since = DISCHARGE, s.step, -1

    def _shake(self, run: CaseRun) -> None:
        vibration, s = self.test.setting.vibration, run.simulation
        if vibration is None or vibration.acceleration == 0.0:
            return
        end = s.time + vibration.seconds
        base = run.case.walls[BASE]
        moving = replace(base, oscillation=vibration.oscillation, moves_from=s.time, moves_until=end)
        s.replace_wall(BASE, moving)

    def _clear(self, run: CaseRun) -> None:
        """Forget a lifted cylinder that nothing can touch any more."""
        if self.cylinder_gone or self.test.lift_speed is None:
            return
        state = run.simulation.particles.state
        top = float((state[:, Z] + state[:, R]).max(initial=0.0))
        if self.phase_time(run) * self.test.lift_speed > top:
            run.simulation.remove_wall(CYLINDER)
            self.cylinder_gone = True

    def fraction(self, run: CaseRun) -> float:
        """Rough share of the work done: the settling bed is larger, the discharge longer."""
        if self.phase == SETTLE:
            return 0.4 * min(1.0, self.phase_time(run) / (self.test.fall_seconds + USUAL_SETTLE))
        usual = USUAL_DISCHARGE + self.test.lift_seconds
        return 0.4 + 0.6 * (1.0 - math.exp(-2.0 * self.phase_time(run) / usual))
