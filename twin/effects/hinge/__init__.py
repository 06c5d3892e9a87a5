"""Effects on a hinge and its motor."""
