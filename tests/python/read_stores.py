"""Stores made by `brickyard pack`, read by zarr-python and tensorstore.

For every voxel type and for volumes of every awkward shape: all readers see what `export` gives, bit for bit; every level
is the mean of the finer one (or, in a second pyramid, the maximum); shards of several time steps share bytes; stored aprons are what surrounds the bricks; the OME metadata
places every level right; and nothing but the levels is listed.
"""

import json
import os
import warnings
from random import Random

import numpy as np
import tensorstore as ts
import zarr

from common import FOLDER, brickyard, check, run_cases, same_bits

DTYPES = ["u1", "i1", "u2", "i2", "u4", "i4", "f4"]
NAMES = {"u1": "u8", "i1": "i8", "u2": "u16", "i2": "i16", "u4": "u32", "i4": "i32", "f4": "f32"}
SMALL = ["--brick", "8", "--shard", "16"]
MEDIUM = ["--brick", "16", "--shard", "64"]
TWO = ["--downsample", "mean,max"]
APRONS = ["--aprons", "1"]
WIDE_APRONS = ["--aprons", "2"]
STEPS_IN_SHARDS = "--shard-time"


class Volume:
    """A volume to be packed: an array (t, c, z, y, x), its place in the world (x, y, z), and flags."""

    def __init__(self, array, flags=(), spacing=(1.0, 1.0, 1.0), origin=(0.0, 0.0, 0.0), unit=None, nodata=None, time=(1.0, 0.0, None), stamps=None):
        self.array, self.flags = np.ascontiguousarray(array), list(flags)
        self.time, self.stamps = time, stamps  # Step, start and unit as OME-Zarr has them; the times of irregular steps.
        self.spacing, self.origin, self.unit, self.nodata = spacing, origin, unit, nodata

    def pack(self, name):
        (FOLDER / f"{name}.raw").write_bytes(self.array.tobytes())
        if self.stamps:
            (FOLDER / "stamps.txt").write_text("".join(f"{stamp}\n" for stamp in self.stamps))
        times, channels, z, y, x = self.array.shape
        triple = lambda v: ",".join(repr(float(n)) for n in v)
        unit = ["--unit", self.unit] if self.unit else []
        brickyard("pack", f"{name}.raw", f"{name}.zarr", "--shape", f"{x},{y},{z}", "--dtype",
                  NAMES[self.array.dtype.str[1:]], "--times", times, "--channels", channels, "--spacing",
                  triple(self.spacing), f"--origin={triple(self.origin)}", *unit, *self.flags, "--progress", "none")
        (FOLDER / f"{name}.raw").unlink()


def noise(dtype, *shape):
    """Every bit pattern of integers; floats of many magnitudes."""
    shape = (1,) * (5 - len(shape)) + shape
    random = np.random.default_rng(len(shape) + sum(shape))
    if dtype == "f4":
        return (random.standard_normal(shape) * 10.0 ** random.integers(-3, 4, shape)).astype("f4")
    limits = np.iinfo(dtype)
    return random.integers(limits.min, limits.max, shape, dtype, endpoint=True)


def moving(dtype, times, channels):
    """A cube that moves through noise that stays as it is."""
    still = noise(dtype, 1, channels, 30, 25, 41)
    if dtype == "f4":
        still = still.astype("i4").astype("f4")
    made = np.repeat(still, times, axis=0)
    for t in range(times):
        made[t, :, 3:9, 4:12, 5 * t : 5 * t + 6] = 99
    return made


def sampled(made):
    """Three types of each kind, others for each commit; or all."""
    if os.environ.get("BRICKYARD_CASES") == "all":
        return made
    random = Random(os.environ.get("BRICKYARD_SEED", "0"))
    kinds = sorted({name.split("-")[1] for name in made})
    kept = {f"{d}-{kind}" for kind in kinds for d in random.sample(DTYPES, 3)}
    return {name: volume for name, volume in made.items() if name in kept}


