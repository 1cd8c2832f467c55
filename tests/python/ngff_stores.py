"""Stores of OME-Zarr 0.6: packed so, upgraded, and changed afterwards. The documents are what 0.6 has it, checked by its rules alone, and zarr-python reads the
voxels; packed and upgraded ones are the same files.
"""

import hashlib
import json

import numpy as np
import zarr

from common import FOLDER, brickyard, check, run_cases

SMALL = ["--brick", "8", "--shard", "16", "--progress", "none"]
PLACE = ["--spacing", "0.5,0.25,2", "--origin", "1,-2,3", "--unit", "um"]
SHAPE = (20, 24, 36)  # z, y, x
IMAGE = np.arange(np.prod(SHAPE), dtype="u2").reshape(SHAPE)
# From voxel indices x, y, z, which are micrometres, to right, front and head.
MATRIX = np.array([[0, -0.25, 0, 10], [0.5, 0, 0, -4], [0, 0, 2, 3.0]])


def saved(name, array):
    np.save(FOLDER / name, array)
    return name


def files(store):
    paths = sorted(path for path in (FOLDER / store).rglob("*") if path.is_file())
    return {str(path.relative_to(FOLDER / store)): hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def systems(store):
    """The multiscale of a store, checked by the rules of 0.6."""
    group = zarr.open_group(FOLDER / store, mode="r", zarr_format=3)
    ome = group.attrs["ome"]
    check(ome["version"] == "0.6", ome)
    (multiscale,) = ome["multiscales"]
    check("axes" not in multiscale and "version" not in multiscale, multiscale)
    names = [system["name"] for system in multiscale["coordinateSystems"]]
    check(len(set(names)) == len(names), names)
    axes = multiscale["coordinateSystems"][0]["axes"]
    for k, dataset in enumerate(multiscale["datasets"]):
        check(dataset["path"] == str(k), dataset)
        (one,) = dataset["coordinateTransformations"]
        check(one["type"] == "sequence" and one["input"] == {"path": str(k)} and one["output"] == {"name": names[0]}, one)
        scale, translation = one["transformations"]
        check(scale["type"] == "scale" and len(scale["scale"]) == len(axes) and "input" not in scale, scale)
        check(translation["type"] == "translation" and len(translation["translation"]) == len(axes), translation)
        check(group[dataset["path"]].ndim == len(axes), dataset)
    for one in multiscale.get("coordinateTransformations", []):
        check({one["input"]["name"], one["output"]["name"]} <= set(names), one, names)
    return multiscale


def packed_and_upgraded():
    brickyard("pack", saved("i.npy", IMAGE), "new.zarr", *PLACE, *SMALL, "--ngff", "0.6")
    brickyard("pack", "i.npy", "old.zarr", *PLACE, *SMALL)
    before = files("old.zarr")
    brickyard("upgrade", "old.zarr")
    check(files("old.zarr") == files("new.zarr"), "upgraded")
    multiscale = systems("new.zarr")
    scale, translation = multiscale["datasets"][0]["coordinateTransformations"][0]["transformations"]
    check(scale["scale"] == [2, 0.25, 0.5] and translation["translation"] == [3, -2, 1], scale, translation)
    array = zarr.open_group(FOLDER / "new.zarr", mode="r")["0"]
    check((array[...] == IMAGE).all(), "voxels")
    brickyard("verify", "new.zarr", "--progress", "none")
    brickyard("upgrade", "old.zarr", "--ngff", "0.5")
    check(files("old.zarr") == before, "and back")


def place_in_a_patient():
    brickyard("pack", "i.npy", "p.zarr", *PLACE, *SMALL, "--ngff", "0.6")
    rows = ",".join(str(number) for number in MATRIX.ravel())
    brickyard("edit", "p.zarr", f"--matrix={rows}")
    multiscale = systems("p.zarr")
    affine = np.array(multiscale["coordinateTransformations"][0]["affine"])
    steps = multiscale["datasets"][0]["coordinateTransformations"][0]["transformations"]
    scale, translation = np.array(steps[0]["scale"]), np.array(steps[1]["translation"])
    for index in [(0, 0, 0), (1, 2, 3), (35, 23, 19)]:
        physical = np.array(index[::-1]) * scale + translation
        found = (affine[:, :3] @ physical + affine[:, 3])[::-1]
        check(np.allclose(found, (MATRIX @ [*index, 1]) / 1000), index, found)
    check([axis["unit"] for axis in multiscale["coordinateSystems"][1]["axes"]] == ["millimeter"] * 3, multiscale)
    brickyard("verify", "p.zarr", "--progress", "none")


def labels_of_an_image():
    brickyard("pack", "i.npy", "l.zarr", *PLACE, *SMALL, "--ngff", "0.6")
    numbers = (IMAGE // 97).astype("u2")
    brickyard("pack", saved("n.npy", numbers), "l.zarr/labels/n", "--kind", "labels", *PLACE, *SMALL)
    systems("l.zarr/labels/n")
    group = zarr.open_group(FOLDER / "l.zarr", mode="r")
    check(group["labels"].attrs["ome"] == {"version": "0.6", "labels": ["n"]}, dict(group["labels"].attrs))
    check((group["labels/n/0"][...] == numbers).all(), "labels")
    brickyard("upgrade", "l.zarr", "--ngff", "0.5")
    for part in ["", "labels", "labels/n"]:
        version = json.loads((FOLDER / "l.zarr" / part / "zarr.json").read_text())["attributes"]["ome"]["version"]
        check(version == "0.5", part, version)
    brickyard("verify", "l.zarr/labels/n", "--progress", "none")


def appended_steps():
    for step in range(3):
        np.save(FOLDER / f"t{step}.npy", IMAGE + np.uint16(step))
    brickyard("append", "t.zarr", "t0.npy", *PLACE, *SMALL, "--ngff", "0.6", "--time-step", "0.5", "--time-unit", "s")
    brickyard("append", "t.zarr", "t1.npy", "t2.npy", "--progress", "none")
    multiscale = systems("t.zarr")
    axes = multiscale["coordinateSystems"][0]["axes"]
    check(axes[0] == {"name": "t", "type": "time", "unit": "second"}, axes)
    array = zarr.open_group(FOLDER / "t.zarr", mode="r")["0"]
    check(all((array[step] == IMAGE + np.uint16(step)).all() for step in range(3)), array.shape)
    brickyard("verify", "t.zarr", "--progress", "none")


run_cases({
    "packed and upgraded": packed_and_upgraded, "patient": place_in_a_patient, "labels": labels_of_an_image, "appended": appended_steps,
})
