"""Files of one object, as scanners of all kinds would lay it down: brickyard shows what SimpleITK resamples, and calls the axes what nibabel
calls them."""

import nibabel
import numpy as np
import pydicom
import pydicom.uid
import SimpleITK
from PIL import Image
from pydicom.dataset import FileDataset, FileMetaDataset

from common import FOLDER, brickyard, check, info, run_cases

MIDDLE = np.array([-12.0, 31.0, 7.0])
SIZE, PIXEL_MM = (64, 48), 0.7
# Of each slice: its axis, what is to the right of the picture, and what is up, right, front and head being x, y and z.
SLICES = {
    "axial": (2, np.array([-1.0, 0, 0]), np.array([0, 1.0, 0])),
    "coronal": (1, np.array([-1.0, 0, 0]), np.array([0, 0, 1.0])),
    "sagittal": (0, np.array([0, -1.0, 0]), np.array([0, 0, 1.0])),
}
LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0])


def object_at(places):
    """A head that is unlike its mirror images, 0 to 1000, at places (..., 3) in millimetres."""
    blobs = [((0, 0, 0), 6, 500), ((-10, 0, 0), 3, 400), ((0, 9, 1), 3, 300), ((1, 2, 10), 3, 200)]
    off = np.asarray(places) - MIDDLE
    return sum(h * np.exp(-((off - at) ** 2).sum(-1) / (2 * w * w)) for at, w, h in blobs)


def affine(axes, spacing, shape):
    """Index to right, front and head, with the object in the middle; `axes` are directions in columns."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.asarray(axes) * spacing
    matrix[:3, 3] = MIDDLE - matrix[:3, :3] @ ((np.array(shape) - 1) / 2)
    return matrix


def voxels(matrix, shape):
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1)
    return np.rint(object_at(index @ matrix[:3, :3].T + matrix[:3, 3])).astype("u2")


def pack(files, expected_code):
    brickyard("pack", *files, "o.zarr", "--overwrite", "--brick", "16", "--progress", "none")
    said = brickyard("info", "o.zarr")
    check(f"axes run to {expected_code}" in said, expected_code, said)


def compare(image, what):
    """Every kind of slice through the store, against SimpleITK's resampling of the image."""
    for name, (axis, right, up) in SLICES.items():
        for step in [-4.0, 0.0, 5.3]:
            target = MIDDLE.copy()
            target[axis] += step
            arguments = ["render", "o.zarr", "-o", "o.png", "--overwrite", "--backend", "cpu", "--size", "%dx%d" % SIZE, "--no-letters"]
            arguments += ["--slice", f"{name}={target[axis]}", "--target=%r,%r,%r" % tuple(target.tolist()), "--transfer", "gray"]
            normal = np.cross(right, up)
            arguments += ["--eye=%r,%r,%r" % tuple((target + 40 * normal).tolist()), "--up=%r,%r,%r" % tuple(up.tolist())]
            brickyard(*arguments, "--ortho", SIZE[1] * PIXEL_MM, "--volume", "0:window=0:1000")
            found = np.asarray(Image.open(FOLDER / "o.png")).astype(float)[..., 0]
            first = target + PIXEL_MM * (-right * (SIZE[0] - 1) / 2 + up * (SIZE[1] - 1) / 2)
            grid = SimpleITK.Image(*SIZE, 1, SimpleITK.sitkFloat64)
            grid.SetSpacing([PIXEL_MM] * 3)
            grid.SetOrigin((LPS_FROM_RAS @ first).tolist())
            directions = [LPS_FROM_RAS @ d for d in [right, -up, np.cross(right, -up)]]
            grid.SetDirection(np.stack(directions, axis=1).ravel().tolist())
            shown = SimpleITK.Resample(image, grid, SimpleITK.Transform(), SimpleITK.sitkLinear, 0.0, SimpleITK.sitkFloat64)
            expected = SimpleITK.GetArrayFromImage(shown)[0] / 1000 * 255
            # A picture has whole levels; a pixel within rounding of the volume's face is in or out.
            off = np.abs(found - expected)
            check(off.mean() < 0.5 and (off > 1.0).mean() < 0.01, what, name, step, off.max(), off.mean(), (off > 1.0).sum())


def nifti(name, matrix, shape):
    nibabel.Nifti1Image(voxels(matrix, shape), matrix).to_filename(FOLDER / name)
    pack([name], "".join(nibabel.aff2axcodes(matrix)))
    compare(SimpleITK.ReadImage(str(FOLDER / name)), name)


