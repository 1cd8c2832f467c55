"""Zarr written by zarr-python, opened where it lies: exported, probed, drawn and indexed, beside a store packed from it."""

import functools
import itertools
import json
import math
import os
import re
import shutil
import subprocess

import numcodecs
import numpy as np
import PIL.Image
import zarr
import zarr.codecs as codecs

import common
from common import COMMAND, FOLDER, brickyard, check, info, run_cases, same_bits

RANDOM = np.random.default_rng(7)
noise = functools.partial(common.noise, RANDOM)
# Kept beside the inputs, and looked into below.
os.environ["BRICKYARD_CACHE"] = str(FOLDER / "cache")


def fails(code, words, *arguments):
    """Runs the command, expects this exit code, and all words in its message."""
    done = subprocess.run([COMMAND, *map(str, arguments)], capture_output=True, text=True, cwd=FOLDER)
    check(done.returncode == code, arguments, "exit", done.returncode, done.stderr)
    for word in [words] if isinstance(words, str) else words:
        check(word in done.stderr, repr(word), "is not in", done.stderr)


def smooth(*shape):
    """Waves of 16 bits, so that pictures show something."""
    grid = np.meshgrid(*(np.linspace(0, 6, n) for n in shape), indexing="ij")
    return (3000 * np.prod([np.sin(g + 1) ** 2 for g in grid], axis=0)).astype("u2")


def write(path, array, chunks, version=3, **how):
    shutil.rmtree(FOLDER / path, ignore_errors=True)
    stored = zarr.create_array(FOLDER / path, shape=array.shape, dtype=array.dtype, chunks=chunks, zarr_format=version, **how)
    stored[...] = array
    return FOLDER / path


def image(path, levels, version="0.5", chunks=(32, 48, 40), scales=None, axes="zyx", extra=None):
    """An OME-Zarr image of these arrays."""
    shutil.rmtree(FOLDER / path, ignore_errors=True)
    group = zarr.create_group(FOLDER / path, zarr_format=3 if version >= "0.5" else 2)
    kinds = {"t": "time", "c": "channel"}
    datasets = []
    for k, array in enumerate(levels):
        n = len(axes) - 3
        stored = group.create_array(str(k), shape=array.shape, dtype=array.dtype, chunks=(1,) * n + tuple(min(a, b) for a, b in zip(chunks, array.shape[n:])))
        stored[...] = array
        factor = scales[k] if scales else [2**k] * 3
        scale = [1.0] * n + [0.5 * f for f in factor]
        offset = [0.0] * n + [0.25 * (f - 1) for f in factor]
        datasets.append({"path": str(k), "coordinateTransformations": [{"type": "scale", "scale": scale}, {"type": "translation", "translation": offset}]})
    space = lambda name: {"name": name, "type": "space", "unit": "micrometer"}
    described = [{"name": a, "type": kinds[a]} if a in kinds else space(a) for a in axes]
    multiscales = [{"name": "waves", "axes": described, "datasets": datasets}]
    if version >= "0.5":
        group.attrs["ome"] = {"version": version, "multiscales": multiscales, **(extra or {})}
    else:
        multiscales[0]["version"] = version
        group.attrs.update({"multiscales": multiscales, **(extra or {})})
    return FOLDER / path


def halved(array):
    """Means of two voxels along each of the last three axes, whose lengths are even."""
    for axis in (-1, -2, -3):
        array = np.moveaxis(array, axis, 0)
        array = np.moveaxis((array[0::2].astype("f8") + array[1::2]) / 2, 0, axis)
    return array


def exported(path, *flags):
    brickyard("export", path, "o.npy", "--overwrite", "--progress", "none", *flags)
    return np.load(FOLDER / "o.npy")


