"""The plant as data: its shipped numbers, changes to them, meshes in their place, and what is refused."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
import trimesh

from demcore.errors import InputError
from demcore.geometry.mesh import TriangleMesh
from demcore.geometry.walls import Wall
from demcore.plant import jet
from demcore.plant.checks import (
    capacity,
    check_mass,
    check_plant,
    level_of,
    level_volume,
)
from demcore.plant.clearance import check_inlet, distance_to_mesh, distance_to_wall, feed_inlet
from demcore.plant.parts import Hopper, Rod
from demcore.plant.plant_file import load_plant
from demcore.plant.surfaces import (
    belt_mesh,
    belt_profile,
    deflector_mesh,
    lid_mesh,
    outside_rectangle,
    plant_walls,
    skirt_mesh,
)

PLANT = load_plant()
PUBLISHED = {
    "drum_height_mm": 2050.0,
    "drum_across_mm": 1541.0,
    "drum_along_mm": 927.5,
    "drum_diameter_mm": 750.0,
    "thickness_mm": 12.0,
    "speed_m_s": 1.79,
    "tilt_deg": 4.0,
    "rollers": 3,
}


def test_every_number_has_its_reason_and_the_published_ones_are_the_papers():
    table = tomllib.loads(files("demcore").joinpath("data/plant.toml").read_text(encoding="utf-8"))
    rows = {
        f"{part}.{key}": row for part, t in table.items() if part != "head_room" for key, row in t.items()
    }
    rows["plant.head_room"] = table["head_room"]
    assert all(len(row["why"]) > 10 for row in rows.values())
    assert dict(PLANT.sources) == {name: row["why"] for name, row in rows.items()}
    belt = table["belt"]
    assert {key: belt[key]["value"] for key in PUBLISHED} == PUBLISHED
    assert all("paper, section 3.1" in belt[key]["why"] for key in PUBLISHED)
    assumed = [row["why"] for name, row in rows.items() if name.split(".")[1] not in PUBLISHED]
    assert all(why.startswith(("assumed: ", "from the jet: ", "the belt's middle")) for why in assumed)


def test_the_drum_stands_where_the_paper_puts_it():
    belt = PLANT.belt
    assert belt.drum_centre == (-1.541, -0.9275, 2.05)
    assert belt.outer_radius == pytest.approx(0.387)
    to_centre = np.subtract(belt.tangent_point, belt.drum_centre)
    assert math.hypot(*to_centre) == pytest.approx(0.387)
    assert np.dot(to_centre, belt.running) == pytest.approx(0.0, abs=1e-15)


def test_the_hopper_holds_both_charges_with_head_room():
    """3 t of coke at 508 kg/m3 and 12.5 t of iron, 65 % sinter at 1863 and 35 % pellet at 2088 kg/m3."""
    check_mass(PLANT, 3000.0, 508.0)
    check_mass(PLANT, 12_500.0, 1.0 / (0.65 / 1863.0 + 0.35 / 2088.0))
    most = capacity(PLANT) * 508.0 / 1.2
    with pytest.raises(
        InputError, match=rf"charge.mass: got 12000.*at most {most:.0f} kg.*with 20% head room"
    ):
        check_mass(PLANT, 12_000.0, 508.0)


def test_the_capacity_is_that_of_a_cylinder_and_cones():
    """A cylinder of 2 m across and 1 m deep, over a bell .9 m high and a thin rod."""
    rod = 1e-3
    plain = replace(
        PLANT,
        hopper=Hopper(rim_radius=1.0, cylinder_height=1.0, seat_radius=1.0, seat_depth=1.0 + 1e-3),
        bell=replace(PLANT.bell, slope_deg=math.degrees(math.atan(0.9))),
        rod=Rod(rod, 1.0),
    )
    expected = math.pi * 1.001 - math.pi / 3.0 * 0.9
    assert capacity(plain) == pytest.approx(expected, rel=1e-5)
    assert level_volume(plain, 0.0) == pytest.approx(capacity(plain), rel=1e-12)
    assert level_volume(plain, -1.001) == 0.0


def test_the_volume_below_a_level_is_the_integral_of_the_floor():
    """Rings of the radius, each from the floor up to the level: an independent sum."""
    for z in (-2.0, -1.0, -0.3, 0.0):
        r = (np.arange(40_000) + 0.5) / 40_000 * PLANT.hopper.rim_radius
        floor = np.array([PLANT.floor_at(float(radius)) for radius in r])
        open_height = np.where(r > PLANT.rod.radius, np.maximum(z - floor, 0.0), 0.0)
        rings = float((2.0 * np.pi * r * open_height).sum() * (r[1] - r[0]))
        assert level_volume(PLANT, z) == pytest.approx(rings, rel=1e-3)
        assert level_of(PLANT, level_volume(PLANT, z)) == pytest.approx(z, abs=1e-6)


def test_the_jet_leaves_as_published_and_follows_its_parabola():
    """32.4 degrees past the top: physics.md section 3. The fall is timed by an independent sum of small steps."""
    start = jet.release(PLANT.belt)
    assert start.angle_deg == pytest.approx(32.4, abs=0.05)
    assert math.hypot(start.vx, start.vz) == pytest.approx(1.79)
    x, z, vz, dt = start.x, start.z, start.vz, 1e-5
    while z > -0.5:
        x, z, vz = x + start.vx * dt, z + vz * dt, vz - 9.81 * dt
    assert jet.x_at(start, -0.5) == pytest.approx(x, abs=1e-4)


def test_a_fast_belt_throws_where_it_meets_the_drum():
    fast = jet.release(replace(PLANT.belt, speed=3.0))
    assert fast.angle_deg == pytest.approx(-4.0)
    assert fast.vz == pytest.approx(3.0 * math.sin(math.radians(4.0)))
    assert (fast.x, fast.z) == pytest.approx((PLANT.belt.tangent_point[0], PLANT.belt.tangent_point[2]))


def test_where_the_jet_crosses_the_lid():
    x, y, z = jet.crossing(PLANT)
    assert z == pytest.approx(PLANT.lid_at(math.hypot(x, y)), abs=1e-9)
    assert x == pytest.approx(jet.x_at(jet.release(PLANT.belt), z))


def test_a_layer_above_the_belt_is_thrown_farther():
    places = [jet.crossing(PLANT, height)[0] for height in (0.0, 0.03, 0.06, 0.1)]
    assert places == sorted(places)


@pytest.mark.parametrize(
    ("part", "change", "said"),
    [
        ("belt", {"speed": 0.5}, "belt.speed.*a jet through the hatch"),
        ("belt", {"speed": 4.0}, "belt.speed.*a jet through the hatch"),
        ("belt", {"drum_along": 0.0}, "belt.speed.*a jet through the hatch"),
        ("belt", {"drum_height": 0.5}, "belt.drum_height.*clear of the lid"),
        ("hatch", {"width": 2.0}, "hatch.length.*inside the rim"),
        ("hatch", {"centre_along": -0.4}, "hatch.width.*clear of the rod"),
        ("deflector", {"ridge_height": 1.0}, "deflector.*below its lid"),
        ("deflector", {"ridge_height": -1.9}, "deflector.*above the bell"),
        ("deflector", {"edge_length": 2.4}, "deflector.*inside the hopper"),
    ],
)
def test_parts_that_do_not_fit_are_refused(part, change, said):
    with pytest.raises(InputError, match=said):
        check_plant(replace(PLANT, **{part: replace(getattr(PLANT, part), **change)}))


@pytest.mark.parametrize(
    ("part", "change", "said"),
    [
        ("belt", {"rollers": 5}, "belt.rollers: got 5"),
        ("belt", {"speed": 0.0}, "belt.speed"),
        ("belt", {"transition_length": 4.0}, "belt.transition_length"),
        ("belt", {"width": 800.0}, "belt.width: got 800.0, allowed is 0.001 to 100 m"),
        ("hopper", {"seat_depth": 0.3}, "hopper.seat_depth"),
        ("hopper", {"seat_radius": 2.0}, "hopper.seat_radius"),
        ("hopper", {"rim_radius": math.nan}, "hopper.rim_radius"),
        ("bell", {"slope_deg": 90.0}, "bell.slope_deg"),
        ("bell", {"slope_deg": 70.0}, "bell.slope_deg.*a bell below the rim"),
        ("rod", {"radius": 0.4}, "rod.radius"),
        ("lid", {"inner_radius": 2.0}, "lid.inner_radius"),
        ("deflector", {"far_pitch_deg": 95.0}, "deflector.far_pitch_deg"),
        ("feeder", {"fall_speed": -1.0}, "feeder.fall_speed"),
        ("feeder", {"skirt_length": 3.0}, "feeder.skirt_length: got 3.0, allowed is at most 2.8 m"),
    ],
)
def test_a_part_refuses_what_cannot_be(part, change, said):
    with pytest.raises(InputError, match=said):
        replace(PLANT, **{part: replace(getattr(PLANT, part), **change)})


def test_an_inlet_inside_a_wall_is_refused():
    check_inlet(PLANT, 0.2, feed_inlet(PLANT))
    low = replace(PLANT, feeder=replace(PLANT.feeder, drop=0.05))
    with pytest.raises(InputError, match=r"feeder.drop: got 0.05.*an inlet clear of walls"):
        check_inlet(low, 0.2, feed_inlet(low))
    with pytest.raises(InputError, match=r"feeder.*room for the largest grain"):
        check_inlet(PLANT, 0.6, feed_inlet(PLANT))


def test_distances_to_walls_are_those_of_geometry():
    """A cone's slant face, its rim beyond the face, a tube from inside and beyond its end; a triangle's face, edge
    and corner."""
    cone = Wall("cone", (0.0, 0.0, 1.0), radius=1.0, end_radius=2.0, length=1.0)
    points = np.array([[2.5, 0.0, 1.0], [0.0, 3.0, 2.0], [0.0, 0.0, 1.0]])
    root = math.sqrt(0.5)
    assert distance_to_wall(points, cone, 9.0) == pytest.approx([1.5 * root, 1.0, 1.0])
    tube = Wall("cylinder", axis=(0.0, 2.0, 0.0), radius=1.0, length=2.0)
    points = np.array([[0.4, 1.0, 0.0], [1.0, 3.0, 0.0], [0.0, -1.0, 2.0]])
    assert distance_to_wall(points, tube, 9.0) == pytest.approx([0.6, 1.0, math.sqrt(2.0)])
    mesh = TriangleMesh(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([[0, 1, 2]]))
    points = np.array([[0.2, 0.2, 0.3], [0.5, -0.4, 0.0], [-0.3, -0.4, 0.0]])
    assert distance_to_mesh(points, mesh, 9.0) == pytest.approx([0.3, 0.4, 0.5])
    assert np.isinf(distance_to_mesh(points + 5.0, mesh, 1.0)).all()


def test_the_inlet_lies_over_the_belts_tail():
    inlet, belt = feed_inlet(PLANT), PLANT.belt
    back = np.subtract(inlet.centre, belt.tangent_point)
    assert -float(back @ np.array(belt.running)) == pytest.approx(belt.loaded_length - 0.45)
    assert float(back @ np.array(belt.normal)) == pytest.approx(PLANT.feeder.drop)


def test_the_lid_has_the_hatch_and_nothing_else_missing():
    """Area in plan: the circle's 64-gon less the inner one less the hatch."""
    mesh = lid_mesh(PLANT)
    corners = mesh.corners()[:, :, :2]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * float(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    polygon = 32.0 * math.sin(math.pi / 32.0) * (PLANT.hopper.rim_radius**2 - 0.3**2)
    assert area == pytest.approx(polygon - PLANT.hatch.length * PLANT.hatch.width, rel=1e-9)
    centres = corners.mean(axis=1)
    (x0, y0), (x1, y1) = PLANT.hatch.lower, PLANT.hatch.upper
    inside = (centres[:, 0] > x0) & (centres[:, 0] < x1) & (centres[:, 1] > y0) & (centres[:, 1] < y1)
    assert not inside.any()


def test_cutting_a_rectangle_out_of_a_polygon():
    square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 1.0, 0.0]])

    def area(pieces):
        flat = [
            0.5 * abs(sum(p[k][0] * p[k - 1][1] - p[k][1] * p[k - 1][0] for k in range(len(p))))
            for p in pieces
        ]
        return sum(flat)

    def cut(lower, upper):
        return outside_rectangle(square, np.array(lower), np.array(upper))

    assert area(cut((0.25, 0.25), (0.5, 0.75))) == pytest.approx(1.0 - 0.125)
    assert area(cut((-1.0, -1.0), (2.0, 2.0))) == 0.0
    assert area(cut((2.0, 2.0), (3.0, 3.0))) == pytest.approx(1.0)
    assert area(cut((0.5, -1.0), (2.0, 2.0))) == pytest.approx(0.5)
    for piece in cut((0.25, 0.25), (0.5, 0.75)):
        assert np.allclose(piece[:, 2], piece[:, 0])