def upright_scans():
    """The same voxels in five orders."""
    sides = {"R": (1, 0, 0), "L": (-1, 0, 0), "A": (0, 1, 0), "P": (0, -1, 0), "S": (0, 0, 1), "I": (0, 0, -1)}
    for code in ["RAS", "LAS", "LPS", "LIA", "PIR"]:
        shape = (40, 36, 30)
        axes = np.array([sides[letter] for letter in code], float).T
        nifti(f"{code}.nii", affine(axes, [0.8, 0.9, 1.2], shape), shape)


def oblique_scan():
    """Turned about the axis from left to right."""
    angle = 0.5
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    shape = (40, 36, 30)
    nifti("oblique.nii", affine(turn @ np.diag([-1.0, -1, 1]), [0.8, 0.9, 1.2], shape), shape)


def sheared_scan():
    """SimpleITK has no sheared images: the object itself is what it should look like."""
    shape = (44, 40, 34)
    matrix = affine(np.array([[1.0, 0.3, 0], [0, 1, 0.2], [0, 0, 1]]), [0.8, 0.9, 1.2], shape)
    nibabel.Nifti1Image(voxels(matrix, shape), matrix).to_filename(FOLDER / "sheared.nii")
    pack(["sheared.nii"], "RAS")
    brickyard("render", "o.zarr", "-o", "o.png", "--overwrite", "--backend", "cpu", "--size", "9x9", "--no-letters", "--slice", f"axial={MIDDLE[2]}",
              "--eye=%r,%r,-40" % tuple(MIDDLE[:2].tolist()), "--target=%r,%r,%r" % tuple(MIDDLE.tolist()), "--up=0,1,0", "--ortho", "9", "--transfer", "gray",
              "--volume", "0:window=0:1000")
    found = np.asarray(Image.open(FOLDER / "o.png")).astype(float)[..., 0]
    steps = np.arange(9) - 4.0
    places = MIDDLE + np.stack([-steps[None, :].repeat(9, 0), -steps[:, None].repeat(9, 1), np.zeros((9, 9))], -1)
    # Interpolation between voxels a fifth of a blob apart loses a hundredth of it.
    check(np.abs(found - object_at(places) * 0.255).max() < 3, np.abs(found - object_at(places) * 0.255).max())


def dicom_series():
    """Slices whose rows run to the back and whose columns run to the feet, as sagittal series have them, and oblique ones."""
    for row, column in [((1, 0, 0), (0, 1, 0)), ((0, 1, 0), (0, 0, -1)), ((0.8, 0.6, 0.0), (0.36, -0.48, -0.8))]:
        folder = FOLDER / "series"
        folder.mkdir(exist_ok=True)
        normal = np.cross(row, column)
        shape = (40, 36, 30)
        matrix = affine(LPS_FROM_RAS @ np.array([row, column, normal], float).T, [0.8, 0.9, 1.2], shape)
        data = voxels(matrix, shape)
        for k in range(shape[2]):
            meta = FileMetaDataset()
            meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
            meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = pydicom.uid.CTImageStorage, pydicom.uid.generate_uid()
            file = FileDataset(None, {}, preamble=b"\0" * 128, file_meta=meta)
            file.SOPClassUID, file.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
            file.SeriesInstanceUID, file.Modality, file.InstanceNumber = "1.2.826.0.1.3680043.8.498.1", "CT", k + 1
            place = LPS_FROM_RAS @ (matrix[:3, :3] @ [0, 0, k] + matrix[:3, 3])
            file.ImagePositionPatient = [float(f"{p:.9g}") for p in place]
            file.ImageOrientationPatient = [*row, *column]
            file.PixelSpacing, file.SliceThickness = [0.9, 0.8], 1.2
            file.SamplesPerPixel, file.PhotometricInterpretation = 1, "MONOCHROME2"
            file.Rows, file.Columns = shape[1], shape[0]
            file.BitsAllocated, file.BitsStored, file.HighBit, file.PixelRepresentation = 16, 16, 15, 0
            file.PixelData = np.ascontiguousarray(data[:, :, k].T).tobytes()
            file["PixelData"].VR = "OW"
            pydicom.dcmwrite(folder / f"{k:03}.dcm", file, enforce_file_format=True)
        pack(["series"], "".join(nibabel.aff2axcodes(matrix)))
        reader = SimpleITK.ImageSeriesReader()
        reader.SetFileNames(reader.GetGDCMSeriesFileNames(str(folder)))
        compare(reader.Execute(), f"DICOM {row} {column}")


run_cases({f.__name__: f for f in [upright_scans, oblique_scan, sheared_scan, dicom_series]})
