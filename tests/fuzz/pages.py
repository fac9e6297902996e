"""Damaged messages to a running viewer: ``python tests/fuzz/pages.py [--messages 20000] [--seed N]``.

Two pages look at one ``elvis view``.  The first sends messages with damage, files to be read again among them; the
second asks for the scene as lines of Python all the time, which the server answers without drawing, and whether ``u``
is a quantity, which the drawing process answers.  A fault is an answer to the second page after more than a second, a
question of the first page without an answer, a line on the terminal that is no sentence of ElVis, a drawing process of
more than 4 GiB, and the end of the server.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import resource
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import aiohttp
import mutations
import numpy as np
from corpus import MESSAGES
from interruptions import ELVIS, inputs

from elvis import ElvisError
from elvis.viewer.messages import table_of_text

#: seconds that a page may wait for an answer without a picture, and seconds between its questions
LONGEST, PAUSE = 1.0, 0.02
#: seconds of a wait that count even if other programs leave the viewer no processor
HANGS = 10.0
#: processor seconds of the viewer in which answers that need pictures or data must come; the longest wait for them
PATIENCE, LONGEST_WAIT = 60.0, 900.0
#: messages between two that make the viewer read its files again, which takes seconds
REREADING = 500
#: messages without an answer, at most, while others are sent
WAITING = 20
#: bytes that the process that draws may take
MEMORY = 4 << 30
#: lines on the terminal
USUAL = re.compile(r"^elvis: (note|warning|error): |^Press Ctrl-C|http://")
#: what the second page asks: the server, and the drawing process
SHORT = ({"type": "copy", "content": "Python"}, {"type": "check", "content": "u"})
#: damage to the text of a message
KINDS = (*mutations.TEXT, mutations.revalue)


class Page:
    """A page without a browser: it confirms pictures, and remembers answers and errors.

    slowest  seconds of the slowest answer
    """

    def __init__(self, socket: aiohttp.ClientWebSocketResponse, process: int) -> None:
        self.socket, self._process = socket, process
        self.waiting: dict[Any, asyncio.Future[float]] = {}
        self.slowest = 0.0
        self.errors = 0

    async def listen(self) -> None:
        """Take in what comes until the connection ends."""
        async for message in self.socket:
            if message.type == aiohttp.WSMsgType.BINARY:
                await self.socket.send_str('{"type": "shown"}')
                continue
            content = json.loads(message.data)
            self.errors += content["type"] == "error"
            answer = self.waiting.pop(content.get("id"), None)
            if answer is not None and not answer.done():
                answer.set_result(perf_counter())

    async def ask(self, text: str, number: Any) -> float:
        """Seconds until the answer to a question with a number; TimeoutError if there is none."""
        answer = self.waiting[number] = asyncio.get_running_loop().create_future()
        start, worked = perf_counter(), seconds_below(self._process)
        await self.socket.send_str(text)
        while not answer.done():
            await asyncio.wait([answer], timeout=PATIENCE / 10)
            is_late = seconds_below(self._process) - worked > PATIENCE or perf_counter() - start > LONGEST_WAIT
            if is_late and not answer.done():
                raise TimeoutError
        seconds = answer.result() - start
        self.slowest = max(self.slowest, seconds)
        return seconds


def damaged(random: np.random.Generator, number: int) -> tuple[str, bool]:
    """The text of a message, and whether it is a question with this number as id."""
    chosen = dict(MESSAGES[random.integers(0, len(MESSAGES))])
    if chosen["type"] == "read again" and number % REREADING:
        chosen = {"type": "redo"}
    if "id" in chosen:
        chosen["id"] = number
    text = json.dumps(chosen).encode()
    for _ in range(random.integers(0, 3)):
        text = KINDS[random.integers(0, len(KINDS))](text or b"{", random)
    shown = text.decode("utf-8", "replace")
    if "read again" in shown and number % REREADING:
        shown = "{}"
    try:
        own = table_of_text(shown)
    except ElvisError:
        return shown, False
    return shown, isinstance(own, dict) and own.get("id") == number and not isinstance(own["id"], bool)


async def disturb(page: Page, count: int, seed: int, faults: list[str]) -> None:
    """Send messages; questions without an answer are faults."""
    random = np.random.default_rng(seed)
    asked: set[asyncio.Task[None]] = set()

    async def ask(text: str, number: int) -> None:
        try:
            await page.ask(text, number)
        except TimeoutError:
            faults.append(f"message {number} has no answer after {PATIENCE:.0f} CPU s: {text[:300]}")

    last: list[str] = []
    for number in range(count):
        text, is_question = damaged(random, number)
        if number % REREADING == REREADING - 1:
            await page.socket.send_str('{"type": "read again"}')
        last = [*last, text[:300]][-20:]
        if page.socket.closed:
            faults.append(f"the connection ends after {last}")
            return
        if not is_question:
            await page.socket.send_str(text)
            await asyncio.sleep(PAUSE / 10)
            continue
        task = asyncio.create_task(ask(text, number))
        asked.add(task)
        task.add_done_callback(asked.discard)
        while len(asked) > WAITING:
            await asyncio.sleep(PAUSE)
    if asked:
        await asyncio.wait(asked)


def seconds_below(process: int) -> float:
    """Processor seconds of a process and of the processes that it has started, those that have ended included."""
    total = 0.0
    with suppress(OSError):
        children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
        for each in (str(process), *children):
            # columns 14 to 17 are ticks, of it and of those it waited for; the second, in parentheses, is its name
            columns = Path(f"/proc/{each}/stat").read_text().rpartition(")")[2].split()
            total += sum(map(int, columns[11:15])) / os.sysconf("SC_CLK_TCK")
    return total


def memory_below(process: int) -> int:
    """Bytes of memory of the processes that a process has started."""
    total = 0
    with suppress(OSError):
        for child in Path(f"/proc/{process}/task/{process}/children").read_text().split():
            total += int(Path(f"/proc/{child}/statm").read_text().split()[1]) * resource.getpagesize()
    return total


async def look(page: Page, process: int, faults: list[str], waits: list[float], sizes: list[int]) -> None:
    """Ask short questions, again and again; how long the answers take, less what this process is late.

    On a busy machine the viewer works for a part of the time only, and waits are the processor seconds that it takes.
    """
    # the data are opened first
    await page.ask(json.dumps({"id": -1, **SHORT[-1]}), -1)
    page.slowest = 0.0
    for number in range(1 << 30):
        start = perf_counter()
        await asyncio.sleep(PAUSE)
        late, worked = perf_counter() - start - PAUSE, seconds_below(process)
        try:
            seconds = await page.ask(json.dumps({"id": number, **SHORT[number % len(SHORT)]}), number) - late
        except TimeoutError:
            seconds = LONGEST_WAIT
        seconds = seconds if seconds > HANGS else min(seconds, seconds_below(process) - worked)
        waits.append(seconds)
        sizes.append(memory_below(process))
        if sizes[-1] > MEMORY:
            faults.append(f"drawing takes {sizes[-1] >> 20} MB")
            os.kill(process, signal.SIGTERM)
            return
        if seconds > LONGEST:
            faults.append(f"the other page waits {seconds:.2f} s")


async def visit(address: str, process: int, count: int, seed: int, faults: list[str]) -> None:
    """Both pages, until the first has sent its messages."""
    place = address.replace("/?", "/socket?")
    waits: list[float] = []
    sizes: list[int] = []
    async with aiohttp.ClientSession() as client:
        pages = [Page(await client.ws_connect(place, max_msg_size=0), process) for _ in range(2)]
        tasks = [asyncio.create_task(page.listen()) for page in pages]
        looking = asyncio.create_task(look(pages[1], process, faults, waits, sizes))
        await disturb(pages[0], count, seed, faults)
        looking.cancel()
        with suppress(asyncio.CancelledError):
            await looking
        for task in tasks:
            task.cancel()
    print(f"{count} messages, {pages[0].errors} rejected; slowest answer with a picture {pages[0].slowest:.1f} s")
    print(f"the other page asked {len(waits)} times and waited {np.median(waits):.3f} s, {max(waits):.2f} s at most")
    print(f"drawing took {max(sizes) >> 20} MB at most")


def main() -> int:
    """Print counts, waits and faults; the exit status is 1 if there is a fault."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--messages", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    faults: list[str] = []
    with TemporaryDirectory() as place:
        folder = Path(place)
        inputs(folder)
        words = ["view", "in/m.xml", "in/m.fld", "--no-browser", "--port", "0"]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        process = subprocess.Popen([*ELVIS, *words], cwd=folder, **pipes)
        lines: list[str] = []
        found = None
        while found is None and (line := process.stdout.readline()):
            lines.append(line)
            found = re.search(r"http://\S+", line)
        try:
            if found is not None:
                asyncio.run(visit(found[0], process.pid, given.messages, given.seed, faults))
            if process.poll() is not None:
                faults.append(f"the viewer ends with status {process.returncode}")
        finally:
            process.terminate()
            lines += process.communicate()[0].splitlines()
    strange = [line.strip() for line in lines if not USUAL.search(line) and line.strip()]
    faults += [f"on the terminal: {line[:300]}" for line in strange]
    print(f"{len(faults)} faults", *faults[:50], sep="\n  ")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
