"""Random files of differential.py in formats of plain arrays: MRC by mrcfile, .npz by NumPy, ANALYZE 7.5 by nibabel, ENVI and BOV as texts."""

import gzip
import struct
import zipfile

import mrcfile
import nibabel
import numpy as np
from differential_cases import in_five
from differential_check import Case, Reference
from differential_written import name_of, noise, pick
from nibabel.analyze import AnalyzeImage
from nibabel.spm2analyze import Spm2AnalyzeImage
from nibabel.spm99analyze import Spm99AnalyzeImage


def shape_of(rng, count=3, most=20):
    return [int(n) for n in rng.integers(1, most, count)]


def in_parts(array, axes):
    """As t, c, z, y, x: complex numbers are two channels."""
    if np.iscomplexobj(array):
        return in_five(np.stack([array.real, array.imag], -1), axes + "C")
    return in_five(array, axes)


# MRC


def write_mrc(rng, stem, name):
    dtype, kind = pick(rng, "i1", "i2", "u2", "f2", "f4", "c8"), pick(rng, "volume", "volume", "image stack", "volume stack", "permuted")
    shape = shape_of(rng, 4 if kind == "volume stack" else 3)
    array = noise(rng, dtype, *shape)
    path = stem.with_suffix(pick(rng, ".mrc", ".map", ".st", ".unknown"))
    map_axes = [1, 2, 3]
    with mrcfile.new(path, overwrite=True, compression=pick(rng, None, None, "gzip")) as mrc:
        mrc.set_data(array.astype(array.dtype.newbyteorder(pick(rng, "<", ">"))))
        if kind == "image stack":
            mrc.set_image_stack()
        mrc.voxel_size = tuple(float(n) for n in rng.choice([0.5, 1.06, 2.7, 13.48], 3))
        placing = pick(rng, "nowhere", "origin", "first indices")
        if placing == "origin":
            mrc.header.origin = tuple(float(n) for n in rng.choice([-5.5, 12.25, 100.0], 3))
        elif placing == "first indices":
            mrc.nstart = tuple(int(n) for n in rng.integers(-50, 50, 3))
        if rng.random() < 0.3:
            mrc.set_extended_header(np.frombuffer(rng.bytes(80 * int(rng.integers(1, 5))), "V80"))
        if kind == "permuted":
            map_axes = [int(n) + 1 for n in rng.permutation(3)]
            mrc.header.mapc, mrc.header.mapr, mrc.header.maps = map_axes
            mrc.header.mx, mrc.header.my, mrc.header.mz = (shape[2 - map_axes.index(a)] for a in (1, 2, 3))
    return Case(name, "written", "MRC", f"{kind} {name_of(array)}", [path], lambda: mrc_reference(path, map_axes))


def mrc_reference(path, map_axes):
    with mrcfile.open(path, permissive=True) as mrc:
        array, header = mrc.data.copy(), mrc.header
        cell = np.array([header.cella[a] for a in "xyz"], np.float64)
        spacing = cell / [header.mx, header.my, header.mz]
    letters = "T" * (array.ndim == 4) + "".join("XYZ"[a - 1] for a in reversed(map_axes))
    if array.ndim == 2:
        letters = "YX"
    return Reference(in_parts(array, letters), spacing=tuple(spacing))


# NumPy archives


def write_npz(rng, stem, name):
    dtype, dimensions = pick(rng, "u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8", "b1"), int(pick(rng, 1, 2, 3, 3, 3, 4))
    array = noise(rng, dtype, *shape_of(rng, dimensions))
    array = array.astype(array.dtype.newbyteorder(pick(rng, "<", ">")))
    if rng.random() < 0.3:
        array = np.asfortranarray(array)
    path, several, packed = stem.with_suffix(".npz"), rng.random() < 0.4, rng.random() < 0.5
    arrays = {"density": array} | ({"other": noise(rng, "f4", 3, 4), "text": np.array("abc")} if several else {})
    (np.savez_compressed if packed else np.savez)(path, **arrays)
    foreign = rng.random() < 0.1
    if foreign:
        with zipfile.ZipFile(path) as archive:
            content = archive.read("density.npy")
        with zipfile.ZipFile(path, "w", pick(rng, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)) as archive:
            archive.writestr("density.npy", content)
    axes = {1: "x", 2: "yx", 3: "zyx", 4: "tzyx"}[dimensions]
    group = "another codec" if foreign else f"{'deflated' if packed else 'stored'} {name_of(array)}"
    case = Case(name, "written", "npz", group, [path], lambda: Reference(in_five(np.load(path)["density"], axes.upper())))
    named = several and not foreign and rng.random() < 0.8
    case.flags = (["--variable", "density"] if named else []) + (["--axes", axes] if dimensions > 3 else [])
    case.must_refuse = foreign or dimensions == 1 or several and not named
    return case


# ANALYZE 7.5


