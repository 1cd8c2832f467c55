"""The place, times and channels of an image by its OME-Zarr document, read by the specification's words in NumPy, for ngff_documents.py.

Maps are homogeneous matrices on column vectors, in the order of the document's axes.
"""

import dataclasses

import numpy as np

METRES = {
    **{"angstrom": 1e-10, "yoctometer": 1e-24, "zeptometer": 1e-21, "attometer": 1e-18, "femtometer": 1e-15, "picometer": 1e-12},
    **{"nanometer": 1e-9, "micrometer": 1e-6, "millimeter": 1e-3, "centimeter": 1e-2, "decimeter": 1e-1, "meter": 1.0, "hectometer": 1e2},
    **{"kilometer": 1e3, "megameter": 1e6, "foot": 0.3048, "inch": 0.0254, "mile": 1609.344, "yard": 0.9144, "parsec": 3.0856775814913673e16},
    **{"µm": 1e-6, "um": 1e-6, "mm": 1e-3, "nm": 1e-9},
}
SPACE = "xyz"


@dataclasses.dataclass
class Axis:
    name: str
    kind: str | None = None
    unit: str | None = None


@dataclasses.dataclass
class Place:
    """Of one level."""

    letters: str  # of the array's axes, '-' for an axis of no letter
    matrix: np.ndarray | None  # 3 x 4 from voxels x, y, z to the image's coordinates; none where the document has none
    units: list  # of x, y, z
    systems: dict  # name: 3 x 4, of further systems that are affine maps of the image's, in their own units
    left_out: bool  # whether a further transformation is no affine map
    time: tuple | None  # start, step, unit


class Unreadable(Exception):
    """The document does not tell, or breaks the specification's form."""


def need(value, kind, words):
    if not isinstance(value, kind) or isinstance(value, bool):
        raise Unreadable(words)
    return value


def read_axes(items):
    axes = []
    for item in need(items, list, "axes"):
        if isinstance(item, str):
            axes.append(Axis(item))
            continue
        item = need(item, dict, "an axis")
        axes.append(Axis(need(item.get("name"), str, "an axis without a name"), item.get("type"), item.get("unit")))
    return axes


def letters_of(axes):
    """Time and channels by type, or name; axes of space by name, or all by order where one has no such name."""
    by_type = {"time": "t", "channel": "c"}
    found = [by_type.get(axis.kind) or (axis.name.lower() if axis.kind is None and axis.name.lower() in list("tc") else "-") for axis in axes]
    space = [n for n, axis in enumerate(axes) if axis.kind in ("space", "array") or (axis.kind is None and found[n] == "-")]
    names = [axes[n].name.lower() for n in space]
    if not (set(names) <= set(SPACE) and len(set(names)) == len(names)):
        names = ["-"] * (len(space) - 3) + list("zyx"[-len(space) :])
    for n, name in zip(space, names):
        found[n] = name
    return "".join(found)


def homogeneous(linear, offset):
    linear, offset = np.asarray(linear, float), np.asarray(offset, float)
    out = np.zeros((linear.shape[0] + 1, linear.shape[1] + 1))
    out[:-1, :-1], out[:-1, -1], out[-1, -1] = linear, offset, 1
    return out


def numbers(values, count):
    if not (isinstance(values, list) and len(values) == count and all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values)):
        raise Unreadable(f"{count} numbers")
    return np.array(values, float)


def map_of(transform, count):
    """The matrix of a transformation of so many coordinates; none if it is no affine map in the document."""
    transform = need(transform, dict, "a transformation")
    kind = need(transform.get("type"), str, "a transformation's type")
    if "path" in transform:
        return None
    same, zero = np.eye(count), np.zeros(count)
    if kind == "identity":
        return homogeneous(same, zero)
    if kind == "scale":
        return homogeneous(np.diag(numbers(transform.get("scale"), count)), zero)
    if kind == "translation":
        return homogeneous(same, numbers(transform.get("translation"), count))
    if kind == "rotation":
        return homogeneous([numbers(row, count) for row in need(transform.get("rotation"), list, "rows")], zero)
    if kind == "affine":
        rows = np.array([numbers(row, count + 1) for row in need(transform.get("affine"), list, "rows")])
        return homogeneous(rows[:, :-1], rows[:, -1])
    if kind == "mapAxis":
        order = need(transform.get("mapAxis"), list, "a permutation")
        if sorted(order) != list(range(count)):
            raise Unreadable("a permutation")
        return homogeneous(same[order], zero)
    if kind == "sequence":
        found = homogeneous(same, zero)
        for item in need(transform.get("transformations"), list, "transformations"):
            step = map_of(item, found.shape[0] - 1)
            if step is None:
                return None
            found = step @ found
        return found
    if kind == "bijection":
        return map_of(transform.get("forward"), count)
    if kind == "byDimension":
        return by_dimension(transform, count)
    return None


