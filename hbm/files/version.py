"""The version of the package that is installed."""


def installed_version() -> str:
    """Version of the installed package, or that it is run from its sources."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("casadi-hbm")
    except PackageNotFoundError:
        return "0+source"
