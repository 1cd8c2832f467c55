"""A store that steps are appended to, read by zarr-python between the steps and edited by it: every step is seen when the store is opened again, and
what zarr-python wrote stays.
"""

import numpy as np
import zarr

from common import FOLDER, brickyard, check, info, run_cases, same_bits

FLAGS = ["--brick", "8", "--shard", "16", "--downsample", "mean,max", "--aprons", "1", "--progress", "none"]


def steps(dtype, channels):
    """Six steps, parts of which are empty, other parts in each."""
    random = np.random.default_rng(channels)
    made = []
    for step in range(6):
        array = (random.random((channels, 19, 21, 23)) * 200).astype(dtype)
        array[:, step * 3:step * 3 + 9, :, :11] = 0
        made.append(array)
    return made


def append(store, number, array, *flags):
    name = f"{store}_{number}.npy"
    axes = "czyx" if array.shape[0] > 1 else "zyx"
    np.save(FOLDER / name, array if array.shape[0] > 1 else array[0])
    brickyard("append", f"{store}.zarr", name, "--axes", axes, *FLAGS, *flags)


def check_store(store, expected):
    """All levels have as many steps; level 0 and the maxima are those of the steps."""
    group = zarr.open_group(FOLDER / f"{store}.zarr", mode="r")
    for name, level in group.arrays():
        check(level.shape[0] == len(expected), store, name, level.shape)
    for number, array in enumerate(expected):
        found = group["0"][number]
        check(same_bits(found.reshape(array.shape), array), store, "step", number)
    maxima = zarr.open_array(FOLDER / f"{store}.zarr/1/.brickyard/max", mode="r")
    check(maxima.shape[0] == len(expected), maxima.shape)
    check(np.max(maxima[-1]) == np.max(expected[-1]), store, "maximum")


def series(store, dtype, channels):
    def run():
        made = steps(dtype, channels)
        for number, array in enumerate(made):
            append(store, number, array, "--time-step", 0.25, "--time-unit", "s")
            check_store(store, made[:number + 1])
            if number == 2:
                group = zarr.open_group(FOLDER / f"{store}.zarr", mode="r+")
                group.attrs["experiment"] = {"name": "flow", "runs": [1, 2]}
                group["1"].attrs["note"] = "coarse"
                # Readers believe this in place of the arrays' own documents.
                zarr.consolidate_metadata(FOLDER / f"{store}.zarr")
        group = zarr.open_group(FOLDER / f"{store}.zarr", mode="r")
        check(group.attrs["experiment"] == {"name": "flow", "runs": [1, 2]}, dict(group.attrs))
        check(group["1"].attrs["note"] == "coarse", dict(group["1"].attrs))
        multiscale = group.attrs["ome"]["multiscales"][0]
        check(multiscale["axes"][0] == {"name": "t", "type": "time", "unit": "second"}, multiscale["axes"])
        check(multiscale["datasets"][0]["coordinateTransformations"][0]["scale"][0] == 0.25, multiscale["datasets"])
        brickyard("verify", f"{store}.zarr")
        check(info(f"{store}.zarr")["times"] == 6, info(f"{store}.zarr"))

    return run


run_cases({
    "bytes": series("bytes", np.uint8, 1),
    "channels": series("channels", np.uint16, 2),
    "floats": series("floats", np.float32, 1),
})
