"""Effects on sliding masses."""
