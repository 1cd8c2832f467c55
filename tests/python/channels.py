"""Images of several channels, written by tifffile: brickyard shows them in their own colours and windows, added as napari adds them, and keeps their
names."""

import json

import numpy as np
import tifffile
from PIL import Image

from common import FOLDER, brickyard, check, info, run_cases

RANDOM = np.random.default_rng(3)
SHAPE = (6, 20, 32)  # z, y, x
NAMES = ["DAPI", "GFP & friends", "Cy5"]
COLORS = np.array([[0, 0, 255], [0, 255, 0], [255, 128, 0]])
WINDOWS = np.array([[100.0, 4000.0], [0.0, 900.0], [20.0, 60000.0]])


def stack():
    """Channels, z, y, x; each in a range of its own."""
    parts = [RANDOM.integers(low, high, SHAPE) for low, high in [(0, 5000), (0, 1000), (0, 65536)]]
    return np.stack(parts).astype("u2")


def added(planes, windows, colors):
    """What napari shows of planes with additive blending: windowed, times the colour, summed, 0 to 255."""
    planes, windows, colors = np.asarray(planes, float), np.asarray(windows, float), np.asarray(colors, float) / 255
    low, high = windows[:, 0, None, None], windows[:, 1, None, None]
    shares = np.clip((planes - low) / (high - low), 0, 1)
    return np.clip(np.einsum("cyx,ck->yxk", shares, colors), 0, 1) * 255


def shown(*flags):
    """A picture of `o.zarr`, a pixel a voxel."""
    brickyard("render", "o.zarr", "-o", "o.png", "--overwrite", "--backend", "cpu", "--size", f"{SHAPE[2]}x{SHAPE[1]}", *flags)
    return np.asarray(Image.open(FOLDER / "o.png")).astype(float)


def close(found, expected, *what):
    # Whole levels, twice: of the picture, and of 16-bit codes in windows of some hundred of them.
    off = np.abs(found - expected)
    check(off.max() <= 1.5, *what, off.max(), np.argwhere(off > 1.5)[:3])


def pack(name):
    brickyard("pack", name, "o.zarr", "--overwrite", "--brick", "16", "--progress", "none")


def write_ome(data):
    tifffile.imwrite(FOLDER / "ome.ome.tif", data, ome=True, photometric="minisblack", metadata={
        "axes": "CZYX", "Channel": {"Name": NAMES, "Color": [int(np.array([*c, 255], "u1").view(">i4")[0]) for c in COLORS]}})
    pack("ome.ome.tif")


