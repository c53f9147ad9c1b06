"""Systems of FMUs: experiments, SSP packages, coupling schemes, runs and their results."""

__all__ = ["open_result", "simulate"]


def __getattr__(name: str):
    # Loaded when asked for: the command line's help must not wait for xarray and matplotlib.
    if name == "simulate":
        from .drive import simulate

        return simulate
    if name == "open_result":
        from .results import open_result

        return open_result
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
