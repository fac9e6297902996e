"""A thousand damaged files are read and evaluated, or rejected with a one-line error; no other exception, no hang."""

import base64
import re
import shutil
import time
import warnings
import zlib

import h5py
import numpy as np
import pytest

from elvis import ElvisError
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.evaluation import evaluate
from elvis.formats.reading import read

ROUNDS = 24
SECONDS_EACH = 10.0
XML_CASES = ["chan3d_tet", "prismhex_wss", "gen_pyr_curved", "quad4", "chan3dh1d", "naca_h1d_line", "scale_compressed"]
XML_CASES += ["triquad_h1d", "hex_chk", "line_1d", "gen_quadface_2d"]
HDF5_CASES = ["kova_varp", "gen_hex_xscale", "interptest_hdf5", "triquad_h5", "gen_allelem_var_h5"]
EXTREMES = ["", "0", "-1", "1", "3", "7", "2147483648", "9223372036854775807", "99999999999999999999"]
EXTREMES += ["1e308", "nan", "0-99999999999"]
ITEMS = np.array([0, -1, 1, 2, 17, 24, 99, 2**31, 2**62, -(2**63), 0x7FF0000000000000, 0x7FF8000000000000], np.int64)
PAYLOAD = re.compile(rb">(eJ[A-Za-z0-9+/]{10,}={0,2})<")
NUMBER = re.compile(rb"(?<=[\"\s,:\[\->])[0-9]+(?=[\"\s,\]\-<])")
VALUE = re.compile(rb'="[^"]*"')
TAG = re.compile(rb"</?[A-Za-z]+")


def flipped(data, random):
    """A few bits turned over."""
    out = bytearray(data)
    for place in random.integers(0, len(out), random.integers(1, 9)):
        out[place] ^= 1 << random.integers(0, 8)
    return bytes(out)


def cut(data, random):
    """The beginning only."""
    return data[: random.integers(0, len(data))]


def shortened(data, random):
    """A stretch left out."""
    start, length = random.integers(0, len(data)), random.integers(1, 200)
    return data[:start] + data[start + length :]


def repeated(data, random):
    """A stretch twice."""
    start, length = random.integers(0, len(data)), random.integers(1, 400)
    return data[: start + length] + data[start:]


def strewn(data, random):
    """Bytes put in."""
    place = random.integers(0, len(data))
    return data[:place] + random.bytes(random.integers(1, 20)) + data[place:]


def renumbered(data, random):
    """A number in the text replaced by an extreme one."""
    return substituted(data, random, NUMBER, lambda _: str(random.choice(EXTREMES)).encode())


def revalued(data, random):
    """The value of an attribute replaced by that of another."""
    values = VALUE.findall(data)
    return substituted(data, random, VALUE, lambda _: values[random.integers(0, len(values))])


def retagged(data, random):
    """A tag replaced by another."""
    tags = TAG.findall(data)
    return substituted(data, random, TAG, lambda _: tags[random.integers(0, len(tags))])


def repacked(data, random):
    """A payload unpacked, damaged within and packed again."""
    return substituted(data, random, PAYLOAD, lambda payload: b">" + damaged_payload(payload[1:-1], random) + b"<")


