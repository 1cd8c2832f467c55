#!/usr/bin/env python3
"""Random stores, exported by brickyard to every format, and opened by other programs: voxels bit for bit, three corners' places, names and times.

    pip install 'ngff-zarr[validate]' nibabel numpy ome-zarr ome-zarr-models pillow pynrrd SimpleITK slicerio tifffile vtk zarr
    tools/differential_exports.py --brickyard target/release/brickyard --count 200 --seed 1

Each case packs a raw file of noise with a text that places it, then exports a box of a level, of some channels and steps, to every format. Files are also
packed again, and compared with the export to .npy; coarser levels of OME-Zarr are compared with means. At last the store is made labels for .seg.nrrd. Prints each difference, and counts of files: equal, refused, wrong.
"""

import argparse
import collections
import json
import pathlib
import subprocess
import sys
import tempfile
import xml.etree.ElementTree

import ngff_zarr
import nibabel
import nrrd
import numpy as np
import ome_zarr.io
import ome_zarr.reader
import ome_zarr_models
import PIL.Image
import SimpleITK
import slicerio
import tifffile
import vtk
import zarr
from vtk.util.numpy_support import vtk_to_numpy

DTYPES = {"u8": "u1", "i8": "i1", "u16": "u2", "i16": "i2", "u32": "u4", "i32": "i4", "f32": "f4"}
METRES = {"millimeter": 1e-3, "micrometer": 1e-6, "nanometer": 1e-9, "meter": 1.0, "inch": 0.0254, None: 1e-3}
SECONDS = {"second": 1.0, "millisecond": 1e-3, "hour": 3600.0}
FORMATS = ["npy", "nii", "nii.gz", "nrrd", "mha", "mhd", "vti", "pvd", "tif", "ome.tif", "/", "raw", "0.4.zarr", "0.5.zarr", "0.6.zarr", "seg.nrrd"]
LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0])


class Wrong(Exception):
    pass


def expect(condition, *what):
    if not condition:
        raise Wrong(" ".join(str(w) for w in what))


