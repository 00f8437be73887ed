"""The command line ``atc VERB``: its errors, warnings, signals and exit status; the verbs are beside this file.

Only what every command needs is imported here, so that ``atc --help`` is instant: numba, xarray and matplotlib come
with the commands that use them.

Exit status: 0 done; 1 ``atc check`` found a broken law, or ``atc verify`` a difference; 2 unusable input (one line on
stderr, never a traceback); 130 interrupted, 143 terminated, 129 hung up (what is finished is kept); 1 anything atc did
not foresee (ATC_DEBUG=1 shows the traceback).
"""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from importlib import import_module
from typing import Annotated

import typer
from typer.core import TyperGroup

from .. import __version__
from ..errors import AtcError
from ..running.interruption import last, watched
from ..terminal import only_printable, printable
from .common import flags, interrupted


def _fail(message: str, status: int) -> None:
    print("error: " + printable(" ".join(str(message).split())), file=sys.stderr, flush=True)
    sys.exit(status)


def _show_warning(message, category, filename, lineno, file=None, line=None) -> None:
    print("warning: " + printable(" ".join(str(message).split())), file=sys.stderr, flush=True)


@contextlib.contextmanager
def _one_line_warnings():
    """Warnings of atc as one line each; those of libraries are for developers."""
    import logging

    from ..errors import AtcWarning

    with warnings.catch_warnings():
        if not os.environ.get("ATC_DEBUG"):
            # It has its say about folders for its own cache.
            logging.getLogger("matplotlib").setLevel(logging.ERROR)
            warnings.simplefilter("ignore")
            warnings.simplefilter("default", AtcWarning)
            warnings.showwarning = _show_warning
        yield


class _Commands(TyperGroup):
    """A command group that turns every failure into one line and an exit status."""

    def main(self, args=None, prog_name=None, complete_var=None, standalone_mode=True, **extra):
        if not standalone_mode:
            return super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
        _outputs_opened().clear()
        if os.environ.get("ATC_DEBUG"):
            status = super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
            sys.exit(status if isinstance(status, int) else 0)
        try:
            with _one_line_warnings(), only_printable(), watched():
                status = super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
            sys.stdout.flush()
        except AtcError as e:
            if isinstance(e.__cause__ or e.__context__, (OSError, RuntimeError)):
                _fail_damaged()
            _fail(e, 2)
        except KeyboardInterrupt:
            _stopped()
        except BrokenPipeError:
            _leave_quietly()
        except SystemExit as e:  # typer's way with a broken pipe
            if isinstance(e.__context__, BrokenPipeError):
                _leave_quietly()
            raise
        except MemoryError as e:
            _fail(
                f"not enough memory{': ' + str(e) if str(e) else ''}: take a coarser grid, a smaller radius or fewer "
                "jobs (-j 1)",
                2,
            )
        except OSError as e:
            _fail_damaged()
            _fail(f"{e.filename + ': ' if isinstance(e.filename, str) else ''}{e.strerror or e}", 2)
        except Exception as e:
            names = {c.__name__ for c in type(e).__mro__}
            if "NoArgsIsHelpError" in names:
                print(e.ctx.get_help())
                sys.exit(2)
            if "ClickException" in names:
                ctx = getattr(e, "ctx", None)
                hint = f" (see: {ctx.command_path} --help)" if ctx is not None else ""
                _fail(e.format_message() + hint, 2)
            if "Abort" in names or last() is not None:
                _stopped()
            _fail_damaged()
            _fail(f"{type(e).__name__}: {e}: atc did not foresee this; run again with ATC_DEBUG=1 for the traceback", 1)
        if status == 130:  # typer's way with Ctrl-C
            _stopped()
        sys.exit(status if isinstance(status, int) else 0)


def _fail_damaged() -> None:
    """Say so if one of the outputs that this command was reading is no longer what was written."""
    for path in _outputs_opened():
        from ..running.opening import damage

        why = damage(path)
        if why:
            _fail(why, 2)


def _outputs_opened() -> list:
    """The outputs that this command has opened, without importing what opens them."""
    opening = sys.modules.get("atc.running.opening")
    return opening.opened if opening else []


def _stopped() -> None:
    """The end of a command that a signal has stopped."""
    signal = last()
    _fail(interrupted(*[signal.word] if signal else []), signal.status if signal else 130)


def _leave_quietly() -> None:
    """The reader of our output (head, less) has left: not an error, and the interpreter must not complain at exit
    either."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.exit(0)


app = typer.Typer(
    cls=_Commands,
    name="atc",
    help="Molecular-dynamics trajectories to continuum fields: Hardy stress, virial stress, density, temperature, "
    "each with a stated error.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Entry point of the ``atc`` command."""
    app(prog_name="atc")


def _version(value: bool) -> None:
    if value:
        print(f"atc {__version__}")
        raise typer.Exit()


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    pass


# --------------------------------------------------------------------------------------------------------------------
# One file a verb, with a function of its name, or the `group` of its own verbs: options only, the work is imported when
# they run.

#: In the order of the help.
VERBS = (
    "info init plan fields compare check conductivity plot verify bench pd export dispersion advect profile report "
    "schema twin upscale"
).split()
for _verb in VERBS:
    _module = import_module(f".{_verb}", __package__)
    if hasattr(_module, "group"):
        app.add_typer(_module.group)
    else:
        app.command()(flags(getattr(_module, _verb)))

if __name__ == "__main__":
    main()
