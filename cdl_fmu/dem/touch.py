"""How a sphere touches a tool, as rows: the form in which ``touch_wheel`` and ``touch_mesh`` answer."""

from __future__ import annotations

#: Rows that a sphere can have on one tool.
MOST = 4

#: Columns of a row: distance of the sphere's centre from the tool's surface [m], < 0 within the tool; and the unit normal (3) there, out of
#: the tool, thus towards a centre outside.
DISTANCE, NORMAL = 0, 1
TOUCH = 4