def damaged_payload(text, random):
    raw = zlib.decompressobj().decompress(base64.b64decode(text + b"=="))
    items = np.frombuffer(raw[: len(raw) // 8 * 8], np.int64).copy()
    kind = random.integers(0, 5)
    if kind == 0 and len(items):
        items[random.integers(0, len(items), random.integers(1, 4))] = random.choice(ITEMS)
    elif kind == 1 and len(items):
        items[random.integers(0, len(items))] = items[random.integers(0, len(items))]
    elif kind == 2:
        items = items[: random.integers(0, len(items) + 1)]
    elif kind == 3:
        items = np.concatenate([items, items[: random.integers(0, 9)]])
    else:
        return base64.b64encode(zlib.compress(flipped(raw or b"\0", random)))
    return base64.b64encode(zlib.compress(items.tobytes()))


def substituted(data, random, pattern, change):
    found = list(pattern.finditer(data))
    if not found:
        return data
    match = found[random.integers(0, len(found))]
    return data[: match.start()] + change(match[0]) + data[match.end() :]


SUFFIXES = (".xml", ".fld", ".nekg", ".rst", ".chk")
ON_BYTES = [flipped, cut, shortened, repeated, strewn]
ON_XML = [*ON_BYTES, renumbered, renumbered, revalued, retagged, repacked, repacked, repacked]


def change_hdf5(path, random):
    """One dataset or attribute of the file changed in value, kind, size or presence."""
    with h5py.File(path, "r+") as file:
        names = []
        file.visit(names.append)
        owner = file[names[random.integers(0, len(names))]]
        if len(owner.attrs) and random.integers(0, 2):
            change_attribute(owner, random)
        elif isinstance(owner, h5py.Dataset):
            change_dataset(file, owner.name, random)
        else:
            change_group(file, owner.name, random)


def change_attribute(owner, random):
    name = list(owner.attrs)[random.integers(0, len(owner.attrs))]
    value = owner.attrs[name]
    others = [value, 0, -1, 2**40, 1.5, [1, 2, 3], h5py.Empty("f")]
    others += ["", "UNIORDER:9999999,1", "MIXORDER", "Prism", b"\xff\xfe", ["u", "u"]]
    chosen = others[random.integers(0, len(others))]
    del owner.attrs[name]
    if random.integers(0, 5):
        owner.attrs[name] = chosen


def change_dataset(file, name, random):
    values = file[name][()]
    del file[name]
    kind = random.integers(0, 8)
    if kind == 0:
        return
    if kind == 1:
        file.create_group(name)
    elif kind == 2:
        file[name] = h5py.ExternalLink("/etc/passwd", "/x") if random.integers(0, 2) else h5py.SoftLink(name)
    elif kind == 3:
        file[name] = values[: random.integers(0, len(values) + 1)] if np.ndim(values) else values
    elif kind == 4:
        file.create_dataset(name, (10**12, 3), "f8", chunks=(1000, 3), compression="gzip")
    elif kind == 5:
        file[name] = np.reshape(values, (1, *np.shape(values))) if values.dtype.kind != "O" else np.arange(4)
    elif values.dtype.kind == "O":
        texts = [random.choice([" A[0-9999999999] ", "C[", "0-1", "", " Z[1] "]) for _ in values]
        file.create_dataset(name, data=texts, dtype=h5py.string_dtype("ascii"))
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            changed = values.astype(random.choice(["f4", "i8", "u8", "f8", "i1", values.dtype.str]))
            if changed.size:
                changed.reshape(-1)[random.integers(0, changed.size)] = random.choice(ITEMS).astype(changed.dtype)
        file[name] = changed


def change_group(file, name, random):
    if random.integers(0, 2):
        del file[name]
    else:
        file.move(name, f"{name}_other")


def attempt(paths, what, seconds):
    """Read the files, and let nothing but an ElvisError of one sentence out."""
    start, message = time.process_time(), "read and evaluated"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            dataset = read(*paths)
        with np.errstate(all="ignore"):
            for patch in patches(dataset, [field.name for field in dataset.fields]):
                evaluate(patch.geometry, patch.geometry_coefficients, patch.shape.vertices / 3)
    except ElvisError as error:
        message = str(error)
    except Exception as error:
        raise AssertionError(f"{what}: {type(error).__name__}: {error}") from error
    assert "\n" not in message, what
    assert 10 < len(message) < 1000, what
    assert time.process_time() - start < seconds, what


def damage(path, case, seed):
    random = np.random.default_rng([seed, len(case), *case.encode()])
    raw = path.read_bytes()
    if raw.startswith(b"\x89HDF"):
        if random.integers(0, 3):
            change_hdf5(path, random)
            return "change_hdf5"
        tools = ON_BYTES
    else:
        tools = ON_XML
    chosen = tools[random.integers(0, len(tools))]
    for _ in range(random.integers(1, 3)):
        raw = chosen(raw, random) if raw else raw
    path.write_bytes(raw)
    return chosen.__name__


@pytest.mark.parametrize("case", [*XML_CASES, *HDF5_CASES])
def test_damaged_files_are_read_or_rejected(case, nektar, tmp_path, slowness):
    files = sorted(path for path in (nektar / case).iterdir() if path.suffix in SUFFIXES)
    for seed in range(ROUNDS):
        for path in files:
            shutil.copyfile(path, tmp_path / path.name)
        target = tmp_path / files[seed % len(files)].name
        done = damage(target, case, seed)
        given = [tmp_path / path.name for path in files if path.suffix != ".nekg"]
        attempt(given, f"{case}, {target.name}, round {seed}, {done}", slowness * SECONDS_EACH)
