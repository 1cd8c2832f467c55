#!/usr/bin/env python3
"""Another program's OME-Zarr drawn where it lies, beside the store packed from it: first pictures, frames and memory.

  foreign_rates.py [--edge 1024] [--turns 3] [--brickyard target/release/brickyard] [--out target/foreign-rates]

zarr-python writes one volume of 16 bits three times: in chunks of 64³ with coarser levels (means), in whole planes with coarser levels, and in chunks of 64³
without these; `pack` makes a store of the first. All are in the page cache. In turns, each is

  drawn   by `render`: seconds to the first complete picture, at whatever level, and to the settled one; of made levels with an empty cache and with a kept one
  flown   by `bench --scenario orbit`: the median frame, and the frame that one in twenty exceeds
  watched for its memory, anonymous and shared as the kernel counts it, under `--host-memory 256MiB --gpu-memory 256MiB`

and the note about its chunks stands beside the chunks that an export of one brick opens.
It needs numpy, zarr and strace. A table goes to standard output; stores in --out are kept.
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

import numpy as np

from measuring import measured, run

BUDGET = ["--host-memory", "256MiB", "--gpu-memory", "256MiB"]
SIZE = ["--size", "512x512"]
KINDS = {"chunks of 64³": ((64, 64, 64), True), "planes": ((1, None, None), True), "chunks of 64³, one level": ((64, 64, 64), False)}


def arguments():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--edge", default=1024, type=int)
    ap.add_argument("--turns", default=3, type=int)
    ap.add_argument("--brickyard", default="target/release/brickyard", type=pathlib.Path)
    ap.add_argument("--out", default="target/foreign-rates", type=pathlib.Path)
    return ap.parse_args()


def slab(first, last, edge):
    """Planes of a shell with waves in it, and noise; nothing outside of a ball."""
    z, y, x = np.ogrid[first:last, :edge, :edge]
    unit = np.float32(edge / 1024)
    r = np.sqrt(((z - edge / 2) ** 2 + (y - edge / 2) ** 2 + (x - edge / 2) ** 2).astype("f4")) / unit
    waves = np.sin(x / unit / 23, dtype="f4") * np.sin(y / unit / 31, dtype="f4") * np.sin(z / unit / 17, dtype="f4")
    voxels = 3000 * np.exp(-(((r - 380) / 60) ** 2)) + 1500 * ((waves > 0.6) & (r < 480))
    noise = np.random.default_rng(first).random(voxels.shape, dtype="f4")
    return ((voxels + 30 * noise) * (r < 500)).astype("u2")


def halved(voxels):
    """Means of two by two by two voxels."""
    means = voxels.astype("f4")
    for axis in range(3):
        even, odd = (np.take(means, range(start, means.shape[axis], 2), axis) for start in (0, 1))
        means = (even + odd) / 2
    return means.round().astype("u2")


def write(path, edge, chunk, has_levels):
    """Writes the volume and its metadata of OME-Zarr 0.5."""
    import zarr

    shutil.rmtree(path, ignore_errors=True)
    group, arrays, datasets = zarr.create_group(path, zarr_format=3), [], []
    codec = zarr.codecs.BloscCodec(cname="lz4", clevel=3)
    levels = 1 + (max(0, (edge // 64).bit_length() - 1) if has_levels else 0)
    for k in range(levels):
        n = edge >> k
        chunks = tuple(min(size or n, n) for size in chunk)
        arrays.append(group.create_array(str(k), shape=(n, n, n), dtype="u2", chunks=chunks, compressors=codec))
        scale = {"type": "scale", "scale": [0.5 * 2**k] * 3}
        place = {"type": "translation", "translation": [0.25 * (2**k - 1)] * 3}
        datasets.append({"path": str(k), "coordinateTransformations": [scale, place]})
    for first in range(0, edge, 64):
        voxels = slab(first, first + 64, edge)
        for k, array in enumerate(arrays):
            array[first >> k : (first + 64) >> k] = voxels
            voxels = halved(voxels)
    axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    group.attrs["ome"] = {"version": "0.5", "multiscales": [{"name": "shell", "axes": axes, "datasets": datasets}]}


def stores(a):
    """Paths by name; what is there is kept."""
    paths = {}
    for name, (chunk, has_levels) in KINDS.items():
        paths[name] = a.out / f"{re.sub('[^a-z0-9]+', '-', name).strip('-')}.zarr"
        if not (paths[name] / "zarr.json").exists() or "multiscales" not in (paths[name] / "zarr.json").read_text():
            write(paths[name], a.edge, chunk, has_levels)
    packed = a.out / "packed.zarr"
    if not (packed / "zarr.json").exists():
        run([str(a.brickyard), "pack", str(paths["chunks of 64³"]), str(packed), "--progress", "none"])
    return {"packed": packed, **paths}


def drawn(a, path):
    """Seconds to the first complete picture and to the settled one, of the process's start."""
    stats = json.loads(measured([a.brickyard, "-q", "render", path, "-o", a.out / "p.png", "--overwrite", "--stats", "-", *SIZE], False).output)
    return stats["first_image_ms"] / 1e3, stats["settled_ms"] / 1e3


