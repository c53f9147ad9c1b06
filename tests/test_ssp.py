"""SSP packages: what is read, what is refused, and how it is said."""

from zipfile import ZipFile

import pytest
from ssp_fmus import (
    PLANT,
    binding,
    component,
    connections,
    connector_list,
    describe,
    mapping,
    message,
    one,
    parameter_set,
    reader,
    structure,
    two,
    variable,
    write_fmu,
)

from orchestrator.ssp import Connection, SspError, read_system


@pytest.fixture
def plant(tmp_path):
    return write_fmu(tmp_path / "plant.fmu", PLANT)


@pytest.fixture
def read(tmp_path, plant):
    return reader(tmp_path, plant)


def test_connection_between_two_components(read):
    system = read(two("a.y -> b.u"))
    assert list(system.components) == ["a", "b"]
    assert system.connections == [Connection("a", "y", "b", "u")]
    assert (system.components["a"].directory / "modelDescription.xml").is_file()
    assert system.components["a"].model_description.modelName == "test"


def test_start_and_end_do_not_give_the_direction(read):
    assert read(two("b.u -> a.y")).connections == [Connection("a", "y", "b", "u")]


def test_default_experiment_and_step(read):
    annotation = (
        '<ssd:Annotations><ssc:Annotation type="com.opensimulationplatform"><osp:Algorithm xmlns:osp="o"><osp:FixedStepAlgorithm '
        'baseStepSize="0.002"/></osp:Algorithm></ssc:Annotation></ssd:Annotations>'
    )
    body = f"<ssd:Elements>{component('a', 'plant')}</ssd:Elements>"
    system = read(structure(body, f'<ssd:DefaultExperiment startTime="1" stopTime="4">{annotation}</ssd:DefaultExperiment>'))
    assert (system.start_time, system.stop_time, system.step_size) == (1.0, 4.0, 0.002)
    system = read(structure(body))
    assert (system.start_time, system.stop_time, system.step_size) == (0.0, None, None)
    assert "stopTime = 1 s is before startTime = 2 s" in message(
        read, structure(body, '<ssd:DefaultExperiment startTime="2" stopTime="1"/>')
    )


def test_units_are_converted_then_the_transformation_is_applied(read):
    linear = '<ssc:LinearTransformation factor="2" offset="1"/>'
    (c,) = read(two(f"a.warm -> b.t|{linear}", a="warm:output", b="t:input")).connections
    # 300 K is 26.85 degC, then 2 x + 1.
    assert c.factor * 300 + c.offset == pytest.approx(2 * 26.85 + 1)


def test_unit_of_a_connector_stands_between_the_variables(read):
    units = '<ssd:Units><ssc:Unit name="km"><ssc:BaseUnit m="1" factor="1000"/></ssc:Unit></ssd:Units>'
    linear = '<ssc:LinearTransformation offset="1"/>'
    elements = component("a", "plant", "y:output") + component("b", "plant", "u:input:km")
    ssd = structure(f"<ssd:Elements>{elements}</ssd:Elements>{connections('a.y -> b.u|' + linear)}", units)
    (c,) = read(ssd).connections
    assert c.factor * 500 + c.offset == pytest.approx(1500)  # 500 m = 0.5 km, + 1 km, in metres


def test_suppressed_unit_conversion(read):
    ssd = two("a.angle -> b.u", a="angle:output").replace("<ssd:Connection ", '<ssd:Connection suppressUnitConversion="true" ')
    assert read(ssd).connections == [Connection("a", "angle", "b", "u")]


def nested(bindings="", outer_bindings="", link="a.y -> sub.in"):
    inner = (
        f'<ssd:System name="sub">{connector_list("in:input out:output gain:parameter")}{bindings}'
        f"<ssd:Elements>{component('b', 'plant', 'u:input y:output k:parameter')}</ssd:Elements>"
        + connections("in -> b.u", "b.y -> out", "gain -> b.k")
        + "</ssd:System>"
    )
    return structure(
        f"{outer_bindings}<ssd:Elements>{component('a', 'plant', 'y:output u:input')}{inner}</ssd:Elements>"
        + connections(link, "sub.out -> a.u")
    )


