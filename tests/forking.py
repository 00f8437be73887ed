"""Runs of `atc` in processes that are forked from one with everything imported and compiled: a run, and a kill of it,
cost a fraction of a second.

``Warm`` is the test's side. The process it starts is this file as a program: it answers each line of JSON on its
standard input with one.
"""

import json
import os
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path


class Warm:
    """A warm process. `run` has it fork, and send the child a signal after so many seconds, or kill it before its n-th
    change of the file system."""

    def __init__(self):
        environment = dict(
            os.environ,
            PYTHONPATH=os.pathsep.join([str(Path(__file__).parent.parent), os.environ.get("PYTHONPATH", "")]),
        )
        self.process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )

    def ask(self, **what) -> dict:
        self.process.stdin.write(json.dumps(what) + "\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def heat(self, folder, arguments) -> None:
        """Run a command in the warm process itself, so that what it imports and compiles is there for those that
        follow."""
        answer = self.ask(cwd=str(folder), arguments=[str(a) for a in arguments], here=True)
        assert answer["status"] == 0, answer

    def run(
        self, folder, arguments, after=None, at=None, limit=200.0, memory=None, number=signal.SIGKILL, file=None
    ) -> dict:
        """{status: exit status, -9 for killed; seconds; changes: how often the file system was changed, if it was not
        killed; out, err}. `number`: the signal; `limit`: seconds after which it is killed in any case; `memory`,
        `file`: bytes of address space and of the largest file that it may have."""
        return self.ask(
            cwd=str(folder),
            arguments=[str(a) for a in arguments],
            after=after,
            at=at,
            limit=limit,
            memory=memory,
            number=int(number),
            file=file,
        )

    def close(self) -> None:
        self.process.stdin.close()
        self.process.wait(timeout=60)


# --- the warm process


def _command(arguments) -> int:
    from atc.cli import app

    try:
        app(arguments, prog_name="atc")
    except SystemExit as e:
        return e.code or 0
    return 0


def _count_changes(at):
    """Count what changes the file system, and end this process before the `at`-th change."""
    count = [0]
    changing = {"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate", "os.link", "os.symlink"}

    def hook(event, a):
        if event == "open":
            path, mode, flags = a
            if isinstance(path, int) or not (
                flags & (os.O_WRONLY | os.O_RDWR) if mode is None else set(mode) & set("wax+")
            ):
                return
        elif event not in changing:
            return
        count[0] += 1
        if count[0] == at:
            os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)
    return count


_SIGNALS = signal.SIGINT, signal.SIGTERM, signal.SIGHUP


def _child(what, said) -> None:
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_DFL)  # as the command's entry point leaves them
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
    os.chdir(what["cwd"])
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    for descriptor, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(said[name], os.O_WRONLY | os.O_CREAT | os.O_TRUNC), descriptor)
    import resource

    for limit, most in ((resource.RLIMIT_AS, what["memory"]), (resource.RLIMIT_FSIZE, what["file"])):
        if most:
            resource.setrlimit(limit, (most,) * 2)
    count = _count_changes(what["at"])
    status = _command(what["arguments"])
    sys.stdout.flush()
    sys.stderr.flush()
    Path(said["changes"]).write_text(str(count[0]))
    os._exit(status)


def _main() -> None:
    import tempfile

    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a command prints here is not an answer
    with tempfile.TemporaryDirectory() as folder:
        said = {name: os.path.join(folder, name) for name in ("out", "err", "changes")}
        for line in sys.stdin:
            what = json.loads(line)
            began = time.monotonic()
            if what.get("here"):
                os.chdir(what["cwd"])
                status = _command(what["arguments"])
                sys.stdout.flush()
                answer = {"status": status}
            else:
                for file in said.values():
                    Path(file).write_text("")  # nothing of the one before
                signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
                child = os.fork()
                if child == 0:
                    try:
                        _child(what, said)
                    except BaseException:
                        traceback.print_exc()
                    finally:
                        os._exit(70)
                signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
                when = [(began + what["limit"], signal.SIGKILL)]
                if what["after"] is not None:
                    when.append((began + what["after"], what["number"]))
                while True:
                    pid, state = os.waitpid(child, os.WNOHANG)
                    if pid:
                        break
                    if when and time.monotonic() >= when[-1][0]:
                        os.kill(child, when.pop()[1])
                    time.sleep(0.001)
                answer = {"status": os.waitstatus_to_exitcode(state), "seconds": time.monotonic() - began}
                answer |= {name: Path(said[name]).read_text(errors="backslashreplace") for name in ("out", "err")}
                # A signal that comes before there is anything to finish ends it on the spot, uncounted.
                counted = Path(said["changes"]).read_text() if answer["status"] >= 0 else ""
                answer["changes"] = int(counted) if counted else None
            answers.write(json.dumps(answer) + "\n")
            answers.flush()


if __name__ == "__main__":
    _main()
