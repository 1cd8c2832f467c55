#!/usr/bin/env python3
"""Writes a large image of OME-Zarr 0.4 that is mostly empty, as other programs do: balls in a cube, chunks of 64³ u8 in Zarr 2, those without a ball never written.

  sparse_image.py OUT.zarr [--edge 10240] [--balls 200] [--radius 80] [--seed 1]

Each level halves the one before, to 64 voxels or fewer, by the balls' formula at its voxels' centres. A ball is brightest, 250, in its middle, and fades to 0.
Needs numpy and numcodecs.
"""
import argparse
import itertools
import json
import pathlib

import numcodecs
import numpy

CHUNK = 64


def arguments():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("out", type=pathlib.Path)
    ap.add_argument("--edge", default=10240, type=int)
    ap.add_argument("--balls", default=200, type=int)
    ap.add_argument("--radius", default=80.0, type=float)
    ap.add_argument("--seed", default=1, type=int)
    return ap.parse_args()


def chunks_of(centre, radius, factor, grid):
    """Chunks of a level that a ball may touch."""
    first = numpy.maximum(numpy.floor((centre - radius) / factor / CHUNK).astype(int), 0)
    last = numpy.minimum(numpy.floor((centre + radius) / factor / CHUNK).astype(int), grid - 1)
    return itertools.product(*(range(a, b + 1) for a, b in zip(first, last)))


def voxels(chunk, centres, radius, factor):
    """A chunk's voxels, z, y, x."""
    axes = [(numpy.arange(CHUNK, dtype=numpy.float32) + 0.5 + at * CHUNK) * factor for at in chunk]
    value = numpy.zeros([CHUNK] * 3, numpy.float32)
    for centre in centres:
        z, y, x = [((axis - at) / radius) ** 2 for axis, at in zip(axes, centre)]
        numpy.maximum(value, 1 - (z[:, None, None] + y[None, :, None] + x[None, None, :]), out=value)
    return numpy.round(250 * value).astype(numpy.uint8)


def write_level(folder, edge, factor, centres, radius, codec):
    grid = -(-edge // CHUNK)
    folder.mkdir(parents=True)
    document = {"zarr_format": 2, "shape": [edge] * 3, "chunks": [CHUNK] * 3, "dtype": "|u1", "compressor": codec.get_config(), "fill_value": 0, "order": "C", "filters": None, "dimension_separator": "/"}
    (folder / ".zarray").write_text(json.dumps(document))
    touched = {}
    for centre in centres:
        for chunk in chunks_of(centre, radius, factor, grid):
            touched.setdefault(chunk, []).append(centre)
    written = 0
    for chunk, near in touched.items():
        values = voxels(chunk, near, radius, factor)
        if values.any():
            path = folder / "/".join(map(str, chunk))
            path.parent.mkdir(parents=True, exist_ok=True)
            written += path.write_bytes(codec.encode(values))
    return len(touched), written


def main():
    options = arguments()
    options.out.mkdir(parents=True)
    codec = numcodecs.Blosc("zstd", 3)
    centres = numpy.random.default_rng(options.seed).uniform(0, options.edge, (options.balls, 3)).astype(numpy.float32)
    axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    datasets, edge, factor, sums = [], options.edge, 1, [0, 0]
    while True:
        level = str(len(datasets))
        datasets.append({"path": level, "coordinateTransformations": [{"type": "scale", "scale": [float(factor)] * 3}, {"type": "translation", "translation": [(factor - 1) / 2] * 3}]})
        counts = write_level(options.out / level, edge, factor, centres, options.radius, codec)
        sums = [a + b for a, b in zip(sums, counts)]
        if edge <= CHUNK:
            break
        edge, factor = -(-edge // 2), factor * 2
    (options.out / ".zgroup").write_text('{"zarr_format": 2}')
    (options.out / ".zattrs").write_text(json.dumps({"multiscales": [{"version": "0.4", "axes": axes, "datasets": datasets}]}))
    print(f"{options.out}: {len(datasets)} levels, {sums[0]} chunks, {sums[1] / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
