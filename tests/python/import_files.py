"""Files written by nibabel, tifffile, Pillow, pydicom and numpy, packed and exported by brickyard: the same voxels, spacing and units."""

import copy
import functools
import io
import pathlib
import shutil
import struct
import warnings

import nibabel
import numpy as np
import PIL.Image
import pydicom
import pydicom.data
import pydicom.encaps
import pydicom.uid
import tifffile
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.pixels import apply_modality_lut

import common
from common import FOLDER, brickyard, check, info, run_cases, same_bits

RANDOM = np.random.default_rng(1)
noise = functools.partial(common.noise, RANDOM)


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
    for kind in [nibabel.Nifti1Image, nibabel.Nifti2Image]:
        image = kind(array, np.diag([0.5, 0.75, 2.0, 1.0]))
        image.header.set_xyzt_units("mm", "msec")
        image.header.set_zooms((0.5, 0.75, 2.0, 2200.0))
        image.header["toffset"] = 0.5
        image.to_filename(FOLDER / "a.nii")
        pack(["a.nii"], array.T, "tzyx", **PLACE)
        check(info("o.zarr")["time_axis"] == {"start": 0.5, "step": 2200.0, "unit": "millisecond"}, info("o.zarr")["time_axis"])


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


def stored_nodata():
    return info("o.zarr")["store"].get("nodata")


def tiff_nodata():
    """GDAL's tag for pixels without data."""
    options = {"photometric": "minisblack", "metadata": None}
    tag = lambda text: {"extratags": [(42113, "s", 0, text, False)]}
    array = noise("i2", 5, 23, 31) // 8
    array[1:, ::2, 4:9] = -2000
    path = tiff("a.tif", array, **options, **tag("-2000"))
    for flags, expected in [((), -2000), (["--nodata", "none"], None), (["--nodata=-5"], -5)]:
        pack([path], array, flags=flags)
        check(stored_nodata() == expected, flags, stored_nodata())
    for text in ["-9999.5", "1e9", "nan", "?"]:  # What no voxel is.
        pack([tiff("a.tif", array, **options, **tag(text))], array)
        check(stored_nodata() is None, text, stored_nodata())
    floats = noise("f4", 5, 23, 31)
    floats[:, 3:5] = np.float32(-3.4028235e38)
    tiff("a.tif", floats, **options, **tag("-3.4028234663852886e+38"))
    brickyard("pack", "a.tif", "o.zarr", "--overwrite", "--progress", "none")
    brickyard("export", "o.zarr", "o.npy", "--overwrite")
    floats[:, 3:5] = np.nan
    check(np.array_equal(np.load(FOLDER / "o.npy"), floats, equal_nan=True), "voxels without data are not NaN")


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


def tiff_imagej_calibrated():
    """ImageJ has no signed images: they are stored 32768 higher, and calibrated by a line."""
    signed = noise("i2", 6, 25, 30)
    meta = {"axes": "ZYX", "cf": 0, "c0": -32768.0, "c1": 1.0, "vunit": "Gray Value"}
    stored = (signed.astype("i4") + 32768).astype("u2")
    pack([tiff("a.tif", stored, imagej=True, metadata=meta)], signed)
    meta = {"axes": "ZYX", "cf": 0, "c0": -1.5, "c1": 0.25, "vunit": "OD"}
    pack([tiff("a.tif", stored, imagej=True, metadata=meta)], (stored * 0.25 - 1.5).astype("f4"))


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
    for d in ["<f2", ">f2"]:
        halves = noise(d, 9, 23, 31)
        pack([npy(halves)], halves.astype("f4"))
    fitting = noise("i4", 9, 23, 31)
    pack([npy(fitting.astype("i8"))], fitting)
    pack([npy(fitting.view("u4").astype(">u8"))], fitting.view("u4"))
    pack([npy(fitting > 0)], (fitting > 0).astype("u1"))
    singles = noise("f4", 9, 23, 31)
    pack([npy(singles.astype("f8"))], singles)
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


