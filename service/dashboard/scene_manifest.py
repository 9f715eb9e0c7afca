"""What the 3D viewer of a pile or a charge has to draw: frames, colours, materials, and what is not stored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from demcore.errors import InputError
from demcore.experiments.charge_case import load_charge
from demcore.material import load_material, material_names
from demcore.output.tessellation import revolution
from service.db.models import ArtifactRow, ChargeRow, DesignRow, StudyRow
from service.domain.states import is_over
from service.file_store import FileStore
from service.scene.journal_file import list_journal
from service.scene.sphere_file import Frames, Surface, Unreadable, list_frames

# Of a charge: grains over time where they were asked for, else those at the end.
SPHERE_KINDS = ("vtkhdf", "spheres", "result")
WALL_KIND = "walls"
# The hopper's rim is the origin of the plant's heights (demcore/plant/parts.py).
RIM_M = 0.0
# The base is drawn as a plate; its thickness is for the eye.
PLATE_SHARE = 0.03
# Before the number of a charge: the frames of one under way, which are no file of the store yet.
RUNNING = "running-"
AT_ITS_END = "a pile test keeps its grains at the end only"


@dataclass(frozen=True)
class Colour:
    """A number that grains may be coloured by. `column`: it is asked for by this name, else the frame holds it."""

    name: str
    label: str
    unit: str
    column: str | None = None
    note: str = ""


@dataclass(frozen=True)
class Missing:
    """What a reader may look for here in vain."""

    label: str
    why: str


@dataclass(frozen=True)
class Scene:
    """`state`: ready, waiting (the run is not over), none (it left nothing), removed (retention) or damaged;
    `says` is told in the place of the picture where it is not ready, above it where the run goes on.
    `is_growing`: there will be more frames. `is_mesh`: there are walls alone."""

    state: str
    says: str = ""
    title: str = ""
    frames: Sequence[Mapping[str, Any]] = ()
    materials: Mapping[int, str] | None = None
    colours: Sequence[Colour] = ()
    missing: Sequence[Missing] = ()
    note: str = ""
    is_growing: bool = False
    is_mesh: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Plain JSON."""
        return asdict(self)


HEIGHT = Colour("height", "height", "m")
SIZE = Colour("size", "diameter", "mm")
MATERIAL = Colour("material", "material", "")
SPEED = Colour("speed", "speed", "m/s", "speed")


def pile_scene(study: StudyRow, design: DesignRow, files: Sequence[ArtifactRow], store: FileStore) -> Scene:
    """The pile of a design; of a pile test only the end is stored."""
    about = f"simulation {design.number} of study {study.id}"
    found = _find(files, store, is_over(design.state), "The simulation", "left no pile to show")
    if isinstance(found, Scene):
        return found
    row, held = found
    results = design.results or {}
    walls = f"/designs/{design.id}/scene/walls" if results.get("rig") else None
    colours = [HEIGHT, SIZE, MATERIAL, *([SPEED] if "Velocity" in held.fields else [])]
    missing = [
        Missing("time of arrival", AT_ITS_END),
        Missing("time-lapse", AT_ITS_END),
    ]
    if "Velocity" not in held.fields:
        missing.append(Missing("velocity", "this file holds none"))
    return Scene(
        "ready",
        title=f"The pile of {about}",
        frames=_frames(row.id, held, lambda _k: walls),
        materials=_materials(study.material, _parts_of(study.material)),
        colours=colours,
        missing=missing,
        note=_scaled(results.get("scale")),
    )


def charge_scene(
    charge: ChargeRow, files: Sequence[ArtifactRow], store: FileStore, journal: Path | None = None
) -> Scene:
    """The grains of a charge: over time where a series was asked for, else at the end. `journal`: where the frames
    of one under way are."""
    if not is_over(charge.state) and not files:
        return _growing_scene(charge, journal)
    found = _find(files, store, is_over(charge.state), "The charge", "left no grains to show")
    if isinstance(found, Scene):
        return found
    row, held = found
    is_series = row.kind == "spheres"
    surface = next(
        (file for file in files if file.kind == WALL_KIND and store.size(file.path) is not None), None
    )
    material = ((charge.results or {}).get("inputs") or {}).get("charge", {}).get("material") or {}
    colours, missing = [HEIGHT, SIZE, MATERIAL], list[Missing]()
    if "Velocity" in held.fields:
        colours.append(SPEED)
    else:
        missing.append(Missing("velocity", "this file holds none"))
    if is_series and "Number" in held.fields:
        step = held.times_s[1] - held.times_s[0] if len(held.times_s) > 1 else 0.0
        note = f"the first stored frame in which the grain is below the rim; frames are {step:.3g} s apart"
        colours.append(Colour("arrival", "time of arrival", "s", "arrival", note))
    else:
        missing.append(Missing("time of arrival", "no time series was asked for with this charge"))
        missing.append(Missing("time-lapse", "no time series was asked for with this charge"))
    if surface is None:
        missing.append(Missing("hopper, bell, belt and deflector", "no walls are stored with this charge"))
    parts = [part["material"]["name"] for part in material.get("parts") or () if "material" in part]
    return Scene(
        "ready",
        title=f"Charge {charge.id}: {charge.charge}",
        frames=_frames(
            row.id, held, lambda k: None if surface is None else f"/scenes/{surface.id}/walls/{k}"
        ),
        materials=_materials(material.get("name") or charge.charge, parts),
        colours=colours,
        missing=missing,
        note=_scaled(charge.scale),
    )


