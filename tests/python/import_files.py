"""Files written by nibabel, tifffile, Pillow and numpy, packed and exported by brickyard: the same voxels, spacing and units."""

import struct

import nibabel
import numpy as np
import PIL.Image
import tifffile

from common import FOLDER, brickyard, check, info, run_cases, same_bits

RANDOM = np.random.default_rng(1)


def noise(dtype, *shape):
    dtype = np.dtype(dtype)
    if dtype.kind == "f":
        return RANDOM.standard_normal(shape).astype(dtype)
    limits = np.iinfo(dtype)
    return RANDOM.integers(limits.min, limits.max, shape, dtype.newbyteorder("="), endpoint=True).astype(dtype)


def pack(inputs, expected, axes="zyx", flags=(), spacing=None, origin=None, unit=None):
    """Packs `inputs`, and compares every volume with `expected`, an array of these axes, and the placement (x, y, z)."""
    brickyard("pack", *inputs, "o.zarr", "--overwrite", "--brick", "16", "--progress", "none", *flags)
    five = np.asarray(expected)[tuple(np.newaxis if a not in axes else slice(None) for a in "tczyx")]
    found = info("o.zarr")
    times, channels = five.shape[:2]
    check((found["times"], found["channels"]) == (times, channels), found["times"], found["channels"], five.shape)
    check(found["levels"][0]["extent"] == list(five.shape[:1:-1]), found["levels"][0]["extent"], five.shape)
    for t in range(times):
        for c in range(channels):
            brickyard("export", "o.zarr", "o.npy", "--overwrite", "--time", t, "--channel", c)
            check(same_bits(np.load(FOLDER / "o.npy"), five[t, c]), f"t{t} c{c} differs from the file")
    check(found["calibrated"] == (spacing is not None), "calibrated:", found["calibrated"])
    # TIFF keeps resolutions as ratios of integers and NIfTI as f32: seven digits.
    close = lambda a, b: np.allclose(a, b, rtol=1e-6, atol=1e-6)
    check(spacing is None or close(found["spacing"], spacing), "spacing:", found["spacing"])
    check(origin is None or close(found["origin"], origin), "origin:", found["origin"])
    check(found["unit"] == unit, "unit:", found["unit"])


def nifti(name, array, kind=nibabel.Nifti1Image, affine=None, units="mm", endian="<"):
    """Writes an array of axes (x, y, z, ...); returns the path."""
    affine = np.diag([0.5, 0.75, 2.0, 1.0]) if affine is None else affine
    header = kind.header_class(endianness=endian)
    header.set_data_dtype(array.dtype.newbyteorder(endian))
    header.set_xyzt_units(units, "sec")
    kind(array, affine, header).to_filename(FOLDER / name)
    return name


PLACE = {"spacing": (0.5, 0.75, 2.0), "origin": (0.0, 0.0, 0.0), "unit": "millimeter"}


def nifti_types():
    for d in ["u1", "i1", "u2", "i2", "u4", "i4", "f4"]:
        array = noise(d, 21, 17, 19)
        pack([nifti("a.nii", array)], array.T, **PLACE)


def nifti_gz():
    array = noise("i2", 41, 37, 29)
    pack([nifti("a.nii.gz", array)], array.T, **PLACE)


def nifti_scaled():
    array = noise("i2", 21, 17, 19)
    for slope in [(2.0, -1024.0), (0.0123, 7.5)]:
        path = nifti("a.nii", array)
        with open(FOLDER / path, "r+b") as file:
            file.seek(112)  # scl_slope and scl_inter; nibabel would choose its own.
            file.write(struct.pack("<2f", *slope))
        image = nibabel.load(FOLDER / path)
        check(np.array_equal(image.dataobj.get_unscaled(), array), "the test's own file is not as meant")
        # Header slopes are f32; the file means the product in exact arithmetic, rounded once.
        pack([path], image.get_fdata().astype("f4").T, **PLACE)


def nifti_series():
    array = noise("u2", 21, 17, 19, 3)
    pack([nifti("a.nii", array)], array.T, "tzyx", **PLACE)