AXIAL = ((1, 0, 0), (0, 1, 0))
# Rows lean to the back and columns to the feet, as cardiac views do.
OBLIQUE = ((0.8, 0.6, 0.0), (0.36, -0.48, -0.8))


def dicom_slice(plane, position, directions=AXIAL, slope=None, bits=None):
    """A data set of one slice: (x, y) spacing 0.5 x 0.75 mm."""
    data = Dataset()
    data.SOPClassUID, data.SOPInstanceUID = pydicom.uid.CTImageStorage, pydicom.uid.generate_uid()
    data.SeriesInstanceUID, data.Modality = "1.2.826.0.1.3680043.8.498.1", "CT"
    data.PatientName = "Müller^Jürgen"
    data.SpecificCharacterSet = "ISO_IR 100"
    data.ImagePositionPatient = [float(f"{p:.9g}") for p in position]
    data.ImageOrientationPatient = [*directions[0], *directions[1]]
    data.PixelSpacing, data.SliceThickness = [0.75, 0.5], 9
    data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
    data.Rows, data.Columns = plane.shape
    data.BitsAllocated = 8 * plane.dtype.itemsize
    data.BitsStored = bits or data.BitsAllocated
    data.HighBit = data.BitsStored - 1
    data.PixelRepresentation = int(plane.dtype.kind == "i")
    if slope is not None:
        data.RescaleSlope, data.RescaleIntercept = slope
    data.PixelData = plane.tobytes()
    data["PixelData"].VR = "OB" if plane.dtype.itemsize == 1 else "OW"
    return data


def dicom_write(name, data, syntax=pydicom.uid.ExplicitVRLittleEndian):
    packs = syntax == pydicom.uid.RLELossless
    meta = FileMetaDataset()
    meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian if packs else syntax
    meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = data.SOPClassUID, data.SOPInstanceUID
    file = FileDataset(str(FOLDER / name), copy.deepcopy(data), preamble=b"\0" * 128, file_meta=meta)
    if syntax == pydicom.uid.ExplicitVRBigEndian:
        itemsize = data.BitsAllocated // 8
        file.PixelData = np.frombuffer(data.PixelData, f"<u{itemsize}").astype(f">u{itemsize}").tobytes()
    if packs:
        file.compress(syntax, encoding_plugin="pydicom")
    pydicom.dcmwrite(FOLDER / name, file, enforce_file_format=True)


def dicom_series(array, directions=AXIAL, slopes=None, syntax=pydicom.uid.ExplicitVRLittleEndian, bits=None):
    """Writes the slices of an array (z, y, x), 2.5 mm apart along their normal, under names that say nothing of their order."""
    shutil.rmtree(FOLDER / "series", ignore_errors=True)
    (FOLDER / "series").mkdir()
    normal = np.cross(*directions)
    for name, z in enumerate(RANDOM.permutation(len(array))):
        position = np.array([-100.0, 50.0, 30.0]) + 2.5 * z * normal
        data = dicom_slice(array[z], position, directions, slopes and slopes[z % len(slopes)], bits)
        dicom_write(f"series/{name:03}", data, syntax)


def dicom_read(dtype):
    """The series as pydicom reads it: the rescaled voxels (z, y, x), and the matrix that the standard's equation C.7.6.2.1-1
    gives, turned from left and back to right and front."""
    files = [pydicom.dcmread(path) for path in (FOLDER / "series").iterdir()]
    first = files[0].ImageOrientationPatient
    row, column = np.array(first[:3], float), np.array(first[3:], float)
    normal = np.cross(row, column)
    files.sort(key=lambda file: np.dot(normal, np.array(file.ImagePositionPatient, float)))
    voxels = np.stack([apply_modality_lut(file.pixel_array, file) for file in files])
    places = [np.array(file.ImagePositionPatient, float) for file in files]
    down, across = (float(mm) for mm in files[0].PixelSpacing)
    step = (places[-1] - places[0]) / (len(places) - 1)
    matrix = np.stack([row * across, column * down, step, places[0]], axis=1)
    return voxels.astype(dtype), np.diag([-1.0, -1.0, 1.0]) @ matrix


