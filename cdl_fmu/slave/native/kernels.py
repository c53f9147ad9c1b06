"""Object code of a model's kernels: what a native FMU is linked from, free of Python, of numba and of the build host's CPU.

A model becomes four C functions, which ``c/model.h`` declares, over its one block of doubles ``[p|u|x|y]``, in which a value reference is
an offset, and over the arrays of its pool (see ``Model.make_pool``): ``arrays[i]`` points to the first element of array i, row-major, of
float64, int64 or records of float64 as in Python; ``extents`` has those of array 0, then those of array 1, and so on. They may be others at
each call: memory that grows between steps stays with the caller, which keeps the rules of the model's pool class.

The functions hold no global state, so any number of instances may run in any number of threads.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from queue import Queue

import llvmlite.binding as llvm

from ..model import KernelModel, Rule
from ..pieces import Piece

#: Functions of libm that the object may leave undefined; LLVM joins a sin and a cos of one angle to glibc's sincos.
LIBM = frozenset(
    """
    acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs floor fma fmax fmin fmod frexp hypot
    ldexp lgamma log log10 log1p log2 modf nearbyint nextafter pow rint round sin sincos sinh sqrt tan tanh tgamma trunc
    """.split()  # noqa: SIM905
)
#: Functions that LLVM makes of loops that copy, zero or compare.
MEMORY = frozenset({"memcpy", "memmove", "memset", "memcmp"})

# Counts of references to arrays, which are all the caller's here: numba leaves calls that do nothing for such.
_COUNTS = re.compile(r"(define [^\n]*@NRT_(?:incref|decref)\([^\n]*\{\n).*?\n\}", re.DOTALL)

_RULE = "use loops and scalars in place of what allocates, raises or prints (CONTRIBUTING.md, kernel rules)"

#: Levels of the processor architecture that all code is there for, each as LLVM names it: any, and one with vectors of four doubles.
_LEVELS = ("x86-64", "x86-64-v3")

# numba reads these when it is imported, hence a process of its own. Without them the code is vectorised for the build host alone.
_ENVIRONMENT = {"NUMBA_CPU_FEATURES": "", "NUMBA_DISABLE_INTEL_SVML": "1"}
_CPU = "NUMBA_CPU_NAME"


class ExportError(Exception):
    """A model's kernels cannot stand without Python; the message says what they call and what to change."""


def object_code(wanted: Sequence[tuple[KernelModel, Sequence[str]]]) -> list[list[bytes]]:
    """Compile the kernels of models to object files, those for any processor and those with vectors at once; what models share, once.

    Args:
        wanted: Models, of classes that can be imported by name, each with LLVM target triples of this machine's processor architecture,
            such as ``x86_64-pc-windows-gnu``.

    Returns:
        For each model an object file for each triple; of foreign functions it needs only those in ``LIBM``, ``MEMORY`` and the model's
        library.

    Raises:
        ExportError: The kernels need more than that, or the class cannot be imported.
    """
    for model, _ in wanted:
        if type(model).__module__ == "__main__":
            name = type(model).__qualname__
            raise ExportError(f"{name} is defined in a script: move it to a module that can be imported, to export it")
    done: Queue = Queue()
    with ThreadPoolExecutor() as pool:
        for level in _LEVELS:
            if models := [(i, model) for i, (model, _) in enumerate(wanted) if level in _levels_of(model)]:
                pool.submit(_compile_all, models, level, done)
        entries: list[dict] = [{} for _ in wanted]
        codes: list[list] = [[] for _ in wanted]
        for _ in range(sum(len(_levels_of(model)) for model, _ in wanted)):
            i, level, compiled = done.get()
            if isinstance(compiled, ExportError):
                raise compiled
            entries[i][level] = compiled
            model, triples = wanted[i]
            if len(entries[i]) == len(_levels_of(model)):
                theirs = frozenset(model.library.functions if model.library else ())
                codes[i] = [pool.submit(_emit, entries[i], triple, theirs) for triple in triples]
        return [[code.result() for code in of_model] for of_model in codes]


def _levels_of(model: KernelModel) -> Sequence[str]:
    return _LEVELS if model.gains_from_vectors else _LEVELS[:1]