def volumes():
    """{name: Volume}."""
    made = {}
    for d in DTYPES:
        made[f"{d}-odd"] = Volume(noise(d, 43, 21, 37), SMALL + TWO + APRONS)
        made[f"{d}-anisotropic"] = Volume(
            noise(d, 19, 40, 33), MEDIUM + TWO, spacing=(0.5, 0.7, 2.25), origin=(-11.5, 3.25, 1e3), unit="um")
        made[f"{d}-slice"] = Volume(noise(d, 1, 50, 34), SMALL, spacing=(2.0, 3.0, 0.1))
        made[f"{d}-times"] = Volume(noise(d, 3, 1, 18, 17, 19), SMALL)
        made[f"{d}-channels"] = Volume(noise(d, 2, 18, 17, 19), SMALL)
        made[f"{d}-5d"] = Volume(noise(d, 2, 3, 9, 10, 20), SMALL + TWO + WIDE_APRONS, unit="mm")
        made[f"{d}-constant"] = Volume(np.full((1, 1, 20, 30, 40), 7, d), MEDIUM)
        made[f"{d}-zero"] = Volume(np.zeros((1, 1, 20, 30, 40), d), MEDIUM)
        made[f"{d}-plain"] = Volume(noise(d, 20, 30, 40), MEDIUM + APRONS + ["--codec", "none"])
    made = sampled(made)
    made["u2-timed"] = Volume(noise("u2", 3, 1, 18, 17, 19), SMALL + TWO + ["--time-step", "0.1", "--time-unit", "ms"],
                              time=(0.1, 0.0, "millisecond"))
    made["u2-stamped"] = Volume(noise("u2", 4, 1, 18, 17, 19), SMALL + ["--time-stamps", "stamps.txt", "--time-unit", "h"],
                                time=(0.5, -1.0, "hour"), stamps=[-1.0, -0.5, 0.25, 0.75])
    made["u8-100x37x211"] = Volume(noise("u1", 211, 37, 100), MEDIUM)
    made["u16-100x37x211"] = Volume(noise("u2", 211, 37, 100))  # One brick shape for all defaults.
    made["u16-zstd"] = Volume(noise("u2", 20, 30, 40), MEDIUM + ["--codec", "zstd:3"])
    made["u8-shuffle"] = Volume(noise("u1", 20, 30, 40), MEDIUM + ["--codec", "shuffle-zstd:5"])
    made["i32-shuffle"] = Volume(noise("i4", 20, 30, 40), MEDIUM + ["--codec", "shuffle-zstd:9"])
    special = noise("f4", 41, 35, 30)
    special[0, 0, ::5, ::3, 1::4] = np.nan
    special[0, 0, 1::7, ::2, ::5] = np.inf
    special[0, 0, 2::7, 1::2, ::5] = -np.inf
    special[0, 0, 8:24, 8:24, 8:24] = np.nan  # Whole bricks, and what is left of them in coarser levels.
    made["f4-not-finite"] = Volume(special, SMALL + TWO)
    for d, nodata in [("u1", 0), ("i2", -2000), ("u2", 65535), ("i4", -9999)]:
        padded = noise(d, 41, 35, 30) // 7
        padded[0, 0, ::5, ::3, 1::4] = padded[0, 0, 8:24, 8:24, 8:24] = padded[0, 0, :, :, 25:] = nodata
        made[f"{d}-nodata"] = Volume(padded, SMALL + TWO + APRONS + [f"--nodata={nodata}"], nodata=nodata)
    # Bricks that stay as they are over the steps of a shard have one range of bytes for all of them.
    for d, times, steps, more in [("u1", 5, 2, TWO + APRONS), ("u2", 7, 3, WIDE_APRONS), ("f4", 4, 9, ["--codec", "none"])]:
        made[f"{d}-shared"] = Volume(moving(d, times, 2), SMALL + more + [STEPS_IN_SHARDS, str(steps)])
    spots = np.zeros((1, 1, 40, 40, 40), "u2")
    spots[..., 3, 33, 20] = 65535
    made["u2-spot"] = Volume(spots, SMALL + TWO + APRONS)
    return made


