#!/usr/bin/env python3
"""Public documents of OME-Zarr and arrays of Zarr, opened by brickyard where they lie and compared. docs/results/ngff_documents.md says what was seen.

usage: tools/ngff_documents.py BRICKYARD OUTPUT FOLDER...

FOLDERs hold a source each: a repository's tree, or an unpacked package. Arrays in them are exported beside zarr-python. Documents without arrays
(attributes, suites of tests, examples in texts) get the arrays they name, of random voxels, under OUTPUT; voxels are compared bit for bit, places and
channels by ngff_places.py. OUTPUT/cases.tsv has a line for each case, OUTPUT/report.md the counts. Needs numpy and zarr; with ome-zarr-models it says
which documents its models take.
"""

import collections
import dataclasses
import hashlib
import json
import pathlib
import re
import shutil
import subprocess
import sys

import ngff_places as places
import numpy as np
import zarr

COMMAND, OUTPUT = sys.argv[1], pathlib.Path(sys.argv[2]).resolve()
SIZES = {"t": 2, "c": 2, "z": 10, "y": 36, "x": 44, "-": 1}
TIMES = [f"{prefix}second" for prefix in ("", "deci", "centi", "milli", "micro", "nano", "pico")] + ["minute", "hour", "day"]
TYPES = ["u1", "u2", "i2", "f4"]
KINDS = ["multiscales", "plate", "well", "labels", "series", "bioformats2raw.layout", "image-label", "scene", "omero"]
PLAIN = [{"version": "0.4", "axes": list("yx"), "datasets": [{"path": "0"}]}]


@dataclasses.dataclass
class Document:
    source: str
    name: str
    ome: dict
    version: int  # of Zarr
    claim: str = ""  # valid, invalid, or nothing said


@dataclasses.dataclass
class Case:
    source: str
    name: str
    claim: str
    outcome: str
    detail: str = ""
    said: str = ""  # notes and warnings


class Wrong(Exception):
    """What differs."""


class Refused(Exception):
    """Exit code and message."""


