#!/usr/bin/env python3
"""Labels of `brickyard pack` and `edit` in the readers of ome-zarr-py and napari-ome-zarr, validated by ome-zarr-models.

usage: tools/label_readers.py BRICKYARD FOLDER

Packs an image, labels inside it and labels alone into FOLDER, and checks the kind, scales and voxels of the layers that each reader makes of them. Needs
numpy, ome-zarr, ome-zarr-models and napari-ome-zarr, without napari itself.
"""

import contextlib
import io
import pathlib
import subprocess
import sys

import numpy as np
import zarr
from napari_ome_zarr import napari_get_reader
from ome_zarr.io import parse_url
from ome_zarr.reader import Label, Multiscales, Reader
from ome_zarr_models.v05 import Image, ImageLabel, Labels

COMMAND, FOLDER = sys.argv[1], pathlib.Path(sys.argv[2])
PLACE = ["--spacing", "0.5,0.5,2", "--unit", "um", "--progress", "none"]


def brickyard(*arguments):
    subprocess.run([COMMAND, *map(str, arguments)], check=True, cwd=FOLDER)


def layers(store):
    """(name, kind, scale, level 0) of napari's layers."""
    with contextlib.redirect_stdout(io.StringIO()):  # The reader prints the metadata.
        made = napari_get_reader(str(FOLDER / store))(str(FOLDER / store))
    return [(look["name"], kind, tuple(look["scale"]), np.asarray(data[0])) for data, look, kind in made]


def nodes(store):
    """(path, whether labels) of ome-zarr-py's nodes with voxels."""
    found = [node for node in Reader(parse_url(FOLDER / store, mode="r"))() if node.load(Multiscales)]
    return [(node.zarr.basename(), node.load(Label) is not None) for node in found]


def main():
    z, y, x = np.indices((40, 48, 72))
    numbers = (1 + x // 8 + 9 * (y // 8) + 54 * (z // 8)).astype("u2")
    np.save(FOLDER / "image.npy", (x + y + z).astype("u1"))
    np.save(FOLDER / "numbers.npy", numbers)
    brickyard("pack", "image.npy", "image.zarr", *PLACE)
    brickyard("pack", "numbers.npy", "image.zarr/labels/cells", "--kind", "labels", *PLACE)
    brickyard("pack", "numbers.npy", "alone.zarr", "--kind", "labels", *PLACE)
    brickyard("pack", "numbers.npy", "edited.zarr", "--downsample", "mode", *PLACE)
    brickyard("edit", "edited.zarr", "--kind", "labels")
    for group, model in [("image.zarr", Image), ("image.zarr/labels", Labels), ("image.zarr/labels/cells", ImageLabel), ("alone.zarr", ImageLabel)]:
        model.from_zarr(zarr.open_group(FOLDER / group, mode="r"))
        print(f"{group}: valid, by ome-zarr-models")
    for store, kinds in [("image.zarr", ["image", "labels"]), ("alone.zarr", ["labels"]), ("edited.zarr", ["labels"])]:
        found = nodes(store)
        print(f"{store}: {found}, by ome-zarr-py")
        assert [are_labels for _, are_labels in found] == [kind == "labels" for kind in kinds], found
        made = layers(store)
        print(f"{store}: {[layer[:3] for layer in made]}, by napari-ome-zarr")
        assert [kind for _, kind, _, _ in made] == kinds, made
        for _, kind, scale, voxels in made:
            assert scale[-3:] == (2.0, 0.5, 0.5), scale
            assert kind == "image" or (voxels == numbers).all()


main()
