"""`atc ...` that stands still once the n-th entry of its output (-o) is finished, until a signal to stop comes:
``python held.py N ARGUMENTS``. Told from outside by the journal, a run may be over before the signal has arrived."""

import sys
import time
from pathlib import Path

from atc.running import interruption
from atc.running.store import Store


def hold_after(entries: int, out: Path) -> None:
    write = Store.write

    def write_and_wait(self, values, note):
        write(self, values, note)
        end = time.monotonic() + 120.0  # nobody may be left to send it
        while self.out.name == out.name and self.done >= entries and not interruption.asked():
            if time.monotonic() > end:
                sys.exit("no signal came")
            time.sleep(0.01)

    Store.write = write_and_wait


if __name__ == "__main__":
    from atc.cli import app

    hold_after(int(sys.argv[1]), Path(sys.argv[sys.argv.index("-o") + 1]))
    app(sys.argv[2:], prog_name="atc")
