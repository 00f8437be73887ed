"""What worker processes may do instead of their work: in a file of its own, which each of them imports."""

import os


def dies_in_an_answer(pipe, settings):
    """As a worker that the kernel ends while it writes: the length is there, what should follow is not."""
    pipe.recv()
    os.write(pipe.fileno(), (1 << 20).to_bytes(4, "big") + b"half")
    os._exit(9)


def answers_what_cannot_be_sent(pipe, settings):
    from atc.running import workers

    workers.fields_of = lambda frames, settings, k: lambda: None
    workers._work(pipe, settings)
