"""Names come from files, and a terminal acts on some of what they may hold."""

import pytest

from elvis.core.base.terminal import one_line, print_json, print_table, say, visible, warn

#: colours, titles of windows, deletion, text that runs backwards, bytes that are no text
HOSTILE = "u\x1b[31m\x1b]0;title\x07\x9b2J\x7f\u202e\udcff\r"


@pytest.fixture(params=[False, True], ids=["pipe", "terminal"])
def on(request, monkeypatch):
    monkeypatch.setattr("sys.stdout.isatty", lambda: request.param, raising=False)


def test_a_picture_of_every_character():
    assert visible(HOSTILE + "é ü µ\n") == "u?[31m?]0;title??2J????é ü µ\n"
    assert one_line("a\n  b\x1b") == "a b?"
    assert one_line(f"expected{1_000_000 * 'x'}, found y").endswith(", found y")
    assert len(one_line("x" * 1_000_000)) < 2_100


def test_control_characters_are_not_printed(capsys, on):
    print_table(("name", "value"), [(HOSTILE, f"two\nlines {HOSTILE}")])
    say(HOSTILE)
    warn(f"{HOSTILE}\n{HOSTILE}")
    captured = capsys.readouterr()
    own = captured.out.replace("\x1b[1m", "").replace("\x1b[0m", "")  # of the table itself
    for character in HOSTILE[1:]:
        if not character.isprintable():
            assert character not in own + captured.err
    assert "two lines u?[31m" in own
    assert captured.err.count("\n") == 1


def test_json_uses_its_escapes(capsys):
    print_json({HOSTILE: HOSTILE})
    said = capsys.readouterr().out
    assert said.isascii()
    assert "\\u001b[31m" in said
    assert "\x1b" not in said


@pytest.mark.parametrize("expression", ["1" * 100_000, "y" * 100_000, "'" + "z" * 100_000 + "'"])
def test_messages_have_an_end(expression):
    from elvis import Dataset, sample
    from elvis.core.base.errors import ElvisError
    from elvis.core.shapes import Shape
    from elvis.core.testing import grid

    with pytest.raises(ElvisError) as raised:
        sample(Dataset(grid(Shape.QUADRILATERAL, 1)), expression, [[0.5, 0.5]])
    assert len(str(raised.value)) < 2000


@pytest.mark.parametrize(
    ("headers", "lines"),
    [
        (
            ("name", "value", "wide"),
            ["name      value  wide", "u           1.5  \u5c71", "velocity    -12  x yz"],
        ),
        (("", "", ""), ["u         1.5  \u5c71", "velocity  -12  x yz"]),
    ],
)
def test_tables_in_a_pipe_are_aligned(capsys, headers, lines):
    print_table(headers, [("u", 1.5, "\u5c71"), ("velocity", -12, "x\nyz")])
    assert capsys.readouterr().out.splitlines() == lines
