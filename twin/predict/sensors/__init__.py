"""What sensors should show of a path, and how their faults change that."""
