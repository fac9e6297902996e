"""The parts of the readers on their own: lists of ids, expressions, payloads, numbers in text, lookups."""

import base64
import math
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elvis import FormatError
from elvis.formats.nektar import numbers, payload
from elvis.formats.nektar.assembly import Lookup
from elvis.formats.nektar.expressions import evaluate

IDS = st.lists(st.integers(0, 40) | st.integers(0, 10**12), max_size=30)


@given(IDS)
def test_lists_of_ids_round_trip(ids):
    text = numbers.format_ids(np.array(ids, np.int64))
    parsed = numbers.parse_ids(f" {text} ")
    assert parsed.count == len(ids)
    assert parsed.expand(30).tolist() == ids


@given(IDS, st.sets(st.integers(0, 60)))
def test_existing_ids_of_a_list_are_selected(ids, present):
    found = numbers.parse_ids(numbers.format_ids(np.array(ids, np.int64))).existing(np.array(sorted(present), np.int64))
    assert found.tolist() == [id for id in ids if id in present]


@pytest.mark.parametrize(
    "text", ["1,,2", "1-", "-1", "3-1", "1-2-3", "a", "1;2", "1 2", "1.5", ",", "1e3", "٣", "1-2,"]
)
def test_invalid_lists(text):
    with pytest.raises(FormatError, match="expected"):
        numbers.parse_ids(text)


def test_a_list_may_declare_more_than_memory():
    claimed = numbers.parse_ids("0-99999999999999999,5")
    assert claimed.count == 10**17 + 1
    assert claimed.existing(np.array([3, 5])).tolist() == [3, 5, 5]
    with pytest.raises(FormatError, match="expected at most 100 ids, found a list of 100000000000000001"):
        claimed.expand(100)
    with pytest.raises(FormatError, match="found 100000000"):
        numbers.parse_ids(",".join(["0-9999"] * 10_000)).existing(np.arange(10_000))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1/(2*PI)", 1 / (2 * math.pi)),
        ("3*PI/3.142/2", 3 * math.pi / 3.142 / 2),
        ("-2^2", -4.0),
        ("2^-1", 0.5),
        ("2^3^2", 512.0),
        (" 1 - 2 - 3 ", -4.0),
        ("8/4/2", 1.0),
        ("--1", 1.0),
        ("-(1+2)*3", -9.0),
        ("sqrt(2)*sin(PI/6)+cos(0)", math.sqrt(2) * math.sin(math.pi / 6) + 1),
        ("atan2(1, 1)*4", math.pi),
        ("1e-3 + .5 + 2.E2", 200.501),
        ("a*b_1", 6.0),
        ("((((((1))))))", 1.0),
    ],
)
def test_expressions(text, value):
    assert evaluate(text, {"a": 2.0, "b_1": 3.0}) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "1+",
        "(1",
        "1)",
        "1 2",
        "nothing",
        "sin",
        "sin()",
        "sin(1,2)",
        "1/0",
        "sqrt(-1)",
        "(-8)^(1/3)",
        "10^400",
        "9^9^9^9",
        "exp(1000)",
        "__import__('os')",
        "1;2",
        "a.b",
        "(" * 200 + "1" + ")" * 200,
        "2^" * 200 + "2",
        "1" * 20_000,
        "sin[1]",
        "inf",
        "nan",
    ],
)
def test_invalid_expressions_are_rejected(text):
    with pytest.raises(FormatError, match="expected"):
        evaluate(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2*(PI+nothing)", r"expression '2\*\(PI\+nothing\)': character 7: expected a known name, found 'nothing'"),
        ("2*", "expression '2\\*': expected a number, a name or \\(, found its end"),
        ("1/0", r"expected an expression with a value, found '1/0' \(float division by zero\)"),
    ],
)
def test_errors_in_expressions_state_their_position(text, message):
    with pytest.raises(FormatError, match=f"^{message}$"):
        evaluate(text)


def encoded(array, level=6, tail=b"\0"):
    return base64.b64encode(zlib.compress(array.tobytes(), level) + tail)


