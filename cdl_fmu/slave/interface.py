"""The contact interface (the unified interface of the Contact Dynamics Library): the records that every tier shares.

World frame: z up, on a slope normal to it, so that x and y lie in the slope and gravity is what tilts. Suffix ``_0`` = resolved in the
world frame. ``T`` is the rotation from world to wheel, as ``R.T`` in
Modelica.Mechanics.MultiBody.Frames: ``v_wheel = T @ v_0``. The wheel frame spins with the wheel; its y axis is the axle, to the left.
"""

from __future__ import annotations

import math

from .records import Array, Real, Record

_BIG = 1e6  # [m], [m/s], [rad/s]: beyond this a value is not a rover's
#: Least depth that the yield pressure of a patch is of, in widths of the wheel: there a loose mound shows.
TESTED = 0.3
_IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


#: Parameters that every part of a system shares.
ENVIRONMENT = Record(
    gravity=Real(
        9.81,
        "m/s2",
        "Acceleration of gravity, along -z on level ground",
        min=0.0,
        max=100.0,
        names={"Earth": 9.81, "Mars": 3.71, "Moon": 1.62},
    ),
    slope=Real(
        0.0, "rad", "Slope of the ground, in which the world's x and y axes lie; gravity is tilted against z by it", min=0.0, max=1.5
    ),
    uphill=Real(
        0.0,
        "rad",
        "Direction of the slope's steepest ascent from the x axis, positive to the left; used where slope is not 0",
        min=-2.0 * math.pi,
        max=2.0 * math.pi,
    ),
)


def _pose_and_twist(of: str, T_start=_IDENTITY) -> Record:
    return Record(
        r_0=Real(0.0, "m", f"Position of {of}, resolved in world", (3,), -_BIG, _BIG),
        T=Real(T_start, "1", f"Rotation from world to the frame of {of} (R.T of MultiBody)", (3, 3), -1.001, 1.001),
        v_0=Real(0.0, "m/s", f"Velocity of {of}, resolved in world", (3,), -_BIG, _BIG),
        w_0=Real(0.0, "rad/s", f"Angular velocity of {of}, resolved in world", (3,), -_BIG, _BIG),
    )


def wheel_pose(n: int) -> Record:
    """Pose and twist of ``n`` wheels, about the wheel's centre."""
    return Record(wheel=Array(n, _pose_and_twist("the wheel's centre")))


def wheel_active(n: int) -> Record:
    """Weight of the contact on each wheel, to switch tiers at run time."""
    return Record(wheel=Array(n, Record(active=Real(1.0, "1", "Weight of this contact's wrench, 0 (off) to 1 (on)", min=0.0, max=1.0))))


def wheel_wrench(n: int) -> Record:
    """Wrench on each of ``n`` wheels, about the wheel's centre."""
    return Record(
        wheel=Array(
            n,
            Record(
                f_0=Real(0.0, "N", "Contact force on the wheel, resolved in world", (3,)),
                t_0=Real(0.0, "N.m", "Contact torque on the wheel about its centre, resolved in world", (3,)),
            ),
        )
    )


def contact_jacobian(n: int) -> Record:
    """Interface Jacobian of each contact: near the anchor the force at ``point`` is F - K (x - x_a) - D (v - v_a), in ``axes``.

    K and D are diagonal and oppose motion; friction gives the secant, the normal force the tangent (coupling of stiff contacts at 1 ms).
    """
    return Record(
        contact=Array(
            n,
            Record(
                point_0=Real(0.0, "m", "Contact point, resolved in world", (3,)),
                axes=Real(_IDENTITY, "1", "Rows: longitudinal, lateral and normal axis of the contact, resolved in world", (3, 3)),
                F=Real(0.0, "N", "Contact force on the wheel at the anchor, resolved in axes", (3,)),
                K=Real(0.0, "N/m", "Stiffness along each axis, opposing motion", (3,), min=0.0),
                D=Real(0.0, "N.s/m", "Damping along each axis, opposing motion", (3,), min=0.0),
                in_contact=Real(0.0, "1", "1 while the wheel touches the ground, else 0", min=0.0, max=1.0),
                anchor=_pose_and_twist("the wheel's centre for which F was evaluated; T = 0: no anchor is sent", T_start=0.0),
            ),
        )
    )