def write_imagej(data):
    ramp = np.arange(256)
    tables = [np.stack([ramp * part // 255 for part in color]).astype("u1") for color in COLORS]
    tifffile.imwrite(FOLDER / "imagej.tif", data.transpose(1, 0, 2, 3), imagej=True, metadata={
        "axes": "ZCYX", "mode": "composite", "LUTs": tables, "Ranges": WINDOWS.ravel().tolist()})
    pack("imagej.tif")


def ome_tiff():
    data = stack()
    write_ome(data)
    kept = info("o.zarr")["displays"]
    check([k["name"] for k in kept] == NAMES and [k["color"] for k in kept] == COLORS.tolist(), kept)
    check(all(name in brickyard("info", "o.zarr") for name in NAMES), "info")
    omero = json.loads((FOLDER / "o.zarr/zarr.json").read_text())["attributes"]["ome"]["omero"]["channels"]
    check([(c["label"], c["color"]) for c in omero] == list(zip(NAMES, ["0000FF", "00FF00", "FF8000"])), omero)
    windows = [k["window"] for k in kept]
    close(shown("--slice", "k=2"), added(data[:, 2], windows, COLORS), "slice")
    top = ["--view", "-z", "--up=0,-1,0", "--ortho", SHAPE[1]]
    # Rays have samples between the planes, where noise is less than in them: planes that are alike are all one value.
    alike = np.repeat(data[:, :1], SHAPE[0], axis=1)
    write_ome(alike)
    close(shown("--mode", "mip", *top), added(alike.max(1), [k["window"] for k in info("o.zarr")["displays"]], COLORS), "mip")
    lit = shown("--lighting", "phong")
    check(lit.max() > 60 and np.ptp(lit, axis=2).max() > 40, "a lit volume in colours", lit.max())


def imagej_hyperstack():
    data = stack()
    write_imagej(data)
    kept = info("o.zarr")["displays"]
    check([k["color"] for k in kept] == COLORS.tolist() and [k["window"] for k in kept] == WINDOWS.tolist(), kept)
    close(shown("--slice", "k=3"), added(data[:, 3], WINDOWS, COLORS), "slice")


def chosen_channels():
    """By number, by name, with windows, colours and opacities of their own."""
    data = stack()
    write_imagej(data)
    close(shown("--slice", "k=1", "--channel", "2,0"), added(data[[2, 0], 1], WINDOWS[[2, 0]], COLORS[[2, 0]]), "two")
    write_ome(data)
    one = shown("--slice", "k=1", "--channel", "gfp & friends", "--window", "10,700", "--color", "white")
    close(one, added(data[[1], 1], [[10, 700]], [[255] * 3]), "one in white")
    flags = ["--window", "0,5000", "--window", "Cy5=1%,99%", "--color", "DAPI=ff00ff", "--color", "1=cyan", "--opacity", "DAPI=0.5"]
    windows = [[0, 5000], [0, 5000], np.percentile(data[2], [1, 99], method="inverted_cdf")]
    colors = np.array([[127.5, 0, 127.5], [0, 255, 255], COLORS[2]])
    close(shown("--slice", "k=4", *flags), added(data[:, 4], windows, colors), "looks")


def photographs():
    """Red, green and blue are what they are."""
    data = RANDOM.integers(0, 256, (*SHAPE, 3), "u1")
    tifffile.imwrite(FOLDER / "rgb.tif", data, photometric="rgb")
    pack("rgb.tif")
    close(shown("--slice", "k=5"), data[5].astype(float), "rgb")
    fog = shown()
    # How opaque its pixels are is no light, and takes none.
    opaque = np.concatenate([data, np.full((*SHAPE, 1), 255, "u1")], axis=-1)
    tifffile.imwrite(FOLDER / "rgba.tif", opaque, photometric="rgb", extrasamples=["unassalpha"])
    pack("rgba.tif")
    close(shown("--slice", "k=5"), data[5].astype(float), "rgba")
    check((shown() == fog).all(), "the same fog")


def edited_metadata():
    """Another program's edit of OME's metadata is what is shown."""
    data = stack()
    write_ome(data)
    path = FOLDER / "o.zarr/zarr.json"
    root = json.loads(path.read_text())
    channels = root["attributes"]["ome"]["omero"]["channels"]
    channels[0].update(label="nuclei", color="FF0000", window={**channels[0]["window"], "start": 50, "end": 3000})
    channels[1]["active"] = False
    path.write_text(json.dumps(root))
    windows = [[50, 3000], info("o.zarr")["displays"][2]["window"]]
    close(shown("--slice", "k=0"), added(data[[0, 2], 0], windows, [[255, 0, 0], COLORS[2]]), "edited")
    close(shown("--slice", "k=0", "--channel", "nuclei"), added(data[[0], 0], windows[:1], [[255, 0, 0]]), "by its new name")


def probes():
    """Every channel's value at a place, in the world and in voxels."""
    data = stack()
    write_ome(data)
    found = json.loads(brickyard("probe", "o.zarr", "7,3,2", "--json"))
    check(found["voxel"] == [7, 3, 2] and [c["value"] for c in found["channels"]] == data[:, 2, 3, 7].tolist(), found)
    check([c["name"] for c in found["channels"]] == NAMES, found)
    brickyard("pack", "ome.ome.tif", "o.zarr", "--overwrite", "--brick", "16", "--progress", "none", "--spacing", "0.5,0.5,2", "--origin=-3,4,10")
    by_world = brickyard("probe", "o.zarr", "0.6,5.4,14.9")
    check(by_world == brickyard("probe", "o.zarr", "7,3,2", "--voxel") and "centre at 0.5,5.5,14 " in by_world, by_world)


run_cases({f.__name__: f for f in [
    ome_tiff, imagej_hyperstack, chosen_channels, photographs, edited_metadata, probes,
]})
