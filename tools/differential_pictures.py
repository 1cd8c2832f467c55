"""Pictures of differential.py: PNG, JPEG and BMP files as Pillow, imageio and pypng write them, and what pypng and Pillow say of any such file."""

import imageio.v3
import numpy as np
import png
from differential_check import Case, Reference
from PIL import Image

KINDS = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG", ".bmp": "BMP"}
# Of JPEG decoders, which round differently: gray, and colours of a lower resolution. These are interpolated by one alone in less than five pixels.
TOLERANCES = {1: 1.0, 3: 6.0}
LEAST_OF_JPEG = 5
# Pixels per inch, along x and y; the first two are a screen's.
DENSITIES = [(72, 72), (96, 96), (300, 300), (200, 400), (2540, 2540)]
INCH = {"PNG": 0.0254, "BMP": 0.0254, "JPEG": 1.0}
LABELS = ["--kind", "labels"]


def picture_reference(paths, labels=False):
    """The slices of pictures of one kind, with their channels."""
    planes = [plane_of(path, labels) for path in paths]
    if any(plane.shape != planes[0].shape for plane in planes):
        raise ValueError("pictures of unlike sizes or channels")
    # As t, c, z, y, x.
    array = np.stack(planes).transpose(3, 0, 1, 2)[np.newaxis]
    jpeg = paths[0].suffix in (".jpg", ".jpeg")
    if jpeg and array.shape[1] > 1 and array.shape[-1] <= 4:
        raise ValueError("libjpeg does not interpolate the colours of so few pixels")
    return Reference(array, tolerance=TOLERANCES[array.shape[1]] if jpeg else 0.0)


def plane_of(path, labels):
    """y, x, channels."""
    if KINDS[path.suffix] == "PNG":
        return stored_numbers(path, labels)
    with Image.open(path) as picture:
        if picture.mode == "P":
            return np.asarray(picture)[:, :, np.newaxis] if labels else of_colours(np.asarray(picture.convert("RGB")), palette_of(picture))
        if picture.mode not in ("1", "L", "RGB", "RGBA"):
            raise ValueError(f"mode {picture.mode}")
        array = np.asarray(picture.convert("L") if picture.mode == "1" else picture)
        if labels and picture.mode == "1":
            array = array // 255
    return array.reshape(*array.shape[:2], -1)


def palette_of(picture):
    return np.array(picture.getpalette("RGB"), "u1").reshape(-1, 3)


def stored_numbers(path, labels):
    with open(path, "rb") as file:
        width, height, rows, info = png.Reader(file=file).read()
        rows = np.array([list(row) for row in rows])
    array = rows.reshape(height, width, -1).astype("u2" if info["bitdepth"] == 16 else "u1")
    if "palette" not in info or labels:
        return array
    colours = np.array([colour[:3] for colour in info["palette"]], "u1")
    return of_colours(colours[array[:, :, 0]], colours)


def of_colours(pixels, colours):
    """One channel where all colours are gray."""
    is_gray = (colours == colours[:, :1]).all()
    return pixels[:, :, :1] if is_gray else pixels


def picture_case(label, collection, path):
    kind = KINDS[path.suffix]
    return Case(label, collection, kind, "found", [path], lambda: picture_reference([path]))


def write_pictures(rng, stem, name):
    """One picture, or a folder or list of them."""
    write = pick(rng, write_png, write_png, write_stored_png, write_jpeg, write_jpeg, write_bmp)
    count = int(pick(rng, 1, 1, 2, 11))
    size = [int(n) for n in rng.integers(1, 70, 2)]
    stem.mkdir(exist_ok=True)
    for old in stem.iterdir():
        old.unlink()
    density = DENSITIES[rng.integers(len(DENSITIES))] if rng.random() < 0.4 and write is not write_stored_png else None
    paths, kind, group, refused, labels = write(rng, stem, count, size, density)
    order = sorted(paths) if count > 1 and rng.random() < 0.3 else [stem]
    flags = LABELS if labels else []

    def reference():
        found = picture_reference(paths, labels)
        if density:
            found.spacing = spacing_of(kind, density)
        return found

    return Case(name, "written", kind, group, order, reference, flags, must_refuse=refused, alone=order != [stem])


def spacing_of(kind, density):
    if density in DENSITIES[:2]:
        return (1, 1, 1)
    x, y = (INCH[kind] / dots for dots in density)
    return (x, y, x)


def named(stem, count, suffix):
    return [stem / f"s_{i}{suffix}" for i in range(1, count + 1)]


def pick(rng, *choices):
    return choices[rng.integers(len(choices))]


def pixels(rng, dtype, *shape):
    """Any values, or smooth ones, as JPEG expects them."""
    most = np.iinfo(dtype).max
    if rng.random() < 0.4:
        return rng.integers(0, most, shape, dtype, endpoint=True)
    ramp = np.cumsum(rng.integers(-3, 4, shape), axis=1)
    return (np.clip(ramp + rng.integers(most), 0, most)).astype(dtype)