@pytest.mark.parametrize("size", [0, 1, 7, 200_001])
@pytest.mark.parametrize("level", [0, 6])
def test_payloads_are_decoded_with_any_padding(size, level):
    values = np.random.default_rng(size).standard_normal(size)
    for tail in (b"", b"\0", b"\0\0", b"anything"):
        text = encoded(values, level, tail)
        for form in (text, text.rstrip(b"="), b"\n " + text + b" \n"):
            assert payload.decode_exactly(memoryview(form), size).view(np.float64).tobytes() == values.tobytes()
            assert payload.decode(memoryview(form), 1).tobytes() == values.tobytes()


@pytest.mark.parametrize("sizes", [[], [0], [1], [5, 0, 7], [33_000, 1, 40_000], [100_000]])
def test_payloads_are_encoded_without_padding(sizes):
    arrays = [np.arange(size) for size in sizes]
    text = b"".join(payload.encode(arrays))
    assert len(text) % 4 == 0
    assert b"=" not in text
    assert payload.decode(memoryview(text), 1).tobytes() == b"".join(array.tobytes() for array in arrays)


def test_broken_payloads():
    text = encoded(np.arange(100), tail=b"")
    cases = {
        "character '!'": text[:40] + b"!" + text[41:],
        "character '='": text[:40] + b"=" + text[41:],
        "ends early": text[: len(text) // 8 * 4],
        "damaged": text[:24] + b"AAAA" + text[28:],
        "found more": text,
    }
    for message, broken in cases.items():
        with pytest.raises(FormatError, match=message):
            payload.decode_exactly(memoryview(broken), 99 if message == "found more" else 100)
    with pytest.raises(FormatError, match="expected 101 numbers, found 100"):
        payload.decode_exactly(memoryview(text), 101)
    with pytest.raises(FormatError, match="which are too few"):
        payload.decode_exactly(memoryview(text), 10**15)
    with pytest.raises(FormatError, match="records of 3 numbers, found 100"):
        payload.decode(memoryview(text), 3)


def test_numbers_in_text():
    assert numbers.floats(b" 1 -2.5e3\n.5 +7 1e-320 -0").tolist() == [1, -2500, 0.5, 7, 1e-320, 0]
    assert numbers.ints(b"1 22\t333").tolist() == [1, 22, 333]
    assert len(numbers.floats(b"  \n")) == 0
    for text in (b"1 2 x 3", b"1,2", b"1 2 0x10", b"\xff"):
        with pytest.raises(FormatError, match="expected a number, found"):
            numbers.floats(text)
    with pytest.raises(FormatError, match=r"found '1\.5'"):
        numbers.ints(b"1 1.5 2")


RUNS = [*range(500, 700), *range(10**12, 10**12 + 100), *range(5, 400)]


@pytest.mark.parametrize("ids", [[], [0, 1, 2], [5, 3, 9], [10**15, 7, 0], [400_000, 1], RUNS, RUNS[:200] + RUNS[300:]])
def test_lookups(ids):
    lookup = Lookup(np.array(ids, np.int64), "vertex")
    assert lookup.ids.tolist() == sorted(ids)
    assert lookup.rows(np.array([ids, ids], np.int64), "test").tolist() == [list(range(len(ids)))] * 2
    others = np.array([-1, -(10**17), 4, 10**17, *ids])
    assert lookup.present(others).tolist() == [False, False, False, False] + [True] * len(ids)
    for wrong in (-1, 4, 10**17):
        with pytest.raises(FormatError, match=f"expected vertex ids that exist in the edges, found vertex {wrong}"):
            lookup.rows(np.array([*ids, wrong]), "edges")


@pytest.mark.parametrize("scale", [1, 10**12])
def test_ids_are_distinct_and_not_negative(scale):
    with pytest.raises(FormatError, match=f"expected every edge once, found edge {3 * scale} twice"):
        Lookup(np.array([1, 3, 2, 3]) * scale, "edge")
    with pytest.raises(FormatError, match=f"expected every edge once, found edge {40 + scale} twice"):
        Lookup(np.array([*range(99, 200), *range(40, 90), 40]) + scale, "edge")
    with pytest.raises(FormatError, match="expected edge ids from 0 up, found -5"):
        Lookup(np.array([1, -5, 2]), "edge")
