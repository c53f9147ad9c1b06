"""RBC: rigid contact by impulses, a linear complementarity problem a step."""
