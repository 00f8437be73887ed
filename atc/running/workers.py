"""Worker processes of this machine, each on a pipe of its own, which nobody else writes to: one that dies, in the
middle of an answer too, is seen at once, and to end them all nothing has to be waited for.

(The standard library's pool shares one pipe: a worker that is killed while it writes leaves everybody waiting for the
rest.)
"""

from __future__ import annotations

import queue
import traceback

from ..errors import AtcError
from ..estimators.driver import fields_of
from .interruption import in_worker, unheard


class Workers:
    """`count` processes that compute fields of frames with `settings`.

    Raises OSError where no processes can be had.
    """

    def __init__(self, count: int, settings):
        import multiprocessing

        context = multiprocessing.get_context("spawn")
        self._processes: list = []
        self._free: queue.SimpleQueue = queue.SimpleQueue()
        try:
            with unheard():
                for _ in range(count):
                    here, there = context.Pipe()
                    process = context.Process(target=_work, args=(there, settings))
                    process.start()
                    there.close()  # so that the end of the process is the end of what comes from it
                    self._processes.append(process)
                    self._free.put(here)
        except BaseException:
            self.end()
            raise

    def compute(self, frames, k: int):
        """The result of frames, `k` the number of the first, by the next process that is free; for threads that
        wait."""
        pipe = self._free.get()
        try:
            pipe.send((frames, k))
            done, answer = pipe.recv()
        except (EOFError, OSError):
            raise AtcError(
                "a worker process died: out of memory, or the script that calls atc.fields with workers > 1 lacks `if "
                '__name__ == "__main__":` around the call'
            ) from None
        finally:
            self._free.put(pipe)
        if done:
            return answer
        raise answer

    def end(self) -> None:
        """End the processes, whatever they do."""
        for process in self._processes:
            process.kill()
        for process in self._processes:
            process.join()


def _work(pipe, settings) -> None:
    in_worker()
    while True:
        try:
            frames, k = pipe.recv()
        except (EOFError, OSError):  # the parent has gone
            return
        try:
            answer = True, fields_of(frames, settings, k)
        except Exception as e:
            e.add_note("".join(traceback.format_exception(e)))
            answer = False, e
        try:
            try:
                pipe.send(answer)
            except OSError:
                raise
            except Exception as e:  # what cannot be sent
                pipe.send((False, RuntimeError(f"{answer[1]!r} ({e})")))
        except OSError:
            return