def dicom_check(array, dtype, flags=(), **written):
    """Writes a series, packs its folder, and compares voxels and place with what pydicom makes of it."""
    dicom_series(array, **written)
    expected, matrix = dicom_read(dtype)
    pack(["series"], expected, "zyx", flags, spacing=(0.5, 0.75, 2.5), unit="millimeter")
    kept = info("o.zarr")["store"]["orientation"]
    check(kept is not None and np.allclose(kept, matrix, atol=1e-6), kept, matrix)


def dicom_syntaxes():
    uid = pydicom.uid
    for syntax in [uid.ImplicitVRLittleEndian, uid.ExplicitVRLittleEndian, uid.ExplicitVRBigEndian,
                   uid.DeflatedExplicitVRLittleEndian, uid.RLELossless]:
        for d in ["u1", "i1", "u2", "i2", "u4", "i4"]:
            if syntax == uid.RLELossless and d in ["u4", "i4"]:
                continue  # Not the standard's, and pydicom writes none.
            try:
                dicom_check(noise(d, 7, 19, 23), d, syntax=syntax)
            except AssertionError as error:
                raise AssertionError(f"{syntax.name} {d}: {error}") from error
    for d in ["u2", "i2"]:  # What runs of one value make of it.
        dicom_check(np.repeat(noise(d, 7, 19, 1), 23, axis=2), d, syntax=uid.RLELossless)


def dicom_rescaled():
    stored = noise("u2", 9, 19, 23) % 4096
    dicom_check(stored, "i2", slopes=[(1, -1024)], bits=12)
    dicom_check(stored, "f4", slopes=[(0.5, -1024.25)], bits=12)
    dicom_check(stored, "f4", slopes=[(0.25, 0), (1.5, -3), (2.0, 7)], bits=12)  # As PET has them: each slice its own.


def dicom_padding():
    """Padding is of stored numbers, voxels are rescaled."""
    stored = noise("u2", 4, 19, 23) % 4096
    stored[:, :5] = stored[:, :, 20:] = 63

    def write(slope, **padding):
        shutil.rmtree(FOLDER / "series", ignore_errors=True)
        (FOLDER / "series").mkdir()
        for z, plane in enumerate(stored):
            data = dicom_slice(plane, (0, 0, 2.5 * z), slope=slope, bits=12)
            for name, value in padding.items():
                setattr(data, name, value)
            dicom_write(f"series/{z}", data)
        return dicom_read("f8")[0]

    def read():
        brickyard("pack", "series", "o.zarr", "--overwrite", "--progress", "none")
        brickyard("export", "o.zarr", "o.npy", "--overwrite")
        return np.load(FOLDER / "o.npy")

    for slope in [None, (1, -1024), (-3, 7)]:
        expected = write(slope, PixelPaddingValue=63)
        check(np.array_equal(read(), expected), slope)
        check(stored_nodata() == expected[0, 0, 0], slope, stored_nodata())
        (channel,) = info("o.zarr")["store"]["channels"]
        valid = expected[expected != expected[0, 0, 0]]
        check(channel["nodata"] == expected.size - valid.size and channel["count"] == valid.size, channel["nodata"])
        check(channel["range"] == [valid.min(), valid.max()] and np.isclose(channel["mean"], valid.mean()), channel["range"])
    # A range of stored numbers is padding: one value stands for all of it.
    expected = write((1, -1024), PixelPaddingValue=70, PixelPaddingRangeLimit=60)
    expected = np.where((stored >= 60) & (stored <= 70), 60 - 1024, expected)
    check(np.array_equal(read(), expected) and stored_nodata() == 60 - 1024, stored_nodata())
    expected = write((0.5, -1024), PixelPaddingValue=63)
    check(np.array_equal(read(), np.where(stored == 63, np.nan, expected), equal_nan=True), "padding is not NaN")