def _growing_scene(charge: ChargeRow, journal: Path | None) -> Scene:
    """The frames that a charge under way has written so far."""
    pause = charge.spec["frame_seconds"]
    if pause is None:
        return Scene(
            "waiting", "No time series was asked for with this charge: its grains appear here when it ends."
        )
    try:
        held = None if journal is None else list_journal(journal)
    except Unreadable:
        held = None
    if held is None or not held.times_s:
        says = (
            f"The grains appear here while the charge runs: at its start, then every {pause:g} s of simulated "
            "time. Of a worker on another machine they come when it ends."
        )
        return Scene("waiting", says)
    name, parts = _charged(charge.charge)
    return Scene(
        "ready",
        says=f"The charge is under way: its last stored frame is at {held.times_s[-1]:.4g} s of simulated time; "
        f"the next one, {pause:g} s later, appears here by itself.",
        title=f"Charge {charge.id}: {charge.charge}, under way",
        frames=_frames(f"{RUNNING}{charge.id}", held, lambda k: f"/scenes/{RUNNING}{charge.id}/walls/{k}"),
        materials=_materials(name, parts),
        colours=[HEIGHT, SIZE, MATERIAL, SPEED],
        missing=[Missing("time of arrival", "it is read when the charge is over")],
        note=_scaled(charge.scale),
        is_growing=True,
    )


def _charged(name: str) -> tuple[str, list[str]]:
    """The material of a shipped charge and, of a mix, its parts."""
    try:
        material = load_charge(name).material
    except InputError:
        return name, []
    return material.name, [part.material.name for part in material.parts]


def base_plate(results: Mapping[str, Any]) -> Surface:
    """The round base of a pile test as triangles, its top at z = 0."""
    radius = 0.5 * float(results["rig"]["base_diameter"])
    under = -PLATE_SHARE * radius
    bands = [revolution((0.0, 0.0), (radius, 0.0)), revolution((radius, 0.0), (radius, under))]
    points = np.concatenate([points for points, _ in bands])
    triangles = np.concatenate([bands[0][1], bands[1][1] + len(bands[0][0])])
    return Surface(points, triangles, np.zeros(len(triangles), np.int64))


def _find(
    files: Sequence[ArtifactRow], store: FileStore, is_at_end: bool, what: str, left: str
) -> tuple[ArtifactRow, Frames] | Scene:
    """The file with the grains and what it holds; where there is none, what to say instead."""
    by_kind = {file.kind: file for file in files}
    known = [by_kind[kind] for kind in SPHERE_KINDS if kind in by_kind]
    row = next((file for file in known if store.size(file.path) is not None), None)
    if row is not None:
        try:
            return row, list_frames(store.local(row.path))
        except Unreadable as error:
            return Scene("damaged", f"The grains cannot be shown: {error}.")
    if known:
        removed = "The grains were removed by the retention rule; every number of the run is kept."
        return Scene("removed", removed)
    if is_at_end:
        return Scene("none", f"{what} {left}.")
    return Scene("waiting", f"{what} is not over: its grains appear here when it ends.")


def _frames(scene: int | str, held: Frames, walls_of: Any) -> list[dict[str, Any]]:
    return [
        {"time_s": time, "grains": count, "url": f"/scenes/{scene}/frames/{k}", "walls": walls_of(k)}
        for k, (time, count) in enumerate(zip(held.times_s, held.counts, strict=True))
    ]


def _materials(name: str, parts: Sequence[str]) -> dict[int, str]:
    """Names by the row of the table of materials, in which 0 is the walls'; a material whose grains are of several
    kinds takes several rows, which the page numbers."""
    return {0: name} if not parts else dict(enumerate(parts, start=1))


def _parts_of(name: str) -> list[str]:
    """Of a mix; none of a material that this installation does not know."""
    return [part.material.name for part in load_material(name).parts] if name in material_names() else []


def _scaled(scale: float | None) -> str:
    if scale is None or scale == 1.0:
        return ""
    return f"Simulated grains are {scale:g} times as large as real ones (coarse-graining)."
