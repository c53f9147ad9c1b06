"""Surface meshes of wheels, rocks and grounds, and where they touch: one file for each step from a file to contact candidates."""