def test_nested_systems_are_flattened(read):
    system = read(nested())
    assert set(system.components) == {"a", "sub.b"}
    assert {(c.source_component, c.target_component) for c in system.connections} == {("a", "sub.b"), ("sub.b", "a")}


def test_parameters_reach_a_nested_component(read):
    inner = binding(parameter_set('gain=<ssv:Real value="2"/>', 'b.count=<ssv:Integer value="5"/>'))
    assert read(nested(inner)).components["sub.b"].parameters == {"k": 2.0, "count": 5}
    # The outer binding counts.
    outer = binding(parameter_set('sub.gain=<ssv:Real value="3"/>', 'sub.b.count=<ssv:Integer value="6"/>'))
    assert read(nested(inner, outer)).components["sub.b"].parameters == {"k": 3.0, "count": 6}


VALUES = (
    'k=<ssv:Real value="2.5"/>',
    'mode=<ssv:Enumeration value="fast"/>',
    'count=<ssv:Integer value="7"/>',
    'on=<ssv:Boolean value="false"/>',
    'file=<ssv:String value="a.stl"/>',
)
RESULT = {"k": 2.5, "mode": 2, "count": 7, "on": False, "file": "a.stl"}


def test_parameters_inline_and_from_a_file(read):
    assert read(one(bindings=binding(parameter_set(*VALUES)))).components["a"].parameters == RESULT
    external = read(one(bindings=binding(source="resources/p.ssv")), **{"resources/p.ssv": parameter_set(*VALUES)})
    assert external.components["a"].parameters == RESULT


@pytest.mark.parametrize("external", [False, True])
def test_mapping_with_units_and_transformation(read, external):
    units = '<ssv:Units><ssc:Unit name="cm"><ssc:BaseUnit m="1" factor="0.01"/></ssc:Unit></ssv:Units>'
    values = parameter_set('p.length=<ssv:Real value="50" unit="cm"/>', 'unused=<ssv:Real value="9"/>', units=units)
    entries = mapping('<ssm:MappingEntry source="p.length" target="k"><ssc:LinearTransformation factor="4" offset="1"/></ssm:MappingEntry>')
    mapped = '<ssd:ParameterMapping source="m.ssm"/>' if external else f"<ssd:ParameterMapping>{entries}</ssd:ParameterMapping>"
    system = read(one(bindings=binding(values, mapped)), **({"m.ssm": entries} if external else {}))
    assert system.components["a"].parameters == {"k": pytest.approx(3.0)}


def test_parameter_set_inside_the_fmu(read, plant):
    with ZipFile(plant, "a") as fmu:
        fmu.writestr("resources/p.ssv", parameter_set('k=<ssv:Real value="2"/>'))
    bound = binding(source="resources/p.ssv", sourceBase="component")
    assert read(one(bindings=bound)).components["a"].parameters == {"k": 2.0}


def test_prefix_of_a_binding(read):
    body = binding(parameter_set('k=<ssv:Real value="2"/>'), prefix="a.") + f"<ssd:Elements>{component('a', 'plant')}</ssd:Elements>"
    assert read(structure(body)).components["a"].parameters == {"k": 2.0}


def test_an_input_may_have_a_value_instead_of_a_connection(read):
    system = read(one("u:input", binding(parameter_set('u=<ssv:Real value="1.5"/>'))))
    assert system.components["a"].parameters == {"u": 1.5}


# What is refused


def test_missing_fmu(read):
    text = message(read, one().replace("plant.fmu", "rover.fmu"))
    assert "SystemStructure.ssd, line 3: source = 'resources/rover.fmu' is missing from the package; add the file" in text


def test_missing_package(tmp_path):
    with pytest.raises(SspError, match=r"nothing\.ssp: no such file"):
        read_system(tmp_path / "nothing.ssp", tmp_path / "cache")


def test_unconnected_input(read):
    text = message(read, one("u:input"))
    assert "input a.u is not connected and has no parameter value; connect it or set a value" in text
    assert "input sub.b.u is not connected" in message(
        read, nested(link="a.y -> sub.in").replace(connections("a.y -> sub.in", "sub.out -> a.u"), connections("sub.out -> a.u"))
    )


