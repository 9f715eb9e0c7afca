"""A box as the bytes of a mesh file of every format."""

from __future__ import annotations

import struct

# A box of 1 x 2 x 3 in the units of the file, twelve triangles wound outwards.
CORNERS = [(x, y, z) for x in (0, 1) for y in (0, 2) for z in (0, 3)]
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = [f for a, b, c, d in QUADS for f in ((a, b, c), (a, c, d))]


def ascii_stl(faces=FACES, corners=CORNERS):
    facets = "".join(
        "facet normal 0 0 0\n outer loop\n"
        + "".join("  vertex {} {} {}\n".format(*corners[k]) for k in face)
        + " endloop\nendfacet\n"
        for face in faces
    )
    return f"solid box\n{facets}endsolid box\n".encode()


def binary_stl(faces=FACES, corners=CORNERS):
    body = b"".join(
        struct.pack("<12fH", 0, 0, 0, *[x for k in face for x in corners[k]], 0) for face in faces
    )
    return b"talus".ljust(80) + struct.pack("<I", len(faces)) + body


def obj(faces=FACES, corners=CORNERS):
    lines = ["v {} {} {}".format(*c) for c in corners] + [
        "f {} {} {}".format(*(k + 1 for k in f)) for f in faces
    ]
    return ("# a box\nmtllib nowhere.mtl\nusemtl steel\n" + "\n".join(lines) + "\n").encode()


def ply(faces=FACES, corners=CORNERS, vertex_count=None, face_count=None, form="ascii"):
    header = (
        f"ply\nformat {form} 1.0\nelement vertex {vertex_count or len(corners)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {face_count or len(faces)}\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()
    if form == "ascii":
        rows = ["{} {} {}".format(*c) for c in corners] + ["3 {} {} {}".format(*f) for f in faces]
        return header + ("\n".join(rows) + "\n").encode()
    body = b"".join(struct.pack("<3f", *c) for c in corners)
    return header + body + b"".join(struct.pack("<B3i", 3, *f) for f in faces)


FILES = {
    "ascii.stl": ascii_stl(),
    "binary.stl": binary_stl(),
    "SHOUTS.STL": ascii_stl().upper(),
    "box.obj": obj(),
    "ascii.ply": ply(),
    "binary.ply": ply(form="binary_little_endian"),
}
