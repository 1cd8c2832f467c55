"""One case of differential.py: pack, export, compare, and what it comes to."""

import dataclasses
import json
import os
import pathlib
import re
import shutil
import subprocess
import threading
import time
from typing import Callable

import numpy as np

# Words that call a file bad. Where an independent reader reads all of it, they are not true.
BLAME = re.compile(
    r"cut short|damaged|fetch the file again|write the file again|write it again|corrupt|malformed|not a (TIFF|NIfTI|DICOM)|missing\)", re.I
)
# Damaged files whose damage Pillow passes over.
DAMAGED = {
    "hopper_bad_exif.jpg": "a restart marker is missing",
    "junk_jpeg_header.jpg": "bytes between segments",
    "photoshop-200dpi-broken.jpg": "bytes between segments",
    "truncated_app14.jpg": "a segment is cut short",
}
# Volumes of a file (steps times channels) that are compared, the first and last among them.
MOST_VOLUMES = 24


@dataclasses.dataclass
class Reference:
    """What an independent reader says."""

    array: np.ndarray  # t, c, z, y, x; as stored, or as f64 where values are rescaled
    rescaled: bool = False
    spacing: tuple | None = None  # x, y, z
    origin: tuple | None = None  # x, y, z
    unit: str | None = None  # of length
    names: list | None = None  # of channels
    matrix: np.ndarray | None = None  # world from voxel, 3 x 4, of NIfTI's world
    typed: bool = True  # whether the voxel type must be the array's
    tolerance: float = 0.0  # of lossy codecs, whose decoders round differently
    flat: bool = False  # whether all pages along z are as good an arrangement
    padding: np.ndarray | None = None  # where there is no value: NaN in floats, the store's value for no data in integers


@dataclasses.dataclass
class Case:
    name: str
    collection: str
    format: str
    group: str
    inputs: list
    reference: Callable  # () -> Reference; raises what the independent reader raises
    flags: list = dataclasses.field(default_factory=list)
    must_refuse: bool = False  # there is nothing in it that a store could hold
    alone: bool = True  # whether inputs are moved to a folder of their own


@dataclasses.dataclass
class Result:
    case: Case
    outcome: str
    detail: str = ""


class Wrong(Exception):
    """What differs."""


class Ended(Exception):
    """A command that came to an outcome of its own."""

    def __init__(self, outcome, detail):
        super().__init__(detail)
        self.outcome, self.detail = outcome, detail


