"""Seeds of mutants.py: small files of every reader, by the writers of differential.py where it has them, else by h5py, netCDF4, pydicom, pynrrd, SimpleITK."""

import json
import warnings

import h5py
import netCDF4
import nrrd
import numpy as np
import SimpleITK
from differential_arrays import write_analyze, write_bov, write_envi, write_mrc, write_npz
from differential_channels import write_channels, write_raw
from differential_pictures import write_pictures
from differential_vtk import write_pvd, write_vtk
from differential_written import (
    described,
    noise,
    pick,
    write_dicom,
    write_hdf5,
    write_meta_image,
    write_netcdf,
    write_nifti,
    write_npy,
    write_nrrd,
    write_tiff,
)
from pydicom.dataset import Dataset
from pydicom.uid import ExplicitVRLittleEndian

# Most bytes of a seed's files: in small ones most changes hit what describes the voxels.
MOST_BYTES = 24 << 10
# Files tried for the seeds of a reader.
MOST_TRIED = 400


def by(write, *more, start=b""):
    """A writer of differential.py; of its files those that start with these bytes."""

    def made(rng, stem):
        case = write(rng, stem, "seed", *more)
        path = case.inputs[0]
        if case.must_refuse or start and not path.read_bytes().startswith(start):
            raise ValueError("no seed")
        return case.inputs, case.flags

    return made


def small(rng, dtype="u2", count=3):
    return noise(rng, dtype, *(int(n) for n in rng.integers(2, 7, count)))


# HDF5 and its kin


def write_tree(rng, stem):
    """Groups of few and many links, links of all kinds, attributes of all kinds, a virtual dataset, compounds; one dataset is named."""
    path, array = stem.with_suffix(".h5"), small(rng)
    with h5py.File(path, "w", libver=pick(rng, "earliest", "latest"), track_order=bool(rng.random() < 0.5)) as file:
        made = file.create_dataset("entry/data", data=array, chunks=(1, 2, 2), compression="gzip")
        made.attrs["units"], made.attrs["element_size_um"], made.attrs["names"] = "K", [1.0, 2.0, 3.0], ["a", "bc"]
        made.attrs.create("fixed", np.array([b"x", b"y"]))
        file.attrs["default"], file["entry"].attrs["NX_class"], file["entry"].attrs["signal"] = "entry", "NXdata", "data"
        made.dims[0].label = "z"
        file["entry/z"] = np.arange(len(array), dtype="f4")
        file["entry/z"].make_scale("z")
        made.dims[0].attach_scale(file["entry/z"])
        if rng.random() < 0.5:
            for i in range(12):
                file[f"many/{i}"] = h5py.SoftLink("/entry/data")
        file["soft"], file["away"], file["again"] = h5py.SoftLink("/no"), h5py.ExternalLink("b.h5", "/a"), made
        layout = h5py.VirtualLayout((4, 3), "u2")
        layout[0] = h5py.VirtualSource("c.h5", "a", (3,))
        file.create_virtual_dataset("virtual", layout)
        file["pairs"] = np.zeros((2, 3), [("a", "<f4"), ("b", "u1")])
    return [path], ["--variable", pick(rng, "/entry/data", "/again", "/entry")]


def write_imaris(rng, stem):
    path, array = stem.with_suffix(".ims"), small(rng, pick(rng, "u1", "u2", "f4"))
    times, channels = (int(n) for n in rng.integers(1, 3, 2))
    said = lambda text: np.array([c.encode() for c in str(text)], "S1")
    with h5py.File(path, "w", libver=pick(rng, "earliest", "latest")) as file:
        for level, t, c in np.ndindex(2, times, channels):
            group = file.create_group(f"DataSet/ResolutionLevel {level}/TimePoint {t}/Channel {c}")
            for name, size in zip("ZYX", array.shape):
                group.attrs[f"ImageSize{name}"] = said(size)
            group.create_dataset("Data", data=np.pad(array, 1), chunks=(2, 4, 4), compression="gzip")
        image = file.create_group("DataSetInfo/Image")
        for a, size in enumerate(array.shape[::-1]):
            image.attrs[f"ExtMin{a}"], image.attrs[f"ExtMax{a}"] = said(-1.5), said(size * 0.25)
        image.attrs["Unit"] = said("um")
        for c in range(channels):
            group = file.create_group(f"DataSetInfo/Channel {c}")
            for name, value in {"Name": f"dye {c}", "Color": "1.0 0.5 0.0", "ColorRange": "0 255"}.items():
                group.attrs[name] = said(value)
        group = file.create_group("DataSetInfo/TimeInfo")
        for t in range(times):
            group.attrs[f"TimePoint{t + 1}"] = said(f"2018-05-30 14:13:{43 + t}.250")
    return [path], []