def dicom_oblique():
    dicom_check(noise("i2", 9, 19, 23), "i2", directions=OBLIQUE)
    dicom_check(noise("i2", 9, 19, 23), "i2", directions=((0, 1, 0), (0, 0, -1)))
    # Right and front is as the world has it: upright, with an origin.
    dicom_series(noise("i2", 9, 19, 23), directions=((-1, 0, 0), (0, -1, 0)))
    expected, matrix = dicom_read("i2")
    pack(["series"], expected, "zyx", spacing=(0.5, 0.75, 2.5), origin=matrix[:, 3], unit="millimeter")


def dicom_enhanced():
    """One file of many frames in a mixed order, each with its own place and slope."""
    array = noise("u2", 6, 19, 23)
    order = RANDOM.permutation(6)
    data = dicom_slice(array[0], (0, 0, 0))
    data.SOPClassUID = pydicom.uid.EnhancedCTImageStorage
    for name in ["ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing", "SliceThickness"]:
        delattr(data, name)

    def group(**macros):
        out = Dataset()
        for name, values in macros.items():
            inner = Dataset()
            for key, value in values.items():
                setattr(inner, key, value)
            setattr(out, name, [inner])
        return out

    data.SharedFunctionalGroupsSequence = [group(
        PlaneOrientationSequence={"ImageOrientationPatient": [1, 0, 0, 0, 1, 0]},
        PixelMeasuresSequence={"PixelSpacing": [0.75, 0.5], "SliceThickness": 9},
    )]
    data.PerFrameFunctionalGroupsSequence = [group(
        PlanePositionSequence={"ImagePositionPatient": [-3, 4, 1.25 * int(z)]},
        PixelValueTransformationSequence={"RescaleSlope": 0.5, "RescaleIntercept": int(z), "RescaleType": "HU"},
    ) for z in order]
    data.NumberOfFrames = 6
    data.PixelData = array[order].tobytes()
    expected = (array * 0.5 + np.arange(6).reshape(6, 1, 1)).astype("f4")
    for syntax in [pydicom.uid.ExplicitVRLittleEndian, pydicom.uid.RLELossless]:
        dicom_write("enhanced.dcm", data, syntax)
        pack(["enhanced.dcm"], expected, spacing=(0.5, 0.75, 1.25), unit="millimeter")


def csa_header(**elements):
    """Siemens' own header ("SV10") with these elements: a representation, and texts."""
    made = b"SV10\4\3\2\1" + struct.pack("<2I", len(elements), 77)
    for name, (vr, *values) in elements.items():
        made += struct.pack("<64si4s3i", name.encode(), len(values), vr.encode(), 0, 6, 77)
        for value in [v.encode() + b"\0" for v in values] + [b""] * (6 - len(values)):
            made += struct.pack("<4i", len(value), len(value), 77, 77) + value + b"\0" * (-len(value) % 4)
    return made


