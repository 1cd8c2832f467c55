"""Random HDF5 files of differential.py whose meaning lies in names and links: Imaris, padded to whole chunks, and NeXus plots of linked signals, by h5py."""

import h5py
import numpy as np
from differential_cases import in_five
from differential_check import Case, Reference
from differential_written import noise, pick


def letters(group, **texts):
    """Attributes of single characters, as Imaris writes them."""
    for name, text in texts.items():
        group.attrs.create(name, np.frombuffer(str(text).encode(), "S1"))


def write_imaris(rng, stem, name):
    times, channels, *shape = (int(n) for n in rng.integers(1, [4, 4, 12, 30, 30]))
    array = noise(rng, pick(rng, "u1", "u2", "f4"), times, channels, *shape)
    spacing = [float(n) for n in rng.choice([0.1, 0.5, 2.0], 3)]
    chunk = tuple(int(n) for n in rng.integers(1, 9, 3))
    path = stem.with_suffix(".ims")
    with h5py.File(path, "w", track_order=bool(rng.random() < 0.5)) as file:
        home = file
        if rng.random() < 0.5:
            # Recent versions keep several images, and link to one.
            home = file.create_group("Workflows/InitialImages")
            file["DataSet"], file["DataSetInfo"] = (h5py.SoftLink(f"/Workflows/InitialImages/{part}") for part in ("DataSet", "DataSetInfo"))
        image = home.create_group("DataSetInfo/Image")
        for axis, step in enumerate(spacing):
            letters(image, **{f"ExtMin{axis}": 0, f"ExtMax{axis}": step * shape[2 - axis]})
        for level, t, c in ((level, t, c) for level in range(2) for t in range(times) for c in range(channels)):
            group = home.create_group(f"DataSet/ResolutionLevel {level}/TimePoint {t}/Channel {c}")
            letters(group, ImageSizeX=shape[2], ImageSizeY=shape[1], ImageSizeZ=shape[0])
            padded = np.full([-(-n // size) * size for n, size in zip(shape, chunk)], 77, array.dtype)
            padded[tuple(slice(n) for n in shape)] = array[t, c] if level == 0 else 0
            group.create_dataset("Data", data=padded, chunks=chunk, compression=pick(rng, None, "gzip"))
    return Case(name, "written", "Imaris", array.dtype.name, [path], lambda: Reference(array, spacing=tuple(spacing)))


def write_nexus(rng, stem, name):
    shape = [int(n) for n in rng.integers(2, 20, 3)]
    array = noise(rng, pick(rng, "u1", "i2", "f4", ">f4"), *shape)
    spacing = [float(n) for n in rng.choice([0.25, 1.0, 3.0], 3)]
    names, kind = ["slow", "middle", "fast"], pick(rng, "axes", "indices", "old", "edges")
    path = stem.with_suffix(".nxs")
    with h5py.File(path, "w", libver=pick(rng, "earliest", "latest"), track_order=bool(rng.random() < 0.5)) as file:
        detector = file.create_group("entry/a_detector")
        detector["raw"], detector["dark"] = array, array[:2]
        plot = file.create_group("entry/plot")
        plot.attrs["NX_class"] = "NXdata"
        plot["counts"] = pick(rng, detector["raw"], h5py.SoftLink("/entry/a_detector/raw"))
        for place, (axis, step) in enumerate(zip(names, reversed(spacing))):
            count = shape[place] + (kind == "edges")
            plot.create_dataset(axis, data=5 + step * np.arange(count), chunks=pick(rng, None, (2,)), compression=pick(rng, None, "lzf"))
            if kind == "old":
                plot[axis].attrs["axis"] = place + 1
        if kind == "old":
            plot["counts"].attrs["signal"] = 1
        else:
            plot.attrs["signal"], plot.attrs["axes"] = "counts", names[::-1] if kind == "indices" else names
        for place, axis in enumerate(names if kind == "indices" else []):
            plot.attrs[f"{axis}_indices"] = place
        file.attrs["default"], file["entry"].attrs["default"] = "entry", "plot"
    return Case(name, "written", "NeXus", kind, [path], lambda: Reference(in_five(array, "ZYX"), spacing=tuple(spacing)))


KINDS = [("imaris", write_imaris, 1), ("nexus", write_nexus, 1)]
