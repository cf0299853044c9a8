"""A function in a process of its own: forked where that is safe, which spares it what is imported and read already."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from threading import Thread
from typing import Any

Send = Callable[[object], None]
PR_SET_PDEATHSIG = 1  # of prctl(2)
AWAKE_S = 1.0  # between two looks at whether somebody asked to stop
TIMES_ASKED = 20  # times that a process is asked to end before it is made to


@contextmanager
def branch(function: Callable[..., None], *arguments: object) -> Iterator[Connection]:
    """Run function(send, *arguments) beside what follows; `received` takes what it sends.

    At the end of the block the process ends, whether it is done or not.
    """
    forks = alone()
    context: Any = get_context("fork" if forks else "spawn")
    mine, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_run, args=(theirs, function, arguments, os.getpid()))
    start(process, forks)
    theirs.close()
    try:
        yield mine
    finally:
        mine.close()
        end(process)


def start(process: BaseProcess, forks: bool = False) -> None:
    """Start a process for which Ctrl-C waits until it is `ready`: while it imports it would end in a traceback."""
    if not forks:
        resource_tracker.ensure_running()  # what starts with the first spawned process lets signals in again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process.start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ready() -> None:
    """Let Ctrl-C in, in a process that has said what it does with it."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def received(connection: Connection) -> Any:
    """The next that a branch has sent; its error is raised here. RuntimeError where it ended without a word."""
    try:
        # Python acts on a signal between two of its steps: one that another thread took would wait for the next word.
        while not connection.poll(AWAKE_S):
            pass
        done, value = connection.recv()
    except EOFError:
        raise RuntimeError("a process ended before it was done; was it killed, or is the memory full?") from None
    if not done:
        raise value
    return value


def end(process: BaseProcess) -> None:
    """End a process, and those it has branched: asked again where an exception that a signal raised came to nothing, as
    one does that is raised while something is being deleted."""
    for _ in range(TIMES_ASKED):
        process.terminate()
        process.join(AWAKE_S)
        if process.exitcode is not None:
            return
    process.kill()
    process.join()


def alone() -> bool:
    """Whether this process can be forked: not beside threads, also such as a library has started, nor on macOS."""
    return sys.platform == "linux" and len(os.listdir("/proc/self/task")) == 1


def end_with(parent: int) -> None:
    """Let this process end where its parent does, however that ends: a killed one can end nobody."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    else:
        Thread(target=_watch, args=(parent,), daemon=True).start()
    if os.getppid() != parent:  # it had ended before
        os._exit(1)


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(AWAKE_S)
    os._exit(1)


def _run(connection: Connection, function: Callable[..., None], arguments: tuple[object, ...], parent: int) -> None:
    end_with(parent)
    # Ctrl-C reaches this process too: it ends without a word, the one that branched says what happened. Where that one
    # ignores it, as in the background of a script, this one has to go on as well.
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGTERM, _leave)
    ready()
    with suppress(BrokenPipeError):  # nobody waits for it any more
        try:
            function(lambda value: connection.send((True, value)), *arguments)
        except Exception as error:
            error.add_note(traceback.format_exc())
            connection.send((False, error))


def _leave(*_: object) -> None:
    """Leave by an exception, so that a branch of a branch ends with it."""
    raise SystemExit(1)