def by_dimension(transform, count):
    parts = need(transform.get("transformations"), list, "transformations")
    read = lambda part, new, old: need(part.get(new, part.get(old)), list, new)
    outputs = sum(len(read(part, "outputAxes", "output_axes")) for part in parts)
    found = homogeneous(np.zeros((outputs, count)), np.zeros(outputs))
    for part in parts:
        columns, rows = read(part, "inputAxes", "input_axes"), read(part, "outputAxes", "output_axes")
        inner = map_of(part.get("transformation", part), len(columns))
        if inner is None:
            return None
        if not all(isinstance(n, int) and 0 <= n < outputs for n in rows) or not all(isinstance(n, int) and 0 <= n < count for n in columns):
            raise Unreadable("axes of byDimension")
        found[np.ix_(rows, columns)], found[rows, -1] = inner[:-1, :-1], inner[:-1, -1]
    return found


def end_of(transform, end):
    value = transform.get(end)
    return (value.get("name"), value.get("path")) if isinstance(value, dict) else (value, None)


def spatial(matrix, inputs, outputs):
    """The part of a map between x, y and z, as 3 x 4."""
    found = np.zeros((3, 4))
    for r, row in enumerate(SPACE):
        if row not in outputs:
            found[r, r] = 1
            continue
        for c, column in enumerate(SPACE):
            found[r, c] = matrix[outputs.index(row), inputs.index(column)] if column in inputs else 0.0
        if row not in inputs and not found[r, :3].any():
            found[r, r] = 1
        found[r, 3] = matrix[outputs.index(row), -1]
    return found


def units_of(axes, letters):
    unit = lambda letter: axes[letters.index(letter)].unit if letter in letters else None
    return [unit(letter) for letter in SPACE]


def read_image(image):
    """Axes, and a map for each level: arrays' paths, and the further systems."""
    image = need(image, dict, "an image")
    datasets = need(image.get("datasets"), list, "datasets")
    if not datasets:
        raise Unreadable("no dataset")
    transforms = [need(item, dict, "a dataset").get("coordinateTransformations") for item in datasets]
    systems = {}
    if "coordinateSystems" in image:
        for system in need(image["coordinateSystems"], list, "coordinateSystems"):
            system = need(system, dict, "a system")
            systems[need(system.get("name"), str, "a system's name")] = read_axes(system.get("axes"))
        ends = {end_of(need(items, list, "transformations")[-1], "output")[0] for items in transforms if items}
        own = ends.pop() if len(ends) == 1 else None
        own = next(iter(systems)) if own is None and len(systems) == 1 else own
        if own not in systems:
            raise Unreadable("the levels' system")
        axes = systems[own]
    else:
        own = None
        axes = read_axes(image["axes"]) if "axes" in image else [Axis(name) for name in "tczyx"]
    # An empty list tells no more than none.
    maps = [None if not items else map_of({"type": "sequence", "transformations": items}, len(axes)) for items in transforms]
    further = image.get("coordinateTransformations") or []
    others, left_out = {}, False
    if own is None and further:
        after = map_of({"type": "sequence", "transformations": further}, len(axes))
        left_out |= after is None
        maps = [after if found is None else after @ found for found in maps] if after is not None else maps
    elif own is not None:
        for transform in need(further, list, "transformations"):
            ends = [end_of(transform, end) for end in ("input", "output")]
            if ends[0] == (own, None) and ends[1][0] in systems and ends[1][1] is None and ends[1][0] != own:
                found = map_of(transform, len(axes))
                left_out |= found is None
                if found is not None:
                    others[ends[1][0]] = (found, systems[ends[1][0]])
    return axes, [item.get("path") for item in datasets], maps, others, left_out


def place_of(image, level, letters=None):
    axes, _, maps, others, left_out = read_image(image)
    letters = letters or letters_of(axes)
    found = maps[level]
    matrix = None if found is None else spatial(found, letters, letters)
    systems = {}
    for name, (other, other_axes) in others.items():
        if found is not None and other.shape[0] == len(other_axes) + 1:
            outputs = letters_of(other_axes)
            systems[name] = spatial(other @ found, letters, outputs)
            # An axis that the system lacks stays as it is.
            for row in (r for r, letter in enumerate(SPACE) if letter in letters and letter not in outputs):
                systems[name][row] = matrix[row]
    time = None
    if found is not None and "t" in letters:
        at = letters.index("t")
        time = (found[at, -1], found[at, at], axes[at].unit)
    return Place(letters, matrix, units_of(axes, letters), systems, left_out, time)
