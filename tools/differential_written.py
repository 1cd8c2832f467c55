"""Random files of differential.py: written by tifffile, nibabel, NumPy, pynrrd, SimpleITK, pydicom, VTK, Pillow and imagecodecs over all types, orders, codecs and layouts.

Each file follows from the seed and its number alone, so that what is wrong with one can be looked at again.
"""

import logging
import struct
import warnings

import h5py
import hdf5plugin
import imagecodecs
import netCDF4
import nibabel
import nrrd
import numpy as np
import openjpeg.utils
import pydicom
import rle.utils
import SimpleITK
import tifffile
from differential_cases import dicom_case, in_five, nifti_case, npy_reference, tiff_case
from differential_check import Case, Reference
from differential_pictures import write_pictures
from differential_vtk import write_pvd, write_vtk
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.encaps import encapsulate

TYPES = ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8"]


def written_cases(folder, count, seed, kinds=None):
    logging.getLogger("tifffile").setLevel(logging.CRITICAL)
    folder.mkdir(parents=True, exist_ok=True)
    kinds = kinds or [
        ("tiff", write_tiff, 1),
        ("nifti", write_nifti, 1),
        ("npy", write_npy, 1),
        ("nrrd", write_nrrd, 1),
        ("metaimage", write_meta_image, 1),
        ("hdf5", write_hdf5, 1),
        ("netcdf", write_netcdf, 1),
        ("dicom", write_dicom, 1),
        ("files", write_files, 4),
        ("pictures", write_pictures, 1),
        ("vtk", lambda *case: write_vtk(*case, noise), 1),
        ("pvd", lambda *case: write_pvd(*case, noise), 4),
    ]
    for kind, write, share in kinds:
        for i in range(count // share):
            rng = np.random.default_rng([seed, i, *kind.encode()])
            stem = folder / f"{kind}-{seed}-{i:04}"
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                try:
                    yield write(rng, stem, f"written/{stem.name}")
                except (
                    ValueError,
                    RuntimeError,
                    TypeError,
                    NotImplementedError,
                    imagecodecs.DelayedImportError,
                    KeyError,
                    struct.error,
                ) as refused:
                    logging.getLogger(__name__).debug("%s: the writer refuses: %s", stem.name, refused)


def pick(rng, *choices):
    return choices[rng.integers(len(choices))]


def noise(rng, dtype, *shape):
    """Any values, or few and in runs, so that codecs have something to do; now and then the ends of the type."""
    dtype = np.dtype(dtype)
    if dtype.kind == "b":
        return rng.integers(0, 2, shape).astype(bool)
    if dtype.kind == "c":
        return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(dtype)
    if dtype.kind == "f":
        values = rng.standard_normal(shape) * 10.0 ** rng.integers(-3, 4)
        if rng.random() < 0.2:
            values.flat[rng.integers(values.size, size=min(3, values.size))] = [np.nan, np.inf, -np.inf][: min(3, values.size)]
        if dtype.itemsize == 8 and rng.random() < 0.2:
            values.flat[0] = 1e300
        return values.astype(dtype)
    limits = np.iinfo(dtype)
    if dtype.itemsize == 8 and rng.random() < 0.7:
        limits = np.iinfo("i4" if dtype.kind == "i" else "u4")
    if rng.random() < 0.5:
        return rng.integers(limits.min, limits.max, shape, np.int64 if dtype.kind == "i" else np.uint64, endpoint=True).astype(dtype)
    ramp = np.cumsum(rng.integers(-2, 3, shape), axis=-1)
    return (ramp - min(0, ramp.min()) * (dtype.kind == "u")).astype(dtype)


# TIFF

CODECS = [
    "none",
    "lzw",
    "lzw",
    "lzw",
    "adobe_deflate",
    "deflate",
    "packbits",
    "zstd",
    "lzma",
    "jpeg",
    "jpeg2000",
    "webp",
    "lerc",
    "png",
    "jpegxl",
    "jpegxr",
]


def write_tiff(rng, stem, name):
    if rng.random() < 0.3:
        return write_microscope(rng, stem, name)
    codec, dtype = pick(rng, *CODECS), pick(rng, *TYPES)
    if codec in ("jpeg", "jpeg2000", "webp", "png", "jpegxl", "jpegxr"):
        dtype = pick(rng, "u1", "u2") if codec not in ("jpeg", "webp") else "u1"
    if codec == "lerc":
        dtype = pick(rng, "u1", "u2", "i2", "f4", "f8")
    pages, height, width = (int(n) for n in (rng.integers(1, 5), rng.integers(1, 90), rng.integers(1, 90)))
    samples = int(pick(rng, 1, 1, 1, 2, 3, 4)) if codec not in ("jpeg", "webp", "png", "jpegxr") else int(pick(rng, 1, 3))
    separate = samples > 1 and rng.random() < 0.5
    shape = (pages, samples, height, width) if separate else (pages, height, width, samples) if samples > 1 else (pages, height, width)
    options = {"compression": None if codec == "none" else codec, "photometric": "rgb" if samples in (3, 4) else "minisblack"}
    if samples > 1:
        options["planarconfig"] = "separate" if separate else "contig"
    if samples == 1 and np.dtype(dtype).kind in "iu" and codec in ("none", "lzw", "adobe_deflate") and rng.random() < 0.15:
        options["photometric"] = "miniswhite"
    if codec in ("lzw", "adobe_deflate", "deflate", "zstd", "lzma") and rng.random() < 0.6:
        options["predictor"] = True if np.dtype(dtype).kind == "f" else 2
    layout = pick(rng, "strips", "rows", "one", "tiles")
    if layout == "tiles":
        options["tile"] = pick(rng, (16, 16), (32, 48), (64, 64), (16, 128))
    elif layout == "rows":
        options["rowsperstrip"] = int(rng.integers(1, height + 1))
    elif layout == "one":
        options["rowsperstrip"] = height
    path = stem.with_suffix(".tif")
    tifffile.imwrite(
        path,
        noise(rng, dtype, *shape),
        byteorder=pick(rng, "<", ">"),
        bigtiff=bool(rng.random() < 0.3),
        metadata=pick(rng, None, {}),
        **options,
    )
    return tiff_case(name, "written", path)


def write_microscope(rng, stem, name):
    """ImageJ's and OME's stacks of several axes, with calibrations, pyramids, several images, all planes behind one directory."""
    kind = pick(rng, "imagej", "imagej one directory", "imagej calibrated", "ome", "ome", "ome pyramid", "ome two images", "depth")
    sizes = {a: int(rng.integers(1, 4)) for a in "TZC"} | {"Y": int(rng.integers(8, 60)), "X": int(rng.integers(8, 60))}
    path = stem.with_suffix(".tif")
    order = pick(rng, "<", ">")
    resolution = (int(rng.integers(1, 9)), int(rng.integers(1, 9)))
    if kind == "depth":
        tifffile.imwrite(
            path, noise(rng, "u2", int(rng.integers(2, 20)), 32, 48), tile=(16, 16, 16), byteorder=order, volumetric=True, metadata=None
        )
    elif kind.startswith("imagej"):
        array = noise(rng, pick(rng, "u1", "u2", "f4"), *(sizes[a] for a in "TZCYX"))
        metadata = {"axes": "TZCYX", "spacing": float(pick(rng, 0.5, 2.0, 3.25)), "unit": pick(rng, "um", "mm", "pixel")}
        if kind == "imagej calibrated":
            metadata |= {"cf": 0, "c0": float(pick(rng, -32768.0, 7.5)), "c1": float(pick(rng, 1.0, 0.25)), "vunit": "gray value"}
            array = noise(rng, "u2", *array.shape)
        one = kind == "imagej one directory"
        tifffile.imwrite(path, array, imagej=True, byteorder=order, resolution=resolution, metadata=metadata, truncate=one, contiguous=True)
    else:
        axes = "".join(rng.permutation(list("TZC"))) + "YX"
        metadata = {"axes": axes, "PhysicalSizeX": 0.5, "PhysicalSizeY": 0.25, "PhysicalSizeZ": float(pick(rng, 1.5, 3.0))}
        options = {"compression": pick(rng, None, "lzw", "zlib"), "tile": pick(rng, None, (16, 16))}
        with tifffile.TiffWriter(path, ome=True, byteorder=order, bigtiff=bool(rng.random() < 0.3)) as tiff:
            for _ in range(2 if kind == "ome two images" else 1):
                array = noise(rng, pick(rng, "u1", "u2", "f4") if kind != "ome two images" else "u2", *(sizes[a] for a in axes))
                tiff.write(array, metadata=metadata, subifds=1 if kind == "ome pyramid" else 0, **options)
                if kind == "ome pyramid":
                    tiff.write(array[..., ::2, ::2], subfiletype=1, **options)
    case = tiff_case(name, "written", path)
    case.group = kind
    return case


# NumPy


def name_of(array):
    return "records" if array.dtype.names else array.dtype.newbyteorder("=").name


def write_npy(rng, stem, name):
    dtype = pick(rng, *TYPES, *TYPES, "b1", "c8", [("a", "<f4"), ("b", "u1")], "S4")
    shape = [int(n) for n in rng.integers(1, 24, rng.integers(0, 6))]
    if shape and rng.random() < 0.05:
        shape[0] = 0
    blank = isinstance(dtype, list) or dtype == "S4" or 0 in shape
    array = np.zeros(shape, dtype) if blank else noise(rng, dtype, *shape)
    if array.dtype.names is None:
        array = array.astype(array.dtype.newbyteorder(pick(rng, "<", ">")))
    if rng.random() < 0.4:
        array = np.asfortranarray(array)
    path = stem.with_suffix(".npy")
    with open(path, "wb") as file:
        np.lib.format.write_array(file, array, version=pick(rng, None, (1, 0), (2, 0), (3, 0)))
    axes = {
        1: "x",
        2: "yx",
        3: pick(rng, None, "zyx", "xyz", "tyx"),
        4: pick(rng, None, "tzyx", "czyx"),
        5: pick(rng, "tczyx", "ctzyx"),
    }.get(len(shape))
    case = Case(name, "written", "npy", name_of(array), [path], None)
    case.flags = ["--axes", axes] if axes and len(shape) > 1 else []
    case.reference = lambda: npy_reference(path, axes if len(shape) > 1 else None)
    case.must_refuse = len(shape) < 2 or array.size == 0 or array.dtype.kind not in "biuf"
    return case


# Several files


def write_files(rng, stem, name):
    """Planes or time steps in files of their own: named in an order, left to the shell, or a folder of them, whole or not."""
    suffix = pick(rng, ".tif", ".npy")
    kind = pick(rng, "in the shell's order", "in the user's order", "a folder", "a folder with a gap", "a folder of two counters")
    if kind.startswith("a folder"):
        suffix = ".tif"
    stem.mkdir(exist_ok=True)
    for old in stem.iterdir():
        old.unlink()
    count = int(rng.integers(9, 13))
    names = [f"s_{i}" for i in range(1, count + 1)]
    if kind == "a folder of two counters":
        names = [f"s_z{i:02}_c{c}" for i in range(6) for c in range(2)]
    elif kind == "a folder with a gap":
        names.remove("s_5")
    elif kind == "in the user's order":
        names = pick(rng, ["before", "after"], ["b", "a", "c"], ["s_3", "s_1", "s_2"])
    planes = noise(rng, "u2", len(names), 6, 7)
    paths = [stem / (n + suffix) for n in names]
    for path, plane in zip(paths, planes):
        if suffix == ".tif":
            tifffile.imwrite(path, plane, metadata=None)
        else:
            np.save(path, plane[np.newaxis])
    axes = "ZYX" if suffix == ".tif" else "TYX"
    inputs = sorted(paths) if kind == "in the shell's order" else [stem] if kind.startswith("a folder") else paths
    case = Case(
        name, "written", f"several {suffix}", kind, inputs, lambda: Reference(in_five(planes, axes)), alone=not kind.startswith("a folder")
    )
    case.must_refuse = kind in ("a folder with a gap", "a folder of two counters")
    return case


# NIfTI


def write_nifti(rng, stem, name):
    dtype = pick(rng, *TYPES[:8], "f4", "f8", "f4", "f8", "i2", "u1", "c8", "rgb")
    dimensions = int(pick(rng, 1, 2, 3, 3, 3, 3, 4, 5, 6))
    shape = [int(n) for n in rng.integers(1, 30, min(dimensions, 3))] + [int(n) for n in rng.integers(1, 4, max(0, dimensions - 3))]
    if dtype == "rgb":
        dtype = np.dtype([("R", "u1"), ("G", "u1"), ("B", "u1")])
        array = np.zeros(shape, dtype)
    else:
        array = noise(rng, dtype, *shape)
    two, pair, endian = rng.random() < 0.4, rng.random() < 0.3, pick(rng, "<", ">")
    kind = {
        (False, False): nibabel.Nifti1Image,
        (False, True): nibabel.Nifti1Pair,
        (True, False): nibabel.Nifti2Image,
        (True, True): nibabel.Nifti2Pair,
    }
    kind = kind[bool(two), bool(pair)]
    header = kind.header_class(endianness=endian)
    header.set_data_dtype(array.dtype.newbyteorder(endian) if array.dtype.names is None else array.dtype)
    header.set_xyzt_units(pick(rng, "mm", "micron", "meter", "unknown"), "sec")
    affine = np.diag([*rng.choice([0.5, 0.75, 1.0, 2.0, 3.1], 3), 1.0])
    affine[:3, 3] = rng.choice([-90.0, 0.0, 12.5], 3)
    placing = pick(rng, "upright", "flipped", "turned", "none")
    if placing == "flipped":
        affine[0, :3] *= -1
    elif placing == "turned":
        affine = affine[rng.permutation(3).tolist() + [3]]
    image = kind(array, affine, header)
    if placing == "none":
        image.set_sform(None, 0)
        image.set_qform(None, 0)
    elif rng.random() < 0.3:
        image.set_sform(None, 0)
        image.set_qform(affine, 1)
    end = pick(rng, "", "", ".gz")
    path = stem.with_name(stem.name + (".img" if pair else ".nii") + end)
    image.to_filename(path)
    group = f"{'NIfTI-2' if two else 'NIfTI-1'}{' pair' if pair else ''} {name_of(array)}"
    if not end and array.dtype.kind in "iuf" and rng.random() < 0.5:
        group += " scaled"
        slope = pick(rng, 2.0, 0.0123, -1.5, 1.0, 0.0, np.nan)
        intercept = pick(rng, 0.0, -1024.0, 7.5, np.nan if slope == 2.0 else 0.0)
        scale(path.with_suffix(".hdr") if pair else path, two, endian, slope, intercept)
    case = nifti_case(name, "written", path, group=group)
    case.must_refuse = array.dtype.kind in "Vc" and shape[4:5] > [1] or dimensions > 5 and shape[5] > 1
    return case


def scale(path, two, endian, slope, intercept):
    """Puts slope and intercept into a written header, which nibabel would compute itself."""
    content = bytearray(path.read_bytes())
    at, form = (176, "dd") if two else (112, "ff")
    content[at : at + struct.calcsize(form)] = struct.pack(endian + form, slope, intercept)
    path.write_bytes(content)


# NRRD and MetaImage


def directions_of(rng):
    """Unit vectors of three axes, as columns."""
    turned = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return pick(rng, np.eye(3), np.diag([-1.0, 1.0, 1.0]), np.eye(3)[rng.permutation(3)], turned)


def write_nrrd(rng, stem, name):
    """Axes of space, with components and times anywhere among them, in a patient's space or with spacings alone."""
    flat = rng.random() < 0.25
    kinds = ["domain"] * (2 if flat else 3)
    sizes = {"domain": 0, "RGB-color": 3, "vector": 2, "3-vector": 3, "complex": 2, "list": 4, "3D-matrix": 9, "time": 2}
    if rng.random() < 0.4:
        kinds.insert(int(rng.integers(len(kinds) + 1)), pick(rng, *list(sizes)[1:-1]))
    if rng.random() < 0.3:
        kinds.insert(int(rng.integers(len(kinds) + 1)), "time")
    shape = [sizes[kind] or int(rng.integers(1, 20)) for kind in kinds]
    dtype = np.dtype(pick(rng, *(t for t in TYPES if t != "f2"))).newbyteorder(pick(rng, "<", ">"))
    header = {"kinds": kinds, "encoding": pick(rng, "raw", "gzip")}
    signs = {"left-posterior-superior": [-1, -1, 1], "LPS": [-1, -1, 1], "RAS": [1, 1, 1], "left-anterior-superior": [-1, 1, 1]}
    steps, matrix, spacing = rng.choice([0.5, 0.75, 2.0, 3.1], len(kinds)), None, None
    places = [i for i, kind in enumerate(kinds) if kind == "domain"]
    if not flat and rng.random() < 0.8:
        space, origin = pick(rng, *signs), rng.choice([-90.0, 0.0, 12.5], 3)
        columns = directions_of(rng) @ np.diag(steps[places])
        rows = np.full((len(kinds), 3), np.nan)
        rows[places] = columns.T
        header |= {"space": space, "space directions": rows, "space origin": origin}
        matrix = np.diag(signs[space]) @ np.c_[columns, origin]
    else:
        header["spacings"] = steps
        spacing = [*steps[places], 1.0][:3]
    path = stem.with_suffix(".nrrd")
    nrrd.write(str(path), noise(rng, dtype.newbyteorder("="), *shape).astype(dtype), header)
    letters = iter("XYZ")
    axes = "".join(next(letters) if kind == "domain" else "T" if kind == "time" else "C" for kind in kinds)

    def reference():
        return Reference(in_five(nrrd.read(str(path))[0], axes), spacing=spacing, matrix=matrix)

    return Case(name, "written", "nrrd", f"{header['encoding']} {dtype.newbyteorder('=').name}", [path], reference)


def write_meta_image(rng, stem, name):
    """Images of ITK, of two to four dimensions and one to three channels, plain or compressed."""
    count, dtype = int(pick(rng, 2, 3, 3, 3, 4)), pick(rng, *(t for t in TYPES if t != "f2"))
    channels = int(pick(rng, 1, 1, 2, 3)) if count < 4 else 1
    shape = [int(n) for n in rng.integers(1, 20, count)] + ([channels] if channels > 1 else [])
    image = SimpleITK.GetImageFromArray(noise(rng, dtype, *shape), isVector=channels > 1)
    spacing, origin = rng.choice([0.5, 0.75, 2.0, 3.1], count), rng.choice([-90.0, 0.0, 12.5], count)
    directions = np.eye(count)
    if count > 2:
        directions[:3, :3] = directions_of(rng)
    image.SetSpacing(spacing.tolist())
    image.SetOrigin(origin.tolist())
    image.SetDirection(directions.ravel().tolist())
    packed, path = bool(rng.random() < 0.5), stem.with_suffix(".mha")
    SimpleITK.WriteImage(image, str(path), useCompression=packed)
    matrix, inside = np.c_[np.eye(3), np.zeros(3)], min(count, 3)
    matrix[:inside, :inside] = (directions * spacing)[:inside, :inside]
    matrix[:inside, 3] = origin[:inside]

    def reference():
        array = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(path)))
        return Reference(in_five(array, "TZYX"[4 - count :] + "C" * (channels > 1)), matrix=np.diag([-1, -1, 1]) @ matrix)

    return Case(name, "written", "metaimage", f"{'zlib' if packed else 'plain'} {np.dtype(dtype).name}", [path], reference)


