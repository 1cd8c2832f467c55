#!/usr/bin/env python3
"""Random images by bioio-ome-zarr's writer, opened by brickyard where they lie: voxels, places, times, channels, every level.

usage: tools/ngff_bioio.py BRICKYARD FOLDER COUNT

OME-Zarr 0.4 in Zarr 2, and 0.5 in Zarr 3, with 2 to 5 axes, levels, shards, channels, units. What is expected are the writer's arguments. Needs numpy, zarr and
bioio-ome-zarr.
"""

import shutil
import sys

import ngff_documents as documents
import numpy as np
import zarr
from bioio_ome_zarr.writers import Channel, OMEZarrWriter

UNITS = {"t": ["second", "millisecond"], "z": ["micrometer", "nanometer"]}


def write(path, rng):
    """Writes an image; returns what was told to the writer."""
    letters = str(rng.choice(["yx", "zyx", "cyx", "tyx", "czyx", "tzyx", "tczyx", "xyz", "zyxc"]))
    shape = [int(rng.integers(1, {"t": 4, "c": 4, "z": 20}.get(a, 70))) for a in letters]
    kind = str(rng.choice(["u1", "u2", "i2", "f4", "u4"]))
    array = (rng.random(shape) * 200).astype(kind)
    levels = [[max(1, n >> k) if a in "zyx" else n for a, n in zip(letters, shape)] for k in range(int(rng.integers(1, 4)))]
    length, time = str(rng.choice(UNITS["z"])), str(rng.choice(UNITS["t"]))
    scale = [float(rng.choice([0.25, 1.5, 3.0])) if a != "c" else 1.0 for a in letters]
    more, version = {}, int(rng.choice([2, 3]))
    if version == 3 and rng.random() < 0.4:
        more = {"chunk_shape": [max(1, n // 4) for n in levels[-1]], "shard_shape": [max(1, n // 4) * 2 for n in levels[-1]]}
    channels = None
    if "c" in letters and rng.random() < 0.8:
        window = lambda n: {"min": 0, "max": 255, "start": n, "end": 90 + n}
        channels = [Channel(label=f"dye {n}", color=f"{40 + n:02X}80FF", window=window(n)) for n in range(shape[letters.index("c")])]
    writer = OMEZarrWriter(
        store=str(path),
        level_shapes=[tuple(level) for level in levels],
        dtype=array.dtype,
        zarr_format=version,
        axes_names=list(letters),
        axes_types=[{"t": "time", "c": "channel"}.get(a, "space") for a in letters],
        axes_units=[{"t": time, "c": None}.get(a, length) for a in letters],
        physical_pixel_size=scale,
        channels=channels,
        **more,
    )
    writer.write_full_volume(array)
    return array, letters, dict(zip(letters, scale)), length, time, channels


def check(path, told):
    array, letters, scale, length, time, channels = told
    group = zarr.open_group(path, mode="r")
    ome = dict(group.attrs).get("ome", dict(group.attrs))
    said, detail = documents.check_image(path, array, letters, ome)
    info = documents.json_of(documents.run("info", path, "--json")[0])
    expected = [scale.get(a, 1.0) for a in "xyz"]
    if not documents.close(info["spacing"], np.array(expected)) or info["unit"] != length:
        raise documents.Wrong(f"spacing {info['spacing']} {info['unit']}, told {expected} {length}")
    if "t" in letters and array.shape[letters.index("t")] > 1:
        axis = info["time_axis"]
        if (axis["start"], axis["step"], axis["unit"]) != (0, scale["t"], time):
            raise documents.Wrong(f"times {axis}, told {scale['t']} {time}")
    if channels and [display["name"] for display in info["displays"]] != [channel.label for channel in channels]:
        raise documents.Wrong(f"channels {info['displays']}")
    for level, dataset in enumerate(ome["multiscales"][0]["datasets"]):
        values = np.asarray(group[dataset["path"]][...])
        documents.check_image(f"{path}::{dataset['path']}", values, letters, ome, level)
    return said, detail


def main():
    cases = []
    for seed in range(int(sys.argv[3])):
        path = documents.OUTPUT / f"{seed}.zarr"
        shutil.rmtree(path, ignore_errors=True)
        told = write(path, np.random.default_rng(seed))
        name = f"{seed} {told[1]} {told[0].shape} {told[0].dtype}"
        case = documents.judged("bioio-ome-zarr", name, "", lambda: check(path, told))
        cases.append(case)
        if case.outcome != "read":
            print(case, flush=True)
    print(documents.report(cases))
    sys.exit(any(case.outcome == "WRONG" for case in cases))


main()