def test_the_deflectors_faces_have_their_pitches_and_lengths():
    d = replace(PLANT.deflector, near_pitch_deg=30.0, far_pitch_deg=60.0, rotation_deg=90.0)
    mesh = deflector_mesh(d)
    normals = mesh.normals()
    assert np.degrees(np.arccos(normals[:, 2])) == pytest.approx([30.0, 30.0, 60.0, 60.0])
    # Turned by 90 degrees, near looks to -y and far to +y.
    assert (normals[:2, 1] < 0.0).all() and (normals[2:, 1] > 0.0).all()
    corners = mesh.corners()
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.sqrt((doubled**2).sum(axis=1)).sum()
    assert area == pytest.approx(2.0 * d.edge_length * d.face_length)
    assert mesh.vertices[:2].mean(axis=0) == pytest.approx((d.ridge_across, d.ridge_along, d.ridge_height))


def test_the_belt_is_troughed_and_flattens_out_to_the_drum():
    belt = PLANT.belt
    strip = belt.width / 3.0
    assert belt_profile(belt, 0.0)[:, 1] == pytest.approx(np.zeros(4))
    assert np.ptp(belt_profile(belt, 0.0)[:, 0]) == pytest.approx(belt.width)
    full = belt_profile(belt, 3.0)
    assert full[0, 1] == pytest.approx(strip * 0.5)
    for upstream in (0.0, 0.5, 3.0):
        lengths = np.sqrt((np.diff(belt_profile(belt, upstream), axis=0) ** 2).sum(axis=1))
        assert lengths == pytest.approx([strip] * 3)
    mesh = belt_mesh(belt)
    assert (mesh.normals() @ np.array(belt.normal) > 0.8).all()
    assert np.ptp(mesh.vertices @ np.array(belt.running)) == pytest.approx(belt.loaded_length)


