#!/usr/bin/env python3
"""Stores of OME-Zarr 0.6 by `brickyard pack --ngff 0.6` and `upgrade`, in ome-zarr-models (v06), ngff-zarr, ome-zarr-py and zarr-python.

usage: tools/ngff_readers.py BRICKYARD FOLDER

Packs an image with labels, a series with channels, and an image with an orientation into FOLDER, by both ways, and checks validity, scales,
translations and voxels as each reader has them. Needs numpy, ngff-zarr, ome-zarr (0.21 or later) and ome-zarr-models.
"""

import pathlib
import subprocess
import sys

import ngff_zarr
import numpy as np
import zarr
from ome_zarr.io import parse_url
from ome_zarr.reader import Label, Multiscales, Reader
from ome_zarr_models.v06 import Image, ImageLabel, Labels

COMMAND, FOLDER = sys.argv[1], pathlib.Path(sys.argv[2])
PLACE = ["--spacing", "0.5,0.25,2", "--origin", "1,-2,3", "--unit", "um"]
SHAPE = (40, 48, 72)  # z, y, x


def brickyard(*arguments):
    subprocess.run([COMMAND, *map(str, arguments), "-q"], check=True, cwd=FOLDER, stdout=subprocess.DEVNULL)


def packed(name, array, *flags):
    """Two stores of an array: packed in 0.6, and upgraded to it."""
    np.save(FOLDER / f"{name}.npy", array)
    stores = [f"{name}-packed.zarr", f"{name}-upgraded.zarr"]
    brickyard("pack", f"{name}.npy", stores[0], "--brick", 16, "--shard", 32, *flags, "--ngff", "0.6")
    brickyard("pack", f"{name}.npy", stores[1], "--brick", 16, "--shard", 32, *flags)
    return stores


def check_image(store, array, model, scale, translation):
    group = zarr.open_group(FOLDER / store, mode="r")
    model.from_zarr(group)
    assert (group["0"][...] == array).all()
    names = [axis["name"] for axis in group.attrs["ome"]["multiscales"][0]["coordinateSystems"][0]["axes"]]
    read = ngff_zarr.from_ngff_zarr(str(FOLDER / store))
    for k, image in enumerate(read.images):
        assert [*image.dims] == names, image.dims
        found = [np.array([place[name] for name in names], "f8") for place in (image.scale, image.translation)]
        factors = np.round(found[0] / scale)
        assert np.allclose(found[0], factors * scale) and (np.log2(factors) % 1 == 0).all(), (store, k, found)
        assert [*np.ceil(np.array(array.shape) / factors)] == [*image.data.shape], (store, k, image.data.shape)
        assert np.allclose(found[1], translation + (factors - 1) / 2 * scale), (store, k, found)
    assert (np.asarray(read.images[0].data) == array).all()
    nodes = [node for node in Reader(parse_url(FOLDER / store, mode="r"))() if node.load(Multiscales)]
    # Labels lead to their image.
    (own,) = [node for node in nodes if node.zarr.basename() == pathlib.Path(store).name]
    assert (np.asarray(own.data[0]) == array).all()
    print(f"{store}: {len(read.images)} levels, {len(nodes)} nodes of ome-zarr-py, all as packed")
    return nodes


def main():
    z, y, x = np.indices(SHAPE)
    array = (x + 2 * y + 3 * z).astype("u2")
    numbers = (1 + x // 8 + 9 * (y // 8) + 54 * (z // 8)).astype("u2")
    np.save(FOLDER / "numbers.npy", numbers)
    scale, translation = np.array([2, 0.25, 0.5]), np.array([3.0, -2, 1])
    for store in packed("image", array, *PLACE):
        brickyard("pack", "numbers.npy", f"{store}/labels/cells", "--kind", "labels", *PLACE)
        brickyard("upgrade", store)
        nodes = check_image(store, array, Image, scale, translation)
        assert [node.load(Label) is not None for node in nodes] == [False, True]
        Labels.from_zarr(zarr.open_group(FOLDER / store / "labels", mode="r"))
        check_image(f"{store}/labels/cells", numbers, ImageLabel, scale, translation)
    series = np.stack([np.stack([array + 7 * t + c for c in range(2)]) for t in range(3)]).astype("u2")
    times = ["--axes", "tczyx", "--time-step", "0.5", "--time-unit", "s"]
    for store in packed("series", series, *PLACE, *times):
        brickyard("upgrade", store)
        check_image(store, series, Image, np.array([0.5, 1, *scale]), np.array([0, 0, *translation]))
    for store in packed("turned", array, *PLACE):
        brickyard("edit", store, "--matrix=0,-0.25,0,10,0.5,0,0,-4,0,0,2,3")
        brickyard("upgrade", store)
        systems = zarr.open_group(FOLDER / store, mode="r").attrs["ome"]["multiscales"][0]["coordinateSystems"]
        assert [system["name"] for system in systems] == ["physical", "patient"]
        print(f"{store}: {Image.from_zarr(zarr.open_group(FOLDER / store, mode='r')).ome_attributes.version}, by ome-zarr-models")


main()
