"""Arrays in public files of several: `.npz`, HDF5, classic NetCDF, MINC 1, MRC. Each array of numbers along 2 or 3 axes is a case, named by `--variable`."""

import re

import h5py
import mrcfile
import nibabel
import numpy as np
from scipy.io import netcdf_file

from differential_arrays import mrc_reference
from differential_cases import in_five
from differential_check import Case, Reference

ARRAYS = re.compile(r"\.(npz|h5|hdf5|nc|mnc|mrc|map|map\.gz)$", re.I)
AXES = {2: "YX", 3: "ZYX"}
# Arrays of a file, the first ones.
MOST = 12
# Attributes that change numbers or name axes: their meaning is compared where the files are written.
MEANING = {"scale_factor", "add_offset", "_FillValue", "missing_value", "_Unsigned", "DIMENSION_LIST", "signal", "axes", "units"}


def array_cases(label, collection, path):
    """A case for each array that an independent reader finds."""
    kind = ARRAYS.search(path.name)[1].lower()
    if kind in ("mrc", "map", "map.gz"):
        with open(path, "rb") as file:
            start = file.read(216)
        if start[:2] == b"\x1f\x8b" or start[208:211] == b"MAP":
            yield Case(label, collection, "MRC", "found", [path], lambda: of_mrc(path))
        return
    try:
        found = {"npz": of_npz, "nc": of_netcdf, "mnc": of_minc}.get(kind, of_hdf5)(path)
    except Exception:  # of another format, or damaged on purpose
        return
    for name, reference in list(found.items())[:MOST]:
        flags = ["--variable", name] if name else []
        format = {"npz": "npz", "nc": "NetCDF", "mnc": "MINC 1"}.get(kind, "HDF5")
        yield Case(f"{label}::{name}" if name else label, collection, format, "found", [path], reference, flags)


def of_mrc(path):
    with mrcfile.open(path, permissive=True, header_only=True) as mrc:
        map_axes = [int(mrc.header[name]) for name in ("mapc", "mapr", "maps")]
    found = mrc_reference(path, map_axes)
    # A single image may have no depth.
    found.spacing = found.spacing if min(found.spacing) > 0 else None
    return found


def fits(array):
    return array.ndim in AXES and array.size > 0 and array.dtype.kind in "biuf" and sum(n > 1 for n in array.shape) > 1


def of_npz(path):
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    return {name: lambda a=array: Reference(in_five(a, AXES[a.ndim])) for name, array in arrays.items() if fits(array)}


def of_hdf5(path):
    if h5py.is_hdf5(path) is False and path.suffix == ".nc":
        return of_netcdf(path)
    found = {}

    def see(name, item):
        plain = isinstance(item, h5py.Dataset) and item.dtype.kind in "biuf" and not MEANING & set(item.attrs)
        if plain and "minc" not in name and fits(item):
            found["/" + name] = lambda: Reference(in_five(h5py.File(path)[name][...], AXES[item_dims(path, name)]))

    with h5py.File(path) as file:
        file.visititems(see)
    return found


def item_dims(path, name):
    with h5py.File(path) as file:
        return file[name].ndim


def of_netcdf(path):
    if h5py.is_hdf5(path):
        return of_hdf5(path)
    with netcdf_file(path, mmap=False) as file:
        arrays = {
            name: variable[...].copy()
            for name, variable in file.variables.items()
            if not MEANING & set(variable._attributes) and name not in file.dimensions
        }
    return {name: lambda a=array: Reference(in_five(a, AXES[a.ndim])) for name, array in arrays.items() if fits(array)}


def of_minc(path):
    image = nibabel.load(path)
    if not isinstance(image, nibabel.Minc1Image) or isinstance(image, nibabel.Minc2Image) or len(image.shape) != 3:
        return {}
    return {"": lambda: Reference(in_five(np.asarray(image.dataobj, np.float64), "ZYX"), rescaled=True)}
