"""Effects on thrusters and what feeds them."""
