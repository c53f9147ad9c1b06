within ContactDynamics.Examples;
block SpringGround "Springs and dampers below a wheel, in place of a contact FMU"
  extends ContactDynamics.ContactFMU;

  parameter Modelica.Units.SI.Length r_w(min = 0) = 0.125 "Radius of the wheel";
  parameter Modelica.Units.SI.TranslationalSpringConstant k(min = 0) = 2e4 "Stiffness of the ground";
  parameter Modelica.Units.SI.TranslationalDampingConstant d(min = 0) = 400 "Damping of the ground, along its normal and in the plane";

protected
  Modelica.Units.SI.Length depth "Depth of the wheel's lowest point below the ground, z = 0";
  Modelica.Units.SI.Velocity v_rim[3] "Velocity of the wheel's material at its lowest point, resolved in world";

equation
  depth = r_w - r_0[3];
  v_rim = v_0 + cross(w_0, {0, 0, -r_w});
  f_0 = if depth > 0 then {-d*v_rim[1], -d*v_rim[2], k*depth - d*v_rim[3]} else zeros(3);
  t_0 = cross({0, 0, -r_w}, f_0);

  annotation (Documentation(info = "<html>
<p>
Ground at z = 0 with viscous friction and no limit of it: for a first test of connections and signs, not of a rover.
</p>
</html>"));
end SpringGround;