def test_the_skirtboards_stand_on_the_belts_edges():
    mesh, belt = skirt_mesh(PLANT), PLANT.belt
    areas = 2.0 * PLANT.feeder.skirt_length * PLANT.feeder.skirt_height
    corners = mesh.corners()
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert 0.5 * np.sqrt((cross**2).sum(axis=1)).sum() == pytest.approx(areas)
    edge = belt_profile(belt, belt.loaded_length)[3]
    offset = mesh.vertices - np.array(belt.tangent_point)
    assert np.abs(offset[:, 1]) == pytest.approx(edge[0])
    above = offset @ np.array(belt.normal)
    assert above.min() == pytest.approx(edge[1])
    assert above.max() == pytest.approx(edge[1] + 0.5)


def test_belt_and_drum_run_alike_and_nothing_else_moves():
    walls = {wall.name: wall for wall in plant_walls(PLANT)}
    assert list(walls) == [
        "hopper",
        "hopper cone",
        "bell",
        "rod",
        "lid",
        "deflector",
        "skirt",
        "belt",
        "drum",
    ]
    assert math.hypot(*walls["belt"].surface_velocity) == pytest.approx(1.79)
    assert walls["drum"].angular_velocity[1] * walls["drum"].radius == pytest.approx(1.79)
    still = [w for name, w in walls.items() if name not in ("belt", "drum")]
    assert not any(any(w.surface_velocity) or any(w.angular_velocity) for w in still)
    assert walls["bell"].length == pytest.approx(1.175 * math.tan(math.radians(50.0)))


