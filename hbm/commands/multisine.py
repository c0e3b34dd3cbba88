"""The command ``hbm multisine``: even, odd and noise content of responses to periodic multisines."""

from typing import Annotated

import typer

from hbm.commands.inverse import SpectraFile
from hbm.commands.options import console

COMMAND = "multisine"


def multisine(
    spectra: SpectraFile,
    force: Annotated[str, typer.Option(metavar="NAME", help="The channel that excites.")] = "force",
) -> None:
    """How nonlinear responses to a periodic multisine are, and how noisy, before any model.

    Per line of the band excited, relative to the lines excited: harmonics between them that are even, and odd, which
    only a nonlinearity answers at; what the force has there is taken off to first order.

    Example:  hbm multisine spectra.csv --force force
    """
    from hbm.commands.tables import print_rows
    from hbm.measurement.multisine import contents
    from hbm.measurement.spectrafile import load_spectra

    measured = load_spectra(spectra)
    rows = []
    for c in contents(measured, force):
        even, odd, noise = (
            "-" if c.db(kind) != c.db(kind) else f"{c.db(kind):.1f}" for kind in ("even", "odd", "noise")
        )
        rows.append(
            {
                "record": c.record,
                "channel": c.channel,
                "excited\nlines": str(c.lines[0]),
                "rms\na line": f"{c.excited:.4g}",
                "even\ndB": even,
                "odd\ndB": odd,
                "noise\ndB": noise,
            }
        )
    print_rows(console(), f"{measured.source}, {measured.hz[0]:.6g} Hz", rows)