def arrays_of_all_kinds():
    shuffled = numcodecs.Blosc(cname="lz4", clevel=3, shuffle=numcodecs.Blosc.SHUFFLE)
    v2 = [{"compressors": None}, {"compressors": shuffled}, {"compressors": numcodecs.Zstd(2)}, {"compressors": numcodecs.GZip(3), "order": "F"}]
    v3 = [{"compressors": None}, {"compressors": codecs.BloscCodec(cname="zstd")}, {"compressors": codecs.GzipCodec()}, {"shards": (40, 60, 56), "compressors": codecs.ZstdCodec()}]
    chunks = itertools.cycle([(20, 30, 28), (64, 64, 64), (1, 70, 90), (20, 10, 7)])
    for version, kinds in ((2, v2), (3, v3)):
        for dtype, how in itertools.product(("u1", "i2", ">u2", "u4", "f4"), kinds):
            array = noise(dtype, 66, 70, 90)
            chunk = (20, 30, 28) if "shards" in how else next(chunks)
            path = write("a.zarr", array, chunk, version, **how)
            check(same_bits(exported(path), array), version, dtype, how, chunk)
    told = json.loads(brickyard("probe", path, "89,69,65", "--json"))
    check(str(float(array[65, 69, 89])) in json.dumps(told) or np.isclose(told["channels"][0]["value"], array[65, 69, 89]), told)


def half_double_and_64_bits():
    array = noise("f2", 20, 30, 40)
    check(same_bits(exported(write("a.zarr", array, (8, 8, 8))), array.astype("f4")))
    array = noise("f8", 20, 30, 40).astype("f4").astype("f8")
    check(same_bits(exported(write("a.zarr", array, (8, 8, 8))), array.astype("f4")))
    array = RANDOM.integers(0, 2**31 - 1, (20, 30, 70), "i8")
    path = write("a.zarr", array, (8, 8, 8))
    check(same_bits(exported(path), array.astype("i4")))
    # Checked where it is read: in the second brick.
    zarr.open_array(path)[19, 29, 69] = 2**40
    check(same_bits(exported(path, "--roi", "0:64,0:30,0:20"), array[..., :64].astype("i4")))
    fails(3, [str(2**40)], "export", path, "o.npy", "--overwrite")


def pictures_equal_a_packed_store_s():
    array = smooth(96, 112, 128)
    levels = [array, halved(array).round().astype("u2")]
    levels.append(halved(levels[1]).round().astype("u2"))
    look = ["--backend", "cpu", "--window", "100,2500", "--size", "160x120", "--overwrite"]
    for version in ("0.4", "0.5"):
        path = image("i.zarr", levels, version)
        brickyard("pack", path, "o.zarr", "--overwrite", "--progress", "none")
        found, packed = info(path), info("o.zarr")
        check(found["foreign"] and not packed["foreign"])
        for key in ("spacing", "origin", "unit", "axes"):
            check(found[key] == packed[key], key, found[key], packed[key])
        # The image has a level more than it needs to end in one brick.
        check([level["extent"] for level in found["levels"]][:-1] == [level["extent"] for level in packed["levels"]])
        for k in range(3):
            check(same_bits(exported(path, "--level", k), levels[k]), "level", k)
        for flags in (["--level", "0"], []):
            for store, picture in ((path, "a.png"), ("o.zarr", "b.png")):
                brickyard("render", store, "-o", picture, *look, *flags)
            a, b = (np.asarray(PIL.Image.open(FOLDER / name), int) for name in ("a.png", "b.png"))
            # Means are rounded to even by packing, and by numpy; levels 1 and up may differ by one unit of 2,400.
            check(abs(a - b).max() <= (0 if flags else 1) and a.std() > 5, flags, abs(a - b).max(), a.std())


