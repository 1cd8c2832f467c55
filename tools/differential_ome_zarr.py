"""Random OME-Zarr of differential.py: images of 0.1 to 0.5 by ome-zarr, of 0.4 to 0.6 by ngff-zarr, and by zarr-python with axes in any order, in plates,
series and groups of labels; arrays of xarray's kind, with coordinates. Spacing, origin, unit, names and orientation are compared, too."""

import shutil

import ngff_zarr
import numpy as np
import ome_zarr.format
import ome_zarr.writer
import zarr
from differential_cases import in_five
from differential_check import Case, Reference
from differential_written import noise, pick

TYPES = ["u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8", "i8"]
UNITS = {"nanometer": "nm", "micrometer": "um", "millimeter": "mm"}
DIRECTIONS = {
    "z": ["inferior-to-superior", "superior-to-inferior"],
    "y": ["posterior-to-anterior", "anterior-to-posterior"],
    "x": ["left-to-right", "right-to-left"],
}


class Image:
    """Random voxels and their place, along axes with these letters."""

    def __init__(self, rng, letters):
        self.letters = letters
        self.shape = [int(rng.integers(1 if a in "tcz" else 2, {"t": 4, "c": 4, "z": 20}.get(a, 50))) for a in letters]
        self.array = noise(rng, pick(rng, *TYPES), *self.shape)
        self.scale = {a: float(rng.choice([0.1, 0.325, 1.0, 2.5])) if a in "zyx" else 1.0 for a in letters}
        self.offset = {a: float(rng.choice([0.0, -7.5, 1000.25])) if a in "zyx" else 0.0 for a in letters}
        self.unit = pick(rng, *UNITS)
        self.names = [f"marker {int(n)}" for n in rng.integers(0, 1000, self.shape[letters.index("c")] if "c" in letters else 1)]

    def along(self, values, missing):
        """Numbers along x, y, z."""
        return tuple(values.get(a, missing) for a in "xyz")

    def chunks(self, rng):
        return tuple(int(rng.integers(1, size + 1)) for size in self.shape)

    def omero(self):
        return {"channels": [{"label": name, "color": f"{i + 1:02X}8000", "active": True} for i, name in enumerate(self.names)]}

    def axes(self):
        kinds = {"t": "time", "c": "channel"}
        return [{"name": a, "type": kinds.get(a, "space"), **({"unit": self.unit} if a in "zyx" else {})} for a in self.letters]

    def reference(self, is_placed=True, names=None):
        five = in_five(self.array, self.letters.upper())
        if not is_placed:
            return Reference(five, names=names)
        spacing, origin = self.along(self.scale, 1.0), self.along(self.offset, 0.0)
        return Reference(five, spacing=spacing, origin=origin, unit=self.unit, names=names)


def letters_of(rng, least="yx"):
    return "".join(a for a in "tcz" if rng.random() < 0.5) + least


def folder_of(stem, end=".zarr"):
    path = stem.with_suffix(end)
    shutil.rmtree(path, ignore_errors=True)
    return path


def write_by_ome_zarr(rng, stem, name):
    version = pick(rng, "0.1", "0.2", "0.3", "0.4", "0.5")
    image = Image(rng, "tczyx" if version in ("0.1", "0.2") else letters_of(rng))
    path = folder_of(stem)
    fmt = ome_zarr.format.format_from_version(version)
    group = zarr.open_group(path, mode="w", zarr_format=2 if version != "0.5" else 3)
    is_placed = version in ("0.4", "0.5")
    datasets = [{"type": "scale", "scale": list(image.scale.values())}]
    if any(image.offset.values()):
        datasets.append({"type": "translation", "translation": list(image.offset.values())})
    axes = image.axes() if is_placed else (list(image.letters) if version == "0.3" else None)
    more = {"coordinate_transformations": [datasets]} if is_placed else {}
    ome_zarr.writer.write_multiscale(
        [image.array], group, fmt=fmt, axes=axes, storage_options={"chunks": image.chunks(rng)}, name="a", **more
    )
    names = image.names if len(image.names) > 1 else None
    if names:
        if version == "0.5":
            group.attrs["ome"] = {**group.attrs["ome"], "omero": image.omero()}
        else:
            group.attrs["omero"] = image.omero()
    return Case(name, "written", f"OME-Zarr {version}", "ome-zarr", [path], lambda: image.reference(is_placed, names), alone=False)


