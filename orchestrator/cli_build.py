"""The command ``cdl build``: reads options, calls the library, prints. What is slow to import is imported inside."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated

import typer

from .assignments import assignment, values_of
from .checkout import home
from .refusals import require_platform, say


def build(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[FMU]...", help="Names of FMUs, in any sizes: cdl_scm_w4p2b1. Default: all that are shipped."),
    ] = None,
    files: Annotated[
        list[str] | None,
        typer.Option("--file", metavar="NAME=PATH", help="File to pack into the FMU, for the file parameter NAME; repeat for more."),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="Start value of a parameter in place of its own, e.g. r_w=0.1; may be repeated."),
    ] = None,
    native: Annotated[
        bool, typer.Option("--native", help="Build FMUs that need no Python, of FMI 2.0 and, in the folder fmi3, of FMI 3.0.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="DIR",
            help="Folder to write. Default: fmus/build, with --native fmus/build/native, of a checkout or here.",
        ),
    ] = None,
) -> None:
    """Build FMUs, for use in other tools. Runs need no build: they use a cache."""
    require_platform()
    from cdl_fmu.slave.model import Instance
    from fmus import SHIPPED, model_of

    from .terminal import output, table

    folder = out or (home() / "fmus" / "build" / "native" if native else home() / "fmus" / "build")
    packed = {name: Path(path) for name, path in (assignment(text, "--file", "body[1].mesh=rock.stl") for text in files or ())}
    models = [model_of(name) for name in names] if names else SHIPPED
    if native and not names:
        for model in models:
            if why := _left_out(model):
                say(f"note: {model.identifier} is left out: {why}")
        models = [model for model in models if not _left_out(model)]
    values = values_of(settings)

    def one(model) -> Path:
        instance = Instance(model)
        for name, value in values.items():
            instance.set_parameter(name, value)
        return (_native if native else _with_python)(model, folder, instance.changed_starts(), packed)

    if native:
        from cdl_fmu.slave.native.build import compile_kernels

        compile_kernels(models)
    rows = table("FMU", "model", "inputs", "outputs", "parameters", right=("inputs", "outputs", "parameters"))
    for model, path in zip(models, _at_once(one, models) if native else map(one, models)):
        first_line = (type(model).__doc__ or "").split("\n")[0]
        rows.add_row(path.name, first_line, *(str(len(record)) for record in (model.inputs, model.outputs, model.parameters)))
    output().print(rows)
    print(f"written to {folder}" + (", for FMI 3.0 to its folder fmi3" if native else ""))
    if not native:
        _note_loader()


def _left_out(model) -> str:
    if model.needed_files:
        return f"it holds its mesh from the start: cdl build --native {model.identifier} --file {model.needed_files[0]}=PATH"
    return model.needs_python


def _at_once(function: Callable, items: Iterable) -> Iterable:
    """As map; compilers run in processes of their own, one for each core."""
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        yield from pool.map(function, items)


def _native(model, folder: Path, starts: dict, files: dict[str, Path]) -> Path:
    from cdl_fmu.slave.native.build import build_native_fmus

    paths = {"2.0": folder / f"{model.identifier}.fmu", "3.0": folder / "fmi3" / f"{model.identifier}.fmu"}
    build_native_fmus(model, paths, starts, files)
    return paths["2.0"]


def _with_python(model, folder: Path, starts: dict, files: dict[str, Path]) -> Path:
    from cdl_fmu.slave.build import build_fmu

    return build_fmu(model, folder / f"{model.identifier}.fmu", starts, files)


def _note_loader() -> None:
    from cdl_fmu.slave.compiler import CompilerError
    from cdl_fmu.slave.loader import python_loader

    try:
        python_loader()
    except CompilerError as error:
        say(f"note: tools in C and C++ on Linux do not find Python by themselves for these FMUs: {error}")
