"""The ``elvis`` command as a process: its exit statuses, its one sentence, its manners in a pipe."""

import json
import os
import pty
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from elvis.plugins.command.interrupts import Interrupts

MINIATURE = Path(__file__).parent / "miniature"
ELVIS = [sys.executable, "-c", "from elvis.plugins.command.command import main; main()"]


@pytest.fixture
def elvis(miniature):
    """Run ``elvis`` with the miniature distribution installed."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(miniature), *sys.path])}
    environment.pop("ELVIS_DEBUG", None)

    def run(*arguments, **options):
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True} | options
        environ = environment | options.pop("env", {})
        return subprocess.run([*ELVIS, *arguments], env=environ, timeout=600, **options)

    return run


def one_sentence(process):
    """The single line on standard error, without the name of the program; an interrupt ends the line before it."""
    lines = process.stderr.strip().splitlines()
    assert len(lines) == 1, process.stderr
    assert lines[0].startswith("elvis: error: ")
    return lines[0].removeprefix("elvis: error: ")


def test_help_lists_every_command_even_broken_ones(elvis):
    process = elvis("--help")
    assert process.returncode == 0
    assert process.stderr == ""
    for name in ("plugins", "hello", "fail"):
        assert f"\n  {name} " in process.stdout
    for name in ("raises", "absent", "text"):
        assert f"\n  {name} " in process.stdout
    assert process.stdout.count("(does not load, see elvis plugins)") == 3


def test_no_arguments_print_the_help(elvis):
    assert elvis().stdout == elvis("--help").stdout


def test_help_shows_topics_and_commands(elvis):
    assert "sphere:C:RADIUS" in elvis("help", "geometry").stdout
    assert elvis("help", "hello").stdout == elvis("hello", "--help").stdout
    assert elvis("help").stdout == elvis("--help").stdout
    process = elvis("help", "xyzzy")
    assert process.returncode == 2
    assert "no topic or command 'xyzzy'" in one_sentence(process)


def test_version_is_that_of_the_distribution(elvis):
    from importlib.metadata import version

    assert elvis("--version").stdout == f"elvis {version('elvis-viz')}\n"


def test_a_command_of_another_distribution_runs(elvis):
    assert elvis("hello", "--name", "you").stdout == "hello you\n"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["helo"], "there is no command 'helo'; did you mean hello? (see elvis --help)"),
        (["xyzzy"], "there is no command 'xyzzy' (see elvis --help)"),
        (["fail"], "Missing argument 'HOW' (see elvis fail --help)"),
    ],
)
def test_usage_errors(elvis, arguments, sentence):
    process = elvis(*arguments)
    assert process.returncode == 2
    assert one_sentence(process) == sentence


def test_an_unknown_option_names_it(elvis):
    process = elvis("hello", "--nam", "you")
    assert process.returncode == 2
    assert "--nam" in one_sentence(process)


@pytest.mark.parametrize(
    ("how", "status", "sentence"),
    [
        ("format", 1, "wing.xml: VERTEX 3: expected 3 numbers, found ?[31m2"),
        ("file", 1, "/nowhere/wing.xml: No such file or directory"),
        ("memory", 1, "not enough memory: Unable to allocate 8 TiB"),
        ("interrupt", 130, "interrupted"),
        ("name", 1, "wing?.msh: expected a name in UTF-8, as the library requires"),
        ("bug", 1, "unexpected KeyError: 'jacobian'; this is a bug in ElVis, --debug shows where"),
        ("wordless", 1, "unexpected AssertionError; this is a bug in ElVis, --debug shows where"),
    ],
)
def test_failures_give_one_line_errors(elvis, how, status, sentence):
    process = elvis("fail", how)
    assert process.returncode == status
    assert one_sentence(process) == sentence
    assert process.stdout == ""


@pytest.mark.parametrize("arguments", [["--debug", "fail", "format"], ["fail", "format", "--debug"]])
def test_debug_shows_the_traceback(elvis, arguments):
    process = elvis(*arguments)
    assert process.returncode == 1
    assert process.stderr.startswith("Traceback")
    assert "elvis: error: wing.xml" in process.stderr


def test_debug_by_the_environment(elvis):
    assert "Traceback" in elvis("fail", "bug", env={"ELVIS_DEBUG": "1"}).stderr
    assert "Traceback" not in elvis("fail", "bug", env={"ELVIS_DEBUG": "0"}).stderr


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("name", "reason"), [("raises", "licence"), ("absent", "no_such_module"), ("text", "not a click")]
)
@pytest.mark.parametrize("arguments", [[], ["--help"], ["a", "--b", "c"]])
def test_a_broken_command_states_its_reason(elvis, name, reason, arguments):
    process = elvis(name, *arguments)
    assert process.returncode == 1
    assert reason in one_sentence(process)


def test_warnings_of_libraries_are_not_printed(elvis):
    process = elvis("warn")
    assert (process.returncode, process.stderr) == (0, "")


def test_warnings_are_shown_on_request(elvis):
    assert "overflow" in elvis("warn", env={"PYTHONWARNINGS": "default"}).stderr


def test_a_closed_output_pipe_gives_no_message(elvis):
    reading, writing = os.pipe()
    os.close(reading)
    process = elvis("flood", stdout=writing)
    os.close(writing)
    assert process.stderr == ""
    assert process.returncode == 1


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="the system has no /dev/full")
def test_a_full_disk_is_reported_once(elvis):
    with open("/dev/full", "w") as full:
        process = elvis("hello", stdout=full)
    assert process.returncode == 1
    assert re.fullmatch("(standard output: )?No space left on device", one_sentence(process))


@pytest.fixture
def interrupted(miniature):
    """Run ``elvis`` until it says that it waits, press Ctrl-C; status, standard output and standard error."""

    def run(*arguments):
        environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(miniature), *sys.path]), "PYTHONUNBUFFERED": "1"}
        process = subprocess.Popen(
            [*ELVIS, *arguments],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        assert process.stdout.readline() == "waiting\n"
        process.send_signal(signal.SIGINT)
        out, err = process.communicate()
        return process.returncode, out, err

    return run


@pytest.mark.parametrize(
    ("how", "said"),
    [("import", "done\n"), ("process", "done\n"), ("destructor", "done\n"), ("translated", ""), ("constructor", "")],
)
def test_an_interrupt_gives_one_line_at_every_point(interrupted, how, said):
    """While a module is loaded or a process started, it waits for that; where Python can't take it, it comes again.

    What it leaves half made says nothing when it is destroyed.
    """
    status, out, err = interrupted("wait", how)
    assert (status, err.strip()) == (130, "elvis: error: interrupted")
    assert said.startswith(out)


def test_after_an_interrupt_files_are_closed_but_no_objects_destroyed(interrupted):
    status, out, err = interrupted("wait", "library")
    assert (status, out, err.strip()) == (130, "closed\n", "elvis: error: interrupted")


def test_an_interrupt_leaves_no_scratch_folder(interrupted, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    status, _, err = interrupted("wait", "folder")
    assert (status, err.strip()) == (130, "elvis: error: interrupted")
    assert not list(tmp_path.iterdir())


def test_an_interrupt_that_comes_when_the_block_ends_is_no_traceback(monkeypatch):
    set_handler = signal.signal

    def interrupted_first(*arguments):
        monkeypatch.undo()
        signal.raise_signal(signal.SIGINT)
        return set_handler(*arguments)

    # tests may run in the background of a script, where interrupts are ignored
    before = set_handler(signal.SIGINT, signal.default_int_handler)
    try:
        with Interrupts(is_process=False) as interrupts:
            monkeypatch.setattr(signal, "signal", interrupted_first)
        assert interrupts.asked
    finally:
        set_handler(signal.SIGINT, before)


def test_an_ignored_interrupt_remains_ignored():
    """As in the background of a script."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with Interrupts(is_process=True):
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


