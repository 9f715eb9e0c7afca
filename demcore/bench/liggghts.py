"""LIGGGHTS on our beds: the data file, the input script, the run, and what its log says.

Source of the syntax: the manual of LIGGGHTS-PUBLIC 3.8. Same physics as `beds.contact_model("hertz")`: double
precision, Hertz-Mindlin with tangential history, `epsd2` rolling (type 3), the same material values and time step.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

from demcore.bench.beds import DENSITY, FRICTION, RESTITUTION, ROLLING, RUN_IN, STIFFNESS, WALL_FRICTION, Bed
from demcore.errors import InputError, SimulationError

PROGRAM = "liggghts"
MODEL = "model hertz tangential history rolling_friction epsd2"
# Skin of its neighbour lists, share of the smallest radius; 0.2 to 0.8 ran within 5 % of each other.
SKIN = 0.5
LONGEST_RUN_S = 600.0


class LiggghtsFailed(SimulationError):
    """LIGGGHTS ended with an error, or its log lacks what it should say."""

    kind = "liggghts"


@dataclass(frozen=True)
class LiggghtsCourse:
    """`seconds` of its own "Loop time" for the timed steps; contacts between particles at the end."""

    seconds: float
    contacts: int
    rebuilds: int


def find_programs(threads: int) -> list[str]:
    """The command line's first words. Raises InputError where a program is missing."""
    program = shutil.which(PROGRAM)
    if program is None:
        raise InputError("against", PROGRAM, f"{PROGRAM} on PATH (Debian: apt-get install liggghts)")
    if threads == 1:
        return [program]
    mpirun = shutil.which("mpirun")
    if mpirun is None:
        raise InputError("threads", threads, "1 against liggghts: more need mpirun on PATH")
    return [mpirun, "-np", str(threads), program]


def data_file(bed: Bed) -> str:
    """The bed in LIGGGHTS' data format, atom style granular; numbers to the last bit."""
    half = bed.container.half * 1.05
    top = float((bed.positions[:, 2] + bed.radii).max()) + 0.1
    lines = [
        f"bed {bed.name}\n",
        f"{len(bed.radii)} atoms",
        "2 atom types\n",
        f"{-half} {half} xlo xhi",
        f"{-half} {half} ylo yhi",
        f"-0.1 {top} zlo zhi",
        "\nAtoms\n",
    ]
    for k, (radius, (x, y, z)) in enumerate(
        zip(bed.radii.tolist(), bed.positions.tolist(), strict=True), start=1
    ):
        lines.append(f"{k} 1 {2.0 * radius!r} {DENSITY!r} {x!r} {y!r} {z!r}")
    lines.append("\nVelocities\n")
    for k, (velocity, spin) in enumerate(
        zip(bed.velocities.tolist(), bed.spins.tolist(), strict=True), start=1
    ):
        lines.append(" ".join([str(k), *(repr(value) for value in (*velocity, *spin))]))
    return "\n".join(lines) + "\n"


def input_script(bed: Bed, steps: int, processes: int) -> str:
    """Run in, then the timed run; particles are type 1, walls type 2."""
    half, skin = bed.container.half, SKIN * float(bed.radii.min())
    primitives = ["zplane 0.0"]
    if bed.container.shape == "cylinder":
        primitives.append(f"zcylinder {half} 0.0 0.0")
    else:
        primitives += [f"{axis}plane {side * half}" for axis in "xy" for side in (-1, 1)]
    walls = [f"fix wall{k} all wall/gran {MODEL} primitive type 2 {p}" for k, p in enumerate(primitives)]

    def per_pair(between: float, at_wall: float) -> str:
        return f"peratomtypepair 2 {between} {at_wall} {at_wall} {at_wall}"

    young, poisson = STIFFNESS.youngs_modulus, STIFFNESS.poisson_ratio
    lines = [
        "atom_style granular",
        "atom_modify map array",
        "boundary m m m",
        "newton off",
        "communicate single vel yes",
        "units si",
        # Halves of a bed hold the same number of particles.
        f"processors {processes} 1 1",
        "read_data bed.data",
        f"neighbor {skin} bin",
        "neigh_modify delay 0",
        f"fix m1 all property/global youngsModulus peratomtype {young} {young}",
        f"fix m2 all property/global poissonsRatio peratomtype {poisson} {poisson}",
        f"fix m3 all property/global coefficientRestitution {per_pair(RESTITUTION, RESTITUTION)}",
        f"fix m4 all property/global coefficientFriction {per_pair(FRICTION, WALL_FRICTION)}",
        f"fix m5 all property/global coefficientRollingFriction {per_pair(ROLLING, ROLLING)}",
        f"pair_style gran {MODEL}",
        "pair_coeff * *",
        f"timestep {bed.container.dt}",
        "fix weight all gravity 9.81 vector 0.0 0.0 -1.0",
        *walls,
        "fix move all nve/sphere",
        "compute touching all contact/atom",
        "compute contacts all reduce sum c_touching",
        "thermo_style custom step atoms c_contacts",
        # Once at the start and once at the end, so that counting costs no time in between.
        f"thermo {RUN_IN['hertz'] + steps}",
        "thermo_modify lost error norm no",
        f"run {RUN_IN['hertz']}",
        f"run {steps}",
    ]
    return "\n".join(lines) + "\n"


def read_log(text: str, steps: int) -> LiggghtsCourse:
    """The last run's "Loop time", its last row of step, atoms and contacts, and its neighbour list builds.

    Each pair that touches is counted at both of its particles. Raises LiggghtsFailed when one is missing.
    """
    loop = re.findall(r"Loop time of (\S+) on \d+ procs for (\d+) steps", text)
    rows = re.findall(r"^ +(\d+) +(\d+) +(\d+) *$", text, re.MULTILINE)
    builds = re.findall(r"Neighbor list builds = (\d+)", text)
    if not loop or int(loop[-1][1]) != steps or not rows or not builds:
        errors = re.findall(r"ERROR[^\n]*", text)
        raise LiggghtsFailed(errors[0] if errors else "its log has no loop time")
    return LiggghtsCourse(float(loop[-1][0]), int(rows[-1][2]) // 2, int(builds[-1]))


def run_liggghts(bed: Bed, threads: int, steps: int) -> LiggghtsCourse:
    """Time `steps` steps of the bed with LIGGGHTS on `threads` processes, in a folder that is removed again.

    Raises InputError where it is not installed, LiggghtsFailed when it does not do its work.
    """
    command = [*find_programs(threads), "-in", "in.bed", "-log", "none"]
    # Open MPI alone reads these: it refuses root, wants a slot per process, and binds processes of unrelated
    # runs to the same core.
    environment = os.environ | {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "OMPI_MCA_hwloc_base_binding_policy": "none",
    }
    with tempfile.TemporaryDirectory(prefix="demcore-bench-") as place:
        folder = Path(place)
        (folder / "bed.data").write_text(data_file(bed), encoding="ascii")
        (folder / "in.bed").write_text(input_script(bed, steps, threads), encoding="ascii")
        try:
            done = subprocess.run(
                command,
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=LONGEST_RUN_S,
                check=False,
            )
        except subprocess.TimeoutExpired as late:
            raise LiggghtsFailed(f"no result within {LONGEST_RUN_S:g} s") from late
    return read_log(done.stdout + done.stderr, steps)