def coarse_levels_are_made_and_kept():
    shutil.rmtree(FOLDER / "cache", ignore_errors=True)
    array = smooth(150, 70, 67)
    path = write("a.zarr", array, (50, 70, 67))
    brickyard("pack", path, "o.zarr", "--overwrite", "--progress", "none")
    for k in (1, 2):
        check(same_bits(exported(path, "--level", k), exported("o.zarr", "--level", k)), "level", k)
    kept = list((FOLDER / "cache").glob("*/*/*"))
    check(kept, "nothing is kept")
    check(same_bits(exported(path, "--level", 1), exported("o.zarr", "--level", 1)), "kept")
    # What was made of other voxels is not taken.
    zarr.open_array(path)[...] = 65535 - array
    check(exported(path, "--level", 1).min() > 60000)
    os.environ["BRICKYARD_CACHE"] = ""
    check(exported(path, "--level", 2).min() > 60000)
    os.environ["BRICKYARD_CACHE"] = str(FOLDER / "cache")


def copies_that_keep_times_are_other_files():
    array = smooth(150, 70, 67)
    path = write("a.zarr", array, (50, 70, 67), compressors=None)
    brickyard("index", path, "--progress", "none")
    check(info(path)["exact_statistics"] and same_bits(exported(path, "--level", 0), array))
    first = exported(path, "--level", 1)
    other = write("b.zarr", 65535 - array, (50, 70, 67), compressors=None)
    # All files of another image, of the same sizes and times.
    for old in [p for p in path.rglob("*") if p.is_file()]:
        new, then = other / old.relative_to(path), old.stat()
        old.write_bytes(new.read_bytes())
        os.utime(old, ns=(then.st_atime_ns, then.st_mtime_ns))
    check(exported(path, "--level", 1).min() > 60000 and first.max() < 5000, "stale levels")
    found = [info(path)["store"]["channels"][0][key] for key in ("range", "mean")]
    check(found[0][0] > 60000 and found[1] > 60000, "stale statistics", found)
    brickyard("index", path, "--progress", "none")
    check(info(path)["store"]["channels"][0]["range"] == [float((65535 - array).min()), float((65535 - array).max())])


def channels_and_volumes_share_a_budget():
    planes = smooth(24, 256, 512)
    many = image("m.zarr", [np.stack([planes] * 6)], axes="czyx", chunks=(1, 256, 512))
    others = [image(f"v{k}.zarr", [planes], chunks=(1, 256, 512)) for k in range(4)]
    look = ["-o", "a.png", "--backend", "cpu", "--size", "80x60", "--overwrite"]
    for volumes in ([many], others, [others[0]] * 4):
        brickyard("render", *volumes, *look, "--host-memory", "512MiB")
        done = subprocess.run([COMMAND, "render", *map(str, volumes), *look, "--host-memory", "1MiB"], capture_output=True, text=True, cwd=FOLDER)
        least = re.search(r"at least ([0-9.]+) MiB", done.stderr)
        check(done.returncode == 2 and least, done.stderr)
        # What the message asks for is enough.
        brickyard("render", *volumes, *look, "--host-memory", f"{math.ceil(float(least[1]) + 0.1)}MiB")


def documents_of_others_need_not_suit_a_store():
    array = smooth(20, 30, 40)
    for version in ("0.6", "0.6rc0"):
        group = zarr.create_group(FOLDER / "d.zarr", zarr_format=3, overwrite=True)
        group.create_array("0", shape=array.shape, dtype=array.dtype, chunks=(20, 30, 40))[...] = array
        systems = [{"name": "a", "axes": [{"name": n, "type": "space"} for n in "zyx"]}]
        step = {"type": "scale", "scale": [1, 2, 3], "input": {"path": "./0"}, "output": {"name": "a"}}
        datasets = [{"path": "0", "coordinateTransformations": [step]}]
        group.attrs["ome"] = {"version": version, "multiscales": [{"coordinateSystems": systems, "datasets": datasets}]}
        check(info("d.zarr")["spacing"] == [3, 2, 1] and same_bits(exported("d.zarr"), array), version)
    path = image("n.zarr", [array], extra={"omero": {"channels": [{"window": {"start": float("nan"), "end": 9.0}}]}})
    check("NaN" in (path / "zarr.json").read_text() and same_bits(exported(path), array))


