"""A run on its way into Rerun: rows collected, sent in chunks off the hot path, and dressed.

Nothing is re-exported: the writer's process must come up without importing the machine's side.
"""
