"""How the command line ends what it refuses: with the message alone."""

from __future__ import annotations

import sys

import typer
from typer.core import TyperGroup

# What users can cause and mend, by module: the message says how, so a traceback would only hide it.
_REFUSALS = {
    "cdl_fmu.slave.compiler": "CompilerError",
    "cdl_fmu.slave.kernel": "CacheError",
    "cdl_fmu.slave.model": "ModelError",
    "cdl_fmu.slave.native.kernels": "ExportError",
    "cdl_fmu.soil": "SoilError",
    "cdl_fmu.soil.measurements": "IdentifyError",
    "orchestrator.experiment": "ExperimentError",
    "orchestrator.fmu": "SlaveError",
    "orchestrator.measured": "MeasuredError",
    "orchestrator.results": "ResultError",
    "orchestrator.run": "RunError",
    "orchestrator.ssp": "SspError",
}


def _is_refusal(error: Exception) -> bool:
    # A class whose module was never imported cannot have been raised.
    known = tuple(getattr(sys.modules[module], name) for module, name in _REFUSALS.items() if module in sys.modules)
    return isinstance(error, known) or (isinstance(error, OSError) and error.filename is not None)


class Commands(TyperGroup):
    """Ends a refused command with its message alone; bugs keep their traceback."""

    def invoke(self, ctx):
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            say("interrupted")
            raise typer.Exit(130) from None
        except Exception as error:
            if not _is_refusal(error):
                raise
            say(f"error: {error.filename}: {error.strerror}" if isinstance(error, OSError) else f"error: {error}")
            raise typer.Exit(2) from None


def say(text: str) -> None:
    """Print a line on stderr, out of what a script reads."""
    print(text, file=sys.stderr)


def require_platform() -> None:
    """End the command where no FMU runs."""
    if sys.platform not in ("linux", "win32"):
        say(
            f"error: FMUs run on Linux and Windows, not on {sys.platform}: use one of them or a container; "
            "results can be plotted, compared and exported here, and the models called from Python"
        )
        raise typer.Exit(2)
