#!/usr/bin/env python3
"""A volume of 1024³ voxels exported to every format, and meshed, within 512 MiB of memory as the kernel counts it: exports are compared with the
voxels at their corners, meshes are closed and enclose as much as the voxels do. With `--rates`, exports beside a plain copy of the raw file or another
program's compression of it, both to the disk: medians of three, in turns.

  large_outputs.py [NAME...] [--rates] [--edge 1024] [--memory 512MiB] [--brickyard target/release/brickyard] [--out target/large-outputs]

It needs numpy, nibabel, Pillow, SimpleITK, tifffile and zarr, and four times the volume's size on the disk; each output is deleted before the next.
Tables go to standard output. It exits with 1 if an output is over its memory, or wrong.
"""

import argparse
import json
import os
import pathlib
import re
import shutil
import statistics
import subprocess
import sys
import time
import zlib

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from differential import ROOT, parsed
from measuring import bytes_of, measured

ISOVALUE = 2048


def arguments():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("names", nargs="*")
    ap.add_argument("--rates", action="store_true")
    ap.add_argument("--edge", default=1024, type=int)
    ap.add_argument("--memory", default="512MiB")
    ap.add_argument("--out", default=ROOT / "target/large-outputs", type=pathlib.Path)
    return parsed(ap)


def gyroid(x, y, z):
    """A gyroid in a ball, with noise in the last five bits: 12 bits, of which some half is left compressed."""
    w = np.float32(4 * np.pi)
    found = np.sin(w * x) * np.cos(w * y) + np.sin(w * y) * np.cos(w * z) + np.sin(w * z) * np.cos(w * x)
    found = np.minimum(found + np.float32(0.2), 12 * (np.float32(0.9) - np.sqrt(x * x + y * y + z * z)))
    noise = np.random.default_rng(int(1e6 * (z + 1))).integers(0, 32, found.shape)
    return np.clip(ISOVALUE - 16 + 800 * found, 0, 4000) + noise


def cells(x, y, z):
    """Labels of cubes with wavy sides, in a ball."""
    at = [(axis + 1 + np.float32(0.02) * np.sin(30 * other)) / np.float32(0.38) for axis, other in ((x, y), (y, z), (z, x))]
    label = 1 + at[0].astype(int) + 6 * at[1].astype(int) + 36 * at[2].astype(int)
    return np.where(x * x + y * y + z * z < np.float32(0.81), label, 0)


class Volume:
    """A raw file of 16 bits by a formula of the place, from -1 to 1 along each axis, and its store."""

    def __init__(self, a, formula):
        self.edge = a.edge
        self.path, self.store = a.out / f"{formula.__name__}.raw", a.out / f"{formula.__name__}.zarr"
        axis = np.linspace(-1, 1, self.edge, dtype="f4")
        with open(self.path, "wb") as file:
            for z in axis:
                file.write(formula(axis[None, :], axis[:, None], z).astype("<u2").tobytes())
        kind = "labels" if formula is cells else "image"
        measured([a.brickyard, "pack", self.path, self.store, *self.flags(), "--kind", kind, "--progress", "none", "-q"])

    def array(self):
        return np.memmap(self.path, "<u2", "r", shape=(self.edge,) * 3)

    def flags(self):
        return ["--shape", ",".join([str(self.edge)] * 3), "--dtype", "u16"]

    def counts(self):
        """Voxels of each value."""
        return sum(np.bincount(plane.ravel(), minlength=1 << 16) for plane in self.array())


def of_nibabel(path):
    import nibabel

    return np.asarray(nibabel.load(path).dataobj).T


def of_itk(path):
    import SimpleITK

    return SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(path)))


def of_tifffile(path):
    import tifffile

    return tifffile.imread(path)


def of_pillow(path):
    from PIL import Image

    return np.stack([np.asarray(Image.open(name)) for name in sorted(path.iterdir())])


def of_zarr(path):
    import zarr

    return zarr.open(path, mode="r")["0"]


