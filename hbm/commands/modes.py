"""The command ``hbm modes``: natural frequencies, damping and compliance."""

from hbm.commands.options import AllowCode, RigFile, console


def modes(rig: RigFile, allow_code: AllowCode = False) -> None:
    """Natural frequencies, sliding and stuck, damping, and the residual compliance.

    Example:  hbm modes examples/paper_beam.toml
    """
    from hbm.commands.tables import print_modes
    from hbm.modes.linear import linear_modes
    from hbm.rigfiles.load import load_rig

    loaded = load_rig(rig, allow_code=allow_code or None)
    print_modes(console(), loaded, linear_modes(loaded))