def run(*arguments):
    done = subprocess.run([COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=120, cwd=OUTPUT)
    said = "\n".join(line for line in done.stderr.splitlines() if re.match("(error|warning|note): ", line))
    if done.returncode in (2, 3):
        raise Refused(done.returncode, said)
    if done.returncode:
        raise Wrong(f"exit {done.returncode}: {done.stderr.strip()[-300:]}")
    return done.stdout, said


# Documents of a source.


def json_of(text):
    """A JSON value, also with comments and commas at ends; none if it is none."""
    bare = re.sub(r'("(?:[^"\\]|\\.)*")|//[^\n]*|/\*.*?\*/', lambda found: found.group(1) or "", text, flags=re.S)
    for attempt in (text, bare, re.sub(r",(\s*[}\]])", r"\1", bare)):
        try:
            return json.loads(attempt)
        except ValueError:
            pass
    return None


def document(source, name, value, claim=""):
    """A document in any wrapping; none if it is none of OME-Zarr."""
    if not isinstance(value, dict):
        return None
    if isinstance(value.get("attributes"), dict):
        value = value["attributes"]
    told = value.get("_conformance")
    if isinstance(told, dict) and not claim:
        claim = "valid" if told.get("valid", True) else "invalid"
    version = 3 if "ome" in value or "coordinateTransformations" in value else 2
    ome = value["ome"] if isinstance(value.get("ome"), dict) else value
    if "wells" in ome and "rows" in ome:
        ome = {"plate": ome}
    if "channels" in ome and "rdefs" in ome:
        ome = {"omero": ome}
    scene = ome.get("scene")
    if isinstance(scene, dict) and "coordinateSystems" in scene and '"path"' not in json.dumps(scene):
        ome = scene
    if "coordinateSystems" in ome and "coordinateTransformations" in ome:
        ome = wrapped(ome)
    if ome is None or not any(key in ome for key in KINDS) or ome.get("@graph"):
        return None
    return Document(source, name, ome, version, claim)


def wrapped(ome):
    """An image around systems and transformations, whose levels lie in the first input's system."""
    systems, transforms = ome["coordinateSystems"], ome["coordinateTransformations"]
    axes = {system.get("name"): len(system.get("axes", [])) for system in systems}
    own = places.end_of(transforms[0], "input")[0]
    if own not in axes:
        own = next(iter(axes))
    step = {"type": "scale", "scale": [0.5] * axes[own], "input": {"path": "0"}, "output": {"name": own}}
    return {"version": "0.6", "multiscales": [{**ome, "datasets": [{"path": "0", "coordinateTransformations": [step]}]}]}


def documents_of(folder):
    """All documents of a source once, whatever their files' names."""
    found, seen = [], set()
    for path in sorted(folder.rglob("*")):
        is_text = path.suffix in (".md", ".bs", ".rst")
        if not path.is_file() or not (is_text or path.suffix in (".json", ".jsonc") or path.name == ".zattrs") or "schemas" in path.parts:
            continue
        name, text = str(path.relative_to(folder)), path.read_text(errors="replace")
        if is_text:
            blocks = re.findall(r"```jsonc?\n(.*?)```|<pre>\s*(\{.*?)</pre>", text, re.S)
            items = [(f"{name}#{n}", json_of(one or two), "") for n, (one, two) in enumerate(blocks)]
        else:
            items = list(in_suite(name, json_of(text)))
            claims = {"valid": "valid", "invalid": "invalid"}.keys() & set(path.parts)
            items = [(n, value, claim or (claims and next(iter(claims))) or "") for n, value, claim in items]
        for item, value, claim in items:
            one = document(folder.name, item, value, claim)
            key = one and hashlib.sha256(json.dumps([one.ome, one.claim], sort_keys=True).encode()).hexdigest()
            if one and key not in seen:
                seen.add(key)
                found.append(one)
    return found


def in_suite(name, value):
    """The documents of a suite of tests, or the file's own."""
    tests = value.get("tests", [value.get("test")]) if isinstance(value, dict) and ("tests" in value or "test" in value) else None
    if not isinstance(tests, list):
        yield name, value, ""
        return
    for n, test in enumerate(tests):
        if isinstance(test, dict) and "data" in test:
            label = re.sub(r".*formerly: (.*)\].*", r"\1", str(test.get("formerly") or test.get("description")))
            yield f"{name}#{n} {label}", test["data"], "valid" if test.get("valid") else "invalid"


# Hierarchies around documents.


class Builder:
    """Writes a document as a group, with the groups and arrays it names."""

    def __init__(self, root, version, seed):
        self.root, self.version, self.rng = root, version, np.random.default_rng(seed)
        self.images = {}  # path from the root on: arrays by level, and the document
        shutil.rmtree(root, ignore_errors=True)

    def group(self, path, ome):
        folder = self.root / path
        folder.mkdir(parents=True, exist_ok=True)
        if self.version == 2:
            (folder / ".zgroup").write_text('{"zarr_format": 2}')
            (folder / ".zattrs").write_text(json.dumps(ome))
        else:
            head = {"zarr_format": 3, "node_type": "group", "attributes": {"ome": ome} if ome else {}}
            (folder / "zarr.json").write_text(json.dumps(head))

    def image(self, path, ome, types=TYPES):
        """An image's group and its arrays; what cannot be told of these is guessed."""
        self.group(path, ome)
        images = ome.get("multiscales")
        image = images[0] if isinstance(images, list) and images and isinstance(images[0], dict) else {}
        try:
            axes, paths, maps, *_ = places.read_image(image)
            letters = places.letters_of(axes)
        except places.Unreadable:
            letters, maps = "-" * max(0, self.guess(image) - 5) + "tczyx"[-min(5, self.guess(image)) :], []
            datasets = image.get("datasets") if isinstance(image.get("datasets"), list) else []
            paths = [item.get("path") for item in datasets if isinstance(item, dict)]
        omero = ome.get("omero") if isinstance(ome.get("omero"), dict) else {}
        sizes = dict(SIZES, c=len(omero["channels"]) if isinstance(omero.get("channels"), list) and omero["channels"] else 2)
        kind, arrays = self.rng.choice(types), []
        for level, name in enumerate(paths):
            shape = [self.size(sizes[letter], letter, at, level, maps) for at, letter in enumerate(letters)]
            arrays.append(self.array(path, name, shape, kind))
        self.images[path] = (arrays, letters, ome)

    def guess(self, image):
        for key in ("axes",):
            if isinstance(image.get(key), list) and image[key]:
                return len(image[key])
        found = re.search(r'"scale": \[([^\]]*)\]', json.dumps(image))
        return found.group(1).count(",") + 1 if found else 3

    def size(self, size, letter, at, level, maps):
        if letter not in "zyx":
            return size
        ratio = 2.0**level
        if maps and maps[0] is not None and maps[level] is not None and maps[0].shape[0] > at + 1 and maps[0][at, at]:
            ratio = abs(maps[level][at, at] / maps[0][at, at])
        return max(1, int(np.ceil(size / ratio))) if ratio > 0 else size

    def array(self, path, name, shape, kind):
        folder = (self.root / path / name).resolve() if isinstance(name, str) and name else None
        if folder is None or self.root.resolve() not in folder.parents or folder.exists():
            return None
        high = 250 if kind[0] in "ui" else 1000
        values = self.rng.integers(0, high, shape).astype(kind)
        chunks = tuple(max(1, n // 2) for n in shape)
        keys = {"name": "v2", "separator": str(self.rng.choice([".", "/"]))} if self.version == 2 else None
        array = zarr.create_array(folder, shape=shape, dtype=kind, chunks=chunks, zarr_format=self.version, chunk_key_encoding=keys)
        array[...] = values
        return values


def as_text(value, default):
    return value if isinstance(value, str) else default


def items_of(value, key):
    """The objects of a list in an object, whatever these are."""
    items = value.get(key) if isinstance(value, dict) else None
    return [item for item in items if isinstance(item, dict)] if isinstance(items, list) else []


def build(one, root):
    """Writes the hierarchy of a document; returns its images and whether the root is one."""
    ome, names = one.ome, set(one.ome)
    builder = Builder(root, one.version, int(hashlib.sha256(one.name.encode()).hexdigest()[:8], 16))
    plain = {"version": "0.5", "multiscales": PLAIN} if one.version == 3 else {"multiscales": PLAIN}
    if "multiscales" in names:
        builder.image("", ome, ["u2", "u4", "i4"] if "image-label" in names else TYPES)
    elif "image-label" in names or "omero" in names:
        builder.image("", {**plain, **ome}, ["u2", "u4"] if "image-label" in names else TYPES)
    elif "plate" in names:
        builder.group("", ome)
        wells = [as_text(well.get("path"), None) for well in items_of(ome["plate"], "wells")] or ["A/1"]
        for well in dict.fromkeys(w for w in wells[:4] if w and ".." not in w):
            builder.group(well, {**{k: v for k, v in plain.items() if k == "version"}, "well": {"images": [{"path": "0"}]}})
            builder.image(f"{well}/0", plain)
    elif "well" in names:
        builder.group("", ome)
        for image in dict.fromkeys(as_text(image.get("path"), "0") for image in items_of(ome["well"], "images")):
            if ".." not in image and image.strip("/"):
                builder.image(image, plain)
    elif "labels" in names:
        builder.group("", ome)
        for label in ome["labels"] if isinstance(ome["labels"], list) else []:
            builder.image(as_text(label, "0"), {**plain, "image-label": {}}, ["u2"])
    elif "series" in names:
        builder.group("", {"bioformats2raw.layout": 3})
        builder.group("OME", ome)
        for image in ome["series"]:
            builder.image(as_text(image, "0"), plain)
    elif "scene" in names:
        builder.group("", ome)
        transforms = items_of(ome["scene"], "coordinateTransformations")
        ends = [places.end_of(item, end) for item in transforms for end in ("input", "output")]
        for name, path in dict.fromkeys(end for end in ends if isinstance(end[1], str)):
            if path not in builder.images:
                builder.image(path, in_system(as_text(name, "physical")))
    else:
        builder.group("", ome)
        for image in "01":
            builder.image(image, plain)
    return builder.images


def in_system(name):
    """An image of 0.6 whose levels lie in a system."""
    axes = [{"name": axis, "type": "space", "unit": "micrometer"} for axis in "yx"]
    step = {"type": "scale", "scale": [0.5, 0.25], "input": {"path": "0"}, "output": {"name": name}}
    image = {"coordinateSystems": [{"name": name, "axes": axes}], "datasets": [{"path": "0", "coordinateTransformations": [step]}]}
    return {"version": "0.6", "multiscales": [image]}


# Comparisons.


def in_five(array, letters):
    """Along t, c, z, y, x."""
    kept = [(letter, n) for letter, n in zip(letters, array.shape) if letter != "-"]
    array = array.reshape([n for _, n in kept])
    letters = [letter for letter, _ in kept]
    array = array.transpose([letters.index(letter) for letter in "tczyx" if letter in letters])
    return array.reshape([array.shape[[l for l in "tczyx" if l in letters].index(a)] if a in letters else 1 for a in "tczyx"])


def check_voxels(path, array, letters):
    """Exports everything at level 0; returns what `info` says, and the notes."""
    printed, said = run("info", path, "--json")
    run("export", path, OUTPUT / "o.npy", "--overwrite", "--time", "all", "--channel", "all", "--level", "0", "-q")
    found = np.load(OUTPUT / "o.npy")
    expected = in_five(array, letters)
    if found.shape != expected.shape:
        raise Wrong(f"shape {found.shape}, expected {expected.shape}")
    wide = expected.astype(np.float64) if expected.dtype.kind != "b" else expected.astype(np.uint8)
    wide = wide.astype(found.dtype) if found.dtype == np.float32 else wide
    if not np.array_equal(found, wide, equal_nan=found.dtype.kind == "f"):
        raise Wrong(f"{(found != wide).sum()} of {wide.size} voxels differ")
    return json.loads(printed), said


def close(found, expected):
    return np.allclose(found, expected, rtol=1e-6, atol=1e-6 * max(1e-12, float(np.abs(expected).max())))


def check_place(info, place):
    if place.matrix is None:
        return
    ours = info.get("axis_units") or [info["unit"]] * 3
    ratio = lambda unit, own: places.METRES[unit] / places.METRES[own] if unit in places.METRES and own in places.METRES else 1.0
    factors = np.array([ratio(unit, own) for unit, own in zip(place.units, ours)])
    kept = info["store"]["orientation"]
    told = [at for at, letter in enumerate("xyz") if letter in place.letters]
    if not told:
        raise Wrong(f"read, though the axes {place.letters!r} are none of space")
    for at in told:
        if place.units[at] in places.METRES and ours[at] not in places.METRES:
            raise Wrong(f"unit {ours[at]} along {'xyz'[at]}, expected {place.units[at]}")
    matrix = place.matrix * factors[:, None]
    spacing = np.linalg.norm(matrix[:, :3], axis=0)
    if (spacing[told] > 0).all() and not close(np.array(info["spacing"])[told], spacing[told]):
        raise Wrong(f"spacing {info['spacing']}, expected {spacing.tolist()}")
    is_upright = close(matrix[:, :3], np.diag(np.diag(matrix[:, :3]))) and (np.diag(matrix)[told] > 0).all()
    systems = [m * factors[:, None] for m in place.systems.values()]
    turned = [m for m in systems if not (close(m[:, :3], np.diag(np.diag(m[:, :3]))) and (np.diag(m[:, :3])[told] > 0).all())]
    if kept is None:
        if not is_upright and (spacing[told] > 0).all():
            raise Wrong(f"no orientation, expected {matrix.tolist()}")
        if turned and not place.left_out:
            raise Wrong(f"no orientation, expected {turned[0].tolist()}")
        if not close(np.array(info["origin"])[told], matrix[told, 3]):
            raise Wrong(f"origin {info['origin']}, expected {matrix[:, 3].tolist()}")
        return
    part = lambda m: np.asarray(m)[np.ix_(told, [*told, 3])]
    if not any(close(part(kept), part(m)) for m in [matrix, *turned]):
        raise Wrong(f"orientation {kept}, expected {[m.tolist() for m in [matrix, *turned]]}")


def check_time(info, place):
    found = info["time_axis"]
    if place.time is None or info["times"] < 2:
        return
    start, step, unit = place.time
    unit = unit if unit in TIMES else None
    if unit is None and (start, step) == (0, 1):
        expected = None
    else:
        expected = (start, step, unit)
    told = found and (found["start"], found["step"], found.get("unit"))
    if told != expected and not (expected and step <= 0 and not told):
        raise Wrong(f"times {told}, expected {expected}")


def check_channels(info, ome):
    omero = ome.get("omero") if isinstance(ome.get("omero"), dict) else {}
    for display, channel in zip(info["displays"], items_of(omero, "channels")):
        label, color, window = (channel.get(key) for key in ("label", "color", "window"))
        if isinstance(label, str) and label.strip() and display["name"] != label.strip():
            raise Wrong(f"channel {display['name']!r}, expected {label!r}")
        if isinstance(color, str) and re.fullmatch("[0-9A-Fa-f]{6}", color) and display["color"] != list(bytes.fromhex(color)):
            raise Wrong(f"color {display['color']}, expected {color}")
        ends = [window.get(end) for end in ("start", "end")] if isinstance(window, dict) else [None, None]
        if all(isinstance(end, (int, float)) for end in ends) and ends[0] < ends[1] and display["window"] != ends:
            raise Wrong(f"window {display['window']}, expected {ends}")


def check_labels(path, ome):
    is_color = lambda item: isinstance(item.get("label-value"), int) and isinstance(item.get("rgba"), list) and len(item["rgba"]) >= 3
    colors = {item["label-value"] for item in items_of(ome.get("image-label"), "colors") if is_color(item)}
    text, _ = run("info", path)
    found = re.search(r"(\d+) labels? with colors", text)
    count = int(found.group(1)) if found else 0
    if count != len(colors):
        raise Wrong(f"{count} colors of labels, expected {len(colors)}")


def check_image(path, array, letters, ome, level=0):
    """Voxels, place, times and channels of an image; returns notes, and whether the document told the place."""
    info, said = check_voxels(path, array, letters)
    try:
        place = places.place_of(ome["multiscales"][0], level, letters)
    except places.Unreadable as reason:
        return said, f"place not compared: {reason}"
    check_place(info, place)
    check_time(info, place)
    if "image-label" not in ome:
        check_channels(info, ome)
    else:
        check_labels(path, ome)
    return said, ""


def judged(source, name, claim, check):
    try:
        said, detail = check()
        return Case(source, name, claim, "read", detail, said)
    except Refused as refusal:
        code, said = refusal.args
        error = next((line for line in said.splitlines() if line.startswith("error")), said)
        outcome = "choice" if re.search(r"holds \d+ datasets", error) else f"refused ({code})"
        short = error.replace(f"{OUTPUT}/", "").replace(f"{FOLDERS.get(source)}/", "")
        return Case(source, name, claim, outcome, short, said)
    except Wrong as wrong:
        return Case(source, name, claim, "WRONG", str(wrong))


def of_document(one, number):
    root = OUTPUT / "h" / f"{number}.zarr"
    images = build(one, root)
    readable = {path: image for path, image in images.items() if image[0] and image[0][0] is not None}
    if not readable:
        yield judged(one.source, one.name, one.claim, lambda: (run("info", root)[1], "without any array"))
        return
    if "" not in readable:
        # One image is read, several are a choice.
        yield judged(one.source, one.name, one.claim, lambda: (run("info", root)[1], f"{len(readable)} images"))
    for path, (arrays, letters, ome) in readable.items():
        input = f"{root}::{path}" if path else root
        yield judged(one.source, f"{one.name}{'::' + path if path else ''}", one.claim, lambda: check_image(input, arrays[0], letters, ome))


# Arrays of a source.


def arrays_of(folder):
    """All nodes of Zarr with their documents."""
    for path in sorted(folder.rglob("*")):
        if path.name == ".zarray" or (path.name == "zarr.json" and (json_of(path.read_text()) or {}).get("node_type") == "array"):
            yield path.parent


def attributes(folder):
    for name in ("zarr.json", ".zattrs"):
        value = json_of((folder / name).read_text()) if (folder / name).is_file() else None
        if isinstance(value, dict):
            value = value.get("attributes", {}) if name == "zarr.json" else value
            return value.get("ome", value)
    return {}


def image_around(folder):
    """The document of the image of which an array is a level, and its number."""
    for around in list(folder.parents)[:3]:
        ome = attributes(around)
        for level, dataset in enumerate(items_of((ome.get("multiscales") or [None])[0], "datasets")):
            if around / as_text(dataset.get("path"), "?") == folder:
                return ome, level
    return None, 0


def of_array(source, folder):
    name = f"array {folder.relative_to(FOLDERS[source])}"
    try:
        array = zarr.open_array(folder, mode="r")
        values, why = np.asarray(array[...]), ""
    except Exception as error:  # readers raise whatever they like
        values, why = None, f"{type(error).__name__}: {error}".splitlines()[0][:160]
    if values is None or values.dtype.kind not in "biuf" or values.ndim == 0:
        case = judged(source, name, "", lambda: (run("export", folder, OUTPUT / "o.npy", "--overwrite", "-q")[1], why))
        return dataclasses.replace(case, outcome="no reference" if case.outcome == "read" else case.outcome, detail=f"{case.detail} [{why}]" if why else case.detail)
    ome, level = image_around(folder)
    if ome is not None:
        letters = places.letters_of(places.read_image(ome["multiscales"][0])[0])
        return judged(source, name, "", lambda: check_image(folder, values, letters, ome, level))
    letters = "tczyx"[-values.ndim :] if values.ndim < 4 else "-" * (values.ndim - 3) + "zyx"
    return judged(source, name, "", lambda: (check_voxels(folder, values, letters)[1], ""))


# The report.


def by_models(one):
    """What ome-zarr-models says of an image: nothing where it does not know it."""
    try:
        from ome_zarr_models import v04, v05, v06
    except ImportError:
        return ""
    version = one.ome.get("version") or (items_of(one.ome, "multiscales") or [{}])[0].get("version")
    module = {"0.4": v04.image.ImageAttrs, "0.5": v05.image.ImageAttrs, "0.6": v06.image.ImageAttrs}.get(str(version)[:3])
    if "multiscales" not in one.ome or module is None:
        return ""
    try:
        ome = {**one.ome, "version": "0.6"} if str(version).startswith("0.6") else one.ome
        module.model_validate({"ome": ome} if one.version == 3 else ome)
        return "valid"
    except Exception:  # validators raise whatever they like
        return "invalid"


def report(cases):
    outcomes = ["read", "choice", "refused (2)", "refused (3)", "no reference", "WRONG"]
    rows = collections.Counter((case.source, case.claim or ("arrays" if case.name.startswith("array ") else "examples"), case.outcome) for case in cases)
    lines = [f"| source | of | cases | {' | '.join(outcomes)} |", "| --- | --- |" + " ---: |" * (len(outcomes) + 1)]
    for source, claim in sorted({key[:2] for key in rows}):
        counts = [rows[source, claim, outcome] for outcome in outcomes]
        lines.append(f"| {source} | {claim} | {sum(counts)} | {' | '.join(str(n or '') for n in counts)} |")
    totals = [sum(n for key, n in rows.items() if key[2] == outcome) for outcome in outcomes]
    return "\n".join([*lines, f"| all | | {sum(totals)} | {' | '.join(map(str, totals))} |", ""])


FOLDERS = {pathlib.Path(folder).name: pathlib.Path(folder).resolve() for folder in sys.argv[3:]}


def main():
    shutil.rmtree(OUTPUT / "h", ignore_errors=True)
    OUTPUT.mkdir(parents=True, exist_ok=True)
    cases, number = [], 0
    for source, folder in FOLDERS.items():
        for one in documents_of(folder):
            number += 1
            model = by_models(one)
            cases += [dataclasses.replace(case, detail=f"{case.detail} [models: {model}]" if model else case.detail) for case in of_document(one, number)]
        cases += [of_array(source, array) for array in arrays_of(folder)]
    with open(OUTPUT / "cases.tsv", "w") as file:
        for case in cases:
            fields = [case.source, case.name, case.claim, case.outcome, case.detail, case.said]
            file.write("\t".join(re.sub(r"\s+", " ", field) for field in fields) + "\n")
    (OUTPUT / "report.md").write_text(report(cases))
    print(report(cases))
    sys.exit(any(case.outcome == "WRONG" for case in cases))


if __name__ == "__main__":
    main()