def _compile_all(models: Sequence[tuple[int, KernelModel]], level: str, done: Queue) -> None:
    """Put number of the model, level and the model's entries into the queue, or an ExportError for them, one model after the other."""
    environment = os.environ | _ENVIRONMENT | {_CPU: level, "PYTHONPATH": os.pathsep.join(sys.path)}
    orders = json.dumps([(type(model).__module__, type(model).__qualname__, model.sizes) for _, model in models])
    command, pipes = [sys.executable, "-m", __name__], dict(stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    with (
        tempfile.TemporaryFile("w+") as said,
        subprocess.Popen(command, env=environment, stderr=said, **pipes) as process,
    ):
        process.stdin.write(orders)
        process.stdin.close()
        for i, model in models:
            line = process.stdout.readline()
            try:
                done.put((i, level, json.loads(line)))
            except json.JSONDecodeError:  # it ended, or something printed: whoever waits for the queue must hear of it
                process.kill()
                process.wait()
                said.seek(0)
                done.put((i, level, ExportError(f"{model.identifier}: {(said.read() or line).strip()}")))
                return


def _entries(model: KernelModel) -> dict[str, tuple[str, str]]:
    """All entries compiled: IR and symbol, by the name that each gets in the object."""
    import numba
    import numpy as np
    from numba import carray, float64, int32, int64, types

    from ..kernel import OPTIONS

    pieces = model.pieces()
    # As the block has no bytes for an array of length 0, that is no record of an array of length 1, from its begin.
    formats = [(piece.dtype, piece.shape[:1] if piece.inner else tuple(max(n, 1) for n in piece.shape)) for piece in pieces]
    offsets = [piece.start * np.float64().itemsize for piece in pieces]
    size = max(offset + np.dtype(one).itemsize for offset, one in zip(offsets, formats))
    names = [piece.name for piece in pieces]
    block = types.CPointer(numba.from_dtype(np.dtype(dict(names=names, formats=formats, offsets=offsets, itemsize=size))))
    parameters = types.CPointer(numba.from_dtype(model.parameters.dtype))
    taken = {piece.name: _taken(piece) for piece in pieces}
    kept = model.at_start(taken)
    pool = model.make_pool(model.parameters.starts().view(model.parameters.dtype).view(np.recarray)[0], {})
    arrays = () if pool is None else pool.arrays
    views = _views(arrays)
    if views and model.arguments is not None:
        views = [f"({', '.join(views)},)"]
    resize = f"resize_kernel(carray(parameters, 1)[0], carray(extents, {sum(a.ndim for a in arrays)}), growth)"
    if model.resize_kernel is None:
        resize = "pass"
    source = f"""
def initialise(t, block, arrays, extents):
    b = carray(block, 1)[0]
    initialise_kernel({", ".join(("t", *kept, *views))})
    return int32(0)

def step(t, h, block, arrays, extents):
    b = carray(block, 1)[0]
    return int32(step_kernel({", ".join(("t", "h", *taken.values(), *views))}))

def check(parameters, numbers):
    p = carray(parameters, 1)[0]
{_rules(model.rules)}
    return int32(0)

def resize(parameters, extents, growth):
    {resize}
    return int32(0)
"""
    kernels = {"initialise_kernel": model.initialise_kernel, "step_kernel": model.step_kernel, "resize_kernel": model.resize_kernel}
    dtypes = {f"dtype{i}": array.dtype for i, array in enumerate(arrays)}
    scope = {"carray": carray, "int32": int32, **dtypes, **kernels, **_functions(model.rules)}
    exec(source, scope)

    doubles, integers, pool_types = types.CPointer(float64), types.CPointer(int64), (types.CPointer(types.voidptr), types.CPointer(int64))
    signatures = {
        "initialise": (float64, block, *pool_types),
        "step": (float64, float64, block, *pool_types),
        "check": (parameters, doubles),
        "resize": (parameters, integers, integers),
    }
    compiled = {}
    for name, signature in signatures.items():
        # Not cfunc: its wrapper pulls in Python's C API. carray wants numba's run-time, of which _emit leaves nothing.
        entry = numba.njit(**OPTIONS | {"_nrt": True})(scope[name])
        try:
            entry.compile(signature)
        except numba.core.errors.NumbaError as error:
            raise ExportError(f"the kernels do not compile; {_RULE}\n{error}") from error
        result = entry.overloads[signature]
        compiled[f"model_{name}"] = result.library.get_llvm_str(), result.fndesc.llvm_func_name
    return compiled


def _taken(piece: Piece) -> str:
    """An expression for a piece of the block ``b`` in an entry."""
    if piece.name.isupper():
        return f"b.{piece.name}[0]"
    if piece.inner:
        return f"b.{piece.name}[:].{piece.inner}"
    return f"b.{piece.name}[{', '.join(f':{n}' for n in piece.shape)}]"


def _views(arrays: tuple) -> list[str]:
    """An expression for each of a pool's arrays in an entry's arguments ``arrays`` and ``extents``."""
    views, at = [], 0
    for i, array in enumerate(arrays):
        extents = "".join(f"extents[{at + k}], " for k in range(array.ndim))
        views.append(f"carray(arrays[{i}], ({extents}), dtype{i})")
        at += array.ndim
    return views


def _rules(rules: Sequence[Rule]) -> str:
    """Lines that find the first broken rule, tell its numbers, and return its number from 1."""
    lines = []
    for i, rule in enumerate(rules):
        applies = "" if rule.applies is None else f"applies{i}(p) and "
        lines += [f"    if {applies}broken{i}(p):"]
        lines += [f"        numbers[{k}] = number{i}_{k}(p)" for k, _ in enumerate(rule.numbers)]
        lines += [f"        return int32({i + 1})"]
    return "\n".join(lines)


def _functions(rules: Sequence[Rule]) -> dict[str, object]:
    """The functions in these lines, for numba."""
    from numba.extending import register_jitable

    functions = {f"broken{i}": rule.broken for i, rule in enumerate(rules)}
    functions |= {f"applies{i}": rule.applies for i, rule in enumerate(rules) if rule.applies}
    functions |= {f"number{i}_{k}": number for i, rule in enumerate(rules) for k, number in enumerate(rule.numbers.values())}
    return {name: register_jitable(function) for name, function in functions.items()}


def target_machine(triple: str) -> llvm.TargetMachine:
    """LLVM's code generator for any processor of this architecture."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(triple).create_target_machine(cpu=_LEVELS[0], opt=3, reloc="pic", codemodel="small")


def _emit(entries: Mapping[str, dict[str, tuple[str, str]]], triple: str, theirs: frozenset[str]) -> bytes:
    """Object file of the entries by level, what they call, and what chooses among levels, and nothing else.

    ``theirs`` are the functions of the model's library.
    """
    machine = target_machine(triple)
    module = llvm.parse_assembly("")
    choices, names = [], entries[_LEVELS[0]].keys()
    for name in names:
        kinds = []
        for level in entries:
            ir, symbol = entries[level][name]
            ir = _COUNTS.sub(r"\1  ret void\n}", ir)
            part = llvm.parse_assembly(re.sub(r"^(define .*) \{$", rf'\1 "target-cpu"="{level}" {{', ir, flags=re.MULTILINE))
            for value in (*part.functions, *part.global_variables):
                if not value.is_declaration:
                    value.linkage = "internal"
            entry = part.get_function(symbol)
            entry.linkage, entry.name = "external", f"{name}.{level}"
            kinds = [str(argument.type) for argument in entry.arguments]
            module.link_in(part)
        choices.append(_choice(name, kinds, list(entries)))
    module.link_in(llvm.parse_assembly("\n".join(["@cpu_has_vectors = external hidden global i32", *choices])))
    for function in module.functions:
        if not function.is_declaration and function.name not in names:
            function.linkage = "internal"
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))

    foreign = {f.name for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")} - LIBM - MEMORY - theirs
    if foreign:
        raise ExportError(f"the kernels call {', '.join(sorted(foreign))}; {_RULE}")
    # numba numbers what it compiles, so local names depend on what else was compiled or cached: not in a reproducible object.
    local = (v for v in (*module.functions, *module.global_variables) if not v.is_declaration and v.name not in names)
    for i, value in enumerate(local):
        value.name = f"local{i}"
    module.triple, module.data_layout, module.name = triple, str(machine.target_data), "kernels"
    return machine.emit_object(module)


def _choice(name: str, kinds: Sequence[str], levels: Sequence[str]) -> str:
    """IR of an entry that goes on to the one that the processor can run, as ``cpu_has_vectors`` of ``c/instance.c`` says."""
    arguments = ", ".join(f"{kind} %a{i}" for i, kind in enumerate(kinds))
    at_any, at_best = f'@"{name}.{min(levels)}"', f'@"{name}.{max(levels)}"'
    declared = "\n".join(f'declare i32 @"{name}.{level}"({", ".join(kinds)})' for level in levels)
    return f"""
{declared}
define hidden i32 @{name}({arguments}) {{
  %level = load i32, ptr @cpu_has_vectors
  %old = icmp eq i32 %level, 0
  br i1 %old, label %any, label %best
any:
  %r = tail call i32 {at_any}({arguments})
  ret i32 %r
best:
  %s = tail call i32 {at_best}({arguments})
  ret i32 %s
}}"""


def _main() -> None:
    for module, name, sizes in json.load(sys.stdin):
        try:
            print(json.dumps(_entries(getattr(import_module(module), name)(**sizes))), flush=True)
        except ExportError as error:
            sys.exit(str(error))


if __name__ == "__main__":
    _main()
