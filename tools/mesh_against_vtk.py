#!/usr/bin/env python3
"""Meshes of `brickyard mesh` beside VTK's: distances, triangles, processor time, memory, and whether trimesh finds them watertight.

usage: tools/mesh_against_vtk.py BRICKYARD FOLDER [--edge N] [--only KIND]

Makes volumes of N voxels along each edge in FOLDER, packs them, and extracts each surface by both: isosurfaces beside vtkFlyingEdges3D, labels beside
vtkSurfaceNets3D; then all labels at once, each closed, with the same vertices as its neighbours, whose cells' labels are looked up; then some of
them decimated, beside vtkQuadricDecimation of VTK's surface to as many triangles. Distances are Hausdorff's, from vertices to the other mesh's
triangles, in voxels; of decimated meshes both ways from the whole one, and from points within triangles, too. VTK's volumes are padded by a voxel, so
that its surfaces are closed as well. Memory is anonymous and shared as the kernel counts it. Needs numpy, scipy, trimesh and vtk.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from large_outputs import objects_of
from measuring import measured


def smooth(n):
    """A gyroid in a ball: 32-bit floats."""
    x = np.linspace(-1, 1, n, dtype="f4")
    z, y, x = np.meshgrid(x, x, x, indexing="ij", sparse=True)
    w = np.float32(4 * np.pi)
    gyroid = np.sin(w * x) * np.cos(w * y) + np.sin(w * y) * np.cos(w * z) + np.sin(w * z) * np.cos(w * x)
    return np.minimum(gyroid + np.float32(0.2), 12 * (np.float32(0.9) - np.sqrt(x * x + y * y + z * z)))


def rounded(n):
    """The same in bytes: many voxels equal the isovalue."""
    return np.clip(np.round(100 + 40 * smooth(n)), 0, 255).astype("u1")


def noise(n):
    # Nearly every cell has triangles: few voxels make many.
    return np.random.default_rng(1).integers(0, 256, (min(n // 2, 64),) * 3, "u1")


def cells(n):
    """Labels of the nearest of 60 points, in a ball."""
    points = np.random.default_rng(2).uniform(0, n, (60, 3)).astype("f4")
    labels = np.empty((n, n, n), "u2")
    y, x = np.indices((n, n), "f4", sparse=True)
    for z in range(n):
        least = np.full((n, n), np.inf, "f4")
        for label, (pz, py, px) in enumerate(points, 1):
            squared = np.square(x - px) + (np.square(y - py) + np.square(z - pz))
            labels[z][squared < least] = label
            np.minimum(least, squared, out=least)
        labels[z][np.square(x - n / 2) + (np.square(y - n / 2) + np.square(z - n / 2)) >= np.square(0.45 * n)] = 0
    return labels


# Name, volume, isovalue or label, iterations of smoothing, and the greatest distance from VTK's mesh in voxels: of isosurfaces that of ambiguous cells,
# which are split in another way, of labels that of two ways to smooth.
CASES = [
    ("floats", smooth, ["--isovalue", "0.01"], 0),
    ("bytes", rounded, ["--isovalue", "100"], 0),
    ("noise", noise, ["--isovalue", "127.5"], 0),
    ("label", cells, ["--label", "7"], 0),
    ("label, smoothed", cells, ["--label", "7"], 16),
]


# The same with tolerances in voxels.
DECIMATED = [
    ("floats", smooth, ["--isovalue", "0.01"], 0, 0.05),
    ("floats", smooth, ["--isovalue", "0.01"], 0, 0.2),
    ("floats", smooth, ["--isovalue", "0.01"], 0, 1),
    ("bytes", rounded, ["--isovalue", "100"], 0, 0.2),
    ("noise", noise, ["--isovalue", "127.5"], 0, 0.2),
    ("label, smoothed", cells, ["--label", "7"], 16, 0.2),
]


# All labels: iterations of smoothing, and flags.
ALL_LABELS = [("labels", 0, []), ("labels, smoothed", 16, []), ("labels, smoothed, within 0.2", 16, ["--decimate", "0.2"])]


def of_vtk(array, flags, smoothing, out, target):
    """Extracts by VTK, in this process."""
    import vtk
    from vtk.util import numpy_support

    kind, value = flags
    volume = np.load(array)
    if kind == "--isovalue":
        # The surface is closed half a voxel past the outermost centres.
        volume, is_pad = np.pad(volume, 1, "edge"), np.pad(np.zeros(volume.shape, bool), 1, constant_values=True)
        pad = volume[is_pad].astype(float)
        volume[is_pad] = np.where(pad >= float(value), 2 * float(value) - pad, pad)
    else:
        volume = np.pad(volume, 1)
    image = vtk.vtkImageData()
    image.SetDimensions(*volume.shape[::-1])
    image.SetOrigin(-1, -1, -1)
    image.GetPointData().SetScalars(numpy_support.numpy_to_vtk(volume.ravel(), deep=False))
    if kind == "--isovalue":
        surface = vtk.vtkFlyingEdges3D()
        surface.SetValue(0, float(value))
        surface.ComputeNormalsOff()
    else:
        surface = vtk.vtkSurfaceNets3D()
        surface.SetBackgroundLabel(0)
        if value == "all":
            for i, label in enumerate(np.unique(volume)[1:]):
                surface.SetLabel(i, label)
        else:
            surface.SetValue(0, float(value))
            surface.SetOutputStyleToSelected()
            surface.AddSelectedLabel(float(value))
        surface.SetOutputMeshTypeToTriangles()
        surface.SetSmoothing(smoothing > 0)
        surface.SetNumberOfIterations(smoothing)
    surface.SetInputData(image)
    began, cpu = time.perf_counter(), time.process_time()
    surface.Update()
    if target:
        whole = surface
        surface = vtk.vtkQuadricDecimation()
        surface.SetInputData(whole.GetOutput())
        surface.SetTargetReduction(1 - target / whole.GetOutput().GetNumberOfCells())
        surface.Update()
    seconds, cpu = time.perf_counter() - began, time.process_time() - cpu
    writer = vtk.vtkPLYWriter()
    writer.SetInputData(surface.GetOutput())
    writer.SetFileName(out)
    writer.Write()
    print(json.dumps({"seconds": seconds, "cpu_s": cpu, "triangles": surface.GetOutput().GetNumberOfCells()}))


# Vertices nearer to each other than this are at the same place but for a least distance from the voxels' centres.
ROUNDED = 1.5 / 1024


def distances(a, b, within=False):
    """Hausdorff's distance both ways, in voxels; also from 12 points within each triangle of the first mesh and at its sides."""
    import vtk
    from scipy.spatial import cKDTree
    from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

    def read(path):
        reader = vtk.vtkPLYReader()
        reader.SetFileName(str(path))
        reader.Update()
        return reader.GetOutput()

    first = read(a)
    if within:
        places = vtk_to_numpy(first.GetPoints().GetData())
        corners = places[vtk_to_numpy(first.GetPolys().GetConnectivityArray()).reshape(-1, 3)]
        shares = [(i / 4, j / 4, (4 - i - j) / 4) for i in range(4) for j in range(5 - i) if max(i, j, 4 - i - j) < 4]
        points = np.concatenate([places, *(np.einsum("k,nkd->nd", np.array(share, "f4"), corners) for share in shares)])
        first.GetPoints().SetData(numpy_to_vtk(points, deep=True))
    both = vtk.vtkHausdorffDistancePointSetFilter()
    both.SetInputData(0, first)
    both.SetInputData(1, read(b))
    both.SetTargetDistanceMethodToPointToCell()
    both.Update()
    # A triangle whose corners meet is no triangle to VTK, but its corners are still points of the mesh.
    places = [vtk_to_numpy(both.GetOutput(k).GetPoints().GetData()) for k in (0, 1)]
    found = [vtk_to_numpy(both.GetOutput(k).GetPointData().GetArray("Distance")) for k in (0, 1)]
    for k, far in enumerate([distance > ROUNDED for distance in found]):
        if far.any():
            found[k][far] = np.minimum(found[k][far], cKDTree(places[1 - k]).query(places[k][far])[0])
    return [distance.max() for distance in found]