class Case:
    """A store of noise in a random place, and a random part of it."""

    def __init__(self, random, folder, command):
        self.random, self.folder, self.command = random, folder, command
        whole = lambda low, high: int(random.integers(low, high, endpoint=True))
        self.dtype = str(random.choice(list(DTYPES)))
        self.shape = [whole(1, 40) for _ in range(3)]
        self.channels, self.times = int(random.choice([1, 1, 2, 3])), int(random.choice([1, 1, 2, 4]))
        self.spacing = np.round(10.0 ** random.uniform(-2, 2, 3), 4)
        if random.random() < 0.5:
            self.spacing[:] = self.spacing[0] * random.choice([1, 1, 1.2, 3], 3)
        self.unit = random.choice(list(METRES)[:-1] + ["none"])
        self.unit = None if self.unit == "none" else str(self.unit)
        self.place = str(random.choice(["none", "origin", "upright", "turned", "mirrored", "sheared"]))
        self.names = [f"ch {i} <&\"{chr(0xE9 + i)}>" for i in range(self.channels)] if random.random() < 0.5 else None
        self.time = str(random.choice(["none", "even", "late", "uneven"])) if self.times > 1 else "none"
        self.time_unit = str(random.choice(list(SECONDS)))
        shape = (self.times, self.channels, *self.shape[::-1])
        if self.dtype == "f32":
            self.array = random.standard_normal(shape).astype("f4")
        else:
            limits = np.iinfo(DTYPES[self.dtype])
            self.array = random.integers(limits.min, limits.max, shape, DTYPES[self.dtype], endpoint=True)

    def matrix_of(self):
        """From voxels to right, front and head, in the store's unit; of a volume without a patient its own x, y, z."""
        matrix = np.eye(4)
        matrix[:3, 3] = np.round(self.random.uniform(-100, 100, 3), 3) if self.place != "none" else 0
        turn = np.eye(3)
        if self.place in ["turned", "mirrored", "sheared"]:
            turn, _ = np.linalg.qr(self.random.standard_normal((3, 3)))
            if np.linalg.det(turn) < 0:
                turn[:, 0] *= -1
        if self.place == "mirrored":
            turn[:, 2] *= -1
        if self.place == "sheared":
            turn[:, 2] = turn[:, 2] + 0.3 * turn[:, 0]
            turn[:, 2] /= np.linalg.norm(turn[:, 2])
        matrix[:3, :3] = turn * self.spacing
        return matrix

    def run(self, *arguments, may_fail=False):
        done = subprocess.run([self.command, *map(str, arguments)], capture_output=True, text=True, cwd=self.folder)
        if may_fail and done.returncode == 2:
            return done
        expect(done.returncode == 0, "brickyard", *arguments, "exit", done.returncode, done.stderr)
        return done

    def pack(self):
        self.matrix = self.matrix_of()
        text = {"shape": self.shape, "dtype": self.dtype, "channels": self.channels, "times": self.times, "spacing": self.spacing.tolist()}
        text["origin"] = self.matrix[:3, 3].tolist()
        if self.place in ["upright", "turned", "mirrored", "sheared"]:
            text["orientation"] = self.matrix[:3].tolist()
        if self.unit:
            text["unit"] = self.unit
        if self.names:
            text["channel_names"] = self.names
        if self.time != "none":
            text["time_unit"] = self.time_unit
        self.start = 0.0
        if self.time in ["even", "late"]:
            self.start = 0.0 if self.time == "even" else 2.5
            text.update(time_step=0.25, time_start=self.start)
        if self.time == "uneven":
            text["time_stamps"] = [0.0, 1.0, 3.0, 3.5][: self.times] if self.times > 2 else [1.0, 4.0]
        (self.folder / "a.raw").write_bytes(self.array.tobytes())
        (self.folder / "a.raw.json").write_text(json.dumps(text))
        self.run("pack", "a.raw", "s.zarr", "--overwrite", "--brick", 8, "--progress", "none")
        self.info = json.loads(self.run("info", "s.zarr", "--json").stdout)

    def choose(self):
        """A random part: its flags, its array (t, c, z, y, x) and its matrix."""
        random = self.random
        levels = self.info["levels"]
        self.level = int(random.integers(len(levels)))
        extent = levels[self.level]["extent"]
        factor = np.round(np.divide(levels[self.level]["spacing"], levels[0]["spacing"]))
        low = [int(random.integers(n)) for n in extent]
        high = [int(random.integers(a + 1, n + 1)) for a, n in zip(low, extent)]
        self.flags = ["--level", self.level, "--roi", ",".join(f"{a}:{b}" for a, b in zip(low, high))]
        channels = random.permutation(self.channels)[: random.integers(1, self.channels + 1)].tolist()
        steps = list(range(self.times))[random.integers(self.times) :]
        self.several = len(channels) > 1, len(steps) > 1
        self.flags += ["--channel", ",".join(map(str, channels)), "--time", f"{steps[0]}:{steps[-1] + 1}" if len(steps) > 1 else steps[0]]
        self.part_names = [self.names[c] for c in channels] if self.names else None
        self.steps = steps
        part = np.eye(4)
        part[:3, :3] = np.diag(factor)
        part[:3, 3] = np.array(low) * factor + (factor - 1) / 2
        self.part = self.matrix @ part
        self.run("export", "s.zarr", "p.npy", "--overwrite", *self.flags)
        found = np.load(self.folder / "p.npy")
        missing = [i for i, is_there in enumerate([len(steps) > 1, len(channels) > 1]) if not is_there]
        self.expected = np.expand_dims(found, missing) if missing else found
        if self.level == 0:
            box = tuple(slice(a, b) for a, b in zip(low[::-1], high[::-1]))
            expect(same(self.expected, self.array[steps][:, channels][(..., *box)]), "npy: voxels")

    def corners(self):
        x, y, z = (n - 1 for n in self.expected.shape[:1:-1])
        return np.array([[0, 0, 0], [x, 0, z], [x, y, z]], float)

    def check_place(self, found, unit_m, name, is_exact=True):
        """`found` maps voxels to right, front, head, in units of so many metres."""
        at = self.corners()
        expected = (at @ self.part[:3, :3].T + self.part[:3, 3]) * METRES[self.unit]
        voxel = np.linalg.norm(self.part[:3, :3], axis=0).min() * METRES[self.unit]
        off = np.abs(found(at) * unit_m - expected).max()
        expect(off <= (1e-6 if is_exact else 1e-2) * voxel + 1e-9 * np.abs(expected).max(), name, "place", found(at) * unit_m, expected)

    def even_times(self):
        """Step and start in seconds, of evenly spaced steps; None otherwise."""
        if self.time not in ["even", "late"] or len(self.steps) < 2:
            return None
        unit = SECONDS[self.time_unit]
        return 0.25 * unit, (self.start + 0.25 * self.steps[0]) * unit

    def check(self, end):
        """Exports and compares; returns whether it was refused."""
        name = "b/" if end == "/" else f"b.{end}"
        if end == "/":
            subprocess.run(["rm", "-rf", self.folder / "b"], check=True)
        if end == "seg.nrrd":
            self.make_labels()
        version = ["--ngff", end[:3]] if end.endswith(".zarr") else []
        done = self.run("export", "s.zarr", name, *([] if end == "/" else ["--overwrite"]), *self.flags, *version, may_fail=True)
        channels, steps = self.expected.shape[1], self.expected.shape[0]
        may = {
            "mha": channels == 1, "mhd": channels == 1, "vti": steps == 1,
            "/": channels == steps == 1 and self.dtype in ["u8", "u16"],
            "seg.nrrd": channels == steps == 1 and self.dtype != "f32" and self.expected.max() < 2**31,
        }.get(end, True)
        expect(may == (done.returncode == 0), name, "refused" if may else "not refused", done.stderr)
        if not may:
            return True
        if version:
            self.check_zarr(self.folder / name, end[:3])
            return False
        getattr(self, "check_" + {"nii.gz": "nii", "mhd": "mha", "/": "png", "ome.tif": "ome", "seg.nrrd": "segments"}.get(end, end))(self.folder / name)
        if end != "npy":
            self.check_again(name, end)
        return False

    def check_again(self, name, end):
        """Packs the file, and compares."""
        self.run("pack", name, "q.zarr", "--overwrite", "--brick", 8, "--progress", "none", *(["--variable", self.vti_names] if end in ["vti", "pvd"] and self.expected.shape[1] > 1 else []))
        self.run("export", "q.zarr", "q.npy", "--overwrite", "--channel", "all", "--time", "all")
        expect(same(np.load(self.folder / "q.npy"), self.expected), name, "packed again: voxels")

    def check_npy(self, path):
        pass

    def check_raw(self, path):
        expect(path.read_bytes() == self.expected.tobytes(), "raw")

    def check_nii(self, path):
        image = nibabel.load(path)
        found = np.asarray(image.dataobj)
        found = found.reshape(found.shape + (1,) * (5 - found.ndim))
        expect(same(found.transpose(3, 4, 2, 1, 0), self.expected), path.name, "voxels", found.shape)
        space, time = image.header.get_xyzt_units()
        metres = {"mm": 1e-3, "meter": 1.0, "micron": 1e-6, "unknown": METRES[None]}[space]
        forms = [image.affine, image.get_sform()] + ([] if self.place == "sheared" else [image.get_qform()])
        for form in forms:
            self.check_place(lambda at: at @ form[:3, :3].T + form[:3, 3], metres, path.name, is_exact=False)
        times = self.even_times()
        if times:
            unit = {"sec": 1.0, "msec": 1e-3, "usec": 1e-6}[time]
            said = float(image.header["pixdim"][4]) * unit, float(image.header["toffset"]) * unit
            expect(np.allclose(said, times, rtol=1e-6), path.name, "times", said, times)
        if channels_one(self.expected) and self.expected.shape[0] == 1 and self.place != "sheared":
            self.check_itk(path, 1e-3, is_exact=False)

    def check_itk(self, path, unit_m, is_exact=True):
        image = SimpleITK.ReadImage(path)
        found = SimpleITK.GetArrayFromImage(image)
        expect(same(found.reshape(self.expected.shape), self.expected), path.name, "SimpleITK: voxels", found.shape)
        place = lambda at: np.array([image.TransformContinuousIndexToPhysicalPoint(p.tolist()) for p in at]) @ LPS_FROM_RAS
        if image.GetDimension() == 3:
            self.check_place(place, unit_m, path.name + " by SimpleITK", is_exact)
        elif self.even_times():
            unit = SECONDS[self.time_unit]
            said = image.GetSpacing()[3] * unit, image.GetOrigin()[3] * unit
            expect(np.allclose(said, self.even_times()), path.name, "times", said, self.even_times())

    def check_mha(self, path):
        written = path.read_bytes()[:4096].split(b"ElementDataFile")[0].decode()
        unit = dict(line.split(" = ", 1) for line in written.splitlines() if " = " in line).get("DistanceUnits")
        self.check_itk(path, {"mm": 1e-3, "um": 1e-6, "cm": 1e-2, None: METRES[None]}[unit])

    def check_nrrd(self, path):
        found, header = nrrd.read(str(path), index_order="C")
        sizes = [n for n, is_there in zip(self.expected.shape[:2], self.expected.shape[:2]) if is_there > 1]
        expect(same(found.reshape(self.expected.shape), self.expected), path.name, "voxels", found.shape, sizes)
        directions = header["space directions"][:3]
        turn = LPS_FROM_RAS if header.get("space") == "left-posterior-superior" else np.eye(3)
        expect((header.get("space") is not None) == (self.place in ["upright", "turned", "mirrored", "sheared"]), "space", header.get("space"))
        unit = header.get("space units", [None])[0]
        metres = {"mm": 1e-3, "um": 1e-6, "nm": 1e-9, "m": 1.0, "inch": 0.0254, None: METRES[None]}[unit]
        self.check_place(lambda at: (at @ directions + header["space origin"]) @ turn, metres, path.name)
        if self.even_times():
            unit = SECONDS[self.time_unit]
            said = header["spacings"][-1] * unit, header["axis mins"][-1] * unit
            expect(np.allclose(said, self.even_times()), path.name, "times", said)
        if self.expected.shape[0] == 1:
            image = SimpleITK.ReadImage(path)
            found = SimpleITK.GetArrayFromImage(image)
            if self.expected.shape[1] > 1:
                found = np.moveaxis(found, -1, 0)
            expect(same(found.reshape(self.expected.shape), self.expected), path.name, "SimpleITK: voxels", found.shape)

    def make_labels(self):
        """Makes the store labels, if its numbers can be, and so other coarser levels."""
        if self.dtype != "f32":
            self.run("edit", "s.zarr", "--kind", "labels", "--progress", "none")
            self.run("export", "s.zarr", "p.npy", "--overwrite", *self.flags)
            self.expected = np.load(self.folder / "p.npy").reshape(self.expected.shape)

    def check_segments(self, path):
        self.check_nrrd(path)
        said = slicerio.read_segmentation(str(path))
        expect(said["containedRepresentationNames"] == ["Binary labelmap"], path.name, said["containedRepresentationNames"])
        voxels = self.expected[0, 0]
        expect(same(np.asarray(said["voxels"]).T, voxels), path.name, "slicerio: voxels")
        found = {int(segment["labelValue"]): segment for segment in said["segments"]}
        expect(sorted(found) == [label for label in np.unique(voxels).tolist() if label], path.name, "labels", sorted(found)[:9])
        for label in list(found)[:: 1 + len(found) // 100]:
            places = np.argwhere(voxels == label)[:, ::-1]
            box = np.stack([places.min(axis=0), places.max(axis=0)], axis=1).ravel().tolist()
            expect(list(found[label]["extent"]) == box and found[label]["layer"] == 0, path.name, "segment", found[label], box)

    def check_pvd(self, path):
        sets = xml.etree.ElementTree.parse(path).getroot().findall(".//DataSet")
        expect(len(sets) == len(self.steps), path.name, "steps", len(sets))
        steps, expected = self.steps, self.expected
        try:
            for i, one in enumerate(sets):
                self.steps, self.expected = steps[i : i + 1], expected[i : i + 1]
                self.check_vti(path.parent / one.get("file"))
                if self.time in ["even", "late"]:
                    expect(float(one.get("timestep")) == self.start + 0.25 * steps[i], path.name, "timestep", one.get("timestep"))
        finally:
            self.steps, self.expected = steps, expected

    def check_vti(self, path):
        reader = vtk.vtkXMLImageDataReader()
        reader.SetFileName(str(path))
        reader.Update()
        image = reader.GetOutput()
        data = image.GetPointData()
        names = [data.GetArrayName(i) for i in range(data.GetNumberOfArrays())]
        self.vti_names = ",".join(names)
        if self.part_names:
            expect(names == self.part_names, path.name, names)
        shape = self.expected.shape[2:]
        expect(image.GetDimensions() == shape[::-1], path.name, image.GetDimensions())
        found = np.stack([vtk_to_numpy(data.GetArray(i)).reshape(shape) for i in range(len(names))])[None]
        expect(same(found, self.expected), path.name, "voxels", found.dtype)
        place = lambda at: np.array([image_place(image, p) for p in at])
        self.check_place(place, METRES[self.unit], path.name)
        time = image.GetFieldData().GetArray("TimeValue")
        if self.time in ["even", "late"]:
            expect(time is not None and np.isclose(time.GetValue(0), self.start + 0.25 * self.steps[0]), path.name, "time")

    def check_tif(self, path):
        with tifffile.TiffFile(path) as file:
            found = file.asarray()
            expect(same(found.reshape(np.moveaxis(self.expected, 1, 2).shape), np.moveaxis(self.expected, 1, 2)), path.name, "voxels", found.shape)
            said = file.imagej_metadata
            expect([said.get(k, 1) for k in ["frames", "slices", "channels"]] == [self.expected.shape[i] for i in [0, 2, 1]], path.name, said)
            spacing = np.linalg.norm(self.part[:3, :3], axis=0)
            if self.unit:
                x, y = (page_resolution(file, tag) for tag in ["XResolution", "YResolution"])
                expect(np.allclose([x, y, said["spacing"]], spacing, rtol=1e-7), path.name, "spacing", x, y, said["spacing"], spacing)
                expect(said["unit"] == {"millimeter": "mm", "micrometer": "micron", "nanometer": "nm", "meter": "m", "inch": "inch"}[self.unit], path.name, said["unit"])
            if self.even_times():
                expect(np.isclose(said["finterval"] * SECONDS[self.time_unit], self.even_times()[0]), path.name, said)

    def check_ome(self, path):
        with tifffile.TiffFile(path) as file:
            found = file.series[0].asarray()
            expect(same(found.reshape(np.moveaxis(self.expected, 1, 2).shape), np.moveaxis(self.expected, 1, 2)), path.name, "voxels", found.shape)
            pixels = xml.etree.ElementTree.fromstring(file.ome_metadata).find(".//{*}Pixels")
        sizes = [float(pixels.get(f"PhysicalSize{axis}")) for axis in "XYZ"]
        unit = {"mm": 1e-3, "µm": 1e-6, "nm": 1e-9, "m": 1.0, "in": 0.0254, "reference frame": METRES[None]}[pixels.get("PhysicalSizeXUnit")]
        spacing = np.linalg.norm(self.part[:3, :3], axis=0) * METRES[self.unit]
        expect(np.allclose(np.array(sizes) * unit, spacing, rtol=1e-9), path.name, "spacing", sizes, unit, spacing)
        if self.part_names:
            names = [channel.get("Name") for channel in pixels.findall("{*}Channel")]
            expect(names == self.part_names, path.name, names)
        if self.even_times() and self.even_times()[1] == 0:
            found = float(pixels.get("TimeIncrement")), pixels.get("TimeIncrementUnit")
            expect(found == (0.25, {"second": "s", "millisecond": "ms", "hour": "h"}[self.time_unit]), path.name, found)

    def check_zarr(self, path, version):
        group = zarr.open_group(path, mode="r")
        attributes = dict(group.attrs)
        ome = attributes.get("ome", attributes)
        multiscale = ome["multiscales"][0]
        levels = [group[dataset["path"]][...] for dataset in multiscale["datasets"]]
        axes = [axis["name"] for axis in multiscale.get("axes") or multiscale["coordinateSystems"][0]["axes"]]
        expected = self.expected.squeeze(tuple(i for i, name in enumerate("tc") if name not in axes))
        expect(same(levels[0], expected), path.name, "voxels", levels[0].shape)
        places = [transform_of(dataset) for dataset in multiscale["datasets"]]
        for k in range(1, len(levels)):
            factors = np.round(places[k][0] / places[k - 1][0]).astype(int)
            expect(same(levels[k], reduced(levels[k - 1], factors)), path.name, "level", k, factors)
            expect(np.allclose(places[k][1] - places[0][1], (places[k][0] - places[0][0]) / 2), path.name, "translation", k, places)
        scale, translation = (numbers[-3:] for numbers in places[0])
        place = lambda at: (at[:, ::-1] * scale + translation)[:, ::-1]
        unit = METRES[self.unit]
        transforms = multiscale.get("coordinateTransformations")
        is_turned = self.place in ["upright", "turned", "mirrored", "sheared"]
        expect((transforms is not None) == (is_turned and version == "0.6"), path.name, transforms)
        if transforms:
            affine = np.array(transforms[0]["affine"])[-3:, -4:]
            physical = place
            place = lambda at: (physical(at)[:, ::-1] @ affine[:, :3].T + affine[:, 3])[:, ::-1]
            unit = 1e-3
        if transforms or not is_turned:
            self.check_place(place, unit, path.name)
        else:
            spacing = np.linalg.norm(self.part[:3, :3], axis=0)
            expect(np.allclose(scale[::-1], spacing, rtol=1e-6), path.name, "spacing", scale, spacing)
        if "t" in axes and self.even_times():
            said = np.array([numbers[0] for numbers in places[0]]) * SECONDS[self.time_unit]
            expect(np.allclose(said, self.even_times()), path.name, "times", said)
        if self.part_names:
            expect([c["label"] for c in ome["omero"]["channels"]] == self.part_names, path.name, ome["omero"])
        # From 0.50 on it reads by zarrs, which knows no zlib.
        images = [] if version == "0.4" else ngff_zarr.from_ngff_zarr(str(path), validate=version != "0.6").images
        for found, level, (scale, translation) in zip(images, levels, places, strict=version != "0.4"):
            expect(same(np.asarray(found.data), level), path.name, "ngff-zarr: voxels")
            expect([found.scale[a] for a in "zyx"] == scale[-3:].tolist(), path.name, "ngff-zarr", found.scale, scale)
            expect([found.translation[a] for a in "zyx"] == translation[-3:].tolist(), path.name, "ngff-zarr", found.translation)
            if self.unit and version != "0.6":
                expect(found.axes_units["x"] == self.unit, path.name, "ngff-zarr", found.axes_units)
        if version != "0.6":
            ome_zarr_models.open_ome_zarr(group)
            [node] = ome_zarr.reader.Reader(ome_zarr.io.parse_url(path))()
            expect(all(same(np.asarray(a), b) for a, b in zip(node.data, levels, strict=True)), path.name, "ome-zarr: voxels")

    def check_png(self, path):
        planes = [np.asarray(PIL.Image.open(p)) for p in sorted(path.iterdir())]
        expect(same(np.stack(planes).astype(self.expected.dtype)[None, None], self.expected), path.name, "voxels")


def transform_of(dataset):
    """Scale and translation of a level."""
    transforms = dataset["coordinateTransformations"]
    if transforms[0]["type"] == "sequence":
        transforms = transforms[0]["transformations"]
    return np.array(transforms[0]["scale"], float), np.array(transforms[1]["translation"], float)


def reduced(fine, factors):
    """Means of boxes, the last voxels repeated; of integers rounded to nearest, ties to even."""
    padded = np.pad(fine.astype("f8"), [(0, -n % f) for n, f in zip(fine.shape, factors)], mode="edge")
    boxes = padded.reshape([size for n, f in zip(padded.shape, factors) for size in (n // f, f)])
    means = boxes.mean(axis=tuple(range(1, boxes.ndim, 2)))
    return (means if fine.dtype.kind == "f" else np.rint(means)).astype(fine.dtype)


def channels_one(array):
    return array.shape[1] == 1


def page_resolution(file, tag):
    numerator, denominator = file.pages[0].tags[tag].value
    return denominator / numerator


def image_place(image, point):
    out = [0.0, 0.0, 0.0]
    image.TransformContinuousIndexToPhysicalPoint(point.tolist(), out)
    return out


def same(a, b):
    return a.shape == b.shape and a.dtype.newbyteorder("=") == b.dtype.newbyteorder("=") and np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--brickyard", type=pathlib.Path, required=True)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    a = parser.parse_args()
    counts = collections.defaultdict(collections.Counter)
    SimpleITK.ProcessObject.SetGlobalWarningDisplay(False)
    for number in range(a.count):
        with tempfile.TemporaryDirectory() as folder:
            case = Case(np.random.default_rng([a.seed, number]), pathlib.Path(folder), a.brickyard.absolute())
            try:
                case.pack()
                case.choose()
            except Wrong as wrong:
                counts["pack"]["wrong"] += 1
                print(f"case {number}: {wrong}")
                continue
            for end in FORMATS:
                try:
                    counts[end]["refused" if case.check(end) else "equal"] += 1
                except Exception as wrong:
                    counts[end]["wrong"] += 1
                    kind = "" if isinstance(wrong, Wrong) else f"{type(wrong).__name__}: "
                    described = f"{case.dtype} {case.expected.shape} {case.place} {case.unit} {case.time} {case.flags}"
                    print(f"case {number}, {end}: {kind}{wrong} ({described})", flush=True)
    for end, found in counts.items():
        print(f"{end}: " + ", ".join(f"{found[word]} {word}" for word in ["equal", "refused", "wrong"]))
    sys.exit(any(found["wrong"] for found in counts.values()))


if __name__ == "__main__":
    main()
