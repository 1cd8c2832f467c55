"""Stores into which zarr-python wrote, indexed: they hold the files of stores packed from the same voxels, and verify finds no fault.
"""

import json

import numpy as np
import zarr

from common import FOLDER, brickyard, check, info, noise, run_cases

SMALL = ["--brick", "16", "--shard", "32", "--progress", "none", "--spacing", "0.5,0.25,2"]
RANDOM = np.random.default_rng(7)
# z, y, x: a shard is cut at each end, and one is whole.
SHAPE = (40, 37, 70)


def files(store):
    """Bytes of a store's files but for the root document, by path; and this document's own part."""
    paths = sorted(path for path in (FOLDER / store).rglob("*") if path.is_file())
    found = {str(path.relative_to(FOLDER / store)): path.read_bytes() for path in paths}
    ours = json.loads(found.pop("zarr.json"))["attributes"]["brickyard"]
    return found, {key: ours[key] for key in ours if key not in ("checksum", "source", "settings_fingerprint")}


def written(name, voxels, change, flags=()):
    """Packs voxels, makes a change of the array by zarr-python, indexes the store, and compares it with one packed from the changed voxels."""
    store, told = f"{name}.zarr", f"{name}-told.zarr"
    np.save(FOLDER / "before.npy", voxels)
    brickyard("pack", "before.npy", store, *SMALL, *flags)
    change(zarr.open_array(FOLDER / store / "0", mode="r+"))
    after = voxels.copy()
    change(after)
    np.save(FOLDER / "after.npy", after)
    brickyard("pack", "after.npy", told, *SMALL, *flags)
    report = json.loads(brickyard("index", store, "--json", "--progress", "none"))
    (found, ours), (expected, theirs) = files(store), files(told)
    other = [path for path in set(found) | set(expected) if found.get(path) != expected.get(path)]
    check(not other, name, other)
    check(ours == theirs, name, ours, theirs)
    held = zarr.open_array(FOLDER / store / "0", mode="r")[...]
    if "--nodata" in flags:
        after = np.where(after == float(flags[1]), np.nan, after)
    check(np.array_equal(held, after, equal_nan="--nodata" in flags), name, "voxels")
    brickyard("verify", store, "--progress", "none")
    check(info(store)["channels"] == info(told)["channels"], name, "statistics")
    return report["changed"]


def box(array):
    array[5:30, 10:37, 20:70] = 9


def every_type():
    for dtype in ["u1", "i2", "u4", "f4"]:
        for flags in [[], ["--aprons", "1", "--codec", "none"], ["--downsample", "nearest"]]:
            changed = written(f"{dtype}-{len(flags)}", noise(RANDOM, dtype, *SHAPE), box, flags)
            check(changed == {"bricks": 2 * 3 * 4, "lost_shards": 0}, dtype, changed)


def shards_come_and_go():
    voxels = noise(RANDOM, "u2", *SHAPE)
    voxels[:32, :32, 32:64] = 0

    def change(array):
        array[:32, :32, :32] = 0
        array[:32, :32, 32:64] = 5

    changed = written("come", voxels, change)
    check(changed == {"bricks": 16, "lost_shards": 1}, changed)


def one_voxel_of_incompressible_ones():
    """Lengths of all bricks stay, and so may a shard's index."""

    def change(array):
        array[-1, -1, -1] ^= 1
        array[0, 0, 0] ^= 1

    check(written("one", noise(RANDOM, "u1", *SHAPE), change) == {"bricks": 2, "lost_shards": 0}, "counts")


def floats_without_data():
    def change(array):
        array[10:12] = -9999

    written("blank", noise(RANDOM, "f4", *SHAPE), change, ["--nodata", "-9999"])


def coarse_levels_written_are_made_again():
    np.save(FOLDER / "c.npy", noise(RANDOM, "u2", *SHAPE))
    brickyard("pack", "c.npy", "c.zarr", *SMALL)
    before = files("c.zarr")
    zarr.open_array(FOLDER / "c.zarr" / "1", mode="r+")[:10, :10, :10] = 3
    report = json.loads(brickyard("index", "c.zarr", "--json", "--progress", "none"))
    check(report["changed"] == {"bricks": 0, "lost_shards": 0}, report)
    check(files("c.zarr") == before, "as packed")


run_cases({
    "every type": every_type, "shards": shards_come_and_go, "one voxel": one_voxel_of_incompressible_ones,
    "no data": floats_without_data,
    "coarse levels": coarse_levels_written_are_made_again,
})
