"""Foreign masters, each run as a process of its own: ``python clients.py CLIENT SSP STOP_TIME OUT`` writes the final outputs as JSON."""

import json
import sys
from pathlib import Path


def in_fmpy(ssp: str, stop_time: float) -> dict[str, float]:
    """Final value of every connector."""
    from fmpy.ssp.simulation import simulate_ssp

    # FMPy adds up the time: half a step less ends it where it is meant to.
    rows = simulate_ssp(ssp, stop_time=stop_time - 0.5e-3, step_size=1e-3)
    return {name: float(rows[name][-1]) for name in rows.dtype.names if name != "time"}


def in_libcosim(ssp: str, stop_time: float) -> dict[str, float]:
    """Final value of every real output."""
    from tempfile import mkdtemp
    from zipfile import ZipFile

    from fmpy.model_description import read_model_description
    from fmpy.ssp.ssd import find_components, read_ssd
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver

    execution = CosimExecution.from_ssp_file(ssp)
    observer = CosimObserver.create_last_value()
    assert execution.add_observer(observer)
    assert execution.simulate_until(target_time=round(stop_time * 1e9))
    index = {info.name.decode(): info.index for info in execution.slave_infos()}
    folder, values = mkdtemp(), {}
    ZipFile(ssp).extractall(folder)
    for component in find_components(read_ssd(ssp).system):
        variables = read_model_description(Path(folder, component.source)).modelVariables
        outputs = {v.name: v.valueReference for v in variables if v.causality == "output" and v.type == "Real"}
        last = observer.last_real_values(index[component.name], list(outputs.values()))
        values |= {f"{component.name}.{name}": value for name, value in zip(outputs, last)}
    return values


if __name__ == "__main__":
    client, ssp, stop_time, out = sys.argv[1:]
    Path(out).write_text(json.dumps({"fmpy": in_fmpy, "libcosim": in_libcosim}[client](ssp, float(stop_time))))