class Checker:
    def __init__(self, command, work, memory, timeout):
        self.command, self.work, self.memory, self.timeout = command, pathlib.Path(work), memory, timeout
        units = {"KiB": 1 << 10, "MiB": 1 << 20, "GiB": 1 << 30}
        self.memory_bytes = int(memory[:-3]) * units[memory[-3:]]
        shutil.rmtree(self.work, ignore_errors=True)

    def check(self, case):
        """Runs a case in a folder of its own."""
        folder = self.work / f"{threading.get_ident()}"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        try:
            return self.judge(case, folder)
        except Ended as end:
            return Result(case, end.outcome, end.detail)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def judge(self, case, folder):
        inputs = case.inputs
        if case.alone:
            (folder / "in").mkdir()
            inputs = []
            for path in case.inputs:
                shutil.copyfile(path, folder / "in" / pathlib.Path(path).name)
                inputs.append(folder / "in" / pathlib.Path(path).name)
            companions = {p for path in case.inputs for p in companions_of(pathlib.Path(path))} - {pathlib.Path(p) for p in case.inputs}
            for path in companions:
                shutil.copyfile(path, folder / "in" / path.name)
        code, said = self.run("pack", *inputs, folder / "o.zarr", "--progress", "none", "--memory", self.memory, *case.flags, cwd=folder)
        if code != 0 and "--allow-lossy" in said:
            code, said = self.run(
                "pack", *inputs, folder / "o.zarr", "--progress", "none", "--memory", self.memory, "--allow-lossy", *case.flags, cwd=folder
            )
        try:
            reference, why = case.reference(), ""
        except Exception as error:  # readers raise whatever they like
            reference, why = None, f"{type(error).__name__}: {error}"
        if code != 0:
            return self.judge_refusal(case, folder, code, said, reference)
        if case.must_refuse:
            return Result(case, "WRONG", f"packed, though nothing in it is a volume: {last_line(said)}")
        if reference is None:
            return Result(case, "no reference", f"packed; the reader said: {why}")
        try:
            self.compare(folder, reference, said)
        except Wrong as wrong:
            return Result(case, "WRONG", str(wrong))
        return Result(case, "equal", "")

    def judge_refusal(self, case, folder, code, said, reference):
        message = last_line(said).replace(str(folder / "in") + "/", "").replace(str(folder), "")
        message = message.replace(str(pathlib.Path(case.inputs[0]).parent) + "/", "").removeprefix("error: ")
        if code == 4 or code not in (2, 3):
            return Result(case, "WRONG-CODE", f"exit {code}: {message}")
        if ":" not in message:
            return Result(case, "WRONG-REFUSAL", f"exit {code} without a message: {said!r}")
        if code == 2 and not re.search("--|name the files|name one file|choose one", message, re.I):
            return Result(case, "WRONG-CODE", f"exit 2, but no flag settles it: {message}")
        is_damaged = pathlib.Path(case.inputs[0]).name in DAMAGED
        blamed = BLAME.search(message) and "not supported" not in message and not is_damaged
        if reference is not None and not case.must_refuse and blamed:
            return Result(
                case,
                "WRONG-REFUSAL",
                f"exit {code}: {message}; an independent reader reads {reference.array.shape} {reference.array.dtype}",
            )
        left = [p.name for p in folder.iterdir() if p.name != "in"]
        if left:
            return Result(case, "LEFT BEHIND", f"{left} after exit {code}: {message}")
        return Result(case, "refused", message)

    def compare(self, folder, reference, said):
        info = json.loads(self.expect("info", folder / "o.zarr", "--json", cwd=folder))
        array = reference.array
        x, y, z = info["levels"][0]["extent"]
        found = (info["times"], info["channels"], z, y, x)
        if found != array.shape and reference.flat and np.prod(found) == array.size and found[3:] == array.shape[3:]:
            array = array.reshape(found) if found[1] == array.shape[1] else flattened(array, found)
        if found != array.shape:
            raise Wrong(f"shape t,c,z,y,x {found}, expected {array.shape}")
        check_type(info["voxel_type"], array, reference)
        volumes = [(t, c) for t in range(found[0]) for c in range(found[1])]
        if len(volumes) > MOST_VOLUMES:
            volumes = volumes[:: len(volumes) // (MOST_VOLUMES - 1)] + volumes[-1:]
        for t, c in volumes:
            self.expect("export", "o.zarr", "o.npy", "--overwrite", "--time", t, "--channel", c, "--progress", "none", cwd=folder)
            padding = None if reference.padding is None else reference.padding[t, c]
            nodata = info["store"].get("nodata")
            check_values(np.load(folder / "o.npy"), array[t, c], reference, padding, nodata, said, f"t{t} c{c}")
        check_place(info, reference)

    def expect(self, *arguments, cwd):
        code, said = self.run(*arguments, cwd=cwd, output=True)
        if code != 0:
            raise Wrong(f"brickyard {arguments[0]} of the packed store: exit {code}: {last_line(said)}")
        return said

    def run(self, *arguments, cwd, output=False):
        """Exit code and what was said; crashes, hangs and too much memory end the case."""
        command = [str(self.command), *map(str, arguments)]
        env = {**os.environ, "RUST_BACKTRACE": "0"}
        with open(cwd / "said", "w+b") as err, open(cwd / "out", "w+b") as out:
            process = subprocess.Popen(command, stdout=out, stderr=err, cwd=cwd, env=env)
            peak = self.watch(process)
            err.seek(0)
            out.seek(0)
            said, printed = err.read().decode(errors="replace"), out.read().decode(errors="replace")
        (cwd / "said").unlink()
        (cwd / "out").unlink()
        if peak is None:
            raise Ended("hang", f"brickyard {arguments[0]} ran longer than {self.timeout} s: {last_line(said)}")
        if process.returncode < 0 or process.returncode > 100 or "panicked" in said:
            raise Ended("crash", f"brickyard {arguments[0]}: exit {process.returncode}: {said.strip()[-400:]}")
        if peak > self.memory_bytes:
            raise Ended("OVER MEMORY", f"brickyard {arguments[0]}: {peak >> 20} MiB of its own under --memory {self.memory}")
        return process.returncode, printed if output and process.returncode == 0 else said

    def watch(self, process):
        """The most memory of its own that the kernel counts for a process until it ends; nothing if it does not."""
        peak, end = 0, time.monotonic() + self.timeout
        while process.poll() is None:
            peak = max(peak, own_bytes(process.pid))
            if time.monotonic() > end:
                process.kill()
                process.wait()
                return None
            time.sleep(0.01)
        return peak


def own_bytes(pid):
    """Anonymous and shared memory; pages of mapped files are not the process's own."""
    try:
        lines = pathlib.Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0
    return sum(int(line.split()[1]) << 10 for line in lines if line.startswith(("RssAnon:", "RssShmem:")))


def companions_of(path):
    """The other half of a header and its body."""
    stem = re.sub(r"\.(hdr|img)(\.gz)?$", "", path.name)
    return [] if stem == path.name else [p for e in ("hdr", "img", "hdr.gz", "img.gz") if (p := path.with_name(f"{stem}.{e}")).exists()]


def last_line(said):
    lines = [line for line in said.strip().splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith("error")]
    return (errors or lines or [""])[-1]


def flattened(array, found):
    """All pages along z, with the samples of a page as channels."""
    samples = found[1]
    t, c, z, y, x = array.shape
    pages = array.reshape(t, c // samples, samples, z, y, x).transpose(0, 3, 1, 2, 4, 5)
    return pages.reshape(-1, samples, y, x).transpose(1, 0, 2, 3)[np.newaxis].reshape(found)


STORE_TYPES = {"uint8": "u8", "int8": "i8", "uint16": "u16", "int16": "i16", "uint32": "u32", "int32": "i32", "float32": "f32"}
# What wider types are documented to become, and booleans and halves without loss.
BECOMES = {"bool": "u8", "float16": "f32", "float64": "f32", "int64": "i32", "uint64": "u32"}


def check_type(found, array, reference):
    name = array.dtype.newbyteorder("=").name
    expected = "f32" if reference.rescaled else {**STORE_TYPES, **BECOMES}.get(name)
    if reference.typed and found != expected:
        raise Wrong(f"voxels are {found}, expected {expected} of {name}")


def check_values(found, expected, reference, padding, nodata, said, where):
    if found.shape != expected.shape:
        raise Wrong(f"{where}: exported {found.shape}, expected {expected.shape}")
    narrowed = False
    with np.errstate(over="ignore", invalid="ignore"):
        if expected.dtype.kind in "iub" and expected.dtype.itemsize == 8 and not reference.rescaled:
            limits = np.iinfo(found.dtype) if found.dtype.kind in "iu" else None
            clamped = np.clip(expected, limits.min, limits.max) if limits else expected
            narrowed = bool((clamped != expected).any())
            expected = clamped
        wide = expected.astype(np.float64)
        expected = wide.astype(np.float32).astype(np.float64) if found.dtype == np.float32 else wide
        narrowed |= bool((np.isfinite(wide) & ~np.isfinite(expected)).any())
    if padding is not None and padding.any():
        expected = np.where(padding, np.nan if found.dtype == np.float32 else nodata, expected)
    got = found.astype(np.float64)
    with np.errstate(invalid="ignore"):
        same = (got == expected) | (np.isnan(got) & np.isnan(expected)) | (np.abs(got - expected) <= reference.tolerance)
    if not same.all():
        at = tuple(int(i) for i in np.argwhere(~same)[0])
        raise Wrong(
            f"{where}: {int((~same).sum())} of {same.size} voxels differ; at z,y,x {at} found {got[at]!r}, expected {expected[at]!r}"
        )
    if narrowed and not any(re.search(r"\b\d+\b", line) for line in said.splitlines() if re.search("beyond|clamp|infinit", line)):
        raise Wrong(f"{where}: values beyond the voxel type were clamped, and their number was not said: {said.strip()[-300:]}")


def check_place(info, reference):
    close = lambda a, b: np.allclose(a, b, rtol=1e-5, atol=1e-5 * max(1e-9, float(np.abs(b).max())))
    if reference.spacing is not None and not close(info["spacing"], np.array(reference.spacing)):
        raise Wrong(f"spacing {info['spacing']}, expected {reference.spacing}")
    if reference.origin is not None and not close(info["origin"], np.array(reference.origin)):
        raise Wrong(f"origin {info['origin']}, expected {reference.origin}")
    if reference.unit is not None and info["unit"] != reference.unit:
        raise Wrong(f"unit {info['unit']}, expected {reference.unit}")
    names = [display["name"] for display in info["displays"]]
    if reference.names is not None and names != reference.names:
        raise Wrong(f"names of channels {names}, expected {reference.names}")
    if reference.matrix is None:
        return
    matrix = np.asarray(reference.matrix, float)[:3]
    kept = info["store"]["orientation"]
    if kept is not None:
        if not close(np.array(kept), matrix):
            raise Wrong(f"orientation {kept}, expected {matrix.tolist()}")
    elif not close(info["origin"], matrix[:, 3]):
        raise Wrong(f"origin {info['origin']}, expected {matrix[:, 3].tolist()}")
    elif not close(np.diag(info["spacing"]), matrix[:, :3]):
        raise Wrong(f"upright with spacing {info['spacing']}, expected {matrix.tolist()}")