# DICOM

NATIVE = {
    "implicit little": "1.2.840.10008.1.2",
    "explicit little": "1.2.840.10008.1.2.1",
    "explicit big": "1.2.840.10008.1.2.2",
    "deflated": "1.2.840.10008.1.2.1.99",
}
ENCAPSULATED = {
    "RLE": "1.2.840.10008.1.2.5",
    "JPEG baseline": "1.2.840.10008.1.2.4.50",
    "JPEG extended": "1.2.840.10008.1.2.4.51",
    "JPEG lossless": "1.2.840.10008.1.2.4.57",
    "JPEG lossless SV1": "1.2.840.10008.1.2.4.70",
    "JPEG-LS lossless": "1.2.840.10008.1.2.4.80",
    "JPEG-LS lossy": "1.2.840.10008.1.2.4.81",
    "JPEG 2000 lossless": "1.2.840.10008.1.2.4.90",
    "JPEG 2000": "1.2.840.10008.1.2.4.91",
    "HTJ2K lossless": "1.2.840.10008.1.2.4.201",
}


def write_dicom(rng, stem, name):
    label = pick(rng, *NATIVE, *ENCAPSULATED, "JPEG 2000 lossless", "JPEG 2000", "RLE", "JPEG lossless SV1")
    allocated = int(pick(rng, 8, 16, 16, 16, 32))
    if label.startswith("JPEG") and allocated == 32 or label == "JPEG extended":
        allocated = 16
    if label == "JPEG baseline":
        allocated = 8
    if label.startswith("HT"):
        allocated = int(pick(rng, 8, 16))
    stored = int(rng.integers(allocated // 2 + 1, allocated + 1))
    if label == "JPEG baseline":
        stored = 8
    elif label == "JPEG extended":
        stored = 12
    signed = bool(rng.random() < 0.5) and label not in ("JPEG baseline", "JPEG extended")
    frames = int(pick(rng, 1, 1, 3)) if label != "deflated" else 1
    # The encoder of JPEG 2000 has six levels, and refuses what is too small for them.
    rows, columns = (int(n) for n in rng.integers(*((32, 90) if "2" in label else (2, 60)), 2))
    low, high = (-(1 << stored - 1), (1 << stored - 1) - 1) if signed else (0, (1 << stored) - 1)
    if label == "JPEG 2000" or rng.random() < 0.5:
        # Steps between the ends of the range: what lossy codecs overshoot.
        array = np.where(
            np.kron(rng.integers(0, 2, (frames, rows // 4 + 1, columns // 4 + 1)), np.ones((1, 4, 4), int))[:, :rows, :columns] > 0,
            high,
            low,
        )
    else:
        array = rng.integers(low, high, (frames, rows, columns), endpoint=True)
    array = array.astype(f"{'i' if signed else 'u'}{allocated // 8}")
    file = described(rng, array, stored, signed, frames, label != "explicit big")
    syntax = (NATIVE | ENCAPSULATED)[label]
    file.file_meta.TransferSyntaxUID = pydicom.uid.UID(syntax)
    if label in NATIVE:
        order = ">" if label == "explicit big" else "<"
        file.PixelData = array.astype(array.dtype.newbyteorder(order)).tobytes()
        file.PixelData += b"\0" * (len(file.PixelData) % 2)
        file["PixelData"].VR = "OB" if allocated == 8 and label != "implicit little" else "OW"
    else:
        coded = [encode(label, frame, stored, rng) for frame in array]
        file.PixelData = encapsulate(coded, fragments_per_frame=int(pick(rng, 1, 1, 2)), has_bot=bool(rng.random() < 0.7))
        file["PixelData"].VR = "OB"
        file["PixelData"].is_undefined_length = True
    path = stem.with_suffix(".dcm")
    implicit = {"implicit_vr": True, "little_endian": True} if label == "implicit little" else {}
    file.save_as(path, enforce_file_format=True, **implicit)
    return dicom_case(name, "written", path, group=label)


def encode(label, frame, stored, rng):
    if label == "RLE":
        return next(
            rle.utils.encode_array(
                frame,
                rows=frame.shape[0],
                columns=frame.shape[1],
                samples_per_pixel=1,
                bits_allocated=8 * frame.itemsize,
                number_of_frames=1,
            )
        )
    if label == "JPEG baseline":
        return imagecodecs.jpeg8_encode(frame, level=95)
    if label == "JPEG extended":
        return imagecodecs.jpeg8_encode(frame, level=95, bitspersample=12)
    if label.startswith("JPEG lossless"):
        return imagecodecs.ljpeg_encode(frame.view(f"u{frame.itemsize}") & ((1 << stored) - 1), bitspersample=stored)
    if label == "JPEG-LS lossless":
        return imagecodecs.jpegls_encode(frame.view(f"u{frame.itemsize}"))
    if label == "JPEG-LS lossy":
        return imagecodecs.jpegls_encode(frame.view(f"u{frame.itemsize}"), level=2)
    if label == "HTJ2K lossless":
        return imagecodecs.htj2k_encode(frame, reversible=True)
    ratio = {} if label.endswith("lossless") else {"compression_ratios": [float(pick(rng, 5, 10, 20))]}
    return openjpeg.utils.encode_array(frame, bits_stored=stored, photometric_interpretation=2, **ratio)


def described(rng, array, stored, signed, frames, little=True):
    """An image's data set: one slice, or an enhanced file with a place for each frame."""
    file = pydicom.FileDataset(None, {}, file_meta=FileMetaDataset(), preamble=b"\0" * 128, is_little_endian=little, is_implicit_VR=False)
    file.SOPClassUID = "1.2.840.10008.5.1.4.1.1.2.1" if frames > 1 else "1.2.840.10008.5.1.4.1.1.2"
    file.SOPInstanceUID = file.file_meta.MediaStorageSOPInstanceUID = "1.2.3.4.5"
    file.file_meta.MediaStorageSOPClassUID = file.SOPClassUID
    file.SeriesInstanceUID = "1.2.3.4"
    file.Modality, file.SamplesPerPixel, file.PhotometricInterpretation = "CT", 1, pick(rng, "MONOCHROME2", "MONOCHROME2", "MONOCHROME1")
    file.Rows, file.Columns = array.shape[1:]
    file.BitsAllocated, file.BitsStored, file.HighBit, file.PixelRepresentation = 8 * array.itemsize, stored, stored - 1, int(signed)
    slope, intercept = pick(rng, (None, None), (1.0, -1024.0), (0.5, 3.25), (2.0, 0.0))
    thickness, pixel = float(pick(rng, 1.0, 2.5)), [float(pick(rng, 0.5, 0.75)), 0.625]
    turned = [[1.0, 0.0, 0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0, 0.0, -1.0], [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0]]
    directions = turned[rng.integers(3)]
    normal = np.cross(directions[:3], directions[3:])
    if frames == 1:
        file.ImagePositionPatient, file.ImageOrientationPatient = [-120.5, 4.25, 7.0], directions
        file.PixelSpacing, file.SliceThickness = pixel, thickness
        if slope is not None:
            file.RescaleSlope, file.RescaleIntercept = slope, intercept
        if array.itemsize < 4 and rng.random() < 0.2:
            file.add_new("PixelPaddingValue", "SS" if signed else "US", int(array.min()))
        return file
    shared = Dataset()
    shared.PixelMeasuresSequence = [Dataset()]
    shared.PixelMeasuresSequence[0].PixelSpacing, shared.PixelMeasuresSequence[0].SliceThickness = pixel, thickness
    shared.PlaneOrientationSequence = [Dataset()]
    shared.PlaneOrientationSequence[0].ImageOrientationPatient = directions
    if slope is not None:
        shared.PixelValueTransformationSequence = [Dataset()]
        values = shared.PixelValueTransformationSequence[0]
        values.RescaleSlope, values.RescaleIntercept = slope, intercept
    file.NumberOfFrames, file.SharedFunctionalGroupsSequence, file.PerFrameFunctionalGroupsSequence = frames, [shared], []
    for i in range(frames):
        own = Dataset()
        own.PlanePositionSequence = [Dataset()]
        own.PlanePositionSequence[0].ImagePositionPatient = [float(n) for n in np.array([5.0, -6.5, 3.0]) + i * thickness * normal]
        file.PerFrameFunctionalGroupsSequence.append(own)
    return file


# HDF5


def write_hdf5(rng, stem, name):
    dtype = pick(rng, *TYPES, *TYPES, "b1", "c8", "c16")
    # The parts of complex numbers are channels already.
    more = [] if dtype[0] == "c" else ["zyxc", "tczyx"]
    axes = pick(rng, "yx", "zyx", "zyx", "tyx", "xyz", "tzyx", *more)
    shape = [int(n) for n in rng.integers(2, 30 if len(axes) < 4 else 8, len(axes))]
    array = noise(rng, dtype, *shape)
    array = array.astype(array.dtype.newbyteorder(pick(rng, "<", ">")))
    filters = {
        "whole": {},
        "chunks": {},
        "gzip": {"compression": "gzip"},
        "lzf": {"compression": "lzf", "shuffle": True},
        "szip": {"compression": "szip"},
        "lz4": hdf5plugin.LZ4(),
        "zstd": hdf5plugin.Zstd(),
        "bitshuffle": hdf5plugin.Bitshuffle(cname=pick(rng, "none", "lz4", "zstd")),
        "blosc": hdf5plugin.Blosc(cname=pick(rng, "blosclz", "lz4", "lz4hc", "zlib", "zstd"), shuffle=int(rng.integers(3))),
    }
    codec = pick(rng, *filters)
    options = dict(filters[codec])
    if codec != "whole":
        options["chunks"] = tuple(int(rng.integers(1, n + 1)) for n in array.shape)
        most = {"same": array.shape, "more": tuple(n + 7 for n in array.shape), "endless": (None,) * array.ndim}
        options["maxshape"] = most[pick(rng, *most)]
        options["fletcher32"] = bool(rng.random() < 0.2)
    if array.dtype.kind != "c" and rng.random() < 0.3:
        options["fillvalue"] = array.dtype.type(7)
    path = stem.with_suffix(".h5")
    with h5py.File(path, "w", libver=pick(rng, "earliest", "latest"), userblock_size=int(pick(rng, 0, 0, 512))) as file:
        made = file.create_dataset("entry/data", array.shape, array.dtype, **options)
        # A part of the chunks, or all.
        part = tuple(slice(0, int(rng.integers(1, n + 1))) for n in array.shape) if rng.random() < 0.3 else ...
        made[part] = array[part]
        file["line"] = np.arange(3)
    case = Case(name, "written", "hdf5", f"{codec} {array.dtype.newbyteorder('=').name}", [path], None, ["--axes", axes])
    case.reference = lambda: hdf5_reference(path, axes)
    return case


def hdf5_reference(path, axes):
    with h5py.File(path) as file:
        array = file["entry/data"][...]
    if array.dtype.kind == "c":
        array, axes = np.stack([array.real, array.imag]), "c" + axes
    return Reference(in_five(array, axes.upper()))


def write_netcdf(rng, stem, name):
    form = pick(rng, "NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA", "NETCDF4", "NETCDF4_CLASSIC")
    wide = form in ("NETCDF3_64BIT_DATA", "NETCDF4")
    dtype = pick(rng, "i1", "i2", "i4", "f4", "f8", *(["u1", "u2", "u4", "i8", "u8"] if wide else []))
    axes = pick(rng, "yx", "zyx", "tyx", "tzyx")
    array = noise(rng, dtype, *(int(n) for n in rng.integers(2, 12, len(axes))))
    path = stem.with_suffix(".nc")
    long_names = {"t": "time", "z": "lev", "y": "lat", "x": "lon"}
    seen = array
    with netCDF4.Dataset(path, "w", format=form) as file:
        for at, (axis, size) in enumerate(zip(axes, array.shape)):
            file.createDimension(long_names[axis], None if at == 0 and rng.random() < 0.5 else size)
        turned = rng.random(3) < 0.5
        is_placed = rng.random() < 0.5
        for at, (axis, size) in enumerate(zip(axes, array.shape)):
            if not is_placed:
                continue
            line = np.arange(size) * 0.5 + 3
            if axis != "t" and turned["zyx".index(axis)]:
                line, seen = line[::-1], np.flip(seen, at)
            made = file.createVariable(long_names[axis], "f8", (long_names[axis],))
            made.units = "hours since 2000-01-01" if axis == "t" else "m"
            made[:] = line
        data = file.createVariable("data", dtype, [long_names[axis] for axis in axes], fill_value=False)
        data.set_auto_maskandscale(False)
        data[:] = array
        if rng.random() < 0.5:
            # Records of an odd size beside it.
            beside = file.createVariable("beside", "i1", (long_names[axes[0]],))
            beside[:] = np.arange(array.shape[0])
    case = Case(name, "written", "netcdf", f"{form} {array.dtype.name}", [path], None, [])
    case.reference = lambda: Reference(in_five(seen, axes.upper()))
    return case
