within ContactDynamics;
package Examples "A wheel of a MultiBody model on a contact block"
  annotation (Documentation(info = "<html>
<p>
<a href=\"modelica://ContactDynamics.Examples.WheelOnGround\">WheelOnGround</a> simulates as it is, on springs in place of an FMU.
</p>
</html>"));
end Examples;