def mean(fine, factor, nodata):
    """What the next level must be: the mean of each box's voxels with data, in f64; NaN where there is none."""
    value, valid = fine.astype("f8"), np.isfinite(fine) & (fine != nodata if nodata is not None else True)
    value = np.where(valid, value, 0.0)
    for axis, f in enumerate(factor):
        pad = [(0, 0)] * fine.ndim
        pad[axis] = (0, -value.shape[axis] % f)
        shape = list(value.shape)
        shape[axis : axis + 1] = [(shape[axis] + pad[axis][1]) // f, f]
        value = np.pad(value, pad).reshape(shape).sum(axis + 1)
        valid = np.pad(valid, pad).reshape(shape).sum(axis + 1)
    return np.divide(value, valid, out=np.full(value.shape, np.nan), where=valid > 0)


def maximum(fine, factor, nodata):
    """What the next level of maxima must be: the greatest voxel with data of each box; NaN or `nodata` where there is none."""
    if nodata is not None:
        found = maximum(np.where(fine == nodata, -np.inf, fine), factor, None)
        return np.where(np.isfinite(found), found, nodata).astype(fine.dtype)
    floats = fine.dtype.kind == "f"
    least = -np.inf if floats else np.iinfo(fine.dtype).min
    value = np.where(np.isfinite(fine), fine, np.array(least, fine.dtype))
    for axis, f in enumerate(factor):
        pad = [(0, 0)] * fine.ndim
        pad[axis] = (0, -value.shape[axis] % f)
        shape = list(value.shape)
        shape[axis : axis + 1] = [(shape[axis] + pad[axis][1]) // f, f]
        value = np.pad(value, pad, constant_values=least).reshape(shape).max(axis + 1)
    return np.where(value == least, np.array(np.nan, fine.dtype), value) if floats else value


def check_mean(fine, coarse, factor, nodata):
    expected = mean(fine, factor, nodata)
    check(coarse.shape == expected.shape, coarse.shape, expected.shape)
    if coarse.dtype.kind == "f":
        # One rounding to f32, and perhaps one in the last bit of the f64 sum.
        both_nan = np.isnan(coarse) & np.isnan(expected)
        near = np.abs(coarse - expected) <= np.spacing(np.abs(coarse))
        check((near | both_nan).all(), "a level is not the mean of the finer one")
    else:
        # Sums of eight 32-bit integers are exact in f64: nearest, ties to even, without any tolerance.
        rounded = np.rint(expected)
        if nodata is not None:
            # A mean that is `nodata`, though there are data, is the number next to it on the mean's side.
            rounded = np.where(rounded == nodata, nodata + np.where(expected >= nodata, 1, -1), rounded)
            rounded = np.where(np.isnan(expected), nodata, rounded)
        check((coarse == rounded).all(), "a level is not the rounded mean of the finer one")


def exported(name, volume, level, shape):
    """The level as `export` gives it, through both of its formats."""
    whole = np.empty(shape, volume.array.dtype)
    for t in range(shape[0]):
        for c in range(shape[1]):
            parts = ["--level", level, "--time", t, "--channel", c]
            for kind in ["npy", "raw"]:
                brickyard("export", f"{name}.zarr", f"{name}.{kind}", "--overwrite", *parts)
            npy, raw = np.load(FOLDER / f"{name}.npy"), (FOLDER / f"{name}.raw").read_bytes()
            check(npy.dtype == volume.array.dtype, npy.dtype)
            check(npy.astype(npy.dtype.newbyteorder("<")).tobytes() == raw, "the .raw is not the .npy")
            whole[t, c] = npy
    return whole


def check_metadata(volume, root):
    """The placement of every level; returns the levels' scales as (z, y, x)."""
    ome = root["attributes"]["ome"]
    check(ome["version"] == "0.5", ome["version"])
    (multiscale,) = ome["multiscales"]
    axes = [a["name"] for a in multiscale["axes"]]
    times, channels = volume.array.shape[:2]
    check(axes == ["t"] * (times > 1) + ["c"] * (channels > 1) + ["z", "y", "x"], axes)
    units = {"um": "micrometer", "mm": "millimeter", None: None}
    for axis in multiscale["axes"]:
        kind = {"t": "time", "c": "channel"}.get(axis["name"], "space")
        unit = {"space": units[volume.unit], "time": volume.time[2], "channel": None}[kind]
        check(axis["type"] == kind and axis.get("unit") == unit, axis)
    scales = []
    for k, dataset in enumerate(multiscale["datasets"]):
        check(dataset["path"] == str(k), dataset)
        scale, translation = dataset["coordinateTransformations"]
        check(scale["type"] == "scale" and translation["type"] == "translation", dataset)
        scale, translation = np.array(scale["scale"]), np.array(translation["translation"])
        check(len(scale) == len(translation) == len(axes), dataset)
        step, start = volume.time[:2]
        check(list(scale[:-3]) == [step] * (times > 1) + [1] * (channels > 1), dataset)
        check(list(translation[:-3]) == [start] * (times > 1) + [0] * (channels > 1), dataset)
        # The first voxel's box starts where level 0's does, half a voxel before its centre.
        spacing, origin = np.array(volume.spacing[::-1]), np.array(volume.origin[::-1])
        corner = translation[-3:] - scale[-3:] / 2
        check(np.allclose(corner, origin - spacing / 2, rtol=1e-12, atol=1e-12), k, corner)
        factor = scale[-3:] / spacing
        check(np.allclose(factor, 2.0 ** np.round(np.log2(factor)), rtol=1e-12), k, factor)
        scales.append(scale[-3:])
    check(root["attributes"]["brickyard"].get("time", {}).get("stamps") == volume.stamps, volume.stamps)
    check(np.allclose(scales[0], volume.spacing[::-1], rtol=1e-12), scales[0])
    return scales


def check_listing(path, levels):
    """Other tools find the levels and nothing else, without a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        group = zarr.open_group(path, mode="r")
        members = dict(group.members(max_depth=None))
        check(set(members) == {str(k) for k in range(levels)}, list(members))
        check(all(isinstance(m, zarr.Array) for m in members.values()), members)
        check(sorted(group.array_keys()) == sorted(members) and not list(group.group_keys()), list(group.keys()))
    # napari's own reader takes the sub-folders of a group, but for hidden ones, in the order of their names, for the levels
    # of a pyramid, and opens the first as an array.
    folders = sorted(p for p in path.iterdir() if p.is_dir() and not p.name.startswith("."))
    check([p.name for p in folders] == [str(k) for k in range(levels)], folders)
    shapes = [json.loads((p / "zarr.json").read_text())["shape"] for p in folders]
    check(shapes == sorted(shapes, reverse=True), shapes)
    check(zarr.open(folders[0], mode="r").shape == tuple(shapes[0]), folders[0])


def opened(path):
    """An array as zarr-python and as tensorstore open it, without a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        array = zarr.open_array(path, mode="r")
    return array, ts.open({"driver": "zarr3", "kvstore": {"driver": "file", "path": str(path)}}).result()


def check_aprons(path, level, root):
    """Where aprons are stored beside the level at `path`, they are the voxels around its bricks, edges repeated."""
    settings = root["attributes"]["brickyard"]
    edge, width = settings["edge"], settings.get("aprons", 0)
    if not width:
        check(not (path / ".brickyard" / "aprons").exists(), path)
        return
    array, store = opened(path / ".brickyard" / "aprons")
    found = array[...]
    check(same_bits(found, store.read().result()), f"{path}: zarr-python and tensorstore differ in the aprons")
    bricks = found.shape[-4:-1]
    core, low, high = slice(width, width + edge), slice(width), slice(width + edge, None)
    slabs = [(low,), (high,), (core, low), (core, high), (core, core, low), (core, core, high)]
    for voxels, aprons in zip(level.reshape(-1, *level.shape[-3:]), found.reshape(-1, *found.shape[-4:]), strict=True):
        pads = [(width, b * edge - n + width) for b, n in zip(bricks, voxels.shape)]
        padded = np.pad(voxels, pads, mode="edge")
        for brick in np.ndindex(*bricks):
            box = padded[tuple(slice(b * edge, (b + 1) * edge + 2 * width) for b in brick)]
            expected = np.concatenate([box[slab].ravel() for slab in slabs])
            check(same_bits(aprons[brick], expected), f"{path}: the apron of brick {brick}")


def check_second(path, root, scales, nodata):
    """The second pyramid's levels, where its metadata say, are the maxima of the finer ones, from the same level 0 on."""
    (main,), (second,) = (root["attributes"][owner]["multiscales"] for owner in ["ome", "brickyard"])
    check(main["type"] == "mean" and second["type"] == "max", main["type"], second["type"])
    check(main["axes"] == second["axes"], second["axes"])
    finer = None
    for k, (ours, theirs) in enumerate(zip(second["datasets"], main["datasets"], strict=True)):
        check(ours["path"] == (f"{k}/.brickyard/max" if k else "0"), ours["path"])
        check({**ours, "path": str(k)} == theirs, ours)
        array, store = opened(path / ours["path"])
        like = zarr.open_array(path / str(k), mode="r").metadata
        check(array.metadata == like, f"level {k}: shape, type, shards or codecs of the pyramids differ")
        found = array[...]
        check(same_bits(found, store.read().result()), f"level {k}: zarr-python and tensorstore differ")
        check_aprons(path / ours["path"], found, root)
        if finer is not None:
            factor = [1] * (found.ndim - 3) + [round(f) for f in scales[k] / scales[k - 1]]
            check(same_bits(found, maximum(finer, factor, nodata)), f"level {k} is not the maximum of the finer one")
        finer = found


def check_shared(path, array, steps):
    """Shards of the level at `path` hold so many steps, and of their bricks those of one content have one range."""
    inner, outer, times = array.chunks, array.shards, array.shape[0]
    check(outer[0] == min(steps, times) and inner[0] == 1, outer, inner)
    grid = [o // i for o, i in zip(outer, inner)]
    voxels = array[...]
    stored = kept = 0
    for file in sorted(p for p in (path / "c").rglob("*") if p.is_file()):
        corner = [int(n) * o for n, o in zip(file.relative_to(path / "c").parts, outer, strict=True)]
        index = np.frombuffer(file.read_bytes()[-4 - 16 * int(np.prod(grid)) : -4], "<u8").reshape(*grid, 2)
        places = {}
        for place in np.ndindex(*grid):
            first = [c + p * i for c, p, i in zip(corner, place, inner)]
            is_there = all(f < n for f, n in zip(first, array.shape))
            if index[place][0] == 2**64 - 1:
                continue
            check(is_there, f"{file}: a brick past the end at {place}")
            brick = voxels[tuple(slice(f, f + i) for f, i in zip(first, inner))]
            # At the far faces bricks hold more than the array does, which repeats what it has.
            places.setdefault((brick.shape, brick.tobytes()), set()).add(tuple(index[place]))
        check(all(len(ranges) == 1 for ranges in places.values()), f"{file}: bricks of one content have several ranges")
        stored += int((index[..., 0] != 2**64 - 1).sum())
        kept += len(places)
    check(kept < 0.8 * stored, f"{path}: {kept} of {stored} bricks are kept")


def check_store(name, volume):
    volume.pack(name)
    path = FOLDER / f"{name}.zarr"
    root = json.loads((path / "zarr.json").read_text())
    scales = check_metadata(volume, root)
    check_listing(path, len(scales))
    if TWO[1] in volume.flags:
        check_second(path, root, scales, volume.nodata)
    finer = None
    for k, scale in enumerate(scales):
        array, store = opened(path / str(k))
        found = array[...]
        five = volume.array.shape[:2] + found.shape[-3:]
        ours = exported(name, volume, k, five).reshape(found.shape)
        check(same_bits(found, ours), f"level {k}: zarr-python and export differ")
        names = tuple(a["name"] for a in root["attributes"]["ome"]["multiscales"][0]["axes"])
        check(array.metadata.dimension_names == names and store.domain.labels == names, store.domain)
        check(same_bits(store.read().result(), ours), f"level {k}: tensorstore and export differ")
        check_aprons(path / str(k), ours, root)
        if k == 0 and STEPS_IN_SHARDS in volume.flags:
            check_shared(path / "0", array, int(volume.flags[volume.flags.index(STEPS_IN_SHARDS) + 1]))
        # The name that xarray and others go by, as CF has it.
        check(array.attrs.get("_FillValue") == volume.nodata, f"level {k}:", dict(array.attrs))
        if finer is None:
            check(same_bits(ours.reshape(volume.array.shape), volume.array), "level 0 is not the input")
        else:
            factor = [1] * (ours.ndim - 3) + [round(f) for f in scale / scales[k - 1]]
            check_mean(finer, ours, factor, volume.nodata)
        finer = ours
    check(all(n <= root["attributes"]["brickyard"]["edge"] for n in finer.shape[-3:]), "the last level is one brick")
    brickyard("verify", f"{name}.zarr", "--progress", "none")


def check_ramp():
    """A volume that is linear in world coordinates has the same value at the same place on every level."""
    shape, spacing, origin = (45, 61, 83), np.array([0.5, 0.75, 1.0]), np.array([7.0, -3.0, 20.0])

    def world(shape, scale, translation):
        axes = [t + s * np.arange(n) for n, s, t in zip(shape, scale, translation)]
        z, y, x = np.meshgrid(*axes, indexing="ij")
        return 3.0 * x - 2.0 * y + 0.5 * z

    array = world(shape, spacing[::-1], origin[::-1]).astype("f4")
    volume = Volume(array[None, None], MEDIUM, tuple(spacing), tuple(origin))
    volume.pack("ramp")
    root = json.loads((FOLDER / "ramp.zarr" / "zarr.json").read_text())
    datasets = root["attributes"]["ome"]["multiscales"][0]["datasets"]
    check(len(datasets) >= 3, datasets)
    for k, dataset in enumerate(datasets):
        scale, translation = (t[t["type"]] for t in dataset["coordinateTransformations"])
        found = zarr.open_array(FOLDER / "ramp.zarr" / str(k), mode="r")[...]
        # A box that the volume's far side cuts is averaged over what exists, so its mean is not its centre's value.
        factor = np.round(np.array(scale) / spacing[::-1]).astype(int)
        whole = tuple(slice(0, n // f) for n, f in zip(shape, factor))
        expected = world(found.shape, scale, translation)
        # Values up to 300 as f32, rounded once a level.
        check(np.allclose(found[whole], expected[whole], rtol=0, atol=len(datasets) * 2e-5), f"level {k}")


cases = {name: lambda n=name, v=volume: check_store(n, v) for name, volume in volumes().items()}
run_cases({"ramp": check_ramp, **cases})