def write_big_data_viewer(rng, stem):
    path, array, times, setups = stem.with_suffix(".h5"), small(rng, "i2"), int(rng.integers(1, 4)), int(rng.integers(1, 3))
    with h5py.File(path, "w") as file:
        for s in range(setups):
            file[f"s{s:02}/resolutions"], file[f"s{s:02}/subdivisions"] = np.ones((1, 3)), np.full((1, 3), 2)
            for t in range(times):
                file.create_dataset(f"t{t:05}/s{s:02}/0/cells", data=array, chunks=(2, 2, 2), compression="gzip")
    text, z_y_x = stem.with_suffix(".xml"), array.shape
    affine = pick(rng, "0.5 0 0 5 0 0.5 0 6 0 0 2 7", "0 -1 0 5 1 0 0 6 0 0 1 7")
    setup = "".join(
        f"<ViewSetup><id>{s}</id><name>a &amp; {s}</name><size>{z_y_x[2]} {z_y_x[1]} {z_y_x[0]}</size><voxelSize><unit>um</unit>"
        "<size>0.5 0.5 2.0</size></voxelSize></ViewSetup>"
        for s in range(setups)
    )
    points = pick(
        rng,
        f'<Timepoints type="range"><first>0</first><last>{times - 1}</last></Timepoints>',
        f'<Timepoints type="pattern"><integerpattern>0-{times - 1}:1</integerpattern></Timepoints>',
        '<Timepoints type="list">' + "".join(f"<Timepoint><id>{t}</id></Timepoint>" for t in range(times)) + "</Timepoints>",
    )
    places = "".join(
        f'<ViewRegistration timepoint="{t}" setup="{s}"><ViewTransform type="affine"><affine>{affine}</affine></ViewTransform>'
        "</ViewRegistration>"
        for t, s in np.ndindex(times, setups)
    )
    text.write_text(
        f'<?xml version="1.0" encoding="UTF-8"?>\n<SpimData version="0.2">\n<BasePath type="relative">.</BasePath>\n<SequenceDescription>'
        f'<ImageLoader format="bdv.hdf5"><hdf5 type="relative">{path.name}</hdf5></ImageLoader>\n<ViewSetups>{setup}</ViewSetups>\n{points}'
        f"<MissingViews/></SequenceDescription>\n<ViewRegistrations>{places}</ViewRegistrations>\n</SpimData>\n"
    )
    return [pick(rng, text, text, path)], []


def write_minc(rng, stem):
    path, array = stem.with_suffix(".mnc"), small(rng, pick(rng, "i1", "i2", "i4"))
    with netCDF4.Dataset(path, "w", format=pick(rng, "NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET")) as file:
        for name, size in zip("zyx", array.shape):
            file.createDimension(f"{name}space", size)
            line = file.createVariable(f"{name}space", "f8", ())
            line.step, line.start, line.direction_cosines, line.spacing = -1.5, 20.0, [0.0, 1.0, 0.0], "regular__"
        image = file.createVariable("image", array.dtype, ("zspace", "yspace", "xspace"), fill_value=False)
        image.signtype, image.valid_range = "signed__", [-100.0, 100.0]
        image[:] = array
        of_slices = pick(rng, (), ("zspace",))
        for name, value in {"image-min": -1.0, "image-max": 7.5}.items():
            limits = file.createVariable(name, "f8", of_slices, fill_value=False)
            limits[...] = value
    return [path], []


# Headers beside their data


def write_detached_nrrd(rng, stem):
    path = stem.with_suffix(".nhdr")
    header = {"kinds": ["domain"] * 3, "encoding": pick(rng, "raw", "gzip"), "space": "RAS", "space directions": np.eye(3)}
    nrrd.write(str(path), small(rng, "i2"), header, detached_header=True, relative_data_path=True)
    return [path], []


def write_detached_meta_image(rng, stem):
    path, image = stem.with_suffix(".mhd"), SimpleITK.GetImageFromArray(small(rng, "f4"))
    image.SetSpacing([0.5, 2.0, 3.0])
    SimpleITK.WriteImage(image, str(path), useCompression=bool(rng.random() < 0.5))
    return [path], []


def write_sidecar(rng, stem):
    array = small(rng, "i2", 5)
    stem.with_suffix(".raw").write_bytes(bytes(16) + array.astype(">i2").tobytes())
    t, c, z, y, x = array.shape
    told = {"file": "s.raw", "shape": [x, y, z], "dtype": "i16", "endian": "big", "offset": 16, "axes": "tczyx", "times": t, "channels": c}
    told |= {"spacing": [0.5, 1, 2e-3], "origin": [0, -1, 2], "unit": "mm", "channel_names": [f"c{i}" for i in range(c)], "nodata": -1}
    path = stem.with_suffix(".json")
    path.write_text(json.dumps(told, indent=1))
    return [path], []


# DICOM


