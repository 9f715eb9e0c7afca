"""Mesh files: what is read, in which units and which way up, and what is refused in one line."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from demcore.errors import InputError
from demcore.geometry.mesh import TriangleMesh
from demcore.geometry.mesh_file import load_mesh, save_mesh
from tests.builders.mesh_files import CORNERS, FACES, FILES, ascii_stl, binary_stl, obj, ply


def stored(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("name", FILES)
def test_the_same_box_from_every_format(tmp_path, name):
    mesh, report = load_mesh(stored(tmp_path, name, FILES[name]), "cm")
    assert len(mesh) == report.triangles == 12
    assert report.vertices == 8
    assert report.merged_vertices == (28 if name.lower().endswith("stl") else 0)
    assert report.watertight
    assert (report.open_edges, report.crowded_edges) == (0, 0)
    assert (report.lower, report.upper) == ((0, 0, 0), pytest.approx((0.01, 0.02, 0.03)))
    assert report.area == pytest.approx(22e-4)
    assert report.volume == pytest.approx(6e-6)
    assert "12 triangles" in report.line()
    assert "watertight" in report.line()
    assert report.record()["units"] == "cm"


@pytest.mark.parametrize(("units", "metres"), [("m", 1.0), ("mm", 1e-3), ("cm", 1e-2), ("inch", 0.0254)])
def test_units(tmp_path, units, metres):
    mesh, _ = load_mesh(stored(tmp_path, "box.stl", binary_stl()), units)
    assert mesh.vertices.max(axis=0) == pytest.approx(np.array([1, 2, 3]) * metres)


@pytest.mark.parametrize(("up", "size"), [("x", (2, 3, 1)), ("y", (1, 3, 2)), ("z", (1, 2, 3))])
def test_the_up_axis_becomes_z_and_nothing_is_mirrored(tmp_path, up, size):
    mesh, report = load_mesh(stored(tmp_path, "box.stl", binary_stl()), "m", up)
    assert tuple(np.ptp(mesh.vertices, axis=0)) == pytest.approx(size)
    column = "xyz".index(up)
    top = np.unique(mesh.vertices[:, 2]).tolist()
    assert top == sorted({float(c[column]) for c in CORNERS})
    # Outward faces stay outward: the signed volume is positive.
    a, b, c = mesh.corners().transpose(1, 0, 2)
    assert (a * np.cross(b, c)).sum() / 6 == pytest.approx(6.0)
    assert report.up_axis == up


def test_open_and_crowded_edges_are_counted(tmp_path):
    _, report = load_mesh(stored(tmp_path, "lid.stl", ascii_stl(FACES[:-2])), "m")
    assert (report.watertight, report.open_edges, report.volume) == (False, 4, None)
    assert "not watertight (4 open edges)" in report.line()
    fin = [*FACES, (0, 1, 6)]
    _, report = load_mesh(stored(tmp_path, "fin.stl", ascii_stl(fin)), "m")
    assert report.crowded_edges == 2
    # Closed, but one face turned over: no volume can be told.
    turned = [FACES[0][::-1], *FACES[1:]]
    _, report = load_mesh(stored(tmp_path, "turned.stl", ascii_stl(turned)), "m")
    assert (report.watertight, report.volume) == (True, None)


def test_polygons_and_several_materials_in_an_obj(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl a\nf 1/1/1 2/1/1 3/1/1\nusemtl b\nf 1//1 3//1 4//1\n"
    mesh, report = load_mesh(stored(tmp_path, "two.obj", text.encode()), "m")
    assert len(mesh) == 2
    assert report.area == pytest.approx(1.0)
    quad = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"
    assert load_mesh(stored(tmp_path, "quad.obj", quad.encode()), "m")[1].area == pytest.approx(1.0)


def zipped():
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("bomb.stl", b"\0" * 10_000_000)
    return buffer.getvalue()


TWO_EQUAL = [*FACES[:4], (3, 3, 5), *FACES[4:]]
NO_AREA = [*FACES[:7], (8, 9, 10)]
LINE = [*CORNERS, (5, 5, 5), (6, 6, 6), (8, 8, 8)]
NAN_CORNER = [*CORNERS[:-1], (1, float("nan"), 3)]

BAD = {
    "empty.stl": b"",
    "short.stl": binary_stl()[:60],
    "cut.stl": binary_stl()[:-30],
    "longer.stl": binary_stl() + b"\0" * 7,
    "huge_count.stl": binary_stl()[:80] + b"\xff" * 4 + binary_stl()[84:],
    "garbage.stl": bytes(range(256)) * 40,
    "text.stl": b"dear sir " * 100,
    "zip.stl": zipped(),
    "cut_text.stl": ascii_stl()[:-300],
    "cut_inside.stl": ascii_stl()[:-300] + b"endsolid box\n",
    "word.stl": ascii_stl().replace(b"vertex 1 0 3", b"vertex 1 zero 3", 1),
    "lost_corner.stl": ascii_stl().replace(b"  vertex 1 0 3\n", b"", 1),
    "no_facets.stl": b"solid nothing\nendsolid nothing\n",
    "no_end.ply": ply()[:60],
    "cut.ply": ply(form="binary_little_endian")[:-20],
    "cut_text.ply": ply()[:-30],
    "huge.ply": ply(vertex_count=10**15),
    "more_faces.ply": ply(face_count=13),
    "fewer_points.ply": ply(vertex_count=7, form="binary_little_endian"),
    "wrong_corner.ply": ply([*FACES, (0, 1, 8)]),
    "points.ply": ply([]).replace(b"element face 0\nproperty list uchar int vertex_indices\n", b""),
    "garbage.ply": b"ply\n" + bytes(range(256)) * 9,
    "no_faces.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\n",
    "wrong_corner.obj": obj([*FACES, (0, 1, 8)]),
    "relative.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -1 -2 -3\n",
    "zero.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n",
    "garbage.obj": bytes(range(256)) * 9,
    "box.step": ascii_stl(),
    "box.stl.gz": ascii_stl(),
    "box": ascii_stl(),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_refused_in_one_line_that_names_it(tmp_path, name):
    with pytest.raises(InputError) as caught:
        load_mesh(stored(tmp_path, name, BAD[name]), "mm")
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.__cause__ is None


@pytest.mark.parametrize("make", [ascii_stl, binary_stl, obj, ply])
@pytest.mark.parametrize(
    ("faces", "corners", "place"),
    [
        (TWO_EQUAL, CORNERS, "mesh.faces[4]"),
        (NO_AREA, LINE, "mesh.faces[7]"),
        (FACES, NAN_CORNER, "mesh.vertices["),
    ],
    ids=["equal corners", "no area", "nan"],
)
def test_a_triangle_without_area_is_refused_with_its_index_and_never_dropped(
    tmp_path, make, faces, corners, place
):
    name = "bad" + {ascii_stl: ".stl", binary_stl: ".stl", obj: ".obj", ply: ".ply"}[make]
    with pytest.raises(InputError) as caught:
        load_mesh(stored(tmp_path, name, make(faces, corners)), "m")
    assert name in caught.value.field
    # The reader may refuse a NaN in a text before we see where it stands.
    assert place in caught.value.field or (make is not binary_stl and place.startswith("mesh.vert"))


def test_units_and_axis_must_be_known(tmp_path):
    path = stored(tmp_path, "box.stl", binary_stl())
    for units in (None, "", "feet", "MM"):
        with pytest.raises(InputError) as caught:
            load_mesh(path, units)
        assert caught.value.field == "units"
    with pytest.raises(InputError) as caught:
        load_mesh(path, "mm", "w")
    assert caught.value.field == "up_axis"


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    (tmp_path / "folder.stl").mkdir()
    for name in ("nowhere.stl", "folder.stl"):
        with pytest.raises(InputError, match=name):
            load_mesh(tmp_path / name, "mm")


@pytest.mark.parametrize("kind", ["stl", "obj", "ply"])
def test_a_mesh_that_is_saved_and_read_again_is_the_same(kind, tmp_path):
    mesh = TriangleMesh(
        [[0, 0, 0], [1.25, 0, 0], [0, 2.5, 0], [0, 0, 0.5]], [[0, 2, 1], [0, 1, 3], [1, 2, 3]]
    )
    path = tmp_path / f"piece.{kind}"
    save_mesh(mesh, path)
    again, report = load_mesh(path, "mm")
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert np.sort(again.corners().reshape(-1, 9), axis=0) == pytest.approx(
        np.sort(mesh.corners().reshape(-1, 9), axis=0), abs=1e-6
    )
    assert report.upper == pytest.approx((1.25, 2.5, 0.5))


def test_a_mesh_is_saved_in_known_units_and_formats_only(tmp_path):
    mesh = TriangleMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    with pytest.raises(InputError, match="units: got 'furlong'"):
        save_mesh(mesh, tmp_path / "piece.stl", "furlong")
    with pytest.raises(InputError, match=r"piece.step: got '.step'"):
        save_mesh(mesh, tmp_path / "piece.step")
    assert list(tmp_path.iterdir()) == []
