#!/usr/bin/env python3
"""A volume of 4 GiB in every readable format, written by other programs: packed within 512 MiB of memory as the kernel counts it, and compared
at its corners. With `--rates`, beside the writer's own plain read of the same file, and beside packing the same voxels from a raw file: medians
of seven, in turns; the last column is the median of each turn's own ratio, and its range.

  large_inputs.py [FORMAT...] [--rates] [--gib 4] [--memory 512MiB] [--brickyard target/release/brickyard] [--out target/large-inputs]

It works in the Python environment of differential.py, and needs three times the volume's size on the disk; each file is deleted before the next.
A table goes to standard output. It exits with 1 if a format is over its memory, or its voxels differ.
"""

import argparse
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from differential import ROOT, enter_environment, parsed
from measuring import bytes_of, measured

# Turns of the rates' table: a machine's own rate changes by a tenth from one to the next.
ROUNDS = 7
# Voxels along x and y of every plane.
PLANE = 1024
# The formats of the rates' table, when none is named.
RATED = ["hdf5-gzip", "netcdf4-zlib", "nrrd-gzip", "tiff-deflate", "dicom", "nifti"]


def arguments():
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("formats", nargs="*")
    ap.add_argument("--rates", action="store_true")
    ap.add_argument("--gib", default=4.0, type=float)
    ap.add_argument("--memory", default="512MiB")
    ap.add_argument("--out", default=ROOT / "target/large-inputs", type=pathlib.Path)
    return parsed(ap)


