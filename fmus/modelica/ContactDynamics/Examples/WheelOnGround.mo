within ContactDynamics.Examples;
model WheelOnGround "A free wheel of 27 kg that is put down rolling"

  inner Modelica.Mechanics.MultiBody.World world(n = {0, 0, -1}) "World, z up"
    annotation (Placement(transformation(extent = {{-80, 60}, {-60, 80}})));

  Modelica.Mechanics.MultiBody.Parts.Body body(
    m = 27,
    r_CM = {0, 0, 0},
    I_11 = 0.14,
    I_22 = 0.21,
    I_33 = 0.14,
    r_0(each fixed = true, start = {0, 0, 0.125}),
    v_0(each fixed = true, start = {0.1, 0, 0}),
    angles_fixed = true,
    w_0_fixed = true,
    w_0_start = {0, 0.8, 0}) "Wheel with its load"
    annotation (Placement(transformation(extent = {{-60, -10}, {-80, 10}})));

  ContactDynamics.WheelFrame wheelFrame "Pose and twist of the wheel, and the wrench on it"
    annotation (Placement(transformation(extent = {{-20, -10}, {0, 10}})));

  // The block of an imported contact FMU goes here: redeclare contact as a block that extends ContactDynamics.ContactFMU.
  replaceable SpringGround contact "Contact of the wheel with the ground"
    constrainedby ContactDynamics.ContactFMU
    annotation (Placement(transformation(extent = {{40, -10}, {60, 10}})), choicesAllMatching = true);

equation
  connect(body.frame_a, wheelFrame.frame_a) annotation (Line(points = {{-60, 0}, {-20, 0}}, color = {95, 95, 95}));
  connect(wheelFrame.r_0, contact.r_0) annotation (Line(points = {{1, 8}, {39, 8}}, color = {0, 0, 127}));
  connect(wheelFrame.T, contact.T) annotation (Line(points = {{1, 5}, {39, 5}}, color = {0, 0, 127}));
  connect(wheelFrame.v_0, contact.v_0) annotation (Line(points = {{1, 2}, {39, 2}}, color = {0, 0, 127}));
  connect(wheelFrame.w_0, contact.w_0) annotation (Line(points = {{1, -1}, {39, -1}}, color = {0, 0, 127}));
  connect(contact.f_0, wheelFrame.f_0) annotation (Line(points = {{39, -5}, {1, -5}}, color = {0, 0, 127}));
  connect(contact.t_0, wheelFrame.t_0) annotation (Line(points = {{39, -8}, {1, -8}}, color = {0, 0, 127}));

  annotation (
    experiment(StopTime = 1, Interval = 0.001),
    Documentation(info = "<html>
<p>
A block around an imported FMU, where the tool has named its variables as they are:
</p>
<pre>
block ImportedContact
  extends ContactDynamics.ContactFMU;
  cdl_bcm_w1 fmu \"Block that the tool made of cdl_bcm_w1.fmu\";
equation
  fmu.wheel[1].r_0 = r_0;
  fmu.wheel[1].T = T;
  fmu.wheel[1].v_0 = v_0;
  fmu.wheel[1].w_0 = w_0;
  fmu.wheel[1].active = 1;
  f_0 = fmu.wheel[1].f_0;
  t_0 = fmu.wheel[1].t_0;
end ImportedContact;
</pre>
<p>
and in a model that extends this one: <code>redeclare ImportedContact contact</code>.
</p>
</html>"));
end WheelOnGround;
