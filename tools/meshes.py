#!/usr/bin/env python3
"""Meshes to show with the head CT: a stereotactic frame (STL) and a region in the brain (PLY, with normals and colours).

usage: tools/meshes.py FOLDER

Needs nothing but Python. The volume is the one that tools/demo packs: 245 x 245 x 162 mm.
"""

import math
import pathlib
import struct
import sys

CENTRE = (122.0, 118.0, 112.0)


def grid(columns, rows, place, closed_rows):
    """A sheet of columns x rows places, closed around the columns, and the triangles between them."""
    places = [place(i / columns, j / rows) for j in range(rows + (not closed_rows)) for i in range(columns)]
    at = lambda i, j: (j % rows if closed_rows else j) * columns + i % columns
    triangles = []
    for j in range(rows):
        for i in range(columns):
            a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
            triangles += [(a, b, c), (a, c, d)]
    return places, triangles


def ring(radius, width, height):
    """A torus of elliptic section about the head."""

    def place(u, v):
        around, across = math.tau * u, math.tau * v
        r = radius + width * math.cos(across)
        return (CENTRE[0] + r * math.cos(around), CENTRE[1] + r * math.sin(around), CENTRE[2] + height * math.sin(across))

    return grid(96, 24, place, True)


def pin(angle, inner, outer, radius):
    """A pin from the ring towards the middle, with a pointed end."""
    out = (math.cos(angle), math.sin(angle), 0.0)
    side = (-math.sin(angle), math.cos(angle), 0.0)
    profile = [(outer, 0.0), (outer, 1.8 * radius), (outer - 6, 1.8 * radius), (outer - 6, radius), (inner + 9, radius), (inner, 0.0)]

    def place(u, v):
        along, r = profile[round(v * (len(profile) - 1))]
        turn = math.tau * u
        return tuple(CENTRE[k] + along * out[k] + r * (math.cos(turn) * side[k] + math.sin(turn) * (k == 2)) for k in range(3))

    return grid(24, len(profile) - 1, place, False)


def write_stl(path, parts):
    triangles = [[places[i] for i in corners] for places, all_corners in parts for corners in all_corners]
    with open(path, "wb") as file:
        file.write(b"stereotactic frame, mm".ljust(80, b" ") + struct.pack("<I", len(triangles)))
        for corners in triangles:
            file.write(struct.pack("<12fH", 0, 0, 0, *[x for corner in corners for x in corner], 0))


def write_ply(path, centre, radii):
    """An ellipsoid, coloured from top to bottom."""

    def unit(u, v):
        around, down = math.tau * u, math.pi * v
        return (math.sin(down) * math.cos(around), math.sin(down) * math.sin(around), math.cos(down))

    places, triangles = grid(48, 24, unit, False)
    with open(path, "w", encoding="ascii") as file:
        file.write(f"ply\nformat ascii 1.0\nelement vertex {len(places)}\n")
        for name in ("x", "y", "z", "nx", "ny", "nz"):
            file.write(f"property float {name}\n")
        for name in ("red", "green", "blue"):
            file.write(f"property uchar {name}\n")
        file.write(f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n")
        for n in places:
            vertex = [c + r * x for c, r, x in zip(centre, radii, n)] + [x / r for r, x in zip(radii, n)]
            color = [round(255 * (0.5 + 0.5 * n[2])), 60, round(255 * (0.5 - 0.5 * n[2]))]
            file.write(" ".join([f"{x:.5g}" for x in vertex] + [str(c) for c in color]) + "\n")
        for corners in triangles:
            file.write("3 " + " ".join(map(str, corners)) + "\n")


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[1])
    pins = [pin(math.tau * (0.125 + k / 4), inner, 128, 2.5) for k, inner in enumerate((62, 64, 76, 74))]
    write_stl(folder / "frame.stl", [ring(118, 4, 7)] + pins)
    write_ply(folder / "region.ply", (112, 120, 105), (38, 46, 30))
    print(f"{folder}/frame.stl {folder}/region.ply")


main()