def after(mark, skipped=0):
    """Voxels to the end of a file, from some bytes behind a mark in its head on."""

    def read(path):
        with open(path, "rb") as file:
            start = file.read(1 << 16).index(mark) + len(mark) + skipped
        edge = round(((path.stat().st_size - start) // 2) ** (1 / 3))
        return np.memmap(path, "<u2", "r", start, (edge,) * 3)

    return read


def copied(a, volume):
    with open(volume.path, "rb") as file, open(a.out / "copy", "wb") as out:
        shutil.copyfileobj(file, out, 1 << 20)
        os.fsync(out.fileno())


def gzipped(a, volume):
    packer = zlib.compressobj(1, wbits=31)
    with open(a.out / "copy", "wb") as out:
        for plane in volume.array():
            out.write(packer.compress(plane))
        out.write(packer.flush())
        os.fsync(out.fileno())


def drawn(a, volume):
    from PIL import Image

    for plane in volume.array():
        with open(a.out / "copy", "wb") as out:
            Image.fromarray(plane).save(out, "png", compress_level=1)
            os.fsync(out.fileno())


def packed(a, volume):
    shutil.rmtree(a.out / "copy", ignore_errors=True)
    measured([a.brickyard, "pack", volume.path, a.out / "copy", *volume.flags(), "--memory", a.memory, "--progress", "none", "-q"])


# Each export: its output, flags, another program's reader, and the work beside which it is timed.
EXPORTS = {
    "nifti": ("o.nii", [], of_nibabel, copied),
    "nrrd": ("o.nrrd", [], of_itk, copied),
    "metaimage": ("o.mha", [], of_itk, copied),
    "metaimage-header": ("o.mhd", [], of_itk, copied),
    # VTK is not among the tests' readers. The array begins behind its length.
    "vti": ("o.vti", [], after(b'<AppendedData encoding="raw">\n   _', 8), copied),
    "tiff": ("o.tif", [], of_tifffile, copied),
    "ome-tiff": ("o.ome.tif", [], of_tifffile, copied),
    "npy": ("o.npy", [], lambda path: np.load(path, mmap_mode="r"), copied),
    "raw": ("o.raw", [], after(b""), copied),
    "nifti-gzip": ("o.nii.gz", [], of_nibabel, gzipped),
    "png": ("o/", [], of_pillow, drawn),
    "ome-zarr-0.4": ("o.zarr", ["--ngff", "0.4"], of_zarr, gzipped),
    "ome-zarr-0.5": ("o.zarr", ["--ngff", "0.5"], of_zarr, packed),
    "ome-zarr-0.6": ("o.zarr", ["--ngff", "0.6"], of_zarr, packed),
}

# Each mesh: its volume, output, and flags.
MESHES = {
    "isosurface": (gyroid, "o.ply", ["--isovalue", ISOVALUE]),
    "smoothed": (gyroid, "o.ply", ["--isovalue", ISOVALUE, "--smooth", 5]),
    "decimated": (gyroid, "o.ply", ["--isovalue", ISOVALUE, "--decimate", 0.5]),
    "labels": (cells, "o.glb", ["--label", "all"]),
    "labels-smoothed": (cells, "o.glb", ["--label", "all", "--smooth", 5]),
    "labels-decimated": (cells, "o.glb", ["--label", "all", "--decimate", 0.5]),
}


def exported(a, volume, path, flags):
    shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    # A folder's name ends in a slash.
    output = f"{path}/" if path.suffix == "" else path
    return measured([a.brickyard, "export", volume.store, output, *flags, "--memory", a.memory, "--overwrite", "--progress", "none", "-q"])


def differs(volume, found):
    """Compares boxes at three corners and in the middle."""
    end, half = volume.edge - 8, volume.edge // 2
    if tuple(found.shape) != (volume.edge,) * 3:
        return f"has the shape {found.shape}"
    for z, y, x in [(0, 0, 0), (end, 0, end), (end, end, end), (half, half, half)]:
        box = (slice(z, z + 8), slice(y, y + 8), slice(x, x + 8))
        if not np.array_equal(found[box], volume.array()[box]):
            return f"differs at {x},{y},{z}"
    return ""


def timed(work, *arguments):
    started = time.monotonic()
    work(*arguments)
    return time.monotonic() - started


def export_rows(a, names, allowed):
    """Exports; returns whether all is right."""
    volume, good = Volume(a, gyroid), True
    mb = volume.path.stat().st_size / 1e6
    head = ["export", f"memory of {a.memory}, MiB", "MB/s"]
    print("| " + " | ".join(head + (["beside, MB/s", "of it"] if a.rates else [])) + " |", flush=True)
    for name in names:
        output, flags, read, beside = EXPORTS[name]
        path = a.out / output
        found = exported(a, volume, path, flags)
        problem = differs(volume, read(path)) + " OVER MEMORY" * (found.most_bytes > allowed)
        row, seconds = [name, f"{found.most_bytes >> 20}"], found.seconds
        if a.rates:
            rounds = [(seconds, timed(beside, a, volume))]
            rounds += [(exported(a, volume, path, flags).seconds, timed(beside, a, volume)) for _ in range(2)]
            seconds, other = (statistics.median(column) for column in zip(*rounds))
            row += [f"{mb / seconds:.0f}", f"{mb / other:.0f} ({beside.__name__})", f"{other / seconds:.2f}"]
        else:
            row.append(f"{mb / seconds:.0f}")
        good &= not problem
        print("| " + " | ".join(row) + f" | {problem}", flush=True)
        for left in a.out.iterdir():
            if left.name[:2] == "o." or left.name in ("o", "copy"):
                shutil.rmtree(left) if left.is_dir() else left.unlink()
    shutil.rmtree(volume.store)
    volume.path.unlink()
    return good


def objects_of(path):
    """Name, vertices and triangles of each object of a file."""
    with open(path, "rb") as file:
        head = file.read(1 << 16)
    if path.suffix == ".ply":
        text, start = head[: head.index(b"end_header\n")].decode(), head.index(b"end_header\n") + 11
        vertices, faces = (int(re.search(rf"element {kind} (\d+)", text)[1]) for kind in ("vertex", "face"))
        places = np.memmap(path, "<f4", "r", start, (vertices, 3))
        corners = np.memmap(path, [("n", "u1"), ("corners", "<i4", 3)], "r", start + 12 * vertices, faces)
        yield "", places, corners["corners"]
        return
    with open(path, "rb") as file:
        file.seek(12)
        length = int.from_bytes(file.read(4), "little")
        file.seek(20)
        text = json.loads(file.read(length))
    for mesh in text["meshes"]:
        [part] = mesh["primitives"]

        def triples(number, dtype):
            view = text["bufferViews"][text["accessors"][number]["bufferView"]]
            return np.memmap(path, dtype, "r", 28 + length + view["byteOffset"], (view["byteLength"] // 12, 3))

        yield mesh["name"], triples(part["attributes"]["POSITION"], "<f4"), triples(part["indices"], "<u4")


def mixed(a, b):
    """A number of 64 bits for a pair of numbers in this order."""
    found = a.astype("u8") * np.uint64(0x9E3779B97F4A7C15) + b.astype("u8") * np.uint64(0xC2B2AE3D27D4EB4F)
    found ^= found >> np.uint64(29)
    found *= np.uint64(0xBF58476D1CE4E5B9)
    return found ^ found >> np.uint64(32)


def balance_and_volume(places, corners):
    """A number that is zero where each edge has as many triangles in one direction as in the other; and the enclosed volume."""
    balance, volume, origin = 0, 0.0, np.asarray(places[0], float)
    for first in range(0, len(corners), 1 << 20):
        some = np.asarray(corners[first : first + (1 << 20)])
        for a, b in ((0, 1), (1, 2), (2, 0)):
            balance += int(mixed(some[:, a], some[:, b]).sum()) - int(mixed(some[:, b], some[:, a]).sum())
        p, q, r = (np.asarray(places)[some[:, k]].astype(float) - origin for k in range(3))
        volume += np.einsum("ij,ij->i", p, np.cross(q, r)).sum() / 6
    return balance % (1 << 64), volume


def mesh_problem(path, expected):
    """Checks each object of a mesh, whose voxels are counted; returns the number of triangles and the problem."""
    triangles, missing = 0, dict(expected)
    for name, places, corners in objects_of(path):
        triangles += len(corners)
        balance, volume = balance_and_volume(places, corners)
        if balance:
            return triangles, f"{name} is not closed"
        voxels = missing.pop(name, None)
        # Corners of voxels are cut off, and small objects are mostly corners.
        if voxels is None or abs(volume - voxels) > 0.02 * voxels + 2000:
            return triangles, f"{name} encloses {volume:.0f}, and has {voxels} voxels"
    return triangles, f"{len(missing)} objects are missing" * bool(missing)


def mesh_rows(a, names, allowed):
    """Meshes; returns whether all is right."""
    good = True
    print(f"\n| mesh | memory of {a.memory}, MiB | s | CPU s | triangles |", flush=True)
    for formula in (gyroid, cells):
        chosen = [name for name in names if MESHES[name][0] is formula]
        if not chosen:
            continue
        volume = Volume(a, formula)
        counts = volume.counts()
        expected = {"": int(counts[ISOVALUE:].sum())}
        if formula is cells:
            expected = {f"label_{label}": int(counts[label]) for label in np.flatnonzero(counts) if label}
        for name in chosen:
            _, output, flags = MESHES[name]
            path = a.out / output
            command = [a.brickyard, "mesh", volume.store, path, *flags, "--memory", a.memory, "--overwrite", "--progress", "none", "-q"]
            found = measured(command)
            triangles, problem = mesh_problem(path, expected)
            problem += " OVER MEMORY" * (found.most_bytes > allowed)
            good &= not problem
            print(f"| {name} | {found.most_bytes >> 20} | {found.seconds:.0f} | {found.cpu_s:.0f} | {triangles} | {problem}", flush=True)
            path.unlink()
        shutil.rmtree(volume.store)
        volume.path.unlink()
    return good


def main():
    a = arguments()
    names = a.names or [*EXPORTS, *([] if a.rates else MESHES)]
    shutil.rmtree(a.out, ignore_errors=True)
    a.out.mkdir(parents=True)
    allowed = bytes_of(a.memory)
    exports, meshes = ([name for name in names if name in known] for known in (EXPORTS, MESHES))
    good = not exports or export_rows(a, exports, allowed)
    good &= not meshes or mesh_rows(a, meshes, allowed)
    shutil.rmtree(a.out)
    sys.exit(not good)


if __name__ == "__main__":
    main()