def nifti_2():
    array = noise("f4", 21, 17, 19)
    pack([nifti("a.nii", array, nibabel.Nifti2Image)], array.T, **PLACE)
    pack([nifti("a.nii.gz", array, nibabel.Nifti2Image)], array.T, **PLACE)


def nifti_big_endian():
    for d in ["i2", "f4"]:
        array = noise(d, 21, 17, 19)
        pack([nifti("a.nii", array, endian=">")], array.T, **PLACE)


def nifti_placed():
    affine = np.diag([0.5, 0.75, 2.0, 1.0])
    affine[:3, 3] = [-12.5, 7.0, 100.0]
    array = noise("u1", 21, 17, 19)
    place = {**PLACE, "origin": (-12.5, 7.0, 100.0), "unit": "micrometer"}
    pack([nifti("a.nii", array, affine=affine, units="micron")], array.T, **place)


def nifti_turned():
    """Turned axes cannot be spacing and origin: the voxels stay in file order, the matrix is kept."""
    turn = np.array([[0.0, -0.75, 0.0, 4.0], [0.5, 0.0, 0.0, -3.0], [0.0, 0.0, 2.0, 9.0], [0.0, 0.0, 0.0, 1.0]])
    array = noise("u1", 21, 17, 19)
    pack([nifti("a.nii", array, affine=turn)], array.T, spacing=(0.5, 0.75, 2.0), unit="millimeter")
    kept = info("o.zarr")["store"]["orientation"]
    check(kept is not None and np.allclose(kept, turn[:3], atol=1e-5), kept)


def tiff(name, array, **options):
    tifffile.imwrite(FOLDER / name, array, **options)
    return name


def tiff_types():
    for d in ["u1", "i1", "u2", "i2", "u4", "i4", "f4"]:
        array = noise(d, 5, 23, 31)
        pack([tiff("a.tif", array, photometric="minisblack", metadata=None)], array)


def tiff_layouts():
    array = noise("u2", 7, 45, 70)
    options = {"photometric": "minisblack", "metadata": None}
    for more in [
        {"bigtiff": True},
        {"byteorder": ">"},
        {"tile": (16, 32)},
        {"rowsperstrip": 10},
        {"compression": "zlib"},
        {"compression": "zlib", "predictor": True},
        {"compression": "zlib", "predictor": True, "tile": (32, 32), "byteorder": ">", "bigtiff": True},
    ]:
        try:
            pack([tiff("a.tif", array, **options, **more)], array)
        except AssertionError as error:
            raise AssertionError(f"{more}: {error}") from error
    floats = noise("f4", 5, 45, 70)
    pack([tiff("a.tif", floats, compression="zlib", **options)], floats)