def array(name, kind, n):
    return " ".join(f"{name}[{i + 1}]:{kind}" for i in range(n))


def test_whole_arrays_are_connected(read):
    pairs = [f"a.w[{i}] -> b.v[{i}]" for i in (1, 2, 3)]
    assert len(read(two(*pairs, a=array("w", "output", 3), b=array("v", "input", 3))).connections) == 3


def test_array_connected_in_part(read):
    text = message(read, two("a.w[1] -> b.v[1]", a="w[1]:output", b="v[1]:input"))
    assert "b.v has 3 elements, of which v[2], v[3] get no value (size mismatch); connect all elements or set values" in text


def test_arrays_of_different_size(read):
    pairs = [f"a.wide[{i}] -> b.pair[{i}]" for i in (1, 2)]
    text = message(read, two(*pairs, a=array("wide", "output", 2), b=array("pair", "input", 2)))
    assert "a.wide has 3 elements, b.pair has 2 (size mismatch); connect arrays of one size" in text


def test_brackets_mean_nothing_in_a_flat_fmu(read, tmp_path):
    flat = write_fmu(tmp_path / "flat.fmu", PLANT.replace('"structured"', '"flat"'))
    assert read(two("a.w[1] -> b.v[1]", a="w[1]:output", b="v[1]:input"), {"plant": flat}).connections


def test_array_as_one_connector(read):
    assert "connector a.v: the FMU has no such variable; it is an array of 3, declare one connector an element" in message(
        read, one("v:input")
    )


def test_unit_mismatch(read):
    text = message(read, two("a.angle -> b.u", a="angle:output"))
    assert "a.angle to b.u: unit 'rad' (rad) to unit 'm' (m) is not the same quantity; correct the unit" in text


def test_unit_without_definition(read, tmp_path):
    vague = write_fmu(tmp_path / "vague.fmu", PLANT.replace('<Unit name="rad"><BaseUnit rad="1"/>', '<Unit name="rad">'))
    assert "'rad' has no base unit; define it" in message(read, two("a.angle -> b.u", a="angle:output"), {"plant": vague})
    units = '<ssd:Units><ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit></ssd:Units>'
    ssd = structure(f"<ssd:Elements>{component('a', 'plant', 'y:output:furlong')}</ssd:Elements>", units)
    assert "unit 'furlong' is not defined in SystemStructure.ssd; add it to its Units" in message(read, ssd)


def test_unknown_component_and_connector(read):
    assert "startElement = 'c' is no element of the system; correct the name" in message(read, two("c.y -> b.u"))
    assert "startConnector = 'yy' is no connector of a; did you mean 'y'?" in message(read, two("a.yy -> b.u"))
    assert "connector b.uu: the FMU has no such variable; did you mean 'u'?" in message(read, two("a.y -> b.uu", b="uu:input"))


def test_two_elements_of_one_name(read):
    elements = component("a", "plant") * 2
    assert "two elements are named 'a'; rename one" in message(read, structure(f"<ssd:Elements>{elements}</ssd:Elements>"))


def test_ring_of_system_connectors(read):
    ssd = nested().replace(connections("in -> b.u", "b.y -> out", "gain -> b.k"), connections("in -> out", "gain -> b.k"))
    ssd = ssd.replace(connections("a.y -> sub.in", "sub.out -> a.u"), connections("sub.out -> sub.in", "sub.out -> a.u"))
    assert "the connections of sub.out form a ring; remove one" in message(read, ssd)


def test_causality_mismatch(read):
    assert "connector a.u is output, in the FMU it is input; correct the kind" in message(read, one("u:output"))
    assert "a.u and b.u both take a value; connect an output to an input" in message(read, two("a.u -> b.u", a="u:input"))
    assert "a.y to b.k joins a signal and a parameter" in message(read, two("a.y -> b.k", b="k:parameter"))


def test_two_sources(read):
    text = message(read, two("a.y -> b.u", "a.w[1] -> b.u", a="y:output w[1]:output"))
    assert "b.u has two sources, a.y (line 6) and a.w[1]; remove one" in text


