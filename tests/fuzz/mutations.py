"""Damage to files: bytes, numbers in text, XML, members of HDF5 files and of archives, payloads of the native format.

Every kind of damage takes the bytes of a sound file and a generator of random numbers, and returns other bytes.
"""

import base64
import io
import re
import warnings
import zipfile
import zlib
from pathlib import Path

import h5py
import numpy as np

#: what takes the place of a number in a text
NUMBERS = ["", "0", "-1", "1", "2", "3", "7", "17", "255", "65536", "2147483648", "-2147483649", "99999999999"]
NUMBERS += ["9223372036854775807", "99999999999999999999", "1e308", "-1e308", "1e-320", "nan", "-inf", "1e999", "x"]
NUMBERS += ["0-99999999999", "1.5", "1,2", "0x10", "٣"]

#: what takes the place of eight bytes
ITEMS = [0, -1, 1, 2, 17, 24, 99, 2**31, 2**62, -(2**63), 0x7FF0000000000000, 0x7FF8000000000000, 10**10]

NUMBER = re.compile(rb"(?<![\w.])-?\d+(\.\d*)?([eE][+-]?\d+)?")
VALUE = re.compile(rb"""=\s*("[^"]*"|'[^']*')""")
TAG = re.compile(rb"</?\w+")
PAYLOAD = re.compile(rb">(eJ[A-Za-z0-9+/]{10,}={0,2})<")
HEAD = 2000


def place(data, random, length=0):
    """Where damage begins; half of the time near the beginning, where files say what they hold."""
    end = max(1, len(data) - length)
    return int(random.integers(0, min(end, HEAD) if random.integers(0, 2) else end))


def flip(data, random):
    """A few bits turned over."""
    out = bytearray(data)
    for _ in range(random.integers(1, 9)):
        out[place(out, random)] ^= 1 << int(random.integers(0, 8))
    return bytes(out)


def overwrite(data, random):
    """A stretch of other bytes."""
    length = int(random.choice([1, 2, 4, 8, 16, 64]))
    start = place(data, random, length)
    filling = [bytes(length), b"\xff" * length, random.bytes(length), b" " * length][random.integers(0, 4)]
    return data[:start] + filling + data[start + length :]


def renumber_binary(data, random):
    """A whole number of four or eight bytes, in either order of bytes, replaced by an extreme one."""
    size = int(random.choice([4, 8]))
    start = place(data, random, size) // 4 * 4
    item = int(random.choice(np.array(ITEMS, object))) & (2 ** (8 * size) - 1)
    raw = item.to_bytes(size, "little" if random.integers(0, 2) else "big")
    return data[:start] + raw + data[start + size :]


def cut(data, random):
    """The beginning alone."""
    return data[: place(data, random)]


def leave_out(data, random):
    """A stretch left out."""
    start, length = place(data, random), int(random.choice([1, 4, 8, 60, 400]))
    return data[:start] + data[start + length :]


def repeat(data, random):
    """A stretch twice."""
    start, length = place(data, random), int(random.integers(1, 400))
    return data[: start + length] + data[start:]


def insert(data, random):
    """Bytes put in."""
    start = place(data, random)
    return data[:start] + random.bytes(int(random.integers(1, 20))) + data[start:]


def exchange(data, random):
    """Two stretches in each other's place."""
    length = int(random.choice([4, 8, 32]))
    one, other = sorted(place(data, random, length) for _ in range(2))
    if other < one + length:
        return flip(data, random)
    first, second = data[one : one + length], data[other : other + length]
    return data[:one] + second + data[one + length : other] + first + data[other + length :]


def substitute(data, random, pattern, change):
    """One match of a pattern, near the beginning half of the time, replaced by what ``change`` makes of it."""
    window = data[:HEAD] if random.integers(0, 2) else data[:60000]
    found = list(pattern.finditer(window)) or list(pattern.finditer(data[:200000]))
    if not found:
        return flip(data, random)
    match = found[random.integers(0, len(found))]
    return data[: match.start()] + change(match[0]) + data[match.end() :]


def renumber(data, random):
    """A number in a text replaced by an extreme one."""
    return substitute(data, random, NUMBER, lambda _: str(random.choice(NUMBERS)).encode())


