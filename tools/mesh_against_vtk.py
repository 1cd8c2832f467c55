#!/usr/bin/env python3
"""Meshes of `brickyard mesh` beside VTK's: distances, triangles, processor time, memory, and whether trimesh finds them watertight.

usage: tools/mesh_against_vtk.py BRICKYARD FOLDER [--edge N] [--table FILE]

Makes volumes of N voxels along each edge in FOLDER, packs them, and extracts each surface by both: isosurfaces beside vtkFlyingEdges3D, labels beside
vtkSurfaceNets3D; then some of them decimated, beside vtkQuadricDecimation of VTK's surface to as many triangles. Distances are Hausdorff's, from vertices
to the other mesh's triangles, in voxels; of decimated meshes both ways from the whole one, and from points within triangles, too. VTK's volumes are
padded by a voxel, so that its surfaces are closed as well. Needs numpy, scipy, trimesh and vtk.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import time

import numpy as np


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
    return np.random.default_rng(1).integers(0, 256, (n // 2, n // 2, n // 2), "u1")


def cells(n):
    """Labels of the nearest of many points, in a ball."""
    from scipy.spatial import cKDTree

    random = np.random.default_rng(2)
    points = random.uniform(0, n, (60, 3))
    grid = np.indices((n, n, n)).reshape(3, -1).T
    nearest = cKDTree(points).query(grid, workers=-1)[1].reshape(n, n, n) + 1
    inside = (np.square(grid - n / 2).sum(1) < np.square(0.45 * n)).reshape(n, n, n)
    return np.where(inside, nearest, 0).astype("u2")


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


def of_vtk(array, flags, smoothing, out, target):
    """Extracts by VTK, in this process."""
    import vtk
    from vtk.util import numpy_support

    volume = np.load(array)
    low = 0 if volume.dtype.kind == "u" else -1e3
    volume = np.pad(volume, 1, constant_values=low)
    image = vtk.vtkImageData()
    image.SetDimensions(*volume.shape[::-1])
    image.SetOrigin(-1, -1, -1)
    image.GetPointData().SetScalars(numpy_support.numpy_to_vtk(volume.ravel(), deep=False))
    kind, value = flags
    if kind == "--isovalue":
        surface = vtk.vtkFlyingEdges3D()
        surface.SetValue(0, float(value))
        surface.ComputeNormalsOff()
    else:
        surface = vtk.vtkSurfaceNets3D()
        surface.SetValue(0, float(value))
        surface.SetBackgroundLabel(0)
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


def measured(command):
    """Runs a command; its output, seconds, processor seconds and greatest memory in MiB as the kernel counts it."""
    began = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    text = process.stdout.read()
    _, status, used = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{' '.join(map(str, command))} failed")
    return json.loads(text), time.perf_counter() - began, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def distances(a, b, subdivisions=0):
    """Hausdorff's distance both ways, in voxels; triangles of the first mesh are subdivided so many times."""
    import vtk

    def read(path):
        reader = vtk.vtkPLYReader()
        reader.SetFileName(str(path))
        reader.Update()
        return reader.GetOutput()

    first = read(a)
    if subdivisions:
        finer = vtk.vtkLinearSubdivisionFilter()
        finer.SetInputData(first)
        finer.SetNumberOfSubdivisions(subdivisions)
        finer.Update()
        first = finer.GetOutput()
    both = vtk.vtkHausdorffDistancePointSetFilter()
    both.SetInputData(0, first)
    both.SetInputData(1, read(b))
    both.SetTargetDistanceMethodToPointToCell()
    both.Update()
    return both.GetRelativeDistance()


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
    return measured(command)


def table(rows):
    return "\n".join("| " + " | ".join(map(str, row)) + " |" for row in rows[:1] + [["---"] * len(rows[0])] + rows[1:])


YES = {True: "yes", False: "no"}


