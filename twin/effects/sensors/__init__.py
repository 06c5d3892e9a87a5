"""Effects on what a sensor shows."""
