"""A tiny distribution that offers commands: good ones, one that fails in every way, and some that never load."""

import click

from elvis.core.base.errors import ElvisError


@click.command("hello", short_help="Greet.")
@click.option("--name", default="world")
def hello(name):
    """Greet NAME."""
    click.echo(f"hello {name}")


@click.command("fail", short_help="Fail.")
@click.argument("how")
def fail(how):
    """Fail in the requested way."""
    failures = {
        "format": ElvisError("wing.xml: VERTEX 3:\n expected 3 numbers,\tfound \x1b[31m2"),
        "file": FileNotFoundError(2, "No such file or directory", "/nowhere/wing.xml"),
        "memory": MemoryError("Unable to allocate 8 TiB"),
        "interrupt": KeyboardInterrupt(),
        "bug": KeyError("jacobian"),
        "name": UnicodeEncodeError("utf-8", "wing\udcff.msh", 4, 5, "surrogates not allowed"),
        "wordless": AssertionError(),
    }
    raise failures[how]


@click.command("warn", short_help="Warn.")
def warn():
    """Warn as a library would."""
    import warnings

    warnings.warn("old API", DeprecationWarning, stacklevel=1)
    warnings.warn("overflow", RuntimeWarning, stacklevel=1)


@click.command("flood", short_help="Print much.")
def flood():
    """Print more than a pipe holds."""
    for number in range(200_000):
        click.echo(number)


not_a_command = "text"


@click.command("wait", short_help="Wait to be interrupted.")
@click.argument("how")
def wait(how):
    """Wait, in the requested way, and say when."""
    import time

    class Slow:
        def __del__(self):
            click.echo("waiting")
            time.sleep(0.5)

    class HalfMade:
        def __init__(self):
            click.echo("waiting")
            time.sleep(60)
            self.socket = 1

        def __del__(self):
            self.socket += 1

    if how == "import":
        import slow  # noqa: F401
    elif how == "constructor":
        HalfMade()
    elif how == "destructor":
        Slow()
    elif how == "process":
        _start_slowly()
    elif how == "folder":
        _remove_slowly()
    elif how == "library":
        _keep_until_the_end()
    elif how == "translated":
        try:
            click.echo("waiting")
            time.sleep(60)
        except KeyboardInterrupt:
            raise RuntimeError("the library has an error of its own") from None
    click.echo("done")
    time.sleep(60)


def _keep_until_the_end():
    """Have an object that is destroyed when Python ends, and something to do before that."""
    import atexit
    import os
    import sys
    import time

    class Held:
        def __del__(self, write=os.write):
            write(1, b"destroyed\n")

    sys.held = Held()
    atexit.register(os.write, 1, b"closed\n")
    click.echo("waiting")
    time.sleep(60)


def _start_slowly():
    """Start a process that receives its task late."""
    import multiprocessing.resource_tracker
    import multiprocessing.util
    import time

    multiprocessing.resource_tracker.ensure_running()
    begin = multiprocessing.util.spawnv_passfds

    def begin_slowly(*arguments):
        number = begin(*arguments)
        click.echo("waiting")
        time.sleep(0.5)
        return number

    multiprocessing.util.spawnv_passfds = begin_slowly
    multiprocessing.get_context("spawn").Process(target=str, daemon=True).start()


def _remove_slowly():
    """Make a scratch folder and remove it slowly."""
    import os
    import tempfile
    import time
    from pathlib import Path

    from elvis.core.files.scratch import scratch

    remove = os.rmdir

    def remove_slowly(*arguments, **options):
        if str(arguments[0]).endswith(".tmp"):
            click.echo("waiting")
            time.sleep(0.5)
        remove(*arguments, **options)

    os.rmdir = remove_slowly
    with scratch(Path(tempfile.gettempdir())):
        pass