def write_series(rng, stem):
    """Slices of one or several time steps, in files of their own."""
    stem.mkdir()
    rows, steps = [int(n) for n in rng.integers(2, 7, 2)], int(pick(rng, 1, 2, 3))
    for z, t in np.ndindex(3, steps):
        rest = np.random.default_rng(int(rows[0]))
        array = noise(rest, "u2", 1, *rows)
        file = described(rest, array, 16, False, 1)
        file.SOPInstanceUID, file.InstanceNumber = f"1.2.3.4.5.{z}.{t}", 1 + t + steps * z
        file.ImageOrientationPatient, file.ImagePositionPatient = [1, 0, 0, 0, 1, 0], [0, 1, 2.5 * z]
        if steps > 1:
            file.TemporalPositionIdentifier, file.TriggerTime, file.AcquisitionTime = t + 1, 40.0 * t, f"1000{t:02}.5"
        file.file_meta.TransferSyntaxUID, file.PixelData = ExplicitVRLittleEndian, array.tobytes()
        file["PixelData"].VR = "OW"
        file.save_as(stem / f"{z}{t}.dcm", enforce_file_format=True)
    return [stem], []


def write_segmentation(rng, stem):
    """Frames of bits or fractions, of two segments."""
    bits, count, rows = bool(rng.random() < 0.6), int(rng.integers(2, 5)), [int(n) for n in rng.integers(3, 9, 2)]
    array = np.zeros((count, *rows), "u1")
    for i in range(count):
        array[i, :, i % rows[1] :: 4] = 1
    file = described(rng, array, 8, False, count)
    file.SOPClassUID = file.file_meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.66.4"
    file.Modality, file.PhotometricInterpretation = "SEG", "MONOCHROME2"
    file.SegmentationType, file.MaximumFractionalValue = "BINARY" if bits else "FRACTIONAL", 200
    file.SegmentSequence = [Dataset() for _ in range(2)]
    for number, segment in enumerate(file.SegmentSequence, 1):
        segment.SegmentNumber, segment.SegmentLabel = number, f"part {number}"
    shared = file.SharedFunctionalGroupsSequence[0]
    shared.pop("PixelValueTransformationSequence", None)
    shared.PixelMeasuresSequence[0].SpacingBetweenSlices = shared.PixelMeasuresSequence[0].SliceThickness
    for i, group in enumerate(file.PerFrameFunctionalGroupsSequence):
        group.SegmentIdentificationSequence = [Dataset()]
        group.SegmentIdentificationSequence[0].ReferencedSegmentNumber = i % 2 + 1
    if bits:
        file.BitsAllocated, file.BitsStored, file.HighBit = 1, 1, 0
    data = np.packbits(array.ravel(), bitorder="little").tobytes() if bits else array.tobytes()
    file.file_meta.TransferSyntaxUID, file.PixelData = ExplicitVRLittleEndian, data + b"\0" * (len(data) % 2)
    file["PixelData"].VR = "OB"
    path = stem.with_suffix(".dcm")
    file.save_as(path, enforce_file_format=True)
    return [path], []


# Each reader by its writers, in the order of risk.
READERS = {
    "hdf5": [by(write_hdf5)],
    "hdf5-tree": [write_tree],
    "imaris": [write_imaris],
    "bigdataviewer": [write_big_data_viewer],
    "netcdf4": [by(write_netcdf, start=b"\x89HDF")],
    "netcdf-classic": [by(write_netcdf, start=b"CDF")],
    "minc": [write_minc],
    "dicom": [by(write_dicom)],
    "dicom-series": [write_series],
    "dicom-segmentation": [write_segmentation],
    "vtk": [by(write_vtk, noise)],
    "pvd": [by(write_pvd, noise)],
    "tiff": [by(write_tiff)],
    "nrrd": [by(write_nrrd), write_detached_nrrd],
    "metaimage": [by(write_meta_image), write_detached_meta_image],
    "pictures": [by(write_pictures)],
    "npz": [by(write_npz), by(write_channels)],
    "npy": [by(write_npy)],
    "nifti": [by(write_nifti)],
    "analyze": [by(write_analyze)],
    "mrc": [by(write_mrc)],
    "envi": [by(write_envi)],
    "bov": [by(write_bov)],
    "raw-json": [write_sidecar],
    "raw": [by(write_raw)],
    "pipe": [by(write_raw)],
}


class Seed:
    """Files of a folder, and the command that reads them."""

    def __init__(self, folder, inputs, flags):
        self.inputs = [path.relative_to(folder) for path in inputs]
        self.flags = [str(flag) for flag in flags]
        self.files = {path.relative_to(folder): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
        # Those that describe the voxels: the input, or all files of an input folder.
        self.headers = [name for name in self.files if name in self.inputs or any(i in name.parents for i in self.inputs)]


def seeds_of(reader, folder, number, count, reads):
    """Up to `count` seeds for which `reads` is true. They follow from the number alone."""
    found = []
    for i in range(MOST_TRIED):
        rng = np.random.default_rng([number, i, *reader.encode()])
        own = folder / str(i)
        own.mkdir(parents=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                seed = Seed(own, *pick(rng, *READERS[reader])(rng, own / "s"))
            except (ValueError, RuntimeError, TypeError, NotImplementedError, ImportError, KeyError):
                # Writers refuse what they cannot write.
                continue
        if sum(map(len, seed.files.values())) <= MOST_BYTES and reads(seed):
            found.append(seed)
            if len(found) == count:
                break
    return found
