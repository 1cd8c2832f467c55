"""What TIFF files say of themselves, in every form that tifffile knows: the store has the planes that tifffile's series has, where it has them."""

import logging
import struct
import subprocess
import uuid

import numpy as np
import tifffile

from common import COMMAND, FOLDER, brickyard, check, info, run_cases, same_bits

logging.disable(logging.CRITICAL)  # tifffile warns of what cases are about.
GRAY = {"photometric": "minisblack"}
SCHEMA = "http://www.openmicroscopy.org/Schemas/OME/2016-06"


def counted(*shape, dtype="u2"):
    """An array whose numbers are all different."""
    return np.arange(np.prod(shape), dtype="u4").astype(dtype).reshape(shape)


def packed(*inputs):
    """The store's voxels along t, c, z, y, x."""
    brickyard("pack", *inputs, "o.zarr", "--overwrite", "--brick", "16", "--progress", "none")
    found = info("o.zarr")
    volumes = []
    for t in range(found["times"]):
        for c in range(found["channels"]):
            brickyard("export", "o.zarr", "o.npy", "--overwrite", "--time", t, "--channel", c)
            volumes.append(np.load(FOLDER / "o.npy"))
    return np.reshape(volumes, (found["times"], found["channels"], *volumes[0].shape))


def five(array, axes):
    """An array along t, c, z, y, x. One axis without a meaning is z, and samples are channels."""
    axes = axes.replace("S", "C") if "C" not in axes else axes
    axes = axes.replace("I", "Z").replace("Q", "Z") if "Z" not in axes else axes
    kept = [axis for axis in "TCZYX" if axis in axes]
    array = array.transpose([axes.index(axis) for axis in kept])
    return array[tuple(slice(None) if axis in kept else np.newaxis for axis in "TCZYX")]


def same_as_series(path, *more):
    with tifffile.TiffFile(FOLDER / path) as file:
        series = file.series[0]
        expected = five(series.asarray(), series.axes)
    found = packed(path, *more)
    check(same_bits(found, expected), path, series.kind, series.axes, "packed:", found.shape, "tifffile:", expected.shape)


def refused(path, *words):
    done = subprocess.run([COMMAND, "pack", path, "no.zarr", "--overwrite"], capture_output=True, text=True, cwd=FOLDER)
    check(done.returncode == 3 and all(word in done.stderr for word in words), path, done.returncode, done.stderr)


def shaped():
    for axes, shape in [("TZYX", (3, 4, 7, 9)), ("CZYX", (3, 4, 7, 9)), ("TCZYX", (2, 3, 4, 7, 9)), ("ZCYX", (4, 3, 7, 9)), ("TYX", (5, 7, 9)),
                        ("CYX", (5, 7, 9)), ("IYX", (5, 7, 9)), ("QYX", (5, 7, 9)), ("YX", (7, 9)), ("CTZYX", (3, 2, 4, 7, 9))]:
        array = counted(*shape)
        for options in [{}, {"bigtiff": True, "byteorder": ">"}, {"compression": "zlib"}, {"truncate": True}, {"tile": (16, 16)}]:
            tifffile.imwrite(FOLDER / "a.tif", array, metadata={"axes": axes}, **GRAY, **options)
            same_as_series("a.tif")
    for axes, shape, options in [("TYXS", (4, 7, 9, 3), {}), ("CYXS", (4, 7, 9, 3), {}), ("TSYX", (4, 3, 7, 9), {"planarconfig": "separate"})]:
        tifffile.imwrite(FOLDER / "a.tif", counted(*shape, dtype="u1"), photometric="rgb", metadata={"axes": axes}, **options)
        if "C" not in axes:
            same_as_series("a.tif")
        else:
            found = packed("a.tif")
            check(found.shape == (1, 12, 1, 7, 9) and np.array_equal(found[0, :, 0], counted(*shape, dtype="u1").transpose(0, 3, 1, 2).reshape(12, 7, 9)))
    # Without axes, as scikit-image writes.
    tifffile.imwrite(FOLDER / "a.tif", counted(5, 7, 9), **GRAY)
    same_as_series("a.tif")
    # Nobody but the user knows.
    for array, axes in [(counted(3, 4, 7, 9), None), (counted(3, 4, 7, 9), "QZYX"), (counted(3, 7, 9), "AYX")]:
        tifffile.imwrite(FOLDER / "a.tif", array, metadata={"axes": axes} if axes else {}, **GRAY)
        refused("a.tif", "--axes", "tifffile's")
    with tifffile.TiffWriter(FOLDER / "a.tif") as writer:
        for plane in counted(5, 7, 9):
            writer.write(plane, contiguous=False, **GRAY)
    check(same_bits(packed("a.tif")[0, 0], counted(5, 7, 9)), "planes that were written one by one")