def an_index_makes_statistics_exact():
    array = np.where(RANDOM.random((2, 100, 110, 120)) < 1e-5, np.float32(1e6), noise("f4", 2, 100, 110, 120))
    path = image("i.zarr", [array], axes="czyx")
    brickyard("pack", path, "o.zarr", "--overwrite", "--progress", "none")
    before = info(path)
    brickyard("index", path, "--progress", "none")
    found, packed = info(path), info("o.zarr")
    check(found["exact_statistics"] and packed["exact_statistics"], before["exact_statistics"])
    for a, b in zip(found["store"]["channels"], packed["store"]["channels"]):
        check(np.isclose(a.pop("mean"), b.pop("mean")) and a == b, a, b)
    zarr.open_array(path / "0")[0, 0, 0, 0] = 5
    check(not info(path)["exact_statistics"] or before["exact_statistics"], "stale")


def one_of_several_is_chosen():
    shutil.rmtree(FOLDER / "g.zarr", ignore_errors=True)
    group = zarr.create_group(FOLDER / "g.zarr")
    arrays = {name: noise("u1", 20, 30, 40) for name in ("left", "right")}
    for name, array in arrays.items():
        group.create_array(name, shape=array.shape, dtype=array.dtype, chunks=(16, 16, 16))[...] = array
    fails(2, ["left (20 x 30 x 40", "right"], "info", "g.zarr")
    for name, array in arrays.items():
        check(same_bits(exported(f"g.zarr::{name}"), array))
    fails(2, "left", "info", "g.zarr::lef")
    fails(3, "nothing", "info", "nothing.zarr::a")


def damage_is_named_and_others_stores_are_only_read():
    path = write("a.zarr", smooth(80, 80, 80), (64, 64, 64))
    chunk = path / "c/1/1/1"
    chunk.write_bytes(chunk.read_bytes()[:-9])
    fails(3, "c/1/1/1", "export", path, "o.npy", "--overwrite")
    check(exported(path, "--roi", "0:64,0:64,0:64").shape == (64, 64, 64))
    for command in (["verify", path], ["edit", path, "--name", "x"], ["append", path, "o.npy"]):
        fails(3, "brickyard pack", *command)
    (path / "zarr.json").write_text("{")
    fails(3, "zarr.json", "info", path)


def labels_are_drawn_as_labels():
    array = np.zeros((40, 50, 60), "i8")
    array[5:20, 5:20, 5:20], array[20:, 20:, 20:] = 3, 70000
    colors = [{"label-value": 3, "rgba": [255, 0, 0, 255]}]
    path = image("i.zarr", [array], extra={"image-label": {"colors": colors}})
    found = info(path)
    check(found["store"]["kind"] == "labels" and found["voxel_type"] == "u32", found["store"]["kind"], found["voxel_type"])
    check(same_bits(exported(path), array.astype("u4")))
    brickyard("mesh", path, "o.obj", "--label", "70000", "--overwrite", "--progress", "none")
    brickyard("render", path, "-o", "a.png", "--backend", "cpu", "--size", "80x80", "--overwrite")
    picture = np.asarray(PIL.Image.open(FOLDER / "a.png"), int)[..., :3]
    check((picture[..., 0] - picture[..., 1:].max(-1)).max() > 60, "no red label is seen")


run_cases({
    "arrays of all kinds": arrays_of_all_kinds,
    "half, double and 64 bits": half_double_and_64_bits,
    "pictures": pictures_equal_a_packed_store_s,
    "coarse levels": coarse_levels_are_made_and_kept,
    "copies that keep times": copies_that_keep_times_are_other_files,
    "a shared budget": channels_and_volumes_share_a_budget,
    "documents of others": documents_of_others_need_not_suit_a_store,
    "an index": an_index_makes_statistics_exact,
    "several": one_of_several_is_chosen,
    "damage": damage_is_named_and_others_stores_are_only_read,
    "labels": labels_are_drawn_as_labels,
})
