"""Random images of VTK for differential.py, written and read again by VTK itself: .vti, legacy .vtk, and .pvd collections."""

import numpy as np
import vtk
from differential_check import Case, Reference
from vtk.util.numpy_support import vtk_to_numpy

TYPES = {
    vtk.VTK_CHAR: "i1",
    vtk.VTK_SIGNED_CHAR: "i1",
    vtk.VTK_UNSIGNED_CHAR: "u1",
    vtk.VTK_SHORT: "i2",
    vtk.VTK_UNSIGNED_SHORT: "u2",
    vtk.VTK_INT: "i4",
    vtk.VTK_UNSIGNED_INT: "u4",
    vtk.VTK_LONG: "i8",
    vtk.VTK_UNSIGNED_LONG: "u8",
    vtk.VTK_LONG_LONG: "i8",
    vtk.VTK_UNSIGNED_LONG_LONG: "u8",
    vtk.VTK_ID_TYPE: "i8",
    vtk.VTK_FLOAT: "f4",
    vtk.VTK_DOUBLE: "f8",
}


def pick(rng, *choices):
    return choices[rng.integers(len(choices))]


def write_vtk(rng, stem, name, noise):
    """One image in either format; `noise` makes values of a type and shape."""
    image, cells = random_image(rng, noise)
    legacy = rng.random() < 0.35
    path = stem.with_suffix(".vtk" if legacy else ".vti")
    if legacy:
        group = write_legacy(rng, image, path)
    else:
        group = write_xml(rng, image, path)
    reader = vtk.vtkStructuredPointsReader() if legacy else vtk.vtkXMLImageDataReader()
    case = Case(name, "written", "VTK", group, [path], lambda: vtk_reference(reader, path, "wanted", cells))
    case.flags = ["--variable", "wanted"] if several(image) and rng.random() < 0.7 or not scalars(image, cells) else []
    case.must_refuse = "LZMA" in group
    return case


def write_pvd(rng, stem, name, noise):
    """A collection of images in no order, at uneven times."""
    stem.mkdir(exist_ok=True)
    count = int(rng.integers(1, 6))
    image, cells = random_image(rng, noise)
    first = data_of(image, cells).GetArray("wanted")
    times = np.sort(rng.choice(1000, count, replace=False) / 8.0 - 20)
    files, arrays = [], []
    settings = rng.integers(1 << 30)
    for i in range(count):
        fill(first, noise(rng, TYPES[first.GetDataType()], first.GetNumberOfTuples() * first.GetNumberOfComponents()))
        data_of(image, cells).SetActiveScalars("wanted")
        write_xml(np.random.default_rng(settings), image, stem / f"s{i}.vti", lzma=False)
        files.append(f"s{i}.vti")
    sets = [f'    <DataSet timestep="{float(t)!r}" group="" part="0" file="{f}"/>\n' for t, f in zip(times, files)]
    path = stem / "all.pvd"
    path.write_text(
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        + "".join(sets[i] for i in rng.permutation(count))
        + "  </Collection>\n</VTKFile>\n"
    )

    def reference():
        steps = [vtk_reference(vtk.vtkXMLImageDataReader(), stem / f, "wanted", cells) for f in files]
        steps[0].array = np.concatenate([s.array for s in steps])
        return steps[0]

    # Its files lie beside it.
    return Case(name, "written", "VTK", "pvd", [path], reference, ["--variable", "wanted"], alone=False)


def random_image(rng, noise):
    """An image, and whether its array `wanted` is of cells."""
    image = vtk.vtkImageData()
    sizes = [int(n) for n in rng.integers(1, 24, 3)]
    if rng.random() < 0.2:
        sizes[rng.integers(3)] = 1
    starts = [int(n) for n in (rng.integers(-9, 10, 3) if rng.random() < 0.5 else np.zeros(3, int))]
    image.SetExtent(*[e for s, n in zip(starts, sizes) for e in (s, s + n - 1)])
    image.SetSpacing(*(float(n) for n in rng.choice([0.25, 0.5, 1.0, 2.75, 0.1], 3)))
    image.SetOrigin(*(float(n) for n in rng.choice([-90.5, 0.0, 12.25, 3.1], 3)))
    if rng.random() < 0.3:
        turn = np.linalg.qr(rng.standard_normal((3, 3)))[0] if rng.random() < 0.5 else np.eye(3)[rng.permutation(3)] * pick(rng, 1, -1)
        image.SetDirectionMatrix(*(float(n) for n in turn.ravel()))
    cells = bool(rng.random() < 0.25)
    for place in (False, True):
        count = image.GetNumberOfCells() if place else image.GetNumberOfPoints()
        names = [f"other {i}" for i in range(rng.integers(0, 3))] + (["wanted"] if place == cells else [])
        for at in rng.permutation(len(names)):
            array = vtk.vtkDataArray.CreateDataArray(pick(rng, *TYPES))
            array.SetName(names[at])
            array.SetNumberOfComponents(int(pick(rng, 1, 1, 1, 2, 3, 3, 4, 9)))
            array.SetNumberOfTuples(count)
            if rng.random() < 0.2:
                for c in range(array.GetNumberOfComponents()):
                    array.SetComponentName(c, f"part {c}")
            fill(array, noise(rng, TYPES[array.GetDataType()], count * array.GetNumberOfComponents()))
            data_of(image, place).AddArray(array)
    if rng.random() < 0.7:
        data_of(image, cells).SetActiveScalars("wanted")
    return image, cells