def diagnostics(n: int) -> Record:
    """What an engineer plots of each wheel; forces in the heading frame (z global, x along the wheel's heading)."""
    return Record(
        diagnostics=Array(
            n,
            Record(
                sinkage=Real(0.0, "m", "Sinkage of the wheel's lowest rim point below undeformed ground"),
                slip=Real(0.0, "1", "Slip: 1 - v_x/(r omega) driving, r omega/v_x - 1 in skid"),
                slip_angle=Real(0.0, "rad", "Angle from the wheel's heading to its velocity, positive to the left"),
                theta_entry=Real(0.0, "rad", "Entry angle theta_1 from nadir, positive forward"),
                theta_exit=Real(0.0, "rad", "Exit angle theta_0 from nadir, positive forward"),
                drawbar_pull=Real(0.0, "N", "Longitudinal contact force in the heading frame"),
                lateral_force=Real(0.0, "N", "Lateral contact force in the heading frame, positive to the left"),
                normal_load=Real(0.0, "N", "Contact force along z"),
                drive_torque=Real(0.0, "N.m", "Torque that the drive has to exert against the contact, about the axle"),
            ),
        )
    )


def patch_in(n: int, compaction: bool = False, nx: int = 13, ny: int = 9) -> Record:
    """Height patch around each of ``n`` wheels: nodes at multiples of the spacing in world axes.

    With ``compaction`` it carries what pressed the soil before, too.
    """
    nodes = Record(
        origin=Real(0.0, "m", "World x and y of node [1,1]", (2,), -_BIG, _BIG),
        spacing=Real(0.0, "m", "Distance of neighbouring nodes; 0 = no patch yet", min=0.0, max=1.0),
        z=Real(0.0, "m", "Height of the soil surface at node [x,y]", (nx, ny), -_BIG, _BIG),
    )
    if compaction:
        nodes |= Record(
            sinkage=Real(0.0, "m", "Plastic sinkage that is left of what pressed the soil at node [x,y]", (nx, ny), 0.0, _BIG),
            yield_pressure=Real(
                0.0,
                "Pa",
                f"Pressure at which the soil at node [x,y] yields at the depth to which it was pressed, at least {TESTED:g} wheel widths",
                (nx, ny),
                0.0,
                1e12,
            ),
        )
    return Record(patch=Array(n, nodes))


def patch_out(n: int, compaction: bool = False) -> Record:
    """What sends patches: the patches, and how often each has changed."""
    meaning = "Number of times that the patch has changed: who has read it need not read it again while this stays"
    return patch_in(n, compaction) | Record(patch=Array(n, Record(revision=Real(0.0, "1", meaning))))


def trailing_in(n: int) -> Record:
    """Position of each of ``n`` wheels of other tiers, which want the heights around them."""
    meaning = "Position of the wheel's centre, resolved in world; (0, 0, 0): none yet, and no patch"
    return Record(trailing=Array(n, Record(r_0=Real(0.0, "m", meaning, (3,), -_BIG, _BIG))))


def body_pose(n: int) -> Record:
    """Pose and twist of ``n`` bodies other than wheels, about the origin of the body's mesh."""
    return Record(body=Array(n, _pose_and_twist("the body")))


def body_wrench(n: int) -> Record:
    """Wrench on each of ``n`` bodies, about the origin of the body's mesh."""
    return Record(
        body=Array(
            n,
            Record(
                f_0=Real(0.0, "N", "Contact force on the body, resolved in world", (3,)),
                t_0=Real(0.0, "N.m", "Contact torque on the body about its origin, resolved in world", (3,)),
            ),
        )
    )


