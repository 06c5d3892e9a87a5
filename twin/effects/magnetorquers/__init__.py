"""Effects on magnetorquers."""