CLOSED = {0: "<&-", 1: ">&-", 2: "2>&-"}


@pytest.mark.parametrize("closed", [(0,), (1,), (2,), (0, 1, 2)])
@pytest.mark.parametrize("arguments", [("hello",), ("fail", "format")])
def test_closed_streams(elvis, tmp_path, closed, arguments):
    """What can't be said fails the command, and no file that it opens takes the place of a stream."""
    shell = f'"$@" {" ".join(CLOSED[number] for number in closed)}'
    code = "import sys; from elvis.plugins.command.command import main; main()"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(MINIATURE), *sys.path])}
    done = subprocess.run(
        ["sh", "-c", shell, "sh", sys.executable, "-c", code, *arguments],
        env=environment,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
    )
    assert done.returncode == (1 if arguments[0] == "fail" or 1 in closed else 0)
    assert "Traceback" not in done.stderr
    if 1 in closed and 2 not in closed and arguments[0] == "hello":
        assert re.fullmatch("(standard output: )?Bad file descriptor", one_sentence(done))


def test_names_that_are_not_text(elvis):
    """File names are bytes."""
    name = os.fsdecode(b"wing\xff\x1b[31m.xml")
    process = elvis("info", name)
    assert process.returncode == 1
    assert one_sentence(process).startswith("wing??[31m.xml: ")


def test_plugins_lists_each_with_its_state(elvis):
    rows = json.loads(elvis("plugins", "--json").stdout)
    state = {(row["kind"], row["name"], row["distribution"]): row["state"] for row in rows}
    assert state["commands", "hello", "miniature 1.2"] == "ok"
    assert state["commands", "raises", "miniature 1.2"] == "RuntimeError: the licence of raises has expired"
    assert state["commands", "plugins", "miniature 1.2"].startswith("hidden")
    assert state["volumes", "wavelets", "miniature 1.2"] == "ok"


def test_plugins_in_a_pipe_is_bare_text(elvis):
    lines = elvis("plugins").stdout.splitlines()
    assert lines[0].split() == ["kind", "name", "distribution", "object", "state"]
    assert any(line.split() == ["commands", "hello", "miniature", "1.2", "miniature:hello", "ok"] for line in lines)
    assert all(ord(character) < 128 for line in lines for character in line)


def test_plugins_on_a_terminal_is_framed(elvis):
    leader, follower = pty.openpty()
    process = elvis("plugins", stdout=follower, stderr=follower, env={"TERM": "xterm", "COLUMNS": "160"})
    os.close(follower)
    shown = b""
    while chunk := _read(leader):
        shown += chunk
    assert process.returncode == 0
    assert "─".encode() in shown


def _read(leader):
    try:
        return os.read(leader, 65536)
    except OSError:  # the other end is closed
        return b""


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("elvis ren", {"render"}),
        ("elvis render --cam", {"--camera"}),
        ("elvis render --camera t", {"top"}),
        ("elvis render --colormap turbo", {"turbo"}),
        ("elvis compare --ax", set()),
    ],
)
def test_shells_complete_commands_options_and_names(words, offered):
    asked = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" ")), "_ELVIS_COMPLETE": "bash_complete"}
    program = "from elvis.plugins.command.command import main; main()"
    environment = {**os.environ, **asked}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert {line.partition(",")[2] for line in done.stdout.splitlines() if line} == offered