def watertight(path):
    import trimesh

    mesh = trimesh.load(path)
    return mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0, mesh.volume


def packed(a, make):
    """A volume and its store."""
    array, store = a.folder / f"{make.__name__}.npy", a.folder / f"{make.__name__}.zarr"
    if not store.exists():
        np.save(array, make(a.edge))
        kind = "labels" if make is cells else "image"
        subprocess.run([a.brickyard, "pack", array, store, "--kind", kind, "--progress", "none"], check=True)
    return array, store


def ours_of(a, store, flags, smoothing, out, *more):
    command = [a.mesh or a.brickyard, *([] if a.mesh else ["mesh"]), store, out, *flags, "--smooth", str(smoothing), "--memory", a.memory, "--overwrite",
               "--json", "--progress", "none", *more]
    return of_json(command)


def vtk_of(array, flags, smoothing, out, target=0):
    return of_json([sys.executable, __file__, "--vtk", array, *flags, str(smoothing), out, str(target)])


def of_json(command):
    """A command's own report, and its measures."""
    found = measured(command)
    return json.loads(found.output), found


def table(rows):
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in rows[:1] + [["---"] * len(rows[0])] + rows[1:])


YES = {True: "yes", False: "no"}


def costs(cost, known, vtk_cost):
    """Processor seconds and memory of both. Of VTK only its filters' seconds count, and its memory has the volume."""
    return f"{cost.cpu_s:.2f}", f"{known['cpu_s']:.2f}", cost.most_bytes >> 20, vtk_cost.most_bytes >> 20


