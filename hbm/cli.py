"""The command ``hbm``: arguments, progress, printing, exit status; docs/reference/commands.md.

Exit status 0: done. 1: a computation failed; what was found is written, and marked. 2: bad input, nothing was
written. 130, 143: ended by SIGINT or SIGTERM; what is complete is kept, or nothing. Every failure is one line on
stderr. Heavy modules are imported by the command that needs them.
"""

import os
import sys
from collections.abc import Callable
from typing import Annotated, Any

import typer
from typer._click.exceptions import NoArgsIsHelpError, UsageError
from typer.core import TyperGroup

from hbm import interrupts
from hbm.commands.backbone import backbone
from hbm.commands.decay import decay
from hbm.commands.diagnose import diagnose
from hbm.commands.examples import examples
from hbm.commands.follow import follow
from hbm.commands.frf import frf
from hbm.commands.identify import identify
from hbm.commands.inverse import inverse
from hbm.commands.laws import laws
from hbm.commands.loops import loops
from hbm.commands.modal import modal
from hbm.commands.modes import modes
from hbm.commands.multisine import multisine
from hbm.commands.options import (
    say,
    spreading,
    warnings_in_one_line,
)
from hbm.commands.simulate import simulate
from hbm.commands.spectra import spectra
from hbm.commands.synthesize import synthesize
from hbm.errors import InputError

INTERRUPTED = 130
"""Status that Typer gives to a keyboard interrupt."""

THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
"""More than one costs time on matrices this small, and the last digits then depend on the machine."""

TRACKED = "ignore:resource_tracker:UserWarning"
"""A warning that is of no use to anybody who runs a command."""


class OneLine(TyperGroup):
    """Commands whose failures are one line on stderr and an exit status."""

    def main(self, *args: Any, **options: Any) -> Any:
        """Run, say a failure in one line, and exit."""
        options["standalone_mode"] = False
        sys.exit(_status(lambda: super(OneLine, self).main(*args, **options)))


app = typer.Typer(cls=OneLine, no_args_is_help=True, add_completion=True, pretty_exceptions_enable=False)


def main() -> None:
    """Entry point of the console script."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a terminal without µ is no reason to fail
    os.environ.update(dict.fromkeys(THREADS, "1"))
    os.environ.setdefault("PYTHONSAFEPATH", "1")  # else workers import what lies in the working folder by accident
    # a command that ends at once leaves it to the tracker of its workers to clean up after it, which need not tell
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, (os.environ.get("PYTHONWARNINGS"), TRACKED)))
    os.environ.setdefault("MPLBACKEND", "agg")  # figures go to files; no window is opened for them
    interrupts.listen()
    try:
        app(prog_name="hbm")
    except KeyboardInterrupt:  # before or after Typer answers it
        say(interrupts.said(), 0)
    except Exception:
        if not interrupts.ending():
            raise
        say(interrupts.said(), 0)  # a library made another error of it
    finally:
        interrupts.conclude()


def _status(run: Callable[[], Any]) -> int:
    """Exit status of a run; what went wrong goes to stderr."""
    try:
        with warnings_in_one_line():
            status = int(run() or 0)
    except InputError as refused:
        return say(str(refused), 2)
    except OSError as refused:  # a name too long, a folder that may not be read
        return say(f"hbm: {refused.filename}: {str(refused.strerror).lower()}; must be a file that can be used", 2)
    except (ArithmeticError, MemoryError) as failed:
        return say(f"hbm: {str(failed) or 'out of memory'}", 1)
    except UsageError as misused:
        return say(_usage(misused), misused.exit_code)
    return say(interrupts.said(), interrupts.status()) if status == INTERRUPTED else status


def _usage(error: UsageError) -> str:
    if isinstance(error, NoArgsIsHelpError):
        return error.format_message()
    path = error.ctx.command_path if error.ctx else "hbm"
    text = error.format_message().rstrip(".")
    return f"{path}: {text[:1].lower()}{text[1:]}; see {path} --help"


# --------------------------------------------------------------------------------------------------------- commands


def _version(wanted: bool) -> None:
    if wanted:
        from hbm import __version__

        print(f"hbm {__version__}")
        raise typer.Exit


@app.callback()
def hbm(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Harmonic balance for beams and structures that rub on a support.

    Start with:  hbm frf examples/paper_beam.toml --plot beam.png
    """


app.command()(modes)
app.command()(laws)
app.command(cls=spreading("--level"))(frf)
app.command()(simulate)
app.command(cls=spreading("--level"))(backbone)
app.command(cls=spreading("--fundamental", "--level"))(spectra)
app.command()(decay)
app.command()(multisine)
app.command(cls=spreading("--record"))(modal)
app.command()(loops)
app.command(cls=spreading("--levels", "--frequencies"))(synthesize)
app.command(cls=spreading("--record"))(inverse)
app.command(cls=spreading("--held-out", "--hold-out"))(identify)
app.command(cls=spreading("--hold-out"))(diagnose)
app.command("continue")(follow)
app.command()(examples)


if __name__ == "__main__":
    main()
