"""Labels that `brickyard pack` puts into an image, found as OME-Zarr 0.5 has it: by zarr-python, from the image's own metadata.

The image, of ours and of zarr-python's making, is a group of Zarr v3; its group `labels` lists them by name; each is a group with `image-label`, whose
`source` leads back to the image; their voxels and places are those packed.
"""

import json
import posixpath
import warnings

import numpy as np
import zarr

from common import FOLDER, brickyard, check, info, run_cases

SMALL = ["--brick", "8", "--shard", "16", "--progress", "none"]
SHAPE = (20, 24, 36)  # z, y, x


def numbers(step=6):
    z, y, x = np.indices(SHAPE)
    return (1 + x // step + 7 * (y // step) + 49 * (z // step)).astype("u2")


def saved(name, array):
    np.save(FOLDER / name, array)
    return name


def found(image):
    """{name: (metadata, level 0)} of an image's labels, by the rules of OME-Zarr alone."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        group = zarr.open_group(FOLDER / image, mode="r", zarr_format=3)
        check("multiscales" in group.attrs["ome"] and "image-label" not in group.attrs["ome"], image)
        listed = group["labels"].attrs["ome"]
        check(listed["version"] == "0.5", listed)
        labels = {}
        for name in listed["labels"]:
            label = group[f"labels/{name}"]
            ome = label.attrs["ome"]
            check(ome["version"] == "0.5" and "omero" not in ome, ome)
            source = ome["image-label"].get("source", {}).get("image")
            check(source is None or posixpath.normpath(f"labels/{name}/{source}") == ".", source)
            labels[name] = ome, label[ome["multiscales"][0]["datasets"][0]["path"]][...]
        members = {name for name, _ in group["labels"].members()}
        check(members == set(labels), members)
        return labels


def scales(ome):
    return [dataset["coordinateTransformations"][0]["scale"] for dataset in ome["multiscales"][0]["datasets"]]


def check_image_of_ours():
    place = ["--spacing", "0.5,0.5,2", "--unit", "um"]
    brickyard("pack", saved("i.npy", np.arange(np.prod(SHAPE), dtype="u2").reshape(SHAPE)), "i.zarr", *place, *SMALL)
    brickyard("pack", saved("a.npy", numbers()), "i.zarr/labels/a", "--kind", "labels", *place, *SMALL)
    brickyard("pack", saved("b.npy", numbers(4)), "i.zarr/labels/b", "--kind", "labels", *place, *SMALL)
    labels = found("i.zarr")
    check(list(labels) == ["a", "b"], list(labels))
    image = zarr.open_group(FOLDER / "i.zarr", mode="r").attrs["ome"]
    for name, array in [("a", numbers()), ("b", numbers(4))]:
        ome, voxels = labels[name]
        check(ome["image-label"]["source"] == {"image": "../../"}, ome["image-label"])
        check(voxels.dtype == array.dtype and (voxels == array).all(), name)
        check(scales(ome) == scales(image), scales(ome))
    check(info("i.zarr")["labels"] == ["a", "b"], info("i.zarr"))
    for store in ["i.zarr", "i.zarr/labels/a", "i.zarr/labels/b"]:
        brickyard("verify", store, "--progress", "none")


def check_image_of_zarr_python():
    image = zarr.open_group(FOLDER / "z.zarr", mode="w", zarr_format=3)
    array = image.create_array("full", shape=SHAPE, dtype="u1", chunks=(8, 8, 8))
    array[...] = 3
    axes = [{"name": name, "type": "space"} for name in "zyx"]
    transforms = [{"type": "scale", "scale": [1, 1, 1]}]
    datasets = [{"path": "full", "coordinateTransformations": transforms}]
    image.attrs["ome"] = {"version": "0.5", "multiscales": [{"axes": axes, "datasets": datasets}]}
    theirs = image.create_group("labels")
    theirs.attrs["ome"] = {"version": "0.5", "labels": ["theirs"]}
    theirs.attrs["note"] = "stays"
    label = theirs.create_group("theirs")
    label.create_array("full", shape=SHAPE, dtype="u1", chunks=(8, 8, 8))
    label.attrs["ome"] = {"version": "0.5", "image-label": {}, "multiscales": [{"axes": axes, "datasets": datasets}]}
    brickyard("pack", saved("o.npy", numbers()), "z.zarr/labels/ours", "--kind", "labels", *SMALL)
    labels = found("z.zarr")
    check(list(labels) == ["theirs", "ours"] and (labels["ours"][1] == numbers()).all(), list(labels))
    check(zarr.open_group(FOLDER / "z.zarr/labels", mode="r").attrs["note"] == "stays", "a key of theirs is gone")


def check_labels_alone():
    brickyard("pack", saved("s.npy", numbers()), "s.zarr", "--kind", "labels", *SMALL)
    ome = json.loads((FOLDER / "s.zarr" / "zarr.json").read_text())["attributes"]["ome"]
    check(ome["image-label"] == {}, ome)
    brickyard("edit", "s.zarr", "--kind", "image")
    ome = json.loads((FOLDER / "s.zarr" / "zarr.json").read_text())["attributes"]["ome"]
    check("image-label" not in ome and "omero" in ome, ome)


run_cases({
    "image of ours": check_image_of_ours, "image of zarr-python": check_image_of_zarr_python, "labels alone": check_labels_alone,
})