def dicom_mosaic():
    """Siemens mosaics: voxels and place as nibabel has them, upright and oblique, with slices along either side of the normal."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Its authors call it experimental.
        from nibabel.nicom.dicomwrappers import wrapper_from_file
    (FOLDER / "mosaic").mkdir()
    for count, directions, sign in [(9, AXIAL, 1), (7, AXIAL, -1), (11, OBLIQUE, 1), (1, OBLIQUE, -1)]:
        across = int(np.ceil(np.sqrt(count)))
        tiles = np.zeros((across**2, 6, 8), "u2")
        tiles[:count] = noise("u2", count, 6, 8) % 4096
        picture = tiles.reshape(across, across, 6, 8).swapaxes(1, 2).reshape(across * 6, across * 8)
        data = dicom_slice(np.ascontiguousarray(picture), (-100.5, 50.25, 30.0), directions)
        data.ImageType, data.SpacingBetweenSlices, data.Manufacturer = ["ORIGINAL", "PRIMARY", "M", "ND", "MOSAIC"], 2.5, "SIEMENS"
        normal = [f"{n:.8f}" for n in sign * np.cross(*directions)]
        data.add_new(0x00290010, "LO", "SIEMENS CSA HEADER")
        data.add_new(0x00291010, "OB", csa_header(
            EchoTime=["DS", "30"], AcquisitionMatrixText=["SH", "8p*6"], NumberOfImagesInMosaic=["US", str(count)],
            SliceNormalVector=["FD", *normal]))
        dicom_write("mosaic/a.dcm", data)
        read = wrapper_from_file(FOLDER / "mosaic/a.dcm")
        check(read.is_mosaic and read.n_mosaic == count, count)
        # Rows, columns, slices, in DICOM's world; slices that go down are turned round.
        expected, affine = read.get_data().transpose(2, 0, 1), read.affine
        if sign < 0:
            expected = expected[::-1]
            affine = affine @ [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, count - 1], [0, 0, 0, 1]]
        matrix = np.array([[-1], [-1], [1]]) * affine[:3, [1, 0, 2, 3]]
        pack(["mosaic/a.dcm"], expected.astype("u2"), spacing=(0.5, 0.75, 2.5), unit="millimeter")
        kept = info("o.zarr")["store"]["orientation"]
        check(kept is not None and np.allclose(kept, matrix, atol=1e-5), count, kept, matrix)


def dicom_gaps():
    """Missing slices: refused, and with --gaps blank where they would be."""
    array = noise("u2", 9, 19, 23) % 4096
    dicom_series(array, bits=12)
    for path in (FOLDER / "series").iterdir():
        z = round((float(pydicom.dcmread(path).ImagePositionPatient[2]) - 30.0) / 2.5)
        if z in [2, 5, 6]:
            path.unlink()
    try:
        brickyard("pack", "series", "gaps.zarr", "--progress", "none")
        refusal = "none"
    except AssertionError as error:
        refusal = str(error)
    check("2 slices are missing between them" in refusal and "--gaps blank" in refusal, refusal)
    expected = array.astype("i2")
    expected[[2, 5, 6]] = -1
    pack(["series"], expected, "zyx", ["--gaps", "blank"], spacing=(0.5, 0.75, 2.5), unit="millimeter")
    check(info("o.zarr")["store"]["nodata"] == -1, info("o.zarr")["store"])


def dicom_jpeg():
    """JPEG baseline by Pillow, in one fragment and in three."""
    smooth = np.add.outer(np.arange(0, 200, 5), np.arange(0, 50, 1)).astype("u1")
    stream = io.BytesIO()
    PIL.Image.fromarray(smooth).save(stream, "jpeg", quality=95)
    whole = stream.getvalue()
    decoded = np.asarray(PIL.Image.open(io.BytesIO(whole)))
    (FOLDER / "jpeg").mkdir()
    for count in [1, 3]:
        data = dicom_slice(smooth, (0, 0, 0))
        data.PixelData = pydicom.encaps.encapsulate([whole], fragments_per_frame=count)
        data["PixelData"].is_undefined_length = True
        dicom_write("jpeg/a.dcm", data, pydicom.uid.JPEGBaseline8Bit)
        brickyard("pack", "jpeg/a.dcm", "o.zarr", "--overwrite", "--progress", "none")
        brickyard("export", "o.zarr", "o.npy", "--overwrite")
        found = np.load(FOLDER / "o.npy")[0].astype(int)
        # Decoders may round the cosine transform either way.
        check(found.shape == decoded.shape and abs(found - decoded).max() <= 1, abs(found - decoded).max())


def dicom_jpeg_2000():
    """Squares of the least and the greatest number, packed strongly by OpenJPEG: what overshoots is clamped, as there."""
    y, x = np.indices((40, 48))
    low = (x // 5 + y // 5) % 2 == 0
    (FOLDER / "jpeg2000").mkdir()
    for bits, d in [(8, "u1"), (12, "u2"), (16, "u2")]:
        plane = np.where(low, 0, 2**bits - 1).astype(d)
        stream = io.BytesIO()
        options = {"no_jp2": True, "irreversible": True, "quality_mode": "rates", "quality_layers": [6]}
        PIL.Image.fromarray(plane).save(stream, "jpeg2000", **options)
        decoded = np.asarray(PIL.Image.open(io.BytesIO(stream.getvalue()))).astype(int)
        check(bits != 12 or decoded.max() > 4095, "the test's own file is not as meant:", decoded.max())
        data = dicom_slice(plane, (0, 0, 0), slope=(1, -1024), bits=bits)
        data.PixelData = pydicom.encaps.encapsulate([stream.getvalue()])
        data["PixelData"].is_undefined_length = True
        dicom_write("jpeg2000/a.dcm", data, pydicom.uid.JPEG2000)
        brickyard("pack", "jpeg2000/a.dcm", "o.zarr", "--overwrite", "--progress", "none")
        brickyard("export", "o.zarr", "o.npy", "--overwrite")
        found = np.load(FOLDER / "o.npy")[0].astype(int)
        expected = decoded.clip(0, 2**bits - 1) - 1024
        # Decoders of f32 may round otherwise: by some 2^-14 of the range.
        limit = max(1, 2**bits >> 13)
        check(abs(found - expected).max() <= limit, bits, abs(found - expected).max())


def pictures():
    """Folders of pictures, a slice each; one more folder is one more time step."""
    steps = noise("u2", 2, 12, 9, 13)
    for i, step in enumerate(steps):
        picture_folder(f"pictures-{i}", step)
    pack(["pictures-0"], steps[0])
    pack(["pictures-0/s_*.png"], steps[0])
    brickyard("pack", "pictures-0", "o.zarr", "--overwrite", "--time-step", "1", "--progress", "none")
    brickyard("append", "o.zarr", "pictures-1", "--progress", "none")
    for t, step in enumerate(steps):
        brickyard("export", "o.zarr", "o.npy", "--overwrite", "--time", t)
        check(same_bits(np.load(FOLDER / "o.npy"), step), f"step {t} differs")
    colours = noise("u1", 3, 9, 13, 3)
    picture_folder("colours", colours, dpi=(254, 508))
    size = 1 / round(254 / 0.0254)
    pack(["colours"], np.moveaxis(colours, -1, 0), "czyx", spacing=(size, size / 2, size), unit="meter")
    PIL.Image.fromarray(colours[0]).save(FOLDER / "one.bmp")
    pack(["one.bmp"], np.moveaxis(colours[:1], -1, 0), "czyx")


def picture_folder(name, planes, **options):
    (FOLDER / name).mkdir()
    for i, plane in enumerate(planes):
        PIL.Image.fromarray(plane).save(FOLDER / name / f"s_{i}.png", **options)


def dicom_of_others():
    """Scanners' files that come with pydicom: one slice in every syntax."""
    for name in ["CT_small", "MR_small", "MR_small_implicit", "MR_small_bigendian", "MR_small_expb", "MR_small_RLE", "MR_small_padded",
                 "MR_small_jp2klossless"]:
        path = pathlib.Path(pydicom.data.get_testdata_file(f"{name}.dcm", download=False))
        shutil.rmtree(FOLDER / "one", ignore_errors=True)
        (FOLDER / "one").mkdir()
        shutil.copy(path, FOLDER / "one")
        file = pydicom.dcmread(path)
        plain = pydicom.dcmread(path.with_name("MR_small.dcm")) if name == "MR_small_jp2klossless" else file
        expected = apply_modality_lut(plain.pixel_array, file)[np.newaxis]
        down, across = (float(mm) for mm in file.PixelSpacing)
        depth = float(file.get("SpacingBetweenSlices", file.SliceThickness))
        expected = expected.astype("i2")
        try:
            pack(["one"], expected, spacing=(across, down, depth), unit="millimeter")
        except AssertionError as error:
            raise AssertionError(f"{name}: {error}") from error


run_cases({f.__name__: f for f in [
    nifti_types, nifti_gz, nifti_scaled, nifti_series, nifti_2, nifti_big_endian, nifti_placed, nifti_turned,
    tiff_types, tiff_layouts, tiff_lzw, tiff_nodata, tiff_imagej, tiff_imagej_calibrated, tiff_ome, tiff_folder, numpy_arrays, raw_files, pictures,
    dicom_syntaxes, dicom_rescaled, dicom_padding, dicom_oblique, dicom_enhanced, dicom_mosaic, dicom_gaps, dicom_jpeg, dicom_jpeg_2000, dicom_of_others,
]})
