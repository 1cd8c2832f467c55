"""Random files of differential.py that no header describes, or whose arrays become channels: raw files by NumPy, .npz and HDF5 by their libraries."""

import h5py
import numpy as np
from differential_cases import in_five
from differential_check import Case, Reference
from differential_written import name_of, noise, pick

TYPES = {"u8": "u1", "i8": "i1", "u16": "u2", "i16": "i2", "u32": "u4", "i32": "i4", "f32": "f4"}


def sizes_of(rng, count, most=14):
    return [int(n) for n in rng.integers(1, most, count)]


# Raw files


def write_raw(rng, stem, name):
    """Steps or channels as records of their own, behind a header, before more bytes than are read."""
    kind, order, apart = pick(rng, *TYPES), pick(rng, "<", ">"), pick(rng, "", "step", "channel")
    axes = pick(rng, "tczyx", "tzyxc", "tyxzc") if apart != "channel" else pick(rng, "tczyx", "tcxyz")
    size = dict(zip("zyx", sizes_of(rng, 3)), t=int(rng.integers(1, 4)), c=int(rng.integers(1, 4)))
    array = noise(rng, TYPES[kind], *(size[a] for a in axes))
    records = {"": array[np.newaxis], "step": array, "channel": array.reshape(-1, *array.shape[2:])}[apart]
    before, after, head = (int(n) for n in rng.integers(0, 9, 3))
    if not apart:
        after = 0
    stored = [np.ascontiguousarray(r).astype(r.dtype.newbyteorder(order)).tobytes() for r in records]
    tail = int(pick(rng, 0, 0, 5, 4096))
    told = bool(before or head or tail) or rng.random() < 0.5
    path = stem.with_suffix(pick(rng, ".raw", ".bin", ".unknown"))
    path.write_bytes(bytes(head) + b"".join(bytes([1] * before) + r + bytes([2] * after) for r in stored) + bytes(tail))
    flags = ["--shape", f"{size['x']},{size['y']},{size['z']}", "--dtype", kind, "--axes", axes]
    flags += ["--times", size["t"], "--channels", size["c"], "--endian", "big" if order == ">" else "little"]
    flags += ["--offset", head + before] if told else []
    flags += [f"--{apart}-bytes", len(stored[0]) + before + after] if apart else []
    # A distance between fewer than two is refused, and a tail unless the start is told.
    idle = bool(apart) and size[apart[0]] < 2
    case = Case(name, "written", "raw", f"{apart or 'in one piece'} {name_of(array)}", [path], lambda: Reference(in_five(array, axes.upper())))
    case.flags, case.must_refuse = flags, idle
    return case


# Arrays as channels


def write_channels(rng, stem, name):
    """Two or three arrays of one file, now and then unlike each other, and a component of them."""
    dtype, names = pick(rng, "u1", "i2", "f4"), ["u", "v", "w"][: int(pick(rng, 2, 3))]
    shape = sizes_of(rng, 3)
    arrays = {n: noise(rng, dtype, *shape) for n in names}
    odd = False
    if rng.random() < 0.1:
        # Unlike types become one that holds both; unlike sizes do not.
        odd = rng.random() >= 0.5
        arrays["v"] = noise(rng, dtype, *shape[:2], shape[2] + 1) if odd else noise(rng, "u2", *shape)
    if rng.random() < 0.5:
        path, prefix = stem.with_suffix(".npz"), ""
        pick(rng, np.savez, np.savez_compressed)(path, **arrays)
    else:
        path, prefix = stem.with_suffix(".h5"), "/a=b/"
        with h5py.File(path, "w") as file:
            for n, array in arrays.items():
                file.create_dataset(f"a=b/{n}", data=array, chunks=True if rng.random() < 0.5 else None)
    paths = [prefix + n for n in names]
    flags = ["--variable", ",".join(paths)] if rng.random() < 0.5 else [f for p in paths for f in ("--variable", p)]
    component = pick(rng, "", "", "magnitude", "1", "v", "phase")
    flags += ["--component", component] if component else []
    refused = odd or component == "phase" and len(names) > 2
    group = f"{path.suffix} {component or 'all'}"
    case = Case(name, "written", "channels", group, [path], lambda: channels_reference([arrays[n] for n in names], component))
    case.flags, case.must_refuse = flags, refused
    return case


def channels_reference(arrays, component):
    arrays = list(np.stack(arrays))
    if component in ("1", "v"):
        arrays = arrays[1:2]
    with np.errstate(over="ignore", invalid="ignore"):
        wide = [a.astype(np.float64) for a in arrays]
        if component == "magnitude":
            arrays = [np.sqrt(sum(a * a for a in wide)).astype(np.float32)]
        elif component == "phase":
            arrays = [np.arctan2(wide[1], wide[0]).astype(np.float32)]
    return Reference(in_five(np.stack(arrays), "CZYX"))


KINDS = [("raw", write_raw, 1), ("channels", write_channels, 1)]
