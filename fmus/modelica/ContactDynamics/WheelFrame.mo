within ContactDynamics;
model WheelFrame "Pose and twist of a frame for a contact FMU, and the FMU's wrench on it"

  Modelica.Mechanics.MultiBody.Interfaces.Frame_a frame_a
    "Frame of the wheel: origin in the wheel's centre, y axis along the axle, to the left; spins with the wheel"
    annotation (Placement(transformation(extent = {{-116, -16}, {-84, 16}})));

  Modelica.Blocks.Interfaces.RealOutput r_0[3](each final quantity = "Length", each final unit = "m")
    "Position of the wheel's centre, resolved in world"
    annotation (Placement(transformation(extent = {{100, 70}, {120, 90}})));
  Modelica.Blocks.Interfaces.RealOutput T[3, 3](each final unit = "1")
    "Rotation from world to the wheel's frame"
    annotation (Placement(transformation(extent = {{100, 40}, {120, 60}})));
  Modelica.Blocks.Interfaces.RealOutput v_0[3](each final quantity = "Velocity", each final unit = "m/s")
    "Velocity of the wheel's centre, resolved in world"
    annotation (Placement(transformation(extent = {{100, 10}, {120, 30}})));
  Modelica.Blocks.Interfaces.RealOutput w_0[3](each final quantity = "AngularVelocity", each final unit = "rad/s")
    "Angular velocity of the wheel, resolved in world"
    annotation (Placement(transformation(extent = {{100, -20}, {120, 0}})));

  Modelica.Blocks.Interfaces.RealInput f_0[3](each final quantity = "Force", each final unit = "N")
    "Contact force on the wheel, resolved in world"
    annotation (Placement(transformation(extent = {{120, -60}, {100, -40}})));
  Modelica.Blocks.Interfaces.RealInput t_0[3](each final quantity = "Torque", each final unit = "N.m")
    "Contact torque on the wheel about its centre, resolved in world"
    annotation (Placement(transformation(extent = {{120, -90}, {100, -70}})));

equation
  r_0 = frame_a.r_0;
  T = frame_a.R.T;
  v_0 = der(frame_a.r_0);
  // R.w is resolved in the frame itself, w_0 in the world frame.
  w_0 = transpose(frame_a.R.T)*frame_a.R.w;
  // A cut force is positive where it acts on this component and is resolved in the frame. What acts on the wheel is its reaction, so the
  // sign changes, as in Modelica.Mechanics.MultiBody.Forces.WorldForceAndTorque.
  frame_a.f = -frame_a.R.T*f_0;
  frame_a.t = -frame_a.R.T*t_0;

  annotation (
    Icon(coordinateSystem(extent = {{-100, -100}, {100, 100}}), graphics = {
      Rectangle(extent = {{-100, 100}, {100, -100}}, lineColor = {95, 95, 95}, fillColor = {255, 255, 255}, fillPattern = FillPattern.Solid),
      Ellipse(extent = {{-60, 60}, {60, -60}}, lineColor = {95, 95, 95}),
      Line(points = {{-80, -60}, {80, -60}}, color = {95, 95, 95}),
      Text(extent = {{-150, 140}, {150, 105}}, textString = "%name", textColor = {0, 0, 255})}),
    Documentation(info = "<html>
<p>
Connect <code>frame_a</code> to the frame of a wheel's body that spins, the outputs to the inputs <code>wheel[i].r_0</code>, <code>T</code>,
<code>v_0</code> and <code>w_0</code> of a contact FMU, and its outputs <code>wheel[i].f_0</code> and <code>t_0</code> to the inputs.
Where several FMUs act on a wheel, each has a <code>WheelFrame</code> of its own on the same frame: the wrenches add up.
</p>
</html>"));
end WheelFrame;
