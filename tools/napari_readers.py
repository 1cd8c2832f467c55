#!/usr/bin/env python3
"""Exports of brickyard in napari without a window, by its own reader (TIFF, .npy, PNG), napari-ome-zarr and napari-tiff.

    pip install napari napari-ome-zarr napari-tiff
    tools/napari_readers.py BRICKYARD FOLDER

Packs an image of channels and steps, one of floats, and labels into FOLDER, exports them, and compares the layers of each reader: kinds, voxels;
scales, places, names and colours where the reader has them. Prints a line for each, and ends with 1 if any differs.
"""

import contextlib
import io
import pathlib
import subprocess
import sys
import warnings

import numpy as np
from napari.components import ViewerModel
from napari_builtins.io import napari_get_reader as napari
from napari_ome_zarr import napari_get_reader as napari_ome_zarr
from napari_tiff.napari_tiff_reader import napari_get_reader as napari_tiff

COMMAND, FOLDER = pathlib.Path(sys.argv[1]).absolute(), pathlib.Path(sys.argv[2])
NAMES, COLORS = ["DAPI", "GFP", "red & <co>"], [(0, 0, 255), (0, 255, 0), (255, 0, 0)]
# z, y, x.
SPACING, ORIGIN = (2.0, 0.25, 0.5), (7.0, -3.0, 5.0)
ZARR = {f"{version}.zarr": [napari_ome_zarr] for version in ("0.4", "0.5", "0.6")}
TIFF = {end: [napari, napari_tiff] for end in ("ome.tif", "tif")}
READERS = {"cells": ZARR | TIFF | {"npy": [napari]}, "floats": ZARR | TIFF | {"npy": [napari]}, "labels": ZARR | TIFF | {"/": [napari]}}


def brickyard(*arguments):
    subprocess.run([COMMAND, *map(str, arguments)], check=True, cwd=FOLDER, stderr=subprocess.DEVNULL)


def volumes():
    """Arrays by name: times, channels, z, y, x."""
    random = np.random.default_rng(7)
    z, y, x = np.indices((20, 33, 41))
    return {
        "cells": random.integers(0, 65536, (4, 3, 20, 33, 41), "u2"),
        "floats": random.standard_normal((1, 1, 20, 33, 41)).astype("f4"),
        "labels": (x // 9 + 7 * (y // 9) + 49 * (z // 9))[None, None].astype("u2"),
    }


def pack(name, array):
    np.save(FOLDER / f"{name}.npy", array.squeeze())
    axes = "".join(axis for axis, size in zip("tczyx", array.shape) if size > 1)
    place = ["--spacing", ",".join(map(str, SPACING[::-1])), "--origin", ",".join(map(str, ORIGIN[::-1])), "--unit", "um"]
    flags = ["--kind", "labels"] if name == "labels" else []
    flags += ["--time-step", "0.5", "--time-unit", "s"] if array.shape[0] > 1 else []
    brickyard("pack", f"{name}.npy", f"{name}.zarr", "--axes", axes, *place, *flags, "--brick", "16")
    if array.shape[1] > 1:
        looks = [[f"--channel-name={i}={NAMES[i]}", f"--channel-color={i}={bytes(COLORS[i]).hex()}"] for i in range(3)]
        brickyard("edit", f"{name}.zarr", *sum(looks, []))


def export(name, end):
    output = f"of-{name}/" if end == "/" else f"of-{name}.{end}"
    flags = ["--ngff", end[:3]] if end.endswith(".zarr") else []
    flags += ["--channel", "all", "--time", "all"] if name == "cells" else []
    brickyard("export", f"{name}.zarr", output, *flags)
    return FOLDER / output


def layers(reader, path):
    """The layers of a napari that has opened this path."""
    viewer = ViewerModel()
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for made in reader(str(path))(str(path)):
            viewer._add_layer_from_data(*made)
    return list(viewer.layers)


def kind(layer):
    return type(layer).__name__.lower()


def voxels(layer):
    return np.asarray(layer.data[0] if layer.multiscale else layer.data)


def differences(name, end, reader, array, found):
    """Facts of layers unlike those packed, with their values."""
    are_labels = name == "labels" and reader is napari_ome_zarr
    if {kind(layer) for layer in found} != {"labels" if are_labels else "image"}:
        yield "kinds", [kind(layer) for layer in found]
    parts = np.stack([voxels(layer) for layer in found], 1 if array.shape[0] > 1 else 0).squeeze()
    # Axes of TIFF are in the order of its pages.
    if not any(np.array_equal(parts, other.squeeze()) for other in (array, array.swapaxes(1, 2))):
        yield "voxels", parts.shape
    step = [0.5] if array.shape[0] > 1 else []
    for layer in found:
        first, second = (np.array(layer.data_to_world([i] * layer.ndim)) for i in (0, 1))
        if not np.array_equal(np.round(second - first, 9), [*step, *SPACING]):
            yield "scale", second - first
        if not np.allclose(first[-3:], ORIGIN):
            yield "place", first
    if array.shape[1] > 1:
        if [layer.name for layer in found] != NAMES:
            yield "names", [layer.name for layer in found]
        if len(found) > 1 and not np.allclose([255 * layer.colormap.colors[-1][:3] for layer in found], COLORS):
            yield "colours", [layer.colormap.name for layer in found]


def left_out(reader, end):
    """Facts that a reader leaves out, whoever wrote the file."""
    if reader is napari:
        return {"scale", "place", "names"}
    # Before 0.6 the first transformation alone is heeded. ImageJ has names of pages, and none of channels.
    return {"0.6.zarr": set(), "tif": {"place", "names"}}.get(end, {"place"})


def main():
    good = True
    for name, array in volumes().items():
        pack(name, array)
        for end, readers in READERS[name].items():
            path = export(name, end)
            for reader in readers:
                found = layers(reader, path)
                unlike = dict(differences(name, end, reader, array, found))
                wrong = {fact: unlike[fact] for fact in unlike.keys() - left_out(reader, end)}
                good &= not wrong
                whole = f"{len(found)} layers of {voxels(found[0]).shape}, without {', '.join(sorted(unlike)) or 'loss'}"
                print(f"{name} {end} by {reader.__module__.split('.')[0]}: {whole}{f': WRONG {wrong}' if wrong else ''}", flush=True)
    sys.exit(not good)


main()