def revalue(data, random):
    """The value of an attribute replaced by that of another, or by an extreme number."""
    values = VALUE.findall(data[:60000])
    if not values:
        return renumber(data, random)
    chosen = values[random.integers(0, len(values))]
    if random.integers(0, 2):
        chosen = b'"' + str(random.choice(NUMBERS)).encode() + b'"'
    return substitute(data, random, VALUE, lambda _: b"=" + chosen)


def retag(data, random):
    """A tag replaced by another."""
    tags = TAG.findall(data[:60000])
    if not tags:
        return renumber(data, random)
    return substitute(data, random, TAG, lambda _: tags[random.integers(0, len(tags))])


def reline(data, random):
    """A line left out, said twice, or moved."""
    lines = data.split(b"\n")
    one, other = (int(random.integers(0, len(lines))) for _ in range(2))
    kind = random.integers(0, 3)
    if kind == 0:
        del lines[one]
    elif kind == 1:
        lines.insert(other, lines[one])
    else:
        lines[one], lines[other] = lines[other], lines[one]
    return b"\n".join(lines)


def repack(data, random):
    """A payload unpacked, damaged within and packed again."""
    return substitute(data, random, PAYLOAD, lambda match: b">" + _payload(match[1:-1], random) + b"<")


def _payload(text, random):
    try:
        raw = zlib.decompressobj().decompress(base64.b64decode(text + b"=="))
    except (zlib.error, ValueError):  # damaged before
        return flip(text, random)
    items = np.frombuffer(raw[: len(raw) // 8 * 8], np.int64).copy()
    kind = random.integers(0, 5)
    if kind == 0 and len(items):
        items[random.integers(0, len(items), random.integers(1, 4))] = ITEMS[random.integers(0, len(ITEMS))]
    elif kind == 1 and len(items):
        items[random.integers(0, len(items))] = items[random.integers(0, len(items))]
    elif kind == 2:
        items = items[: random.integers(0, len(items) + 1)]
    elif kind == 3:
        items = np.concatenate([items, items[: random.integers(0, 9)]])
    else:
        return base64.b64encode(zlib.compress(flip(raw or b"\0", random)))
    return base64.b64encode(zlib.compress(items.tobytes()))


BYTES = (flip, flip, overwrite, renumber_binary, renumber_binary, cut, leave_out, repeat, insert, exchange)
TEXT = (flip, cut, leave_out, repeat, insert, *(renumber,) * 6, reline, reline, exchange)
XML = (*TEXT, revalue, revalue, retag, repack, repack, repack)


def rezip(data, random):
    """A member of an archive left out, exchanged with another, or with other bytes, another shape or another type."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    names = list(members)
    one, other = (names[random.integers(0, len(names))] for _ in range(2))
    kind = random.integers(0, 6)
    if kind == 0:
        del members[one]
    elif kind == 1:
        members[one], members[other] = members[other], members[one]
    elif kind == 2:
        members[one] = renumber(members[one][:128], random) + members[one][128:]
    elif kind == 3:
        members[one] = BYTES[random.integers(0, len(BYTES))](members[one], random)
    else:
        stream = io.BytesIO()
        np.save(stream, other_array(np.load(io.BytesIO(members[one])), random))
        members[one] = stream.getvalue()
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED if random.integers(0, 2) else zipfile.ZIP_STORED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return out.getvalue()


def other_array(values, random):
    """An array of another shape, another type, or with an extreme entry."""
    kind = random.integers(0, 6)
    if kind == 0 and values.ndim:
        return values[: random.integers(0, len(values) + 1)]
    if kind == 1:
        return values.reshape(1, *values.shape)
    if kind == 2 and values.ndim > 1:
        return np.swapaxes(values, 0, -1).copy()
    if kind == 3:
        return np.array([[], 0, -1, 1e300, "text", [1, 2, 3], [[0]]][random.integers(0, 7)])
    if values.dtype.kind not in "iuf":
        return values[:0]
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)
        changed = values.astype(random.choice(["f4", "i8", "u8", "f8", "i1", "c16", values.dtype.str]))
        if changed.size:
            item = np.array([ITEMS[random.integers(0, len(ITEMS))]], np.int64).view(np.float64)
            extreme = item if random.integers(0, 2) else np.float64(ITEMS[random.integers(0, len(ITEMS))])
            changed.reshape(-1)[random.integers(0, changed.size)] = (
                np.asarray(extreme).astype(changed.dtype).reshape(())
            )
    return changed


def change_hdf5(path, random):
    """One object or attribute of an HDF5 file changed in value, type, size, name or presence."""
    with h5py.File(path, "r+") as file:
        names = ["/"]
        file.visit(names.append)
        owner = file[names[random.integers(0, len(names))]]
        if len(owner.attrs) and random.integers(0, 2):
            _change_attribute(owner, random)
        elif isinstance(owner, h5py.Dataset):
            _change_dataset(file, owner.name, random)
        elif owner.name != "/":
            _change_group(file, owner.name, random)


def _change_attribute(owner, random):
    name = list(owner.attrs)[random.integers(0, len(owner.attrs))]
    value = owner.attrs[name]
    others = [value, 0, -1, 2**40, 1.5, float("nan"), [1, 2, 3], h5py.Empty("f"), "", "x" * 300, b"\xff\xfe"]
    others += ["UNIORDER:9999999,1", "MIXORDER", "Prism", ["u", "u"], np.zeros((2, 2)), np.float64(1e300)]
    chosen = others[random.integers(0, len(others))]
    if np.asarray(value).dtype.kind in "iuf" and random.integers(0, 2):
        chosen = other_array(np.asarray(value), random)
    del owner.attrs[name]
    if (random.integers(0, 6) and np.asarray(chosen).dtype.kind != "U") or isinstance(chosen, (str, list)):
        owner.attrs[name] = chosen


def _change_dataset(file, name, random):
    values = file[name][()]
    attributes = dict(file[name].attrs)
    del file[name]
    kind = int(random.integers(0, 9))
    if kind == 0:
        return
    if kind == 1:
        file.create_group(name)
    elif kind == 2:
        links = h5py.ExternalLink("/etc/passwd", "/x"), h5py.SoftLink(name), h5py.SoftLink("/")
        file[name] = links[random.integers(0, 3)]
        return
    elif kind == 3:
        shape = (int(random.choice([10**6, 10**12])), *np.shape(values)[1:])
        options = {"chunks": (1000, *np.shape(values)[1:]), "compression": "gzip"} if random.integers(0, 2) else {}
        file.create_dataset(name, shape, getattr(values, "dtype", "f8"), **options)
    elif np.asarray(values).dtype.kind in "iuf":
        file[name] = numbers(np.asarray(values), random)
    else:
        texts = [random.choice(["A[0-9999999999]", "C[", "0-1", "", "Z[1]", "ü", "9" * 300]) for _ in np.ravel(values)]
        file.create_dataset(name, data=texts, dtype=h5py.string_dtype())
    file[name].attrs.update(attributes)


def numbers(values, random):
    """Another array of numbers, of a type that HDF5 holds."""
    changed = other_array(values, random)
    return changed if changed.dtype.kind in "iufc" else values[:0]


def _change_group(file, name, random):
    if random.integers(0, 2):
        del file[name]
    else:
        file.move(name, f"{name}_other")


def damage(path, random):
    """Damage a file in one way or two; the names of these."""
    path = Path(path)
    raw = path.read_bytes()
    if raw.startswith(b"\x89HDF") and random.integers(0, 3):
        change_hdf5(path, random)
        return "change_hdf5"
    if raw.startswith(b"PK\x03\x04") and random.integers(0, 3):
        path.write_bytes(rezip(raw, random))
        return "rezip"
    is_binary = b"\0" in raw[:HEAD]
    kinds = BYTES if is_binary else XML if raw.lstrip().startswith(b"<") else TEXT
    names = []
    for _ in range(random.integers(1, 3)):
        chosen = kinds[random.integers(0, len(kinds))]
        raw = chosen(raw, random) if raw else raw
        names.append(chosen.__name__)
    path.write_bytes(raw)
    return " ".join(names)
