"""Files exported by brickyard, opened by nibabel, SimpleITK, tifffile, Pillow, numpy, zarr-python and tensorstore: the same voxels, in the same places, with their names and times."""

import json
import xml.etree.ElementTree

import nibabel
import numpy as np
import PIL.Image
import SimpleITK
import tensorstore
import tifffile
import zarr

from common import FOLDER, brickyard, check, info, run_cases, same_bits

RANDOM = np.random.default_rng(7)
LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0])
BOX = (3, 36, 8, 31, 2, 19)


def turned():
    """An oblique matrix from voxels to right, front and head, of unlike spacings."""
    a, b = 0.3, -0.8
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    lean = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    matrix = np.eye(4)
    matrix[:3, :3] = turn @ lean @ np.diag([0.5, 0.65, 2.0])
    matrix[:3, 3] = [-70.0, 12.5, 100.0]
    return matrix


def packed(dtype):
    """Packs a volume of noise; returns its array (z, y, x)."""
    shape = (41, 37, 29)
    if np.dtype(dtype).kind == "f":
        array = RANDOM.standard_normal(shape).astype(dtype)
    else:
        limits = np.iinfo(dtype)
        array = RANDOM.integers(limits.min, limits.max, shape, dtype, endpoint=True)
    image = nibabel.Nifti1Image(array, turned())
    image.header.set_xyzt_units("mm")
    image.to_filename(FOLDER / "a.nii")
    brickyard("pack", "a.nii", "o.zarr", "--overwrite", "--brick", "16", "--progress", "none")
    return array.T


def export(output, *flags):
    brickyard("export", "o.zarr", output, "--overwrite", "--progress", "none", *flags)
    return FOLDER / output


def corners(shape):
    x, y, z = (n - 1 for n in shape)
    return np.array([[0, 0, 0], [x, 0, z], [x, y, z]], float)


def check_place(found, matrix, shape, name):
    """`found` maps indices of voxels to right, front, head."""
    at = corners(shape)
    expected = at @ matrix[:3, :3].T + matrix[:3, 3]
    check(np.abs(found(at) - expected).max() < 1e-4, name, found(at), expected)


def check_with_nibabel(path, array, matrix):
    image = nibabel.load(path)
    check(same_bits(np.asarray(image.dataobj), array.T), path.name, "voxels")
    for affine in [image.affine, image.get_sform(), image.get_qform()]:
        check_place(lambda at: at @ affine[:3, :3].T + affine[:3, 3], matrix, array.T.shape, path.name)
    check(image.header.get_xyzt_units()[0] == "mm", path.name, image.header.get_xyzt_units())


def check_with_simpleitk(path, array, matrix):
    image = SimpleITK.ReadImage(path)
    check(same_bits(SimpleITK.GetArrayFromImage(image), array), path.name, "voxels")
    place = lambda at: np.array([image.TransformContinuousIndexToPhysicalPoint(p.tolist()) for p in at]) @ LPS_FROM_RAS
    check_place(place, matrix, array.T.shape, path.name)


def places():
    for dtype in ["i2", "u1", "f4", "u4", "i1", "u2", "i4"]:
        array = packed(dtype)
        x0, x1, y0, y1, z0, z1 = BOX
        matrix = turned()
        part = matrix.copy()
        part[:3, 3] = (matrix @ [x0, y0, z0, 1])[:3]
        # Level 1 halves the two axes of fine voxels: its first voxel is in the middle of two and two.
        coarse = matrix @ np.diag([2, 2, 1, 1.0])
        coarse[:3, 3] = (matrix @ [0.5, 0.5, 0, 1])[:3]
        level = np.load(export("level.npy", "--level", 1))
        check(level.shape == (29, 19, 21), level.shape)
        roi = f"{x0}:{x1},{y0}:{y1},{z0}:{z1}"
        for flags, expected, place in [
            ((), array, matrix),
            (("--roi", roi), array[z0:z1, y0:y1, x0:x1], part),
            (("--level", 1), level, coarse),
        ]:
            check_with_nibabel(export("b.nii", *flags), expected, place)
            check_with_nibabel(export("b.nii.gz", *flags), expected, place)
            for name in ["b.nii", "b.nii.gz", "b.nrrd", "b.mha", "b.mhd"]:
                check_with_simpleitk(export(name, *flags), expected, place)
            for name in ["b.tif", "b.ome.tif"]:
                found = tifffile.imread(export(name, *flags))
                check(same_bits(found, expected), name, found.shape, found.dtype)
            check(same_bits(np.load(export("b.npy", *flags)), expected), "npy")


