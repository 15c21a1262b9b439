"""An executor of processes on this machine, none of which that dies takes the calls of another one with it.

`concurrent.futures.ProcessPoolExecutor` is broken for every call when one of its processes is killed, and does not
say how that ended; here each thread has a process of its own, and a new one after each that died.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import re
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from functools import partial
from pathlib import Path
from typing import Any

import musatpy
from musatpy.errors import MusatError

_ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_START = "import sys; sys.path.append(sys.argv[1]); from musatpy.campaign.worker import main; main()"
_TAIL = 300  # characters of the last line of an error stream

OnMessage = Callable[["Future[Any]", Any], None]


class ProcessDiedError(Exception):
    """A process ended before its call did."""


class _Process:
    """One process. It inherits `fds` (locks), which are held until it has ended too."""

    def __init__(self, fds: Sequence[int]) -> None:
        self.errors = tempfile.TemporaryFile()  # noqa: SIM115 (closed with the process)
        # -P and -c: a file in the folder of the user that is named as a module is not taken for it
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", _START, str(Path(musatpy.__file__).parents[1])],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.errors,
            env=os.environ | _ONE_THREAD,
            pass_fds=fds,
            start_new_session=True,  # Ctrl-C is for the batch, which then ends its processes
        )

    def call(self, work: tuple[Any, ...], on_message: Callable[[Any], None]) -> Any:
        """Return the result of a call (function, arguments); raises `ProcessDiedError`."""
        assert self.process.stdin and self.process.stdout
        try:
            pickle.dump(work, self.process.stdin)
            self.process.stdin.flush()
            while True:
                kind, content = pickle.load(self.process.stdout)
                if kind == "result":
                    return content
                on_message(content)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            self.process.kill()
            raise ProcessDiedError(self._end()) from error

    def _end(self) -> str:
        """Return how the process ended, and the last line of its errors."""
        code = self.process.wait()
        how = f"ended with status {code}"
        if code < 0:
            how = f"was killed by {_signal_name(-code)}"
            if -code == signal.SIGKILL:
                how += " (the system does so when memory runs out)"
        self.errors.seek(0)
        last = last_words(self.errors.read().decode("utf-8", "replace"))
        return f"its process {how}" + (f": {last}" if last else "")

    def kill(self) -> None:
        """End the process at once."""
        self.process.kill()
        for stream in (self.process.stdin, self.process.stdout):
            if stream:
                with contextlib.suppress(OSError):
                    stream.close()
        self.process.wait()
        self.errors.close()


class LocalExecutor(Executor):
    """Processes at work on calls; a call gets the keyword `tell`, whose messages go to `on_message` here.

    The first message of each call is None: it was begun. A call whose process dies raises `ProcessDiedError`, one
    for which none can be started `OSError`. `fds` are inherited by all processes. Raises `MusatError` where no
    thread can be started; as many as can be serve all calls.
    """

    def __init__(self, processes: int, on_message: OnMessage, fds: Sequence[int] = ()) -> None:
        self._fds, self._on_message = fds, on_message
        self._calls: queue.SimpleQueue[tuple[Future[Any], tuple[Any, ...]] | None] = queue.SimpleQueue()
        self._at_work: set[_Process] = set()
        self._stopped = False
        self._guard = threading.Lock()
        self._threads: list[threading.Thread] = []
        for _ in range(processes):
            thread = threading.Thread(target=self._serve, daemon=True)
            try:
                thread.start()
            except RuntimeError as error:
                if not self._threads:
                    raise MusatError(f"no job can be started, processes or memory are limited: {error}") from error
                break
            self._threads.append(thread)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Return the future of a call, whose function and arguments can be pickled."""
        future: Future[Any] = Future()
        self._calls.put((future, (fn, args, kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes at once, those at work too; other than in other executors no call goes on."""
        with self._guard:
            self._stopped = True
            for process in self._at_work:
                process.process.kill()
        for _ in self._threads:
            self._calls.put(None)
        for thread in self._threads:
            thread.join()

    def _serve(self) -> None:
        """Keep one process at work, a new one after each that died."""
        process: _Process | None = None
        while (call := self._calls.get()) is not None:
            future, work = call
            if self._stopped:
                future.cancel()
            if not future.set_running_or_notify_cancel():
                continue
            try:
                self._on_message(future, None)
                process = process or self._start()
                result = process.call(work, partial(self._on_message, future))
            except Exception as error:  # whatever it is: a thread that ends here leaves the batch waiting
                self._end(process)
                process = None
                future.set_exception(error)
            else:
                future.set_result(result)
        self._end(process)

    def _start(self) -> _Process:
        with self._guard:
            if self._stopped:
                raise ProcessDiedError("the batch was interrupted")
            process = _Process(self._fds)
            self._at_work.add(process)
            return process

    def _end(self, process: _Process | None) -> None:
        if process is not None:
            with self._guard:
                self._at_work.discard(process)
            process.kill()


def last_words(errors: str) -> str:
    """Return of all that a process wrote the line that tells most: where a fault was, else the last one."""
    fault = re.search(r'^Current thread .*\n\s*(File ".*", line \d+ in .*)', errors, re.MULTILINE)
    lines = [fault[1]] if fault else errors.split("\n")
    return next((" ".join(line.split())[-_TAIL:] for line in reversed(lines) if line.strip()), "")


def _signal_name(number: int) -> str:
    """Return the name of a signal; those for programs' own use have none."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
