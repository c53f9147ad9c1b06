"""Slaves in other processes: a served FMU gives the same bits and tells its own errors; after a lost connection a run can be resumed."""

import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from orchestrator.cli import app
from orchestrator.experiment import load_experiment
from orchestrator.fmu import Slave, SlaveError
from orchestrator.remote import write_remote
from orchestrator.results import open_result
from orchestrator.run import run
from orchestrator.ssp import SspError, read_system

CDL = [sys.executable, "-c", "from orchestrator.cli import app; app()"]


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """Two wheels, SCM in front and BCM in its rut."""
    path = tmp_path_factory.mktemp("package") / "x.ssp"
    load_experiment("two_wheel", tiers=("SCM", "BCM")).write_system(path)
    return path


@pytest.fixture
def serve():
    """Start ``cdl serve`` of a component at a port; returns the process and the port."""
    started = []

    def start(package, component, port=0):
        process = subprocess.Popen(
            [*CDL, "serve", str(package), component, "--port", str(port)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        started.append(process)
        line = process.stdout.readline()
        found = re.fullmatch(rf"serving {component} \(\w+\) at 127\.0\.0\.1:(\d+)\n", line)
        assert found, line + process.stdout.read()
        return process, int(found[1])

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def proxied(package, tmp_path):
    """The package with a proxy in place of a component, read."""

    def write(component, port):
        path = tmp_path / f"{component}_{port}.ssp"
        write_remote(package, read_system(package, tmp_path / "unpacked"), {component: ("127.0.0.1", port)}, path)
        return read_system(path, tmp_path / "unpacked")

    return write


def values(outcome):
    return open_result(outcome.result).series.values


@pytest.mark.parametrize("component, scheme", [("scm", "ij"), ("bcm", "jacobi"), ("rover", "aitken")])
def test_a_slave_in_another_process_gives_the_same_bits(component, scheme, package, serve, proxied, tmp_path):
    process, port = serve(package, component)
    near = run(read_system(package, tmp_path / "unpacked"), tmp_path / "near", scheme=scheme, stop_time=0.05)
    for again in range(2):  # a fresh instance for each master
        far = run(proxied(component, port), tmp_path / f"far{again}", scheme=scheme, stop_time=0.05)
        assert np.array_equal(values(far), values(near))
    said = [process.stdout.readline() for _ in range(2)]
    assert said == ["a master at 127.0.0.1 runs it\n", "the master has ended its run\n"]


def test_a_lost_connection_ends_the_run_and_its_checkpoint_resumes_to_the_same_bits(package, serve, proxied, tmp_path):
    process, port = serve(package, "bcm")
    system, out = proxied("bcm", port), tmp_path / "far"

    def end_it(t, stop):
        if t > 0.035:
            os.kill(process.pid, signal.SIGKILL)
            process.wait()

    with pytest.raises(SlaveError) as refused:
        run(system, out, stop_time=2.0, checkpoint_every=0.01, progress=end_it)
    said = str(refused.value)
    assert re.search(
        rf"bcm did not do the step \(fmi2Discard\) at t = 0\.\d+ s: bcm: lost the connection to 127\.0\.0\.1:{port}, where", said
    )
    assert "see why it ended and start 'cdl serve' there again; once its cause is mended, go on with --resume " in said
    checkpoint = re.search(r"--resume (\S+\.npz); the steps before it are in", said)[1]
    serve(package, "bcm", port)
    far = run(system, out, stop_time=0.2, resume=Path(checkpoint))
    near = run(read_system(package, tmp_path / "unpacked"), tmp_path / "near", stop_time=0.2)
    assert np.array_equal(values(far), values(near))


def test_a_connection_lost_before_the_outputs_are_read_is_an_error_too(package, serve, proxied):
    process, port = serve(package, "bcm")
    component = proxied("bcm", port).components["bcm"]
    slave = Slave("rear", component.model_description, component.directory, print)
    slave.connect([], np.zeros(0), ["wheel[1].f_0[3]"], np.zeros(1))
    slave.initialise(0.0, None, {})
    slave.step(0.0, 1e-3)
    process.kill()
    process.wait()
    with pytest.raises(SlaveError, match=r"rear did not give its outputs at t = 0\.001 s: rear: lost the connection"):
        slave.get(1e-3)
    slave.close()  # which makes no call any more


def test_what_the_fmu_says_comes_through(package, serve, proxied, tmp_path):
    _, port = serve(package, "scm")
    component = proxied("scm", port).components["scm"]

    def slave(*names):
        warned = []
        made = Slave("front", component.model_description, component.directory, warned.append)
        made.connect(list(names), np.zeros(len(names)), [], np.zeros(0))
        return made, warned

    made, warned = slave(*(f"wheel[1].T[{i},{j}]" for i in (1, 2, 3) for j in (1, 2, 3)))
    made.initialise(0.0, None, {})
    made.set(0.0)
    made.step(0.0, 1e-3)
    made.close()
    assert "front: wheel 1 has no pose yet" in warned[0]

    made, _ = slave("wheel[1].r_0[1]")
    made.initialise(0.0, None, {})
    made.u[0] = np.nan
    made.set(0.0)
    with pytest.raises(SlaveError, match=r"front: input wheel\[1\]\.r_0\[1\] = nan m"):
        made.step(0.0, 1e-3)
    made.close()

    made, _ = slave()
    with pytest.raises(SlaveError, match=r"front: parameter wheel\.r_w|r_w = -1"):
        made.initialise(0.0, None, {"r_w": -1.0})
    made.close()


def test_nothing_or_another_fmu_at_the_address_is_refused_before_the_first_step(package, serve, proxied, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(SlaveError, match=rf"scm: nothing serves cdl_scm_w1p1 at 127\.0\.0\.1:{port} .* start 'cdl serve' there"):
        run(proxied("scm", port), tmp_path / "none", stop_time=0.01)
    _, port = serve(package, "bcm")
    with pytest.raises(
        SlaveError, match=r"scm: the FMU that is served has GUID .*, the proxy stands for .*write it again with 'cdl remote'"
    ):
        run(proxied("scm", port), tmp_path / "other", stop_time=0.01)


def test_a_second_master_and_a_stranger_are_turned_away(package, serve, proxied, tmp_path):
    process, port = serve(package, "bcm")
    with socket.create_connection(("127.0.0.1", port)):
        assert process.stdout.readline() == "a master at 127.0.0.1 runs it\n"
        with pytest.raises(SlaveError, match=rf"nothing serves cdl_bcm_w1p1 at 127\.0\.0\.1:{port}"):
            run(proxied("bcm", port), tmp_path / "second", stop_time=0.01)
    assert process.stdout.readline() == "the connection to the master is lost (the other end closed it)\n"
    assert process.stdout.readline().startswith("serving bcm")
    with socket.create_connection(("127.0.0.1", port)) as stranger:
        stranger.sendall(b"\x02\x00\x00\x00\x63hi")
        assert stranger.recv(1) == b""
    assert process.stdout.readline() == "a master at 127.0.0.1 runs it\n"
    assert process.stdout.readline() == "what is connected is no proxy FMU of this version (it began with call 99)\n"


def test_a_proxy_is_a_valid_fmu_and_takes_the_place_of_the_other_in_the_package(package, proxied, tmp_path):
    system = proxied("scm", 9000)
    path = system.components["scm"].fmu_path
    assert validate_fmu(str(path)) == []
    assert fmpy.read_model_description(str(path)).guid != read_system(package, tmp_path / "x").components["scm"].model_description.guid
    with ZipFile(tmp_path / "scm_9000.ssp") as written:
        fmus = {name for name in written.namelist() if name.endswith(".fmu")}
    assert fmus == {f"resources/{n}.fmu" for n in ("scm_remote", "cdl_bcm_w1p1", "cdl_rover_w2", "cdl_driver_w2")}
    first = (tmp_path / "scm_9000.ssp").read_bytes()
    proxied("scm", 9000)
    assert (tmp_path / "scm_9000.ssp").read_bytes() == first


@pytest.mark.parametrize(
    "options, said",
    [
        (["remote", "{}", "scm=nowhere"], "'scm=nowhere': write COMPONENT=HOST:PORT, e.g. dem=127.0.0.1:9000"),
        (["remote", "{}", "dem=127.0.0.1:9000"], "the system two_wheel has no component 'dem'; it has rover, driver, scm, bcm"),
        (["serve", "{}", "dem", "--port", "0"], "the system two_wheel has no component 'dem'; it has rover, driver, scm, bcm"),
    ],
)
def test_wrong_options_are_refused(options, said, package, capsys):
    with pytest.raises(SystemExit) as ended:
        app([option.format(package) for option in options])
    assert ended.value.code == 2
    assert said in " ".join(re.sub(r"[│╭╮╰╯─]", " ", capsys.readouterr().err).split())


def test_only_components_of_the_system_are_served(package, tmp_path):
    with pytest.raises(SspError, match="has no component 'dem'"):
        write_remote(package, read_system(package, tmp_path), {"dem": ("127.0.0.1", 9000)}, tmp_path / "y.ssp")