def write_by_ngff_zarr(rng, stem, name):
    version = pick(rng, "0.4", "0.5", "0.6")
    image = Image(rng, letters_of(rng))
    path = folder_of(stem, ".ome.zarr")
    units = {a: image.unit for a in image.letters if a in "zyx"}
    ngff = ngff_zarr.to_ngff_image(
        image.array, dims=list(image.letters), scale=image.scale, translation=image.offset, axes_units=units, name="a"
    )
    scales = ngff_zarr.to_multiscales(ngff, scale_factors=pick(rng, [], [2]), chunks=16)
    shards = {"chunks_per_shard": 2} if version != "0.4" and rng.random() < 0.4 else {}
    ngff_zarr.to_ngff_zarr(str(path), scales, version=version, **shards)
    return Case(name, "written", f"OME-Zarr {version}", "ngff-zarr", [path], image.reference, alone=False)


def write_group(path, attributes):
    group = zarr.open_group(path, mode="w", zarr_format=3)
    group.attrs.update(attributes)


def write_image(rng, path, image, version, extra=None, orientation=None):
    """An image of 0.5 or 0.6 by zarr-python, with one further level of zeros."""
    transforms = lambda factor: [
        {"type": "scale", "scale": [v * factor for v in image.scale.values()]},
        {"type": "translation", "translation": list(image.offset.values())},
    ]
    axes = image.axes()
    for axis in axes:
        if orientation and axis["name"] in orientation:
            axis["orientation"] = {"type": "anatomical", "value": orientation[axis["name"]]}
    datasets = []
    for level, factor in enumerate([1, 2]):
        steps = transforms(factor)
        if version == "0.6":
            ends = {"input": {"path": f"s{level}"}, "output": {"name": "physical"}}
            steps = [{"type": "sequence", "transformations": steps, **ends}]
        datasets.append({"path": f"s{level}", "coordinateTransformations": steps})
    multiscale = {"name": "a", "datasets": datasets}
    if version == "0.6":
        multiscale["coordinateSystems"] = [{"name": "physical", "axes": axes}]
    else:
        multiscale["axes"] = axes
    write_group(path, {"ome": {"version": version, "multiscales": [multiscale], **(extra or {})}})
    small = [max(1, n // 2) if a in "zyx" else n for a, n in zip(image.letters, image.shape)]
    for level, array in enumerate([image.array, np.zeros(small, image.array.dtype)]):
        chunks = tuple(int(rng.integers(1, n + 1)) for n in array.shape)
        shards = tuple(n * int(rng.integers(1, 3)) for n in chunks) if rng.random() < 0.4 else None
        target = zarr.create_array(path / f"s{level}", shape=array.shape, dtype=array.dtype, chunks=chunks, shards=shards, overwrite=True)
        target[...] = array


def write_in_any_order(rng, stem, name):
    version = pick(rng, "0.5", "0.6")
    letters = list(letters_of(rng, pick(rng, "yx", "zyx") if rng.random() < 0.5 else "yx"))
    letters = "".join(dict.fromkeys(letters))
    letters = "".join(rng.permutation(list(letters)))
    image, path = Image(rng, letters), folder_of(stem)
    orientation, matrix = None, None
    if "z" in letters and rng.random() < 0.4:
        orientation = {a: pick(rng, *DIRECTIONS[a]) for a in "zyx"}
        sign = [1.0 if orientation[a] == DIRECTIONS[a][0] else -1.0 for a in "xyz"]
        spacing, origin = image.along(image.scale, 1.0), image.along(image.offset, 0.0)
        matrix = np.column_stack([np.diag(np.multiply(sign, spacing)), np.multiply(sign, origin)])
    write_image(rng, path, image, version, {"omero": image.omero()}, orientation)
    names = image.names if len(image.names) > 1 else None

    def reference():
        found = image.reference(names=names)
        if matrix is not None:
            found.matrix, found.origin = matrix, None
        return found

    return Case(name, "written", f"OME-Zarr {version}", "any order", [path], reference, alone=False)


def write_in_collection(rng, stem, name):
    """One of several images, by its path."""
    version, kind, path = pick(rng, "0.5", "0.6"), pick(rng, "plate", "series", "labels", "groups"), folder_of(stem)
    image, other = Image(rng, letters_of(rng)), Image(rng, letters_of(rng))
    ome = lambda **members: write_group(path, {"ome": {"version": version, **members}})
    extra = None
    if kind == "plate":
        ome(plate={"wells": [{"path": "A/1", "rowIndex": 0, "columnIndex": 0}, {"path": "B/2", "rowIndex": 1, "columnIndex": 1}]})
        for well in ("A/1", "B/2"):
            write_group(path / well, {"ome": {"version": version, "well": {"images": [{"path": "0"}]}}})
        places = ["B/2/0", "A/1/0"]
    elif kind == "series":
        ome(**{"bioformats2raw.layout": 3})
        places = ["1", "0"]
    elif kind == "labels":
        image.array = np.abs(image.array.astype("i4") % 1000).astype(pick(rng, "u1", "u2", "i4"))
        ome(multiscales=[])
        extra = {"image-label": {"colors": [{"label-value": 1, "rgba": [255, 0, 0, 255]}]}}
        places = ["labels/nuclei", "."]
    else:
        write_group(path, {})
        write_group(path / "deep", {})
        places = ["deep/a", "b"]
    write_image(rng, path / places[1], other, version)
    if kind == "labels":
        write_group(path / "labels", {"ome": {"version": version, "labels": ["nuclei"]}})
    write_image(rng, path / places[0], image, version, extra)
    input = f"{path}::{places[0]}"
    return Case(name, "written", f"OME-Zarr {version}", kind, [input], image.reference, alone=False)


def write_like_xarray(rng, stem, name):
    path = folder_of(stem)
    image = Image(rng, pick(rng, "zyx", "yx", "tzyx"))
    image.array = image.array if image.array.dtype.itemsize < 8 else image.array.astype("f4")
    names = {"t": "time", "z": "depth", "y": "lat", "x": "lon"}
    version = int(pick(rng, 2, 3))
    root = zarr.open_group(path, mode="w", zarr_format=version)

    def put(key, values, dims, **attributes):
        more = {"dimension_names": dims} if version == 3 else {"fill_value": None}
        array = root.create_array(key, shape=values.shape, dtype=values.dtype, chunks=tuple(max(1, n // 2) for n in values.shape), **more)
        array[...] = values
        array.attrs.update({**attributes, **({"_ARRAY_DIMENSIONS": dims} if version == 2 else {})})

    put("field", image.array, [names[a] for a in image.letters], units="K")
    for letter, size in zip(image.letters, image.shape):
        start, step = image.offset[letter], image.scale[letter]
        units = "seconds since 2000-01-01" if letter == "t" else "m"
        put(names[letter], start + step * np.arange(size), [names[letter]], units=units)
    five = in_five(image.array, image.letters.upper())
    # One voxel along an axis has no spacing.
    spacing = tuple(image.scale[a] if a in image.letters and image.shape[image.letters.index(a)] > 1 else 1.0 for a in "xyz")
    return Case(name, "written", f"Zarr {version}", "xarray", [path], lambda: Reference(five, spacing=spacing), alone=False)


KINDS = [
    ("ome-zarr", write_by_ome_zarr, 1),
    ("ngff-zarr", write_by_ngff_zarr, 1),
    ("ome-zarr-order", write_in_any_order, 1),
    ("ome-zarr-collection", write_in_collection, 1),
    ("zarr-xarray", write_like_xarray, 1),
]
