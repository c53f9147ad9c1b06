"""The commands ``cdl serve`` and ``cdl remote``: a slave in another process. What is slow to import is imported inside."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .refusals import require_platform

Package = Annotated[Path, typer.Argument(metavar="SSP", help="A package, as 'cdl export' writes it.")]


def serve(
    package: Package,
    component: Annotated[str, typer.Argument(metavar="COMPONENT", help="The component whose FMU runs here.")],
    port: Annotated[int, typer.Option(metavar="N", min=0, max=65535, help="TCP port; 0: a free one, which is printed.")],
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address to listen at; 0.0.0.0: every one of this machine. There is no password.")
    ] = "127.0.0.1",
) -> None:
    """Run the FMU of a component for masters in other processes, on this machine or another, one after the other, until interrupted."""
    require_platform()
    from .remote import serve as serve_component
    from .ssp import UNPACKED, read_system

    serve_component(read_system(package, UNPACKED), component, host, port, lambda text: print(text, flush=True))


def remote(
    package: Package,
    served: Annotated[list[str], typer.Argument(metavar="COMPONENT=HOST:PORT...", help="Where 'cdl serve' runs the component's FMU.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", metavar="FILE", help="Package to write. Default: <SSP>_remote.ssp.")] = None,
) -> None:
    """Write a package in which proxies stand for components that run elsewhere; any master that can run the package can run this one."""
    require_platform()
    from .remote import write_remote
    from .ssp import UNPACKED, read_system

    out = out or package.with_name(f"{package.stem}_remote.ssp")
    out.parent.mkdir(parents=True, exist_ok=True)
    write_remote(package, read_system(package, UNPACKED), dict(map(_address, served)), out)
    print(out)


def _address(text: str) -> tuple[str, tuple[str, int]]:
    component, _, address = text.partition("=")
    host, _, port = address.rpartition(":")
    if not (component and host and port.isdecimal() and int(port) < 65536):
        raise typer.BadParameter(f"{text!r}: write COMPONENT=HOST:PORT, e.g. dem=127.0.0.1:9000", param_hint="COMPONENT=HOST:PORT")
    return component, (host, int(port))