def tiff_lzw():
    """As libtiff writes it, through Pillow."""
    for d in ["u1", "u2"]:
        # What compresses has codes for long strings; noise fills the table of codes several times over.
        ramp = np.add.outer(np.arange(5 * 45), np.arange(70) // 3).reshape(5, 45, 70).astype(d)
        for array in [ramp, noise(d, 5, 145, 170)]:
            for options in [{}, {"Predictor": 2}, {"Predictor": 2, "RowsPerStrip": 10}]:
                tags = {tifffile.TIFF.TAGS[name]: value for name, value in options.items()}
                first, *rest = [PIL.Image.fromarray(plane) for plane in array]
                first.save(FOLDER / "a.tif", save_all=True, append_images=rest, compression="tiff_lzw", tiffinfo=tags)
                with tifffile.TiffFile(FOLDER / "a.tif") as file:
                    page = file.pages[4]
                    found = page.compression, page.predictor, page.rowsperstrip
                expected = 5, options.get("Predictor", 1), options.get("RowsPerStrip", array.shape[1])
                check(found == expected, "the test's own file is not as meant:", found)
                pack(["a.tif"], array)


def tiff_imagej():
    array = noise("u2", 2, 3, 2, 25, 30)
    meta = {"axes": "TZCYX", "spacing": 3.0, "unit": "um"}
    path = tiff("a.tif", array, imagej=True, resolution=(2.0, 4.0), metadata=meta)
    pack([path], array.transpose(0, 2, 1, 3, 4), "tczyx", spacing=(0.5, 0.25, 3.0), unit="micrometer")
    stack = noise("u1", 6, 25, 30)
    path = tiff("a.tif", stack, imagej=True, metadata={"axes": "ZYX"})
    pack([path], stack)
    channels = noise("f4", 3, 25, 30)
    path = tiff("a.tif", channels, imagej=True, metadata={"axes": "CYX"})
    pack([path], channels, "cyx")


def tiff_ome():
    array = noise("u2", 2, 3, 4, 25, 30)
    meta = {"axes": "TCZYX", "PhysicalSizeX": 0.25, "PhysicalSizeXUnit": "µm", "PhysicalSizeY": 0.5,
            "PhysicalSizeYUnit": "µm", "PhysicalSizeZ": 2.0, "PhysicalSizeZUnit": "µm"}
    path = tiff("a.ome.tif", array, photometric="minisblack", metadata=meta)
    pack([path], array, "tczyx", spacing=(0.25, 0.5, 2.0), unit="micrometer")


def tiff_folder():
    array = noise("u2", 12, 25, 30)
    (FOLDER / "planes").mkdir()
    for z, plane in enumerate(array):
        tiff(f"planes/slice {z}.tif", plane, metadata=None)  # 10 and 11 come after 9, not after 1.
    pack(["planes"], array)
    pack([f"planes/slice {z}.tif" for z in range(12)], array)


def numpy_arrays():
    def npy(array, name="a.npy"):
        np.save(FOLDER / name, array)
        return name

    for d in ["u1", "i1", "<u2", ">u2", "<i2", ">i2", "<u4", ">i4", "<f4", ">f4"]:
        array = noise(d, 9, 23, 31)
        pack([npy(array)], array)
        pack([npy(np.asfortranarray(array))], array)
    plane = noise("u1", 23, 31)
    pack([npy(plane)], plane, "yx")
    series = noise("u2", 2, 9, 23, 31)
    pack([npy(series)], series, "tzyx", ["--axes", "tzyx"])
    pack([npy(series)], series, "czyx", ["--axes", "czyx"])
    last = noise("u1", 9, 23, 31, 3)
    pack([npy(last)], last.transpose(3, 0, 1, 2), "czyx", ["--axes", "zyxc"])
    turned = noise("u2", 31, 23, 9)
    pack([npy(turned)], turned.T, "zyx", ["--axes", "xyz"])
    doubles = noise("f8", 9, 23, 31)
    pack([npy(doubles)], doubles.astype("f4"), "zyx", ["--allow-lossy"])
    steps = noise("u1", 3, 9, 23, 31)
    pack([npy(step, f"step{t}.npy") for t, step in enumerate(steps)], steps, "tzyx")


def raw_files():
    for d, name in [(">u2", "u16"), ("<f4", "f32"), (">i4", "i32")]:
        array = noise(d, 9, 23, 31)
        (FOLDER / "a.raw").write_bytes(b"header!" + array.tobytes())
        endian = "big" if d[0] == ">" else "little"
        flags = ["--shape", "31,23,9", "--dtype", name, "--endian", endian, "--offset", 7]
        pack(["a.raw"], array, "zyx", flags)
        placed = ["--spacing", "1,2,3", "--origin=-1,0,5", "--unit", "nm"]
        pack(["a.raw"], array, "zyx", flags + placed, (1, 2, 3), (-1, 0, 5), "nanometer")
    array = noise("u1", 9, 2, 23, 31, 3)
    (FOLDER / "a.raw").write_bytes(array.tobytes())
    flags = ["--shape", "31,23,9", "--dtype", "u8", "--axes", "ztyxc", "--times", 2, "--channels", 3]
    pack(["a.raw"], array.transpose(1, 4, 0, 2, 3), "tczyx", flags)


run_cases({f.__name__: f for f in [
    nifti_types, nifti_gz, nifti_scaled, nifti_series, nifti_2, nifti_big_endian, nifti_placed, nifti_turned,
    tiff_types, tiff_layouts, tiff_lzw, tiff_imagej, tiff_ome, tiff_folder, numpy_arrays, raw_files,
]})
