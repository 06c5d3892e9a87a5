"""Papers' tables and figures beside ours, by criteria fixed before any value was known."""