def whole(a):
    rows = [["", "voxels", "triangles", "VTK's", "farthest, voxels", "VTK's from ours", "volume, ours / VTK's", "watertight", "VTK's",
             "CPU s", "VTK's", "peak MiB", "VTK's"]]
    for name, make, flags, smoothing in CASES:
        array, store = packed(a, make)
        ours, theirs = a.folder / "ours.ply", a.folder / "vtk.ply"
        found, cost = ours_of(a, store, flags, smoothing, ours)
        known, vtk_cost = vtk_of(array, flags, smoothing, theirs)
        forth, back = distances(ours, theirs)
        (tight, volume), (vtk_tight, vtk_volume) = watertight(ours), watertight(theirs)
        voxels = np.load(array, mmap_mode="r").shape[0]
        rows.append([name, f"{voxels}³", found["objects"][0]["triangles"], known["triangles"], f"{forth:.3f}", f"{back:.3f}",
                     f"{volume / vtk_volume:.5f}", YES[tight], YES[vtk_tight], *costs(cost, known, vtk_cost)])
        print(" | ".join(map(str, rows[-1])), flush=True)
        if not tight:
            sys.exit(f"{name}: not watertight")
    print("\n" + table(rows))


def decimated(a):
    rows = [["", "voxels", "triangles", "within, voxels", "triangles left", "farthest", "VTK's", "watertight", "VTK's", "CPU s", "VTK's", "peak MiB", "VTK's"]]
    full, vtk_full, ours, theirs = [a.folder / f"{name}.ply" for name in ("full", "vtk_full", "ours", "vtk")]
    for name, make, flags, smoothing, voxels in DECIMATED:
        array, store = packed(a, make)
        whole, _ = ours_of(a, store, flags, smoothing, full)
        found, cost = ours_of(a, store, flags, smoothing, ours, "--decimate", str(voxels))
        whole, found = whole["objects"][0]["triangles"], found["objects"][0]["triangles"]
        vtk_of(array, flags, smoothing, vtk_full)
        known, vtk_cost = vtk_of(array, flags, smoothing, theirs, found)
        farthest, vtk_farthest = max(distances(ours, full, True)), max(distances(theirs, vtk_full, True))
        (tight, _), (vtk_tight, _) = watertight(ours), watertight(theirs)
        rows.append([name, f"{np.load(array, mmap_mode='r').shape[0]}³", whole, voxels, f"{found} ({100 * found / whole:.1f}%)", f"{farthest:.3f}",
                     f"{vtk_farthest:.3f}", YES[tight], YES[vtk_tight], *costs(cost, known, vtk_cost)])
        print(" | ".join(map(str, rows[-1])), flush=True)
        if not tight:
            sys.exit(f"{name}: not watertight")
    print("\n" + table(rows))


