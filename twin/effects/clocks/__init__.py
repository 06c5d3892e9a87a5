"""Effects on when a sensor shows it."""