def pictures():
    for dtype in ["u1", "u2"]:
        array = packed(dtype)
        folder = FOLDER / f"planes-{dtype}"
        brickyard("export", "o.zarr", f"{folder.name}/", "--progress", "none")
        planes = sorted(folder.iterdir())
        check([p.name for p in planes[:2]] == ["0000.png", "0001.png"], planes[:2])
        found = np.stack([np.asarray(PIL.Image.open(p)).astype(dtype) for p in planes])
        check(same_bits(found, array), "pictures")


def texts():
    """A raw file and its text come back without a flag, with the same place."""
    array = packed("i2")
    before = info("o.zarr")["store"]
    export("b.raw")
    brickyard("pack", "b.raw", "p.zarr", "--overwrite", "--brick", "16", "--progress", "none")
    after = info("p.zarr")["store"]
    check(np.fromfile(FOLDER / "b.raw", "<i2").tobytes() == array.tobytes(), "voxels")
    for field in ["orientation", "spacing", "calibrated"]:
        check(before[field] == after[field], field, before[field], after[field])
    check(json.loads((FOLDER / "b.raw.json").read_text())["unit"] == "millimeter", "unit")


def ome_of(folder):
    attributes = dict(zarr.open_group(folder, mode="r").attrs)
    return attributes.get("ome", attributes)


def level_of(folder, version, path):
    """A level's array by zarr-python, which tensorstore reads alike."""
    array = zarr.open_array(folder / path, mode="r")
    found = array[...]
    driver = "zarr" if version == "0.4" else "zarr3"
    store = tensorstore.open({"driver": driver, "kvstore": {"driver": "file", "path": str(folder / path)}}).result()
    check(array.metadata.zarr_format == (2 if version == "0.4" else 3), folder.name, array.metadata.zarr_format)
    check(same_bits(found, store.read().result()), folder.name, path, "zarr-python and tensorstore differ")
    return found


def transform_of(dataset):
    """Scale and translation of a level."""
    transforms = dataset["coordinateTransformations"]
    if transforms[0]["type"] == "sequence":
        transforms = transforms[0]["transformations"]
    return np.array(transforms[0]["scale"]), np.array(transforms[1]["translation"])


def zarrs():
    """OME-Zarr of every version: levels bit for bit, and places, of a patient where the version has them."""
    x0, x1, y0, y1, z0, z1 = BOX
    for dtype in ["i2", "u1", "f4", "i1"]:
        array, matrix = packed(dtype), turned()
        for version in ["0.4", "0.5", "0.6"]:
            folder = export(f"z{version}.ome.zarr", "--ngff", version)
            datasets = ome_of(folder)["multiscales"][0]["datasets"]
            check(len(datasets) > 1, datasets)
            for k, dataset in enumerate(datasets):
                expected = np.load(export("level.npy", "--level", k))
                check(same_bits(level_of(folder, version, dataset["path"]), expected), version, "level", k)
                factors = 2.0 ** np.round(np.log2(np.array(array.shape) / expected.shape))
                scale, translation = transform_of(dataset)
                check(np.allclose(scale, factors * [2.0, 0.65, 0.5]), version, k, scale)
                first = transform_of(datasets[0])
                check(np.allclose(translation - first[1], (scale - first[0]) / 2), version, k, translation)
            folder = export(f"z{version}.ome.zarr", "--ngff", version, "--roi", f"{x0}:{x1},{y0}:{y1},{z0}:{z1}")
            part = array[z0:z1, y0:y1, x0:x1]
            check(same_bits(level_of(folder, version, "0"), part), version, "box")
            if version == "0.6":
                multiscale = ome_of(folder)["multiscales"][0]
                affine = np.array(multiscale["coordinateTransformations"][0]["affine"])
                scale, translation = transform_of(multiscale["datasets"][0])
                place = lambda at: ((at[:, ::-1] * scale + translation) @ affine[:, :3].T + affine[:, 3])[:, ::-1]
                moved = matrix.copy()
                moved[:3, 3] = (matrix @ [x0, y0, z0, 1])[:3]
                check_place(place, moved, part.T.shape, "0.6")
    done = json.loads((FOLDER / "z0.5.ome.zarr" / "zarr.json").read_text())
    check(done["attributes"]["brickyard"]["orientation"] is not None, "0.5")
    brickyard("verify", "z0.5.ome.zarr", "--progress", "none")