def test_a_file_of_ones_own_changes_only_what_it_names(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(
        "head_room = 0.1\n[belt]\nspeed_m_s = 2\n[deflector]\n"
        'ridge_across_mm = { value = -200, why = "measured" }\nedge_length_mm = 800\n'
    )
    plant = load_plant(file)
    assert plant.head_room == 0.1
    assert plant.belt == replace(PLANT.belt, speed=2.0)
    assert plant.deflector == replace(PLANT.deflector, ridge_across=-0.2, edge_length=0.8)
    reasons = dict(plant.sources)
    assert reasons["deflector.ridge_across_mm"] == "measured"
    assert reasons["belt.speed_m_s"] == "given in mine.toml"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[belt]\nwidth = 0.8\n", "belt.width: got 0.8, allowed is width_mm: a number says its unit"),
        ("[belt]\ncolour = 1\n", "belt.colour: got 1, allowed is a known key"),
        ("[belt]\nwidth_mm = '800'\n", "belt.width_mm: got '800', allowed is a number"),
        ("[belt]\nwidth_mm = true\n", "belt.width_mm: got True"),
        ("[belt]\nwidth_mm = nan\n", "belt.width_mm: got nan"),
        ("[belt]\nwidth_mm = { value = 1, reason = 'x' }\n", "belt.width_mm"),
        ("[crane]\nwidth_mm = 1\n", "plant.crane"),
        ("belt = 5\n", "plant.belt: got 5"),
        ("[belt\n", "a TOML file"),
        ("[feeder]\nstl = 'a.stl'\nstl_units = 'mm'\n", "feeder.stl"),
        ("[deflector]\nstl = 'a.stl'\n", "deflector.stl_units: got None"),
        ("[deflector]\nstl_units = 'mm'\n", "deflector.stl: got None"),
        ("[deflector]\nstl = 'a.stl'\nstl_units = 'mm'\n", "a.stl"),
    ],
)
def test_a_bad_file_is_refused(text, said, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=said.replace("[", r"\[")):
        load_plant(file)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="plant_file"):
        load_plant(tmp_path / "nowhere.toml")