def write_analyze(rng, stem, name):
    kind, endian = pick(rng, AnalyzeImage, Spm99AnalyzeImage, Spm2AnalyzeImage), pick(rng, "<", ">")
    array = noise(rng, pick(rng, "u1", "i2", "i4", "f4", "f8"), *shape_of(rng, 3), *shape_of(rng, int(pick(rng, 0, 0, 1)), 4))
    header = kind.header_class(endianness=endian)
    header.set_data_dtype(array.dtype)
    path, header_path = stem.with_suffix(".img"), stem.with_suffix(".hdr")
    kind(array, np.diag([-float(pick(rng, 0.5, 1.25)), 2.0, 3.0, 1.0]), header).to_filename(path)
    stem.with_suffix(".mat").unlink(missing_ok=True)
    content = bytearray(header_path.read_bytes())
    scaling = pick(rng, "nibabel's", "none", "slope", "intercept", "ranges")
    if scaling != "nibabel's":
        numbers = {"slope": (-1.5, 0.0), "intercept": (2.5, pick(rng, -7.5, np.nan))}.get(scaling, (0.0, 0.0))
        content[112:120] = struct.pack(endian + "ff", *numbers)
    if scaling == "ranges":
        content[124:132], content[140:148] = struct.pack(endian + "ff", 5.5, 0.5), struct.pack(endian + "ii", pick(rng, 110, -3), 10)
    content[253:259] = struct.pack(endian + "3h", *(int(n) for n in rng.integers(-3, 12, 3)))
    header_path.write_bytes(content)
    group = f"{kind.__name__.removesuffix('Image')} {name_of(array)}"
    return Case(name, "written", "ANALYZE", group, [path, header_path][int(rng.integers(2)) :][:1], lambda: analyze_reference(path))


def analyze_reference(path):
    image = nibabel.load(path)
    proxy = image.dataobj
    rescaled = (proxy.slope, proxy.inter) != (1.0, 0.0)
    array = image.get_fdata(caching="unchanged") if rescaled else np.asanyarray(proxy)
    array = in_five(array, "XYZT"[: array.ndim])
    return Reference(array, rescaled=rescaled, spacing=tuple(abs(float(n)) for n in image.header["pixdim"][1:4]))


# Texts beside raw files


def raw_bytes(rng, array, start):
    """The bytes of an array after others, and whether it is big-endian."""
    big = bool(rng.random() < 0.5)
    return bytes(start) + np.ascontiguousarray(array).astype(array.dtype.newbyteorder(">" if big else "<")).tobytes(), big


def write_envi(rng, stem, name):
    types = {1: "u1", 2: "i2", 3: "i4", 4: "f4", 5: "f8", 6: "c8", 9: "c16", 12: "u2", 13: "u4", 14: "i8", 15: "u8"}
    code, interleave, start = pick(rng, *types), pick(rng, "bsq", "bil", "bip"), int(pick(rng, 0, 0, 512))
    array = noise(rng, types[code], *shape_of(rng))
    stored = array.transpose({"bsq": (0, 1, 2), "bil": (1, 0, 2), "bip": (1, 2, 0)}[interleave])
    content, big = raw_bytes(rng, stored, start)
    stem.with_suffix(pick(rng, "", ".img", ".dat", f".{interleave}")).write_bytes(content)
    bands, lines, samples = array.shape
    path = stem.with_suffix(".hdr")
    path.write_text(
        f"ENVI\nsamples = {samples}\nlines   = {lines}\nbands   = {bands}\nheader offset = {start}\nfile type = ENVI Standard\n"
        f"data type = {code}\ninterleave = {interleave}\nbyte order = {int(big)}\nband names = {{\n"
        + ",\n".join(f"Band {i}" for i in range(bands))
        + "}\n"
    )
    return Case(name, "written", "ENVI", f"{interleave} {name_of(array)}", [path], lambda: Reference(in_parts(array, "ZYX")), alone=False)


def write_bov(rng, stem, name):
    types = {"BYTE": "u1", "SHORT": "i2", "INT": "i4", "FLOAT": "f4", "DOUBLE": "f8"}
    kind, start, centring = pick(rng, *types), int(pick(rng, 0, 4)), pick(rng, "zonal", "nodal")
    array = noise(rng, types[kind], *(n + 1 for n in shape_of(rng)), int(pick(rng, 1, 1, 2, 3, 4)))
    content, big = raw_bytes(rng, array, start)
    stem.with_suffix(".values").write_bytes(gzip.compress(content) if rng.random() < 0.2 else content)
    z, y, x, components = array.shape
    path = stem.with_suffix(".bov")
    path.write_text(
        f"TIME: 1.5\nDATA_FILE: {stem.name}.values\nDATA_SIZE: {x} {y} {z}\nDATA_FORMAT: {kind}\nVARIABLE: density\n"
        f"DATA_ENDIAN: {'BIG' if big else 'LITTLE'}\nCENTERING: {centring}\nBRICK_ORIGIN: 1 -2 3.5\nBRICK_SIZE: 8 9 10\n"
        f"BYTE_OFFSET: {start}\nDATA_COMPONENTS: {components}\n"
    )
    counts = np.array([x, y, z]) - (centring == "nodal")
    reference = Reference(in_five(array, "ZYXC"), spacing=tuple([8.0, 9.0, 10.0] / counts))
    return Case(name, "written", "BOV", f"{centring} {kind}", [path], lambda: reference, alone=False)


KINDS = [(f"{write.__name__.removeprefix('write_')}", write, 1) for write in (write_mrc, write_npz, write_analyze, write_envi, write_bov)]
