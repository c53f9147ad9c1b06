within ContactDynamics;
partial block ContactFMU "Interface of a contact FMU for one wheel"

  Modelica.Blocks.Interfaces.RealInput r_0[3](each final quantity = "Length", each final unit = "m")
    "Position of the wheel's centre, resolved in world: wheel[1].r_0 of the FMU"
    annotation (Placement(transformation(extent = {{-120, 70}, {-100, 90}})));
  Modelica.Blocks.Interfaces.RealInput T[3, 3](each final unit = "1")
    "Rotation from world to the wheel's frame: wheel[1].T of the FMU"
    annotation (Placement(transformation(extent = {{-120, 40}, {-100, 60}})));
  Modelica.Blocks.Interfaces.RealInput v_0[3](each final quantity = "Velocity", each final unit = "m/s")
    "Velocity of the wheel's centre, resolved in world: wheel[1].v_0 of the FMU"
    annotation (Placement(transformation(extent = {{-120, 10}, {-100, 30}})));
  Modelica.Blocks.Interfaces.RealInput w_0[3](each final quantity = "AngularVelocity", each final unit = "rad/s")
    "Angular velocity of the wheel, resolved in world: wheel[1].w_0 of the FMU"
    annotation (Placement(transformation(extent = {{-120, -20}, {-100, 0}})));

  Modelica.Blocks.Interfaces.RealOutput f_0[3](each final quantity = "Force", each final unit = "N")
    "Contact force on the wheel, resolved in world: wheel[1].f_0 of the FMU"
    annotation (Placement(transformation(extent = {{-100, -60}, {-120, -40}})));
  Modelica.Blocks.Interfaces.RealOutput t_0[3](each final quantity = "Torque", each final unit = "N.m")
    "Contact torque on the wheel about its centre, resolved in world: wheel[1].t_0 of the FMU"
    annotation (Placement(transformation(extent = {{-100, -90}, {-120, -70}})));

  annotation (
    Icon(coordinateSystem(extent = {{-100, -100}, {100, 100}}), graphics = {
      Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {0, 0, 127}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
      Text(extent = {{-80, 40}, {80, -40}}, textString = "contact", textColor = {0, 0, 127}),
      Text(extent = {{-150, 140}, {150, 105}}, textString = "%name", textColor = {0, 0, 255})}),
    Documentation(info = "<html>
<p>
Extend this block by the block that your tool makes of an FMU such as <code>cdl_bcm_w1</code>, and by equations between both, in the
names that the tool gives to the FMU's variables. The example shows where it goes.
</p>
</html>"));
end ContactFMU;