def write_stl(path, mesh: TriangleMesh, factor: float) -> None:
    trimesh.Trimesh(mesh.vertices * factor, mesh.faces, process=False).export(path)


def test_an_stl_in_millimetres_replaces_a_part_and_read_as_metres_is_refused(tmp_path):
    write_stl(tmp_path / "mine.stl", deflector_mesh(PLANT.deflector), 1000.0)
    file = tmp_path / "mine.toml"
    file.write_text('[deflector]\nstl = "mine.stl"\nstl_units = "mm"\n')
    plant = load_plant(file)
    walls = {wall.name: wall for wall in plant_walls(plant)}
    assert len(walls["deflector"].mesh) == 4
    assert walls["deflector"].mesh.vertices.min(axis=0) == pytest.approx(
        deflector_mesh(PLANT.deflector).vertices.min(axis=0), abs=1e-6
    )
    file.write_text('[deflector]\nstl = "mine.stl"\nstl_units = "m"\n')
    with pytest.raises(
        InputError, match=r"deflector.stl_units: got 'mine.stl read in m'.*is its unit another"
    ):
        load_plant(file)


def test_a_replaced_belt_runs_too(tmp_path):
    write_stl(tmp_path / "belt.stl", belt_mesh(PLANT.belt), 1.0)
    file = tmp_path / "mine.toml"
    file.write_text('[belt]\nstl = "belt.stl"\nstl_units = "m"\n')
    walls = {wall.name: wall for wall in plant_walls(load_plant(file))}
    assert math.hypot(*walls["belt"].surface_velocity) == pytest.approx(1.79)