def series():
    """Channels with names and colours, in steps half a second apart."""
    array = RANDOM.integers(0, 60000, (3, 5, 2, 20, 30), "u2")
    metadata = {
        "axes": "TZCYX",
        "PhysicalSizeX": 0.65, "PhysicalSizeXUnit": "µm", "PhysicalSizeY": 0.65, "PhysicalSizeYUnit": "µm",
        "PhysicalSizeZ": 2.0, "PhysicalSizeZUnit": "µm", "TimeIncrement": 0.5, "TimeIncrementUnit": "s",
        "Channel": {"Name": ["DAPI", "GFP & <b>"], "Color": [0x0000FFFF, 0x00FF00FF]},
    }
    tifffile.imwrite(FOLDER / "c.ome.tif", array, photometric="minisblack", metadata=metadata)
    brickyard("pack", "c.ome.tif", "o.zarr", "--overwrite", "--brick", "16", "--progress", "none")
    everything = ["--channel", "all", "--time", "all"]
    with tifffile.TiffFile(export("d.ome.tif", *everything)) as file:
        check(same_bits(file.asarray(), array) and file.series[0].axes == "TZCYX", file.series[0].axes, file.series[0].shape)
        pixels = xml.etree.ElementTree.fromstring(file.ome_metadata).find(".//{*}Pixels")
        said = {key: pixels.get(key) for key in ["PhysicalSizeX", "PhysicalSizeZ", "PhysicalSizeZUnit", "TimeIncrement", "TimeIncrementUnit"]}
        check(list(said.values()) == ["0.65", "2", "µm", "0.5", "s"], said)
        channels = [(c.get("Name"), c.get("Color")) for c in pixels.findall("{*}Channel")]
        check(channels == [("DAPI", "65535"), ("GFP & <b>", "16711935")], channels)
    with tifffile.TiffFile(export("d.tif", *everything)) as file:
        check(file.is_imagej and same_bits(file.asarray(), array), file.series[0].axes, file.series[0].shape)
        said = file.imagej_metadata
        found = [said.get(key) for key in ["channels", "slices", "frames", "spacing", "unit", "finterval"]]
        check(found == [2, 5, 3, 2.0, "micron", 0.5], found)
        check(len(said["LUTs"]) == 2 and said["LUTs"][0][:, 255].tolist() == [0, 0, 255], said["LUTs"])
        numerator, denominator = file.pages[0].tags["XResolution"].value
        check(abs(denominator / numerator - 0.65) < 1e-9, numerator, denominator)
    for version in ["0.4", "0.5", "0.6"]:
        folder = export(f"d{version}.ome.zarr", "--ngff", version, *everything)
        ome = ome_of(folder)
        check(same_bits(level_of(folder, version, "0"), array.transpose(0, 2, 1, 3, 4)), version)
        scale, translation = transform_of(ome["multiscales"][0]["datasets"][0])
        check(np.allclose(scale, [0.5, 1, 2, 0.65, 0.65]) and not translation.any(), version, scale, translation)
        channels = [(c["label"], c["color"]) for c in ome["omero"]["channels"]]
        check(channels == [("DAPI", "0000FF"), ("GFP & <b>", "00FF00")], channels)
    image = nibabel.load(export("d.nii", *everything))
    check(same_bits(np.asarray(image.dataobj), array.transpose(4, 3, 1, 0, 2)), "nii", image.shape)
    check(image.header.get_xyzt_units() == ("micron", "sec") and abs(image.header["pixdim"][4] - 0.5) < 1e-6, "nii times")
    check(same_bits(np.load(export("d.npy", *everything)), array.transpose(0, 2, 1, 3, 4)), "npy")
    found = SimpleITK.ReadImage(export("d.nrrd", "--channel", "GFP & <b>,DAPI", "--time", 1))
    check(found.GetNumberOfComponentsPerPixel() == 2, "nrrd", found.GetSize())
    check(same_bits(SimpleITK.GetArrayFromImage(found), array[1, :, ::-1].transpose(0, 2, 3, 1)), "nrrd")
    found = SimpleITK.ReadImage(export("d.mha", "--channel", 1, "--time", "all"))
    check(same_bits(SimpleITK.GetArrayFromImage(found), array[:, :, 1]) and found.GetSpacing()[3] == 0.5, "mha", found.GetSpacing())


run_cases({"places": places, "pictures": pictures, "texts": texts, "zarrs": zarrs, "series": series})
