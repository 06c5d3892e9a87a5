"""Effects on reaction wheels."""
