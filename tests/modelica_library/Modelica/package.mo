within ;
package Modelica "The few classes of the Modelica Standard Library 4.0.0 that ContactDynamics needs, for its tests alone"
  package Units
    package SI
      type Length = Real(final quantity = "Length", final unit = "m");
      type Velocity = Real(final quantity = "Velocity", final unit = "m/s");
      type Force = Real(final quantity = "Force", final unit = "N");
      type Torque = Real(final quantity = "Torque", final unit = "N.m");
      type TranslationalSpringConstant = Real(final quantity = "TranslationalSpringConstant", final unit = "N/m");
      type TranslationalDampingConstant = Real(final quantity = "TranslationalDampingConstant", final unit = "N.s/m");
    end SI;
  end Units;

  package Blocks
    package Interfaces
      connector RealInput = input Real;
      connector RealOutput = output Real;
    end Interfaces;
  end Blocks;

  package Mechanics
    package MultiBody
      model World
        parameter Real n[3] = {0, 0, -1};
        parameter Real g = 9.81;
      end World;

      package Frames
        record Orientation
          Real T[3, 3];
          Real w[3];
        end Orientation;
      end Frames;

      package Interfaces
        connector Frame_a
          Modelica.Units.SI.Length r_0[3];
          Modelica.Mechanics.MultiBody.Frames.Orientation R;
          flow Modelica.Units.SI.Force f[3];
          flow Modelica.Units.SI.Torque t[3];
        end Frame_a;
      end Interfaces;

      package Parts
        model Body "Rigid body with its centre of mass in its frame and no products of inertia; its rotation is integrated as a matrix"
          Modelica.Mechanics.MultiBody.Interfaces.Frame_a frame_a;
          parameter Real m;
          parameter Real r_CM[3];
          parameter Real I_11;
          parameter Real I_22;
          parameter Real I_33;
          parameter Boolean angles_fixed;
          parameter Boolean w_0_fixed;
          parameter Real w_0_start[3];
          Real r_0[3];
          Real v_0[3];
        protected
          outer Modelica.Mechanics.MultiBody.World world;
          Real T[3, 3](start = [1, 0, 0; 0, 1, 0; 0, 0, 1], each fixed = true);
          Real w[3](start = w_0_start, each fixed = true);
        equation
          frame_a.r_0 = r_0;
          frame_a.R.T = T;
          frame_a.R.w = w;
          der(r_0) = v_0;
          m*der(v_0) = transpose(T)*frame_a.f + m*world.g*world.n;
          der(T) = -[0, -w[3], w[2]; w[3], 0, -w[1]; -w[2], w[1], 0]*T;
          I_11*der(w[1]) + (I_33 - I_22)*w[2]*w[3] = frame_a.t[1];
          I_22*der(w[2]) + (I_11 - I_33)*w[3]*w[1] = frame_a.t[2];
          I_33*der(w[3]) + (I_22 - I_11)*w[1]*w[2] = frame_a.t[3];
        end Body;
      end Parts;
    end MultiBody;
  end Mechanics;

  annotation (version = "4.0.0");
end Modelica;