def write_png(rng, stem, count, size, density):
    """By Pillow and imageio."""
    mode, paths = pick(rng, "1", "L", "LA", "P", "RGB", "RGBA", "I;16"), named(stem, count, ".png")
    labels = mode == "P" and rng.random() < 0.4
    by_imageio = mode in ("L", "RGB", "RGBA", "I;16") and density is None and rng.random() < 0.4
    gray, colours, bits = rng.random() < 0.3, rng.integers(0, 256, (16, 3)), int(pick(rng, 1, 2, 4, 8))
    if gray:
        colours[:] = colours[:, :1]
    channels = {"LA": [2], "RGB": [3], "RGBA": [4]}.get(mode, [])
    for path in paths:
        array = pixels(rng, "u2" if mode == "I;16" else "u1", size[1], size[0], *channels)
        if by_imageio:
            imageio.v3.imwrite(path, array)
            continue
        if mode == "P":
            picture = Image.fromarray(array % min(16, 1 << bits), "P")
            picture.putpalette(colours.astype("u1").tobytes())
        else:
            picture = Image.fromarray(array > 127) if mode == "1" else Image.fromarray(array)
        more = {"dpi": density} if density else {}
        if mode == "P":
            more["bits"] = bits
        picture.save(path, optimize=bool(rng.random() < 0.3), compress_level=int(rng.integers(10)), **more)
    return paths, "PNG", f"{'imageio' if by_imageio else 'Pillow'} {mode}", False, labels


def write_stored_png(rng, stem, count, size, _density):
    """By pypng: every depth, interlaced or not."""
    colour, bits = pick(rng, "gray", "gray", "alpha", "rgb", "rgba", "palette"), int(pick(rng, 1, 2, 4, 8, 16))
    if colour in ("alpha", "rgb", "rgba"):
        bits = int(pick(rng, 8, 16))
    if colour == "palette":
        bits = min(bits, 8)
    samples = {"alpha": 2, "rgb": 3, "rgba": 4}.get(colour, 1)
    options = {"greyscale": colour in ("gray", "alpha"), "alpha": colour in ("alpha", "rgba"), "bitdepth": bits}
    if colour == "palette":
        options = {"bitdepth": bits, "palette": [tuple(int(n) for n in c) for c in rng.integers(0, 256, (1 << bits, 3))]}
    elif colour == "gray" and rng.random() < 0.2:
        options["transparent"] = 1
    labels, interlace = colour == "palette" and rng.random() < 0.4, bool(rng.random() < 0.5)
    paths = named(stem, count, ".png")
    for path in paths:
        array = rng.integers(0, 1 << bits, (size[1], size[0] * samples))
        with open(path, "wb") as file:
            png.Writer(size[0], size[1], interlace=interlace, **options).write(file, array.tolist())
    return paths, "PNG", f"pypng {colour} {bits}{' interlaced' if interlace else ''}", False, labels


def write_jpeg(rng, stem, count, size, density):
    mode, paths = pick(rng, "L", "L", "RGB", "RGB", "RGB", "RGB", "CMYK"), named(stem, count, ".jpg")
    options = {"quality": int(pick(rng, 5, 30, 75, 95, 100)), "progressive": bool(rng.random() < 0.4), "optimize": bool(rng.random() < 0.3)}
    if mode == "RGB":
        options["subsampling"] = int(rng.integers(3))
    if rng.random() < 0.3:
        options["restart_marker_blocks"] = int(rng.integers(1, 9))
    if density:
        options["dpi"] = density
    size = [max(n, LEAST_OF_JPEG) for n in size]
    for path in paths:
        array = pixels(rng, "u1", size[1], size[0], *{"RGB": [3], "CMYK": [4]}.get(mode, []))
        Image.fromarray(array, mode).save(path, **options)
    labels = mode == "L" and rng.random() < 0.1
    group = f"{mode} {'progressive' if options['progressive'] else 'baseline'} {options.get('subsampling', '')}".strip()
    return paths, "JPEG", group, mode == "CMYK" or labels, labels


def write_bmp(rng, stem, count, size, density):
    mode, paths = pick(rng, "1", "L", "P", "RGB", "RGBA"), named(stem, count, ".bmp")
    colours = rng.integers(0, 256, (256, 3))
    for path in paths:
        array = pixels(rng, "u1", size[1], size[0], *{"RGB": [3], "RGBA": [4]}.get(mode, []))
        picture = Image.fromarray(array > 127) if mode == "1" else Image.fromarray(array, mode)
        if mode == "P":
            picture.putpalette(colours.astype("u1").tobytes())
        picture.save(path, **({"dpi": density} if density else {}))
    return paths, "BMP", f"Pillow {mode}", False, mode in ("1", "P") and rng.random() < 0.4