def flown(a, path):
    """Median and 95 % of an orbit's frames in milliseconds, and the most memory."""
    found = measured([a.brickyard, "-q", "bench", path, "--scenario", "orbit", "--json", *SIZE, *BUDGET])
    (row,) = json.loads(found.output)
    return row["frame_ms"]["p50"], row["frame_ms"]["p95"], found.most_bytes / (1 << 20)


def chunks_opened(a, words):
    """How often a command opens chunk files of the finest level, and what it says on standard error."""
    trace = a.out / "trace"
    command = ["strace", "-f", "-qq", "-e", "trace=openat", "-o", str(trace), str(a.brickyard), *map(str, words)]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stderr.strip()
    return len(re.findall(r'"[^"]*/?0/c/[0-9/]+"', trace.read_text())), said


def chunks_of_a_brick(a, path):
    """Number of chunks opened for one brick in the middle, without the sample that every opening takes; and the notes."""
    middle = a.edge // 2 // 64 * 64
    box = ",".join(f"{middle}:{middle + 64}" for _ in range(3))
    export = ["-q", "export", path, a.out / "brick.npy", "--roi", box, "--overwrite", "--progress", "none"]
    of_opening, notes = chunks_opened(a, ["info", path])
    return chunks_opened(a, export)[0] - of_opening, notes


def main():
    a = arguments()
    a.out.mkdir(parents=True, exist_ok=True)
    paths = stores(a)
    cache = a.out / "cache"
    os.environ["BRICKYARD_CACHE"] = str(cache.resolve())
    kept = {name: [] for name in paths}
    empty, flights = {name: [] for name in paths}, {name: [] for name in paths}
    for _ in range(a.turns):
        for name, path in paths.items():
            shutil.rmtree(cache, ignore_errors=True)
            empty[name].append(drawn(a, path))
            kept[name].append(drawn(a, path))
            flights[name].append(flown(a, path))
    median = lambda found, i: statistics.median(row[i] for row in found)
    print("| | first picture, s | settled, s | with the cache kept, s | frame, ms (median, 95 %) | memory, MiB |\n| --- | ---: | ---: | ---: | ---: | ---: |")
    for name in paths:
        first, settled, again = median(empty[name], 0), median(empty[name], 1), median(kept[name], 1)
        frame, slow, most = (median(flights[name], i) for i in range(3))
        print(f"| {name} | {first:.2f} | {settled:.2f} | {again:.2f} | {frame:.1f}, {slow:.1f} | {most:.0f} |", flush=True)
    for name in KINDS:
        chunks, notes = chunks_of_a_brick(a, paths[name])
        print(f"{name}: {chunks} chunks opened for a brick; {notes or 'no note'}")


if __name__ == "__main__":
    sys.exit(main())
