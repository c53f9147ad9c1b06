"""What a height patch costs through FMI 2.0 and FMI 3.0, in a host in C: ``python benchmarks/patch.py``; cc is needed."""

import math
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy

from cdl_fmu.slave.native.build import build_native_fmus
from fmus import model_of

MODEL = "cdl_bcm_w17p17"  # 17 patches of 13 x 9: 1989 values in, the largest arrays that any tier takes
HERE = Path(__file__).parent
INCLUDED = HERE.parent / "examples" / "c_host", Path(fmpy.__file__).parent / "c-code"


def main() -> None:
    with TemporaryDirectory() as name:
        folder = Path(name)
        build_native_fmus(model_of(MODEL), {"3.0": folder / "x.fmu"})
        description = fmpy.read_model_description(str(folder / "x.fmu"))
        fmpy.extract(str(folder / "x.fmu"), str(folder / "x"))
        heights = [v for v in description.modelVariables if v.name.startswith("patch[") and v.name.endswith(".z")]
        arrays = [f"{v.valueReference}:{math.prod(int(d.start) for d in v.dimensions)}" for v in heights]
        headers = [flag for place in INCLUDED for flag in ("-I", place)]
        subprocess.run(["cc", "-std=c99", "-O2", *headers, HERE / "patch.c", "-o", folder / "patch", "-ldl"], check=True)
        library = folder / "x" / "binaries" / "x86_64-linux" / f"{MODEL}.so"
        subprocess.run([folder / "patch", library, description.instantiationToken, *arrays], check=True)


if __name__ == "__main__":
    main()