def body_support(n: int) -> Record:
    """Interface Jacobian of each body: near the anchor its wrench is f_0 - K (x - x_a) - D (v - v_a) and t - K_r phi - D_r (w - w_a).

    Here x and v are those of the body's material at ``point_0``, t is the torque about it, phi the rotation since the anchor, and all is
    resolved in world. K, D, K_r and D_r are diagonal, oppose motion and are nowhere softer than the ground: friction gives the secant,
    pressure the tangent, and couplings between axes are added to both.
    """
    return Record(
        support=Array(
            n,
            Record(
                point_0=Real(0.0, "m", "Point at which the ground resists translation, resolved in world", (3,)),
                K=Real(0.0, "N/m", "Stiffness along each axis of the world, opposing motion", (3,), min=0.0),
                D=Real(0.0, "N.s/m", "Damping along each axis of the world, opposing motion", (3,), min=0.0),
                K_r=Real(0.0, "N.m/rad", "Stiffness of rotation about each axis of the world, opposing motion", (3,), min=0.0),
                D_r=Real(0.0, "N.m.s/rad", "Damping of rotation about each axis of the world, opposing motion", (3,), min=0.0),
                in_contact=Real(0.0, "1", "1 while the body touches the ground, else 0", min=0.0, max=1.0),
                anchor=_pose_and_twist("the body for which the wrench was evaluated; T = 0: no anchor is sent", T_start=0.0),
            ),
        )
    )


def n_pairs(n_wheels: int, n_bodies: int) -> int:
    """Number of contacts between pairs of tools that a hard contact slave tells."""
    return 4 * (n_wheels + n_bodies)


def pair_contacts(n_wheels: int, n_bodies: int) -> Record:
    """Wrenches on wheels and bodies from contacts with each other, and the interface Jacobian of these contacts, one for each pair.

    Tools are counted from 1, wheels first. Near the anchors the force on tool ``on`` at ``point_0``, and its opposite on tool ``against``,
    is F - K (x - x_a) - D (v - v_a) in ``axes``, x and v being those of the first against the second. What the pairs do not explain of
    the wrenches acts as it is.
    """
    most = float(n_wheels + n_bodies)
    pair = Record(
        on=Real(0.0, "1", "Tool on which the force acts; 0 = no contact", (), 0.0, most),
        against=Real(0.0, "1", "Tool on which its opposite acts; 0 = the ground, or what does not move", (), 0.0, most),
        point_0=Real(0.0, "m", "Contact point, resolved in world", (3,)),
        axes=Real(_IDENTITY, "1", "Rows: two tangents and the normal towards tool ``on``, resolved in world", (3, 3)),
        F=Real(0.0, "N", "Contact force at the anchor, resolved in axes", (3,)),
        K=Real(0.0, "N/m", "Stiffness along each axis, opposing motion", (3,), min=0.0),
        D=Real(0.0, "N.s/m", "Damping along each axis, opposing motion", (3,), min=0.0),
    )
    anchor = _pose_and_twist("the tool, wheels first, for which the forces hold; T = 0: no anchor is sent", T_start=0.0)
    return (
        wheel_wrench(n_wheels)
        | body_wrench(n_bodies)
        | Record(pair=Array(n_pairs(n_wheels, n_bodies), pair), anchor=Array(n_wheels + n_bodies, anchor))
    )


def triangle(n: int) -> int:
    """Number of elements of a symmetric [n, n] matrix's lower triangle."""
    return n * (n + 1) // 2


def tool_twists(n_wheels: int, n_bodies: int) -> Record:
    """What rigid contacts need of a multibody system, wheels first, then bodies: its inverse inertia at them, and where they are going."""
    n, frames = n_wheels + n_bodies, "velocity, then angular velocity of each tool, resolved in world"
    return Record(
        inverse_inertia=Real(
            0.0,
            "1",  # of different units: 1/kg, 1/(kg.m), 1/(kg.m2)
            f"Twist per impulse wrench about the tools' origins, of the step's own matrix J (M - H dF/dv)^-1 J' [SI], symmetric: its lower "
            f"triangle row by row; {frames}",
            (triangle(6 * n),),
        ),
        free_twist=Real(
            0.0,
            "1",
            f"Twist [m/s, rad/s] at the end of the next step without rigid impulses; {frames}",
            (6 * n,),
        ),
    )