def test_wrong_type(read):
    assert "a.y to b.selected: Real to Enumeration; connect variables of one type" in message(
        read, two("a.y -> b.selected", b="selected:input")
    )
    assert "a.gear to b.selected: enumerations of different items (low to slow, fast)" in message(
        read, two("a.gear -> b.selected", a="gear:output", b="selected:input")
    )
    ssd = one("y:output").replace('kind="output">', 'kind="output"><ssc:Integer/>')
    assert "connector a.y is Integer, in the FMU it is Real; correct the type" in message(read, ssd)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ('kk=<ssv:Real value="1"/>', "parameter 'kk' does not exist in a; did you mean 'k'?"),
        ('y=<ssv:Real value="1"/>', "a.y is no parameter but output; remove its value"),
        ('k=<ssv:Real value="11"/>', "a.k = 11 m is outside [0, 10] m; use a value inside"),
        ('k=<ssv:Real value="NaN"/>', "a.k = nan m is outside [0, 10] m; use a value inside"),
        ('k=<ssv:Real value="one"/>', "a.k = 'one' is not a Real value; correct it"),
        ('count=<ssv:Integer value="3000000000"/>', "a.count = 3e+09 is outside"),
        ('k=<ssv:Boolean value="true"/>', "a.k is Real, its value 'true' is Boolean; state a Real value"),
        ('count=<ssv:Real value="3.5"/>', "a.count is Integer, its value '3.5' is Real; state a Integer value"),
        ('mode=<ssv:Enumeration value="fsat"/>', "a.mode = 'fsat' is not one of slow, fast; correct it"),
        ('mode=<ssv:Integer value="3"/>', "a.mode = 3 is no item; use one of slow, fast"),
        ('k=<ssv:Binary value="00"/>', "element Binary in Parameter is not supported; leave binary variables to the FMU"),
    ],
)
def test_parameter_that_does_not_fit(read, values, expected):
    assert expected in message(read, one(bindings=binding(parameter_set(values))))


def test_parameter_of_another_quantity(read):
    units = '<ssv:Units><ssc:Unit name="rad"><ssc:BaseUnit rad="1"/></ssc:Unit></ssv:Units>'
    text = message(read, one(bindings=binding(parameter_set('k=<ssv:Real value="1" unit="rad"/>', units=units))))
    assert "parameter value 1 unit 'rad' (rad) to unit 'm' (m) is not the same quantity" in text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("<ssd:SignalDictionaries/>", "line 3: element SignalDictionaries in System is not supported; connect the elements directly"),
        (
            connections("a.y -> b.u|<ssc:BooleanMappingTransformation/>"),
            "element BooleanMappingTransformation in Connection is not supported",
        ),
        (
            '<ssd:Elements><ssd:SignalDictionaryReference name="d" dictionary="d"/></ssd:Elements>',
            "element SignalDictionaryReference in Elements",
        ),
    ],
)
def test_unsupported_elements(read, text, expected):
    assert expected in message(read, structure(text))


def test_unsupported_components(read, tmp_path):
    assert "component 'a' of type 'application/x-ssp-package' is not supported" in message(read, one(type="application/x-ssp-package"))
    assert "asks for model exchange" in message(read, one(implementation="ModelExchange"))
    for description, expected in (
        (describe(version="1.0"), "plant.fmu (a): FMI version 1.0 is not supported; export it as FMI 2.0"),
        (describe(version="3.0"), "plant.fmu (a): FMI version 3.0 is not supported; export it as FMI 2.0"),
        (describe(kind="ModelExchange"), "plant.fmu (a): model exchange is not supported"),
        (describe(variable("x", "input", "<Complex/>")), "plant.fmu (a): invalid modelDescription.xml"),
    ):
        assert expected in message(read, one(), {"plant": write_fmu(tmp_path / "other.fmu", description)})
    assert "system structure variant Variant.ssd is not supported" in message(read, one(), **{"Variant.ssd": one()})
    assert "SSP version 2.0; only SSP 1.0 is supported" in message(read, structure("", version="2.0"))