class Volume:
    """The voxels in a raw file, 16 bits below 4096, so that signed and unsigned types hold them alike."""

    def __init__(self, folder, gib):
        self.shape = (int(gib * (1 << 30)) // (PLANE * PLANE * 2), PLANE, PLANE)
        self.path = folder / "volume.raw"
        y, x = np.mgrid[0:PLANE, 0:PLANE]
        with open(self.path, "wb") as file:
            for z in range(self.shape[0]):
                # Smooth, with noise in the last two bits: it packs to some half.
                plane = (x + 3 * y + 7 * z) // 8 * 4 + (x * 31 + y * 17 + z * 13) % 4
                file.write((plane % 4096).astype("<u2").tobytes())

    def array(self, dtype="<u2"):
        return np.memmap(self.path, dtype, "r", shape=self.shape)

    def planes(self, dtype="<u2"):
        return iter(self.array(dtype))

    def flags(self):
        z, y, x = self.shape
        return ["--shape", f"{x},{y},{z}", "--dtype", "u16"]


def pillow(end, narrowed=False, **options):
    def write(volume, folder):
        from PIL import Image

        for number, plane in enumerate(volume.planes()):
            Image.fromarray((plane >> 4).astype("u1") if narrowed else plane).save(folder / f"{number:05}.{end}", **options)
        return folder

    return write


def read_pillow(path):
    from PIL import Image

    for name in sorted(path.iterdir()):
        np.asarray(Image.open(name))


def write_npy(volume, folder):
    np.save(folder / "v.npy", volume.array())
    return folder / "v.npy"


def npz(save):
    def write(volume, folder):
        getattr(np, save)(folder / "v.npz", volume=volume.array())
        return folder / "v.npz"

    return write


def nibabel_of(end, kind="Nifti1Image"):
    def write(volume, folder):
        import nibabel

        nibabel.openers.Opener.default_compresslevel = 1
        nibabel.openers.Opener.default_zst_compresslevel = 1
        array = volume.array("<i2" if kind == "AnalyzeImage" else "<u2").T
        getattr(nibabel, kind)(array, np.eye(4)).to_filename(folder / f"v{end}")
        return folder / (f"v{end}" if end != ".img" else "v.hdr")

    return write


def read_nibabel(path):
    import nibabel

    np.array(nibabel.load(path).dataobj)


def nrrd(encoding):
    def write(volume, folder):
        import nrrd as pynrrd

        pynrrd.write(str(folder / "v.nrrd"), volume.array(), {"encoding": encoding}, index_order="C", compression_level=1)
        return folder / "v.nrrd"

    return write


def read_nrrd(path):
    import nrrd as pynrrd

    pynrrd.read(str(path), index_order="C")


def meta_image(compressed):
    def write(volume, folder):
        import SimpleITK

        image = SimpleITK.GetImageFromArray(volume.array())
        SimpleITK.WriteImage(image, str(folder / "v.mha"), compressed, 1)
        return folder / "v.mha"

    return write


def write_mrc(volume, folder):
    import mrcfile

    with mrcfile.new_mmap(folder / "v.mrc", volume.shape, mrc_mode=6) as mrc:
        for z, plane in enumerate(volume.planes()):
            mrc.data[z] = plane
    return folder / "v.mrc"


def vtk_image(volume):
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk

    image = vtk.vtkImageData()
    image.SetDimensions(*volume.shape[::-1])
    scalars = numpy_to_vtk(np.fromfile(volume.path, "<u2"))
    scalars.SetName("density")
    image.GetPointData().SetScalars(scalars)
    return image


def vti(compressor):
    def write(volume, folder):
        import vtk

        writer = vtk.vtkXMLImageDataWriter()
        writer.SetFileName(str(folder / "v.vti"))
        writer.SetInputData(vtk_image(volume))
        writer.SetHeaderTypeToUInt64()
        getattr(writer, f"SetCompressorTypeTo{compressor}")()
        writer.EncodeAppendedDataOff()
        writer.Write()
        return folder / "v.vti"

    return write


def write_legacy_vtk(volume, folder):
    import vtk

    writer = vtk.vtkStructuredPointsWriter()
    writer.SetFileName(str(folder / "v.vtk"))
    writer.SetInputData(vtk_image(volume))
    writer.SetFileTypeToBinary()
    writer.Write()
    return folder / "v.vtk"


def hdf5(**options):
    def write(volume, folder):
        import h5py

        with h5py.File(folder / "v.h5", "w") as file:
            data = file.create_dataset("data", volume.shape, "<u2", **options)
            for z in range(0, volume.shape[0], 64):
                data[z : z + 64] = volume.array()[z : z + 64]
        return folder / "v.h5"

    return write


def bitshuffle(volume, folder):
    import hdf5plugin

    return hdf5(chunks=(1, PLANE, PLANE), **hdf5plugin.Bitshuffle(cname="lz4"))(volume, folder)


def read_hdf5(path):
    import h5py
    import hdf5plugin  # noqa: F401

    with h5py.File(path) as file:
        data = file["data"]
        for z in range(0, data.shape[0], 64):
            data[z : z + 64]


def netcdf(form, **options):
    def write(volume, folder):
        import netCDF4

        # The classic forms have no unsigned 16 bits.
        dtype = "u2" if form == "NETCDF4" else "i2"
        with netCDF4.Dataset(folder / "v.nc", "w", format=form) as file:
            for name, size in zip("zyx", volume.shape):
                file.createDimension(name, size)
            data = file.createVariable("data", dtype, tuple("zyx"), **options)
            for z in range(0, volume.shape[0], 64):
                data[z : z + 64] = volume.array()[z : z + 64]
        return folder / "v.nc"

    return write


def read_netcdf(path):
    import netCDF4

    with netCDF4.Dataset(path) as file:
        data = file["data"]
        data.set_auto_maskandscale(False)
        for z in range(0, data.shape[0], 64):
            data[z : z + 64]


def tiff(single=False, **options):
    def write(volume, folder):
        import tifffile

        if single:
            for number, plane in enumerate(volume.planes()):
                tifffile.imwrite(folder / f"{number:05}.tif", plane, **options)
            return folder
        with tifffile.TiffWriter(folder / "v.tif", bigtiff=True) as file:
            for plane in volume.planes():
                file.write(plane, contiguous=not options, metadata=None, **options)
        return folder / "v.tif"

    return write


def read_tiff(path):
    import tifffile

    with tifffile.TiffFile(path) as file:
        for page in file.pages:
            page.asarray()


def write_dicom(volume, folder):
    import pydicom
    from pydicom.dataset import FileDataset, FileMetaDataset
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, generate_uid

    series, study, frame = generate_uid(), generate_uid(), generate_uid()
    for number, plane in enumerate(volume.planes()):
        meta = FileMetaDataset()
        meta.MediaStorageSOPClassUID, meta.TransferSyntaxUID = CTImageStorage, ExplicitVRLittleEndian
        meta.MediaStorageSOPInstanceUID = generate_uid()
        slice_ = FileDataset(None, {}, file_meta=meta, preamble=b"\0" * 128)
        slice_.SOPClassUID, slice_.SOPInstanceUID = CTImageStorage, meta.MediaStorageSOPInstanceUID
        slice_.StudyInstanceUID, slice_.SeriesInstanceUID, slice_.FrameOfReferenceUID = study, series, frame
        slice_.Modality, slice_.InstanceNumber = "CT", number + 1
        slice_.Rows, slice_.Columns, slice_.PixelSpacing = PLANE, PLANE, [1, 1]
        slice_.ImagePositionPatient, slice_.ImageOrientationPatient = [0, 0, number], [1, 0, 0, 0, 1, 0]
        slice_.SamplesPerPixel, slice_.PhotometricInterpretation = 1, "MONOCHROME2"
        slice_.BitsAllocated, slice_.BitsStored, slice_.HighBit, slice_.PixelRepresentation = 16, 16, 15, 0
        slice_.PixelData = plane.tobytes()
        pydicom.dcmwrite(folder / f"{number:05}.dcm", slice_, enforce_file_format=True)
    return folder


def read_dicom(path):
    import pydicom

    for name in sorted(path.iterdir()):
        pydicom.dcmread(name).pixel_array


def described(end, text):
    """A raw file beside a text that describes it."""

    def write(volume, folder):
        shutil.copyfile(volume.path, folder / "v.raw")
        z, y, x = volume.shape
        (folder / f"v{end}").write_text(text.format(x=x, y=y, z=z))
        return folder / f"v{end}"

    return write


ENVI = "ENVI\nsamples = {x}\nlines = {y}\nbands = {z}\nheader offset = 0\ndata type = 12\ninterleave = bsq\nbyte order = 0\n"
BOV = "DATA_FILE: v.raw\nDATA_SIZE: {x} {y} {z}\nDATA_FORMAT: SHORT\nDATA_ENDIAN: LITTLE\n"

# Each format: its writer, and a plain read of its file by independent software.
FORMATS = {
    "npy": (write_npy, lambda path: np.load(path)),
    "npz": (npz("savez"), None),
    "npz-deflate": (npz("savez_compressed"), lambda path: np.load(path)["volume"]),
    "nifti": (nibabel_of(".nii"), read_nibabel),
    "nifti-gzip": (nibabel_of(".nii.gz"), read_nibabel),
    "analyze": (nibabel_of(".img", "AnalyzeImage"), None),
    "nrrd": (nrrd("raw"), read_nrrd),
    "nrrd-gzip": (nrrd("gzip"), read_nrrd),
    "metaimage": (meta_image(False), None),
    "metaimage-zlib": (meta_image(True), None),
    "mrc": (write_mrc, None),
    "vti-zlib": (vti("ZLib"), None),
    "vti-lz4": (vti("LZ4"), None),
    "vtk": (write_legacy_vtk, None),
    "hdf5": (hdf5(), read_hdf5),
    "hdf5-gzip": (hdf5(chunks=(64, 64, 64), compression="gzip", compression_opts=1, shuffle=True), read_hdf5),
    "hdf5-planes": (hdf5(chunks=(1, PLANE, PLANE), compression="gzip", compression_opts=1), read_hdf5),
    "hdf5-bitshuffle": (bitshuffle, read_hdf5),
    "netcdf4-zlib": (netcdf("NETCDF4", compression="zlib", complevel=1, chunksizes=(64, 64, 64)), read_netcdf),
    "netcdf-cdf5": (netcdf("NETCDF3_64BIT_DATA"), read_netcdf),
    "tiff": (tiff(), read_tiff),
    "tiff-deflate": (tiff(compression="zlib", compressionargs={"level": 1}), read_tiff),
    "tiff-planes": (tiff(single=True), None),
    "dicom": (write_dicom, read_dicom),
    "png": (pillow("png", compress_level=1), read_pillow),
    "jpeg": (pillow("jpg", narrowed=True), None),
    "bmp": (pillow("bmp", narrowed=True), None),
    "envi": (described(".hdr", ENVI), None),
    "bov": (described(".bov", BOV), None),
}


def packed(a, inputs, store, is_watched=False):
    """Packs anew."""
    shutil.rmtree(store, ignore_errors=True)
    command = [a.brickyard, "pack", *inputs, store, "--memory", a.memory, "--progress", "none", "--scratch", a.out, "-q"]
    return measured(command, is_watched)


def differs(a, volume, store, name):
    """Compares boxes at three corners and in the middle."""
    z, y, x = (size - 8 for size in volume.shape)
    for x0, y0, z0 in [(0, 0, 0), (x, 0, z), (x, y, z), (x // 2, y // 2, z // 2)]:
        box = f"{x0}:{x0 + 8},{y0}:{y0 + 8},{z0}:{z0 + 8}"
        out = a.out / "box.npy"
        command = [a.brickyard, "export", store, out, "--roi", box, "--overwrite", "--progress", "none", "-q"]
        subprocess.run([str(word) for word in command], check=True)
        expected = volume.array()[z0 : z0 + 8, y0 : y0 + 8, x0 : x0 + 8].astype(int)
        expected = expected >> 4 if name in ("jpeg", "bmp") else expected
        # JPEG is lossy: its own loss at the default quality is some tens here.
        if np.abs(np.load(out).astype(int) - expected).max() > (64 if name == "jpeg" else 0):
            return f"differs in {box}"
    return ""


def others(a, volume, read, path, store):
    """Seconds of the format's own read, and of a pack from a raw file."""
    started = time.monotonic()
    read(path)
    own = time.monotonic() - started
    return own, packed(a, [volume.path, *volume.flags()], store).seconds


def main():
    a = arguments()
    enter_environment(ROOT / "target/differential")
    global np
    import numpy as np

    names = a.formats or (RATED if a.rates else list(FORMATS))
    shutil.rmtree(a.out, ignore_errors=True)
    a.out.mkdir(parents=True)
    volume = Volume(a.out, a.gib)
    allowed = bytes_of(a.memory)
    mb = volume.path.stat().st_size / 1e6
    head = ["format", f"memory of {a.memory}, MiB"]
    print("| " + " | ".join(head + (["MB/s", "its own read, MB/s", "pack of raw, MB/s", "of the slower"] if a.rates else [])) + " |", flush=True)
    bad = False
    for name in names:
        write, read = FORMATS[name]
        folder, store = a.out / name, a.out / "o.zarr"
        folder.mkdir()
        path = write(volume, folder)
        # Else the disk is still busy with it in the first turns.
        os.sync()
        most = packed(a, [path], store, is_watched=True).most_bytes
        problem = differs(a, volume, store, name)
        rates = []
        if a.rates:
            rounds = [(packed(a, [path], store).seconds, *others(a, volume, read, path, store)) for _ in range(ROUNDS)]
            ratios = sorted(max(own, raw) / seconds for seconds, own, raw in rounds)
            seconds, own, raw = (statistics.median(column) for column in zip(*rounds))
            of_slower = f"{statistics.median(ratios):.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f})"
            rates = [f"{mb / seconds:.0f}", f"{mb / own:.0f}", f"{mb / raw:.0f}", of_slower]
        row = [name, f"{most >> 20}", *rates]
        bad |= bool(problem) or most > allowed
        print("| " + " | ".join(row) + f" | {problem}{' OVER MEMORY' * (most > allowed)}", flush=True)
        shutil.rmtree(folder)
    shutil.rmtree(a.out)
    sys.exit(bad)


if __name__ == "__main__":
    main()
