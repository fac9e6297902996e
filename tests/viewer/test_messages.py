"""Messages of pages: what is one is taken, everything else is answered with a sentence."""

import json
from types import SimpleNamespace

import pytest

from elvis.core.base.errors import ElvisError
from elvis.viewer.messages import MAX_QUANTITIES, Change, Pick, id_of, parsed, table_of_text
from elvis.viewer.session import Session
from elvis.viewer.viewers import Viewer


def line(**changes):
    content = {"start": [0, 0, 0], "end": [1, 0.5], "quantities": ["u"]} | changes
    return {"type": "line", "id": 1, "content": content}


def test_messages_are_parsed():
    assert parsed({"type": "pick", "id": 7, "content": {"row": 1, "column": 2}}) == Pick(
        type="pick", id=7, content={"row": 1, "column": 2}
    )
    assert parsed({"type": "change", "changes": {"title": None}}) == Change(type="change", changes={"title": None})
    assert parsed(line()).content.end == [1, 0.5]


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (None, "does not understand None"),
        ([], r"does not understand \[\]"),
        ({"type": []}, "Input tag"),
        ({"type": "nonsense"}, "Input tag"),
        ({"type": "change", "changes": [1]}, "changes: Input should be a valid dictionary"),
        ({"type": "change", "changes": {"k" * 301: 1}}, "at most 300 characters"),
        ({"type": "unhide", "number": "0"}, "number: Input should be a valid integer"),
        ({"type": "undo", "steps": 3}, "steps: Extra inputs"),
        ({"type": "size", "size": [float("inf"), 2]}, "size.0: Input should be a finite number"),
        ({"type": "size", "size": [1]}, "size: List should have at least 2 items"),
        (line(start=[float("nan"), 0]), "content.start.0: Input should be a finite number"),
        (line(quantities=["u"] * (MAX_QUANTITIES + 1)), "content.quantities: List should have at most 100 items"),
        (line(quantities=["u" * 10_001]), "at most 10000 characters"),
        ({"type": "copy", "id": 1, "content": "C++"}, "content: Input should be 'command' or 'Python'"),
    ],
)
def test_other_messages_are_rejected_with_the_reason(message, reason):
    with pytest.raises(ElvisError, match=reason) as refused:
        parsed(message)
    assert len(str(refused.value)) < 600
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("text", ["", "{", '{"a": NaN}', "[-Infinity]", "1e999", "[" * 100_000, "\ud800", "9" * 5000])
def test_texts_that_are_not_json_are_rejected(text):
    with pytest.raises(ElvisError, match="expected JSON, found"):
        table_of_text(text)


def test_ids_are_numbers_or_short_texts():
    assert [id_of({"id": own}) for own in (3, "a", [1], 1.5, "x" * 400)] == [3, "a", None, None, None]
    assert id_of("id") is None


def test_internal_errors_are_also_answered(viewer, monkeypatch):
    answers = []

    async def send(text):
        answers.append(json.loads(text))

    async def fail(*_):
        raise OverflowError("too large")

    monkeypatch.setattr(viewer.session, "_step", fail)
    viewer.call(viewer.session.receive(Viewer(send), {"type": "undo"}))
    viewer.call(viewer.session.receive(Viewer(send), {"type": "nonsense", "id": 5}))
    assert "unexpected OverflowError: too large" in answers[0]["text"]
    assert (answers[1]["type"], answers[1]["id"]) == ("error", 5)


@pytest.mark.parametrize(
    ("asked", "size"),
    [((1e300, 1e6), (4096, 4096)), ((-5, 0), (64, 64)), ((700.9, 9000), (700, 8192)), ((8000, 4000), (5792, 2896))],
)
def test_requested_picture_sizes_are_limited(asked, size):
    session = SimpleNamespace(size=(100, 100), _wake_up=lambda: None)
    Session._resize(session, asked)
    assert session.size == size