def shaped_sizes():
    place = {"axes": "TZYX", "spacing": 2.5, "unit": "um", "finterval": 0.5}
    tifffile.imwrite(FOLDER / "a.tif", counted(3, 4, 7, 9), metadata=place, resolution=(4, 2), **GRAY)
    packed("a.tif")
    found = info("o.zarr")
    check(np.allclose(found["spacing"], (0.25, 0.5, 2.5)) and found["unit"] == "micrometer", found["spacing"], found["unit"])
    check(found["time_axis"]["step"] == 0.5, found["time_axis"])
    tifffile.imwrite(FOLDER / "a.tif", counted(4, 7, 9), metadata=None, resolution=(400, 200), resolutionunit="CENTIMETER", **GRAY)
    packed("a.tif")
    found = info("o.zarr")
    check(np.allclose(found["spacing"][:2], (1 / 400, 1 / 200)) and found["unit"] == "centimeter", found["spacing"], found["unit"])
    tifffile.imwrite(FOLDER / "a.tif", counted(4, 7, 9), metadata=None, resolution=(72, 72), resolutionunit="INCH", **GRAY)
    packed("a.tif")
    check(not info("o.zarr")["calibrated"], "a printer's resolution")


def metamorph():
    """Written byte by byte: tifffile reads such files, and writes none."""
    planes, height, width = 5, 7, 9
    array = counted(planes, height, width)

    def write(distance, milliseconds, strips=1):
        data = array.tobytes()
        rows = -(-height // strips)
        offsets = [8 + i * rows * width * 2 for i in range(strips)]
        counts = [min(rows, height - i * rows) * width * 2 for i in range(strips)]
        lists = struct.pack(f"<{2 * strips}I", *offsets, *counts)
        uic2 = b"".join(struct.pack("<6I", distance(i), 10, 2459000, milliseconds(i), 0, 0) for i in range(planes))
        calibration = struct.pack("<2I", 1, 4) + struct.pack("<I2s", 2, b"um")
        at = 8 + len(data)
        uic1_at = at + len(lists) + len(uic2) + len(calibration)
        values = uic1_at - len(calibration)
        uic1 = struct.pack("<8I", 3, 1, 4, values, 5, values, 6, values + 8)
        strip_values = [offsets[0], counts[0]] if strips == 1 else [at, at + 4 * strips]
        entries = [(254, 4, 1, 0), (256, 4, 1, width), (257, 4, 1, height), (258, 3, 1, 16), (259, 3, 1, 1), (262, 3, 1, 1),
                   (273, 4, strips, strip_values[0]), (277, 3, 1, 1), (278, 4, 1, rows), (279, 4, strips, strip_values[1]),
                   (33628, 4, 4, uic1_at), (33629, 5, planes, at + len(lists))]
        directory = struct.pack("<H", len(entries)) + b"".join(struct.pack("<HHII", *entry) for entry in entries) + bytes(4)
        ifd = uic1_at + len(uic1)
        (FOLDER / "a.stk").write_bytes(b"II*\0" + struct.pack("<I", ifd) + data + lists + uic2 + calibration + uic1 + directory)

    for distance, milliseconds, strips, spacing in [(lambda i: 5, lambda i: 7, 1, 0.5), (lambda i: 5, lambda i: i, 3, 0.5), (lambda i: 0, lambda i: 500 * i, 1, None),
                                                    (lambda i: 0, lambda i: 7, 1, None), (lambda i: i, lambda i: i, 2, None)]:
        write(distance, milliseconds, strips)
        same_as_series("a.stk")
        found = info("o.zarr")
        check(spacing is None or np.allclose(found["spacing"], (0.25, 0.25, spacing)), found["spacing"])
        check(found["unit"] == "micrometer", found["unit"])


def ome_xml(own, order, sizes, tiff_data):
    t, c, z, y, x = sizes
    channels = "".join(f'<Channel ID="Channel:0:{i}" SamplesPerPixel="1"/>' for i in range(c))
    return (f'<?xml version="1.0" encoding="UTF-8"?><OME xmlns="{SCHEMA}" UUID="{own}"><Image ID="Image:0" Name="a > b"><!-- <TiffData IFD="1"/> -->'
            f'<Pixels ID="Pixels:0" DimensionOrder="{order}" Type="uint16" SizeX="{x}" SizeY="{y}" SizeZ="{z}" SizeC="{c}" SizeT="{t}">'
            f'{channels}{tiff_data}</Pixels></Image></OME>')


def write_pages(path, pages, xml):
    with tifffile.TiffWriter(FOLDER / path) as writer:
        for i, page in enumerate(pages):
            writer.write(page, metadata=None, description=None if i else xml, contiguous=False, **GRAY)


def names(count):
    return [f"urn:uuid:{uuid.UUID(int=i + 1)}" for i in range(count)]


def ome_orders():
    """Planes in orders of their own, one by one and in runs: as the model says, and as tifffile has them."""
    sizes = (2, 3, 4, 7, 9)
    array = counted(*sizes)
    places = list(np.ndindex(2, 3, 4))
    random = np.random.default_rng(3)
    for order in ["XYZCT", "XYCZT", "XYTCZ", "XYZTC"]:
        shuffled = [places[i] for i in random.permutation(len(places))]
        data = "".join(f'<TiffData IFD="{ifd}" FirstT="{t}" FirstC="{c}" FirstZ="{z}" PlaneCount="1"/>' for ifd, (t, c, z) in enumerate(shuffled))
        write_pages("a.ome.tif", [array[place] for place in shuffled], ome_xml(names(1)[0], order, sizes, data))
        same_as_series("a.ome.tif")
        check(same_bits(packed("a.ome.tif"), array), order)
        # Two runs, the later planes first.
        along = sorted(places, key=lambda place: [place["TCZ".index(axis)] for axis in reversed(order[2:])])
        first = along[10]
        data = (f'<TiffData IFD="0" FirstT="{first[0]}" FirstC="{first[1]}" FirstZ="{first[2]}" PlaneCount="14"/>'
                '<TiffData IFD="14" PlaneCount="10"/>')
        write_pages("a.ome.tif", [array[place] for place in along[10:] + along[:10]], ome_xml(names(1)[0], order, sizes, data))
        same_as_series("a.ome.tif")
        check(same_bits(packed("a.ome.tif"), array), order)
    missing = "".join(f'<TiffData IFD="{i}" FirstZ="{i}" PlaneCount="1"/>' for i in (0, 2, 3))
    write_pages("a.ome.tif", array[0, 0], ome_xml(names(1)[0], "XYZCT", (1, 1, 4, 7, 9), missing))
    refused("a.ome.tif", "TiffData", "step 0, channel 0, slice 1")


def ome_sets():
    sizes = (2, 3, 4, 7, 9)
    array, owns = counted(*sizes), names(4)
    data = "".join(f'<TiffData IFD="{z}" FirstT="{t}" FirstC="{c}" FirstZ="{z}" PlaneCount="1"><UUID FileName="set_{c}{t}.ome.tif">{owns[c]}{t}</UUID></TiffData>'
                   for t, c, z in np.ndindex(2, 3, 4))
    for t, c in np.ndindex(2, 3):
        write_pages(f"set_{c}{t}.ome.tif", array[t, c], ome_xml(f"{owns[c]}{t}", "XYZTC", sizes, data))
    for path in ["set_00.ome.tif", "set_21.ome.tif"]:
        same_as_series(path)
        check(same_bits(packed(path), array), path)
    # The same by a companion.
    for t, c in np.ndindex(2, 3):
        xml = f'<OME xmlns="{SCHEMA}" UUID="{owns[c]}{t}"><BinaryOnly MetadataFile="set.companion.ome" UUID="{owns[3]}"/></OME>'
        write_pages(f"set_{c}{t}.ome.tif", array[t, c], xml)
    refused("set_11.ome.tif", "BinaryOnly", "set.companion.ome")
    (FOLDER / "set.companion.ome").write_text(ome_xml(owns[3], "XYZTC", sizes, data))
    for path in ["set_11.ome.tif", "set.companion.ome"]:
        check(same_bits(packed(path), array), path)
    (FOLDER / "set_20.ome.tif").unlink()
    refused("set.companion.ome", "set_20.ome.tif", "missing")


def geotiff_nodata():
    """As many programs write the least f32."""
    floats = np.linspace(0, 1, 3 * 7 * 9, dtype="f4").reshape(3, 7, 9).copy()
    floats[:, 3:5] = np.finfo("f4").min
    expected = np.where(floats < -1, np.nan, floats)
    scale = [(33550, "d", 3, (30.0, 15.0, 0.0), True), (33922, "d", 6, (0.0, 0.0, 0.0, 500.0, 900.0, 0.0), True)]
    for text in ["-3.4028234663852886e+38", "-3.4028235e+38", "-3.40282347e+38", "-3.40282346638529e+38"]:
        tags = [(42113, "s", 0, text, True), *scale]
        tifffile.imwrite(FOLDER / "a.tif", floats, metadata=None, extratags=tags, **GRAY)
        found = packed("a.tif")
        check(np.array_equal(found[0, 0], expected, equal_nan=True), text)
        check(info("o.zarr")["spacing"] == [30.0, 15.0, 30.0], info("o.zarr")["spacing"])


def orientations():
    """Turned as the standard says: by NumPy, since tifffile leaves planes as they are stored."""
    array = counted(3, 7, 9)
    turns = {1: lambda a: a, 2: lambda a: a[..., ::-1], 3: lambda a: a[..., ::-1, ::-1], 4: lambda a: a[..., ::-1, :],
             5: lambda a: a.swapaxes(-1, -2), 6: lambda a: a.swapaxes(-1, -2)[..., ::-1],
             7: lambda a: a.swapaxes(-1, -2)[..., ::-1, ::-1], 8: lambda a: a.swapaxes(-1, -2)[..., ::-1, :]}
    for orientation, turn in turns.items():
        tifffile.imwrite(FOLDER / "a.tif", array, metadata=None, extratags=[(274, "H", 1, orientation, False)], **GRAY)
        check(same_bits(packed("a.tif")[0, 0], np.ascontiguousarray(turn(array))), orientation)


run_cases({f.__name__: f for f in [shaped, shaped_sizes, metamorph, ome_orders, ome_sets, geotiff_nodata, orientations]})