def crossed(around):
    """Cells beside a face whose four voxels meet crosswise, where labels have vertices of their own; `around` has a voxel more on each side."""
    from scipy.ndimage import binary_dilation

    found = np.zeros([n - 1 for n in around.shape], bool)
    for axis in range(3):
        along = np.moveaxis(around, axis, 0)
        a, b, c, d = along[:, :-1, :-1], along[:, 1:, :-1], along[:, 1:, 1:], along[:, :-1, 1:]
        faces = (a == c) & (a != b) & (a != d) | (b == d) & (b != a) & (b != c)
        np.moveaxis(found, axis, 0)[:] |= faces[:-1] | faces[1:]
    # Such a vertex may be in the cell beside.
    return binary_dilation(found, np.ones((3, 3, 3)))


def unshared(objects, volume):
    """Vertices of labels' meshes in cells with voxels of a second label, and how many of these are not the second label's, too."""
    places = np.concatenate([places for _, places, _ in objects]) + np.float32(0)
    labels = np.concatenate([np.full(len(places), label) for label, places, _ in objects])
    _, names = np.unique(np.ascontiguousarray(places).view("V12").ravel(), return_inverse=True)
    known = np.unique(names.astype("i8") << 16 | labels)
    around = np.pad(volume, 1)
    cell = np.floor(places).astype(int)[:, ::-1] + 1
    taken = ~crossed(around)[tuple(cell.T)]
    names, labels, cell = names[taken], labels[taken], cell[taken]
    shared = missing = 0
    for corner in np.ndindex(2, 2, 2):
        beyond = around[tuple((cell + corner).T)]
        is_other = (beyond != 0) & (beyond != labels)
        wanted = np.unique(names[is_other].astype("i8") << 16 | beyond[is_other])
        shared, missing = shared + len(wanted), missing + int((~np.isin(wanted, known)).sum())
    return shared, missing


def all_labels(a):
    import trimesh

    rows = [["", "voxels", "triangles", "VTK's", "closed", "at borders of two labels", "not shared", "CPU s", "VTK's", "peak MiB", "VTK's"]]
    for name, smoothing, more in ALL_LABELS:
        array, store = packed(a, cells)
        ours, flags = a.folder / "ours.glb", ["--label", "all"]
        found, cost = ours_of(a, store, flags, smoothing, ours, *more)
        known, vtk_cost = vtk_of(array, flags, smoothing, a.folder / "vtk.ply")
        objects = [(int(name.removeprefix("label_")), places, corners) for name, places, corners in objects_of(ours)]
        meshes = [trimesh.Trimesh(places, corners, process=False) for _, places, corners in objects]
        closed = sum(bool(mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0) for mesh in meshes)
        volume = np.load(array)
        shared, missing = unshared(objects, volume)
        triangles = sum(object["triangles"] for object in found["objects"])
        rows.append([name, f"{volume.shape[0]}³", triangles, known["triangles"] if not more else "", f"{closed} of {len(np.unique(volume)) - 1}", shared,
                     missing, *costs(cost, known, vtk_cost)])
        print(" | ".join(map(str, rows[-1])), flush=True)
        if closed < len(np.unique(volume)) - 1 or missing:
            sys.exit(f"{name}: not closed, or not shared")
    print("\n" + table(rows))


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("brickyard")
    ap.add_argument("folder", type=pathlib.Path)
    ap.add_argument("--edge", type=int, default=256)
    ap.add_argument("--memory", default="512MiB")
    ap.add_argument("--only", choices=["whole", "labels", "decimated"])
    ap.add_argument("--mesh", type=pathlib.Path, help="a program that takes the arguments of `brickyard mesh`")
    a = ap.parse_args()
    a.folder.mkdir(parents=True, exist_ok=True)
    for name, rows in {"whole": whole, "labels": all_labels, "decimated": decimated}.items():
        if a.only in (None, name):
            rows(a)


if sys.argv[1:2] == ["--vtk"]:
    of_vtk(sys.argv[2], sys.argv[3:5], int(sys.argv[5]), sys.argv[6], int(sys.argv[7]))
else:
    main()
