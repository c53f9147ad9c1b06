within ;
package ContactDynamics "Contact FMUs of the Contact Dynamics Library on frames of Modelica's MultiBody library"
  annotation (
    version = "0.1.0",
    uses(Modelica(version = "4.0.0")),
    Documentation(info = "<html>
<p>
A contact FMU gets the pose and the twist of a wheel, resolved in the world frame, and gives the wrench of the ground on it.
<a href=\"modelica://ContactDynamics.WheelFrame\">WheelFrame</a> puts both on a frame of a MultiBody model,
<a href=\"modelica://ContactDynamics.ContactFMU\">ContactFMU</a> is the interface of a contact FMU for one wheel, and
<a href=\"modelica://ContactDynamics.Examples.WheelOnGround\">Examples.WheelOnGround</a> connects them.
</p>
<p>
The world frame has z up: set <code>n = {0, 0, -1}</code> in <code>Modelica.Mechanics.MultiBody.World</code>.
The y axis of the wheel's frame is its axle, to the left; the frame spins with the wheel.
</p>
</html>"));
end ContactDynamics;
