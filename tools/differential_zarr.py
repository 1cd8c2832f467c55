"""Random Zarr arrays of differential.py, by zarr-python: both versions, orders, byte orders, keys, codecs, filters, shards, fill values and gaps."""

import numcodecs
import numcodecs.zarr3
import numpy as np
import zarr
from differential_cases import in_five
from differential_check import Case, Reference
from differential_written import TYPES, noise, pick
from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, GzipCodec, ShardingCodec, TransposeCodec, ZstdCodec

COMPRESSORS = ["blosclz", "lz4", "lz4hc", "zlib", "zstd"]


def write_zarr(rng, stem, name):
    dtype = pick(rng, *TYPES, *TYPES, "b1", "c8", "M8[ns]")
    axes = pick(rng, "x", "yx", "zyx", "zyx", "tyx", "xyz", "zyxc", "tzyx", "tczyx", "six")
    shape = random_shape(rng, 6 if axes == "six" else len(axes))
    values = np.zeros(shape, dtype) if dtype[0] in "cM" else noise(rng, dtype, *shape)
    path = stem.with_suffix(".zarr")
    what = write_array(rng, path, values)
    case = Case(name, "written", "Zarr", f"{what} {values.dtype.name}", [path], None, ["--axes", axes], alone=False)
    case.must_refuse = axes in ("x", "six") or dtype[0] in "cM"
    if axes == "six":
        case.flags = []
    case.reference = lambda: Reference(in_five(zarr.open_array(path, mode="r")[...], axes.upper()))
    return case


def random_shape(rng, axes):
    return [int(n) for n in rng.integers(1, {1: 200, 2: 60, 3: 30, 4: 12, 5: 8}.get(axes, 6), axes)]


def write_array(rng, path, values):
    """Writes all or a part of some values in any way, and says in which."""
    is_v3 = bool(rng.random() < 0.6)
    chunks = tuple(int(rng.integers(1, n + 3)) for n in values.shape)
    write = write_v3 if is_v3 else write_v2
    array, what = write(rng, path, values, chunks)
    # A part of the chunks, or all.
    part = tuple(slice(0, int(rng.integers(1, n + 1))) for n in values.shape) if rng.random() < 0.3 else ...
    array[part] = values[part]
    return what


def random_fill(rng, dtype):
    if dtype.kind == "f":
        return pick(rng, 0, 1.5, float("nan"), float("inf"), float("-inf"), -0.1)
    if dtype.kind in "iu":
        return int(pick(rng, 0, 7, np.iinfo(dtype).max, np.iinfo(dtype).min))
    return False if dtype.kind == "b" else 0


def write_v2(rng, path, values, chunks):
    dtype = values.dtype.newbyteorder(pick(rng, "<", ">"))
    compressor = pick(
        rng,
        None,
        numcodecs.Blosc(pick(rng, *COMPRESSORS), int(rng.integers(10)), int(pick(rng, -1, 0, 1, 2)), int(pick(rng, 0, 0, 512))),
        numcodecs.Zstd(int(rng.integers(1, 10)), checksum=bool(rng.random() < 0.5)),
        numcodecs.GZip(int(rng.integers(10))),
        numcodecs.Zlib(int(rng.integers(10))),
        numcodecs.LZ4(),
    )
    filters = pick(rng, None, None, [numcodecs.Shuffle(dtype.itemsize)], [numcodecs.Delta(dtype)] if dtype.kind in "iuf" else None)
    order = pick(rng, "C", "C", "F")
    array = zarr.create_array(
        path,
        shape=values.shape,
        dtype=dtype,
        chunks=chunks,
        compressors=compressor,
        filters=filters,
        order=order,
        fill_value=pick(rng, None, random_fill(rng, values.dtype)),
        zarr_format=2,
        chunk_key_encoding={"name": "v2", "separator": pick(rng, ".", "/")},
        config={"write_empty_chunks": bool(rng.random() < 0.5)},
    )
    names = [codec.codec_id for codec in [*(filters or []), *([compressor] if compressor else [])]]
    return array, f"2 {order} {' '.join(names) or 'plain'}"


def write_v3(rng, path, values, chunks):
    size = values.dtype.itemsize
    choices = {
        "plain": [],
        "blosc": [BloscCodec(typesize=size, cname=pick(rng, *COMPRESSORS), clevel=int(rng.integers(10)), shuffle=pick(rng, "noshuffle", "shuffle", "bitshuffle"))],
        "zstd": [ZstdCodec(level=int(rng.integers(1, 10)), checksum=bool(rng.random() < 0.5))],
        "gzip": [GzipCodec(level=int(rng.integers(10)))],
        "crc32c": [Crc32cCodec()],
        "zstd crc32c": [ZstdCodec(), Crc32cCodec()],
        "shuffle zlib": [numcodecs.zarr3.Shuffle(elementsize=size), numcodecs.zarr3.Zlib(level=3)],
        "numcodecs lz4": [numcodecs.zarr3.LZ4()],
        "numcodecs blosc": [numcodecs.zarr3.Blosc(cname=pick(rng, *COMPRESSORS), shuffle=int(rng.integers(3)))],
    }
    name = pick(rng, *choices)
    transposes = [TransposeCodec(order=tuple(int(n) for n in rng.permutation(len(chunks))))] if rng.random() < 0.4 else []
    bytes_codec = BytesCodec(endian=pick(rng, "little", "big"))
    options = {"filters": transposes, "serializer": bytes_codec, "compressors": choices[name], "chunks": chunks}
    kind = pick(rng, "chunks", "chunks", "shards")
    if kind == "shards":
        shard = tuple(n * int(rng.integers(1, 4)) for n in chunks)
        is_inside = bool(rng.random() < 0.5) or not transposes
        inner = chunks if is_inside else tuple(chunks[n] for n in transposes[0].order)
        index_codecs = [BytesCodec(endian=pick(rng, "little", "big")), *pick(rng, [], [Crc32cCodec()])]
        sharding = ShardingCodec(
            chunk_shape=inner,
            codecs=[*(transposes if is_inside else []), bytes_codec, *choices[name]],
            index_codecs=index_codecs,
            index_location=pick(rng, "start", "end"),
        )
        options = {"filters": [] if is_inside else transposes, "serializer": sharding, "compressors": [], "chunks": shard}
    array = zarr.create_array(
        path,
        shape=values.shape,
        dtype=values.dtype,
        fill_value=random_fill(rng, values.dtype),
        zarr_format=3,
        chunk_key_encoding={"name": pick(rng, "default", "v2"), "separator": pick(rng, ".", "/")},
        config={"write_empty_chunks": bool(rng.random() < 0.5)},
        **options,
    )
    return array, f"3 {kind} {'turned ' if transposes else ''}{name}"


KINDS = [("zarr", write_zarr, 1)]