def data_of(image, cells):
    return image.GetCellData() if cells else image.GetPointData()


def fill(array, values):
    # VTK reads the -inf that it writes in words as inf.
    if values.dtype.kind == "f":
        values[values == -np.inf] = np.inf
    vtk_to_numpy(array).reshape(-1)[:] = values


def several(image):
    return image.GetPointData().GetNumberOfArrays() + image.GetCellData().GetNumberOfArrays() > 1


def scalars(image, cells):
    """Whether `wanted` is what is read unless another is asked for."""
    first = image.GetPointData().GetScalars() or image.GetCellData().GetScalars()
    return not several(image) or first is not None and first.GetName() == "wanted"


def write_xml(rng, image, path, lzma=True):
    writer = vtk.vtkXMLImageDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(image)
    mode = pick(rng, "Ascii", "Binary", "Appended", "Appended")
    getattr(writer, f"SetDataModeTo{mode}")()
    compressor = pick(rng, "None", "ZLib", "ZLib", "LZ4", "LZ4", "LZMA" if lzma and rng.random() < 0.3 else "None")
    getattr(writer, f"SetCompressorTypeTo{compressor}")()
    writer.SetEncodeAppendedData(bool(rng.random() < 0.5))
    getattr(writer, pick(rng, "SetHeaderTypeToUInt32", "SetHeaderTypeToUInt64"))()
    getattr(writer, pick(rng, "SetByteOrderToLittleEndian", "SetByteOrderToBigEndian"))()
    writer.SetBlockSize(int(pick(rng, 64, 256, 1024, 32768)))
    pieces = int(pick(rng, 1, 1, 1, 2, 3, 5)) if min(image.GetDimensions()) > 4 else 1
    writer.SetNumberOfPieces(pieces)
    if writer.Write() != 1:
        raise RuntimeError("not written")
    group = f"vti {mode}" if mode == "Ascii" else f"vti {mode} {compressor}"
    return group + (" pieces" if pieces > 1 else "")


def write_legacy(rng, image, path):
    writer = vtk.vtkStructuredPointsWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(image)
    binary = rng.random() < 0.6
    writer.SetFileTypeToBinary() if binary else writer.SetFileTypeToASCII()
    writer.SetFileVersion(int(pick(rng, 42, 51)))
    writer.SetHeader("by VTK")
    if writer.Write() != 1:
        raise RuntimeError("not written")
    return "vtk binary" if binary else "vtk ascii"


def vtk_reference(reader, path, wanted, cells):
    reader.SetFileName(str(path))
    if isinstance(reader, vtk.vtkStructuredPointsReader):
        reader.ReadAllScalarsOn(), reader.ReadAllFieldsOn(), reader.ReadAllVectorsOn(), reader.ReadAllTensorsOn()
    reader.Update()
    image = reader.GetOutput()
    array = data_of(image, cells).GetArray(wanted)
    sizes = [max(1, n - 1) if cells else n for n in image.GetDimensions()]
    values = vtk_to_numpy(array).reshape(sizes[2], sizes[1], sizes[0], array.GetNumberOfComponents())
    reference = Reference(np.ascontiguousarray(values.transpose(3, 0, 1, 2))[np.newaxis], spacing=image.GetSpacing())
    # Places of voxels as VTK computes them: of the points around a cell, the mean.
    first = [e + (0.5 if cells and n > 1 else 0.0) for e, n in zip(image.GetExtent()[::2], image.GetDimensions())]
    at = lambda *step: np.array(image_place(image, [f + s for f, s in zip(first, step)]))
    origin = at(0, 0, 0)
    reference.matrix = np.stack([at(1, 0, 0) - origin, at(0, 1, 0) - origin, at(0, 0, 1) - origin, origin], axis=1)
    return reference


def image_place(image, index):
    out = [0.0] * 3
    image.TransformContinuousIndexToPhysicalPoint(index, out)
    return out


def vtk_case(label, collection, path):
    """A file of a collection, which may hold any data set."""
    return Case(label, collection, "VTK", path.suffix.lower(), [path], lambda: file_reference(path))


def file_reference(path):
    legacy = path.suffix.lower() == ".vtk"
    reader = vtk.vtkGenericDataObjectReader() if legacy else vtk.vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    image = reader.GetOutput()
    if not isinstance(image, vtk.vtkImageData) or image.GetNumberOfPoints() == 0:
        raise ValueError("not an image")
    for cells in (False, True):
        data = data_of(image, cells)
        chosen = data.GetScalars() or (None if several(image) else data.GetArray(0))
        if chosen is not None:
            again = vtk.vtkStructuredPointsReader() if legacy else reader
            return vtk_reference(again, path, chosen.GetName(), cells)
    raise ValueError("several arrays, and no scalars")