def whole(a):
    rows = [["", "voxels", "triangles", "VTK's", "farthest, voxels", "VTK's from ours", "volume, ours / VTK's", "watertight", "VTK's",
             "CPU s", "VTK's", "peak MiB", "VTK's"]]
    for name, make, flags, smoothing in CASES:
        array, store = packed(a, make)
        ours, theirs = a.folder / "ours.ply", a.folder / "vtk.ply"
        found, _, cpu, peak = ours_of(a, store, flags, smoothing, ours)
        known, _, _, vtk_peak = measured([sys.executable, __file__, "--vtk", array, *flags, str(smoothing), theirs, "0"])
        forth, back = distances(ours, theirs)
        (tight, volume), (vtk_tight, vtk_volume) = watertight(ours), watertight(theirs)
        voxels = np.load(array, mmap_mode="r").shape[0]
        rows.append([name, f"{voxels}³", found["objects"][0]["triangles"], known["triangles"], f"{forth:.3f}", f"{back:.3f}",
                     f"{volume / vtk_volume:.5f}", YES[tight], YES[vtk_tight], f"{cpu:.2f}", f"{known['cpu_s']:.2f}", f"{peak:.0f}", f"{vtk_peak:.0f}"])
        print(" | ".join(map(str, rows[-1])), flush=True)
        if not tight:
            sys.exit(f"{name}: not watertight")
    print("\n" + table(rows))


def decimated(a):
    rows = [["", "voxels", "triangles", "within, voxels", "triangles left", "farthest", "VTK's", "watertight", "VTK's", "CPU s", "VTK's", "peak MiB", "VTK's"]]
    full, vtk_full, ours, theirs = [a.folder / f"{name}.ply" for name in ("full", "vtk_full", "ours", "vtk")]
    for name, make, flags, smoothing, voxels in DECIMATED:
        array, store = packed(a, make)
        whole, *_ = ours_of(a, store, flags, smoothing, full)
        found, _, cpu, peak = ours_of(a, store, flags, smoothing, ours, "--decimate", str(voxels))
        whole, found = whole["objects"][0]["triangles"], found["objects"][0]["triangles"]
        vtk = [sys.executable, __file__, "--vtk", array, *flags, str(smoothing)]
        measured([*vtk, vtk_full, "0"])
        known, _, _, vtk_peak = measured([*vtk, theirs, str(found)])
        farthest, vtk_farthest = max(distances(ours, full, 2)), max(distances(theirs, vtk_full, 2))
        (tight, _), (vtk_tight, _) = watertight(ours), watertight(theirs)
        rows.append([name, f"{np.load(array, mmap_mode='r').shape[0]}³", whole, voxels, f"{found} ({100 * found / whole:.1f}%)", f"{farthest:.3f}",
                     f"{vtk_farthest:.3f}", YES[tight], YES[vtk_tight], f"{cpu:.2f}", f"{known['cpu_s']:.2f}", f"{peak:.0f}", f"{vtk_peak:.0f}"])
        print(" | ".join(map(str, rows[-1])), flush=True)
        if not tight:
            sys.exit(f"{name}: not watertight")
    print("\n" + table(rows))


def main():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("brickyard")
    ap.add_argument("folder", type=pathlib.Path)
    ap.add_argument("--edge", type=int, default=256)
    ap.add_argument("--memory", default="512MiB")
    ap.add_argument("--only", choices=["whole", "decimated"])
    ap.add_argument("--mesh", type=pathlib.Path, help="a program that takes the arguments of `brickyard mesh`")
    a = ap.parse_args()
    a.folder.mkdir(parents=True, exist_ok=True)
    if a.only != "decimated":
        whole(a)
    if a.only != "whole":
        decimated(a)


if sys.argv[1:2] == ["--vtk"]:
    of_vtk(sys.argv[2], sys.argv[3:5], int(sys.argv[5]), sys.argv[6], int(sys.argv[7]))
else:
    main()
